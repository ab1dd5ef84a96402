"""Sessions. A browser signs in with a one-time token, then uses a cookie; a program sends a bearer token."""

import hashlib
import hmac
import itertools
import secrets
import threading
import time
from dataclasses import dataclass, field, replace
from typing import Any

from console.address import Address
from console.refused import Refused
from console.session_file import KeptSession, SessionFile
from rtstack.access.tokens import Scope, Tokens
from rtstack.live.audit import AuditTrail

_SESSION_S = 12 * 3600.0  # a shift
_MAX_SESSIONS = 64  # of browsers
INVITATION_S = 600.0
_MAX_INVITATIONS = 32
PAIRING_S = 120.0
_now_s = time.monotonic
CODE_DIGITS, MAX_GUESSES = 6, 5  # guesses of an address before it has to wait
_ALL_GUESSES = 200  # of all addresses together, at a million: one in 5,000 is right
_WAIT_S, _LONGEST_S = 15.0, 60.0  # after that many, and at most
_MAX_NOTED, _NOTED_S = 20, 60.0  # lines about refusals, within so long


@dataclass(frozen=True, slots=True)
class UserSession:
    """A signed-in browser or program. No two sessions have the same name at the same time.

    `key`: a browser's cookie, of a program a word that never leaves this process; `csrf`: what every change that a
    browser asks for has to repeat; `operator`: what it calls itself; `token`: id of a program's token; `panel`: all
    that it may ask for, None for everything; `feed`: part of the live feed's address, good for watching; `stop`: a
    browser's second cookie, which outlives the session, for STOP.
    """

    key: str
    csrf: str
    ends_s: float
    operator: str
    scope: Scope
    token: str | None = None
    panel: str | None = None
    feed: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    stop: str = field(default_factory=lambda: secrets.token_urlsafe(32))


@dataclass(slots=True)
class _Code:
    code: str
    scope: Scope
    ends_s: float
    guesses: dict[str, tuple[int, float]] = field(default_factory=dict)  # by address: wrong ones, and no other before


class SignIn:
    """The one-time tokens and the sessions. `cookie`, `stop_cookie`: names with the port, which cookies do not know."""

    def __init__(self, address: Address, tokens: Tokens, audit: AuditTrail, file: SessionFile) -> None:
        self.address = address
        self.cookie = f"rtstack-{address.port}"
        self.stop_cookie = f"{self.cookie}-stop"
        self.tokens = tokens
        self._audit = audit
        self._lock = threading.Lock()
        self._token = secrets.token_urlsafe(24)  # the first one-time token
        self._open: dict[str, tuple[Scope, float]] = {self._token: (Scope.OPERATE, float("inf"))}
        self._sessions: dict[str, UserSession] = {}
        self._stoppers: dict[str, UserSession] = {}  # by their second cookie
        self._programs: dict[str, str] = {}  # token's id -> session's key
        self._used_s: dict[str, float] = {}  # token's id -> Unix time, s
        self._file, self._kept = file, file.load()  # by digest: browsers of an earlier process, not seen since
        self._redeemed = 0
        self._code: _Code | None = None
        self._noted: dict[tuple[str, str], float] = {}  # refusals in the audit trail, and when

    @property
    def token(self) -> str | None:
        """The first one-time token, None once it was used."""
        return self._token if self._token in self._open else None

    def watching(self, feed: str) -> UserSession | None:
        """Return the session that was told this word of the live feed's address, None where it has ended."""
        with self._lock:
            key = next((session.key for session in self._sessions.values() if _same(feed, session.feed)), None)
        return self.session(key)

    def invite(self, scope: Scope) -> str:
        """Return a further one-time token, which lasts for INVITATION_S; the oldest ones make room."""
        token = secrets.token_urlsafe(24)
        with self._lock:
            self._drop_old_invitations()
            _make_room(self._open, [other for other in self._open if other != self._token], _MAX_INVITATIONS)
            self._open[token] = scope, _now_s() + INVITATION_S
        return token

    def pair(self, scope: Scope) -> str:
        """Return a code that a person types into another browser, within PAIRING_S; an older one is worth nothing."""
        code = f"{secrets.randbelow(10**CODE_DIGITS):0{CODE_DIGITS}d}"
        with self._lock:
            self._code = _Code(code, scope, _now_s() + PAIRING_S)
        return code

    def redeem_code(self, code: str, instead_of: UserSession | None = None, address: str = "") -> UserSession | None:
        """Exchange a code for a browser's session, as `redeem` a token.

        address: the client's. After MAX_GUESSES wrong codes it has to wait, twice as long after each further one.
        """
        with self._lock:
            known, now_s = self._code, _now_s()
            if known is None or known.ends_s < now_s:
                return None
            wrong, locked_s = known.guesses.get(address, (0, 0.0))
            if locked_s > now_s:
                return None
            if not _same(code.replace(" ", ""), known.code):
                wait_s = 0.0 if wrong + 1 < MAX_GUESSES else min(_LONGEST_S, _WAIT_S * 2.0 ** (wrong + 1 - MAX_GUESSES))
                known.guesses[address] = wrong + 1, now_s + wait_s
                if sum(count for count, _ in known.guesses.values()) >= _ALL_GUESSES:
                    self._code = None
                return None
            self._code = None
            session = self._begin(known.scope, instead_of)
        text = f"{session.operator} signed in in a browser by a code: {session.scope}"
        self._audit.note("sign in", session.operator, text)
        return session

    def waits_s(self, address: str) -> float:
        """Return how long an address has to wait before its next code counts, s."""
        with self._lock:
            return 0.0 if self._code is None else max(0.0, self._code.guesses.get(address, (0, 0.0))[1] - _now_s())

    def refused(self, what: str, address: str) -> None:
        """Note in the audit trail what an address brought in vain, once in _NOTED_S for each."""
        with self._lock:
            now_s = _now_s()
            self._noted = {key: s for key, s in self._noted.items() if now_s - s < _NOTED_S}
            if (what, address) in self._noted or len(self._noted) >= _MAX_NOTED:
                return
            self._noted[what, address] = now_s
        self._audit.note("refused", None, f"{what} from {address} was refused")

    def redeem(self, token: str, instead_of: UserSession | None = None) -> UserSession | None:
        """Exchange a one-time token for a browser's session, None for a wrong, old or used one; `instead_of` ends."""
        with self._lock:
            known = self._offered(token)
            if known is None:
                return None
            scope, _ = self._open.pop(known)
            session = self._begin(scope, instead_of)
        self._audit.note("sign in", session.operator, f"{session.operator} signed in in a browser: {scope}")
        return session

    def is_open(self, token: str) -> bool:
        """Whether a one-time token would sign a browser in."""
        with self._lock:
            return self._offered(token) is not None

    def program(self, word: str) -> UserSession | None:
        """Return the session of a bearer token, None where it is none of ours. Waits for no disk to write."""
        token = self.tokens.match(word)
        if token is None:
            return None
        with self._lock:
            self._used_s[token.id] = time.time()
            session = self._sessions.get(self._programs.get(token.id, ""))
            if session is None:
                key, name = secrets.token_urlsafe(32), self._free_name(token.name)
                session = UserSession(key, "", float("inf"), name, token.scope, token.id, token.panel)
                self._sessions[key], self._programs[token.id] = session, key
            return session

    def stopping_program(self, word: str) -> UserSession | None:
        """Return as whom a program may still stop while the file of tokens is not there; see Tokens.may_stop."""
        token = self.tokens.may_stop(word)
        return None if token is None else UserSession("", "", float("inf"), token.name, Scope.VIEW, token.id)

    def used_s(self, token_id: str) -> float | None:
        """Return when a program last brought this token, Unix time in s; None where not since this process began."""
        return self._used_s.get(token_id)

    def session(self, key: str | None) -> UserSession | None:
        """Return a session as it is now, by its key; None where it has ended, or its token was revoked."""
        if not key:
            return None
        with self._lock:
            session = self._sessions.get(key)
            if session is not None and not self._lasts(session):
                self._forget(session)
                return None
            return session

    def reopened(self, token: str, session: UserSession | None) -> bool:
        """Spend the first one-time token in a browser whose operator is signed in already; return whether it was."""
        with self._lock:
            again = session is not None and session.scope is Scope.OPERATE and self._offered(token) == self._token
            if again:
                del self._open[self._token]
            return again

    def browser(self, cookie: str | None) -> UserSession | None:
        """Return the session of a cookie; no program's can be reached this way."""
        with self._lock:
            kept = self._kept.pop(_digest(cookie or ""), None)
            if kept is not None and cookie:
                ends_s = kept.ends_s - time.time() + _now_s()
                self._add(_browser(cookie, ends_s, self._free_name(kept.operator), kept.scope))
        session = self.session(cookie)
        return session if session is not None and session.token is None else None

    def stopper(self, cookie: str | None) -> UserSession | None:
        """Return as whom a browser was signed in last, by its second cookie, for STOP alone; None for never."""
        with self._lock:
            return self._stoppers.get(cookie or "")

    def end(self, session: UserSession) -> None:
        """Sign a browser out: its cookie is worth nothing any more."""
        with self._lock:
            self._forget(session)
        self._audit.note("sign out", session.operator, f"{session.operator} signed out")

    def rename(self, session: UserSession, operator: str) -> UserSession:
        """Return the session under the name that it gives itself. Raises Refused while another session has it."""
        with self._lock:
            if self._has(operator, but=session.key):
                raise Refused(409, f"another session calls itself {operator}; choose another name")
            renamed = replace(session, operator=operator)
            if session.key in self._sessions:
                self._sessions[session.key] = renamed
            if session.stop in self._stoppers:
                self._stoppers[session.stop] = renamed
            self._save()
            return renamed

    def _begin(self, scope: Scope, instead_of: UserSession | None) -> UserSession:
        self._redeemed += 1
        name = self._free_name(f"{'operator' if scope is Scope.OPERATE else 'viewer'} {self._redeemed}")
        session = _browser(secrets.token_urlsafe(32), _now_s() + _SESSION_S, name, scope)
        if instead_of is not None:
            self._forget(instead_of)
        self._add(session)
        self._save()
        return session

    def _add(self, session: UserSession) -> None:
        browsers = [key for key, other in self._sessions.items() if other.token is None]
        _make_room(self._sessions, browsers, _MAX_SESSIONS)
        _make_room(self._stoppers, list(self._stoppers), _MAX_SESSIONS)
        self._sessions[session.key] = self._stoppers[session.stop] = session

    def _save(self) -> None:
        unix_s = time.time() - _now_s()
        browsers = [
            KeptSession(_digest(one.key), one.operator, one.scope, one.ends_s + unix_s)
            for one in self._sessions.values() if one.token is None
        ]  # fmt: skip
        self._file.save([*self._kept.values(), *browsers][-_MAX_SESSIONS:])

    def _lasts(self, session: UserSession) -> bool:
        return session.ends_s >= _now_s() and (session.token is None or self.tokens.get(session.token) is not None)

    def _forget(self, session: UserSession) -> None:
        self._sessions.pop(session.key, None)
        if session.token is not None:
            self._programs.pop(session.token, None)
        else:
            self._save()

    def _offered(self, token: str) -> str | None:
        self._drop_old_invitations()
        return next((own for own in self._open if _same(token, own)), None)

    def _drop_old_invitations(self) -> None:
        now_s = _now_s()
        self._open = {token: (scope, ends_s) for token, (scope, ends_s) in self._open.items() if ends_s >= now_s}

    def _has(self, operator: str, but: str = "") -> bool:
        others = (other for key, other in self._sessions.items() if key != but and other.operator == operator)
        return any(map(self._lasts, others))

    def _free_name(self, wanted: str) -> str:
        names = itertools.chain([wanted], (f"{wanted} ({number})" for number in itertools.count(2)))
        return next(name for name in names if not self._has(name))


def csrf_matches(session: UserSession, word: str | None) -> bool:
    """Whether a request carries the session's word."""
    return word is not None and _same(word, session.csrf)


def _browser(key: str, ends_s: float, operator: str, scope: Scope) -> UserSession:
    return UserSession(key, _word(key, "csrf"), ends_s, operator, scope, stop=_word(key, "stop"))


def _word(key: str, use: str) -> str:
    """Return a word of a session that its cookie alone determines, for pages that outlive the console's process."""
    return hmac.new(key.encode(), use.encode(), hashlib.sha256).hexdigest()


def _digest(cookie: str) -> str:
    return hashlib.sha256(cookie.encode(errors="replace")).hexdigest()


def _make_room(kept: dict[str, Any], counted: list[str], most: int) -> None:
    """Remove the oldest ones of those that count, so that one more has room."""
    for oldest in counted[: max(0, len(counted) - most + 1)]:
        del kept[oldest]


def _same(left: str, right: str) -> bool:
    return hmac.compare_digest(left.encode(errors="replace"), right.encode())
