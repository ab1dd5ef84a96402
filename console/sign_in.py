"""Who may use the console: one-time token -> session cookie. Kept in memory: a restart signs everybody out."""

import hmac
import secrets
import threading
import time
from dataclasses import dataclass, replace

_SESSION_S = 12 * 3600.0  # a shift
_MAX_SESSIONS = 64


class NameTaken(Exception):
    """Another session has the name. The message is one line."""


@dataclass(frozen=True, slots=True)
class Session:
    """A signed-in browser: its cookie, and the word that every change-making request has to repeat.

    `operator`: what it calls itself. No two sessions have the same name at the same time.
    """

    key: str
    csrf: str
    ends_s: float
    operator: str


class SignIn:
    """The one-time token and the sessions. `cookie` is the cookie's name: cookies do not know ports, so it does."""

    def __init__(self, port: int) -> None:
        self.cookie = f"rtstack-{port}"
        self._lock = threading.Lock()
        self._token: str | None = secrets.token_urlsafe(24)
        self.feed = secrets.token_urlsafe(24)  # part of the live feed's address: who has it may watch, no more
        self._sessions: dict[str, Session] = {}
        self._redeemed = 0

    @property
    def token(self) -> str | None:
        """The one-time token, None once it was used."""
        return self._token

    def may_watch(self, feed: str) -> bool:
        """Whether this is the word of the live feed's address."""
        return _same(feed, self.feed)

    def redeem(self, token: str) -> Session | None:
        """Exchange the token for a session. Returns None for a wrong or used one."""
        with self._lock:
            if self._token is None or not _same(token, self._token):
                return None
            self._token = None
            self._redeemed += 1
            key, csrf = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
            session = Session(key, csrf, time.monotonic() + _SESSION_S, f"operator {self._redeemed}")
            while len(self._sessions) >= _MAX_SESSIONS:
                self._sessions.pop(next(iter(self._sessions)))
            self._sessions[session.key] = session
            return session

    def session(self, key: str | None) -> Session | None:
        """Return the session of a cookie, None where there is none or it has ended."""
        if not key:
            return None
        with self._lock:
            session = self._sessions.get(key)
            if session is not None and session.ends_s < time.monotonic():
                del self._sessions[key]
                return None
            return session

    def rename(self, session: Session, operator: str) -> Session:
        """Return the session under the name that it gives itself. Raises NameTaken while another session has it."""
        with self._lock:
            others = (other for key, other in self._sessions.items() if key != session.key)
            if any(other.operator == operator and other.ends_s >= time.monotonic() for other in others):
                raise NameTaken(f"another session calls itself {operator}; choose another name")
            renamed = replace(session, operator=operator)
            if session.key in self._sessions:
                self._sessions[session.key] = renamed
            return renamed


def csrf_matches(session: Session, word: str | None) -> bool:
    """Whether a request carries the session's word."""
    return word is not None and _same(word, session.csrf)


def _same(left: str, right: str) -> bool:
    return hmac.compare_digest(left.encode(), right.encode())
