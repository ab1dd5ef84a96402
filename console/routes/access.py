"""Who may use the console: who I am, further browsers, tokens for programs, and the trail of what everybody did."""

import contextlib
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path, Query
from fastapi.exceptions import HTTPException
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsParts, NeedsSession, Parts
from console.routes.problems import problems
from console.sign_in import INVITATION_S, PAIRING_S
from rtstack.access.tokens import Scope, Token, TokenName
from rtstack.live.audit import AuditLine
from rtstack.live.client import RobotRefused, RobotUnreachable
from rtstack.messages import MESSAGE

router = APIRouter(prefix="/api", tags=["access"])

_Id = Annotated[str, Path(pattern="^[0-9a-f]{8}$")]


@dataclass(frozen=True, slots=True)
class Me:
    """operator: the name under which this session acts; program: whether it came with a bearer token."""

    operator: str
    scope: Scope
    program: bool


@dataclass(frozen=True, slots=True)
class SignedOut:
    """Says that the session is over."""

    signed_out: bool


@checked(frozen=True, slots=True, config=MESSAGE)
class InvitationOrder:
    """What another browser shall be able to do."""

    scope: Scope = Scope.VIEW


@dataclass(frozen=True, slots=True)
class Invitation:
    """address: signs one browser in, once, within so many seconds."""

    address: str
    scope: Scope
    seconds: float


@dataclass(frozen=True, slots=True)
class Pairing:
    """code: signs the first browser in that types it at `address`, within so many seconds."""

    code: str
    address: str
    scope: Scope
    seconds: float


@checked(frozen=True, slots=True, config=MESSAGE)
class TokenOrder:
    """What a program is called, and what it shall be able to do; panel: to look at that one, and at nothing else."""

    name: TokenName
    scope: Scope = Scope.VIEW
    panel: Annotated[str, Field(max_length=80)] | None = None


@dataclass(frozen=True, slots=True)
class TokenRow:
    """A token without what makes it one. Unix times, s; `used_s`: None where not since this console started."""

    id: str
    name: str
    scope: Scope
    created_s: float
    used_s: float | None
    panel: str | None


@dataclass(frozen=True, slots=True)
class NewToken:
    """A token; `word` is what the program brings as `Authorization: Bearer WORD`, and is never shown again."""

    row: TokenRow
    word: str


@router.get("/me")
def me(session: NeedsSession) -> Me:
    """Say who this session is, and what it may do."""
    return Me(session.operator, session.scope, session.token is not None)


@router.post("/sign-out", responses=problems(409))
def sign_out(session: NeedsSession, parts: NeedsParts) -> SignedOut:
    """End this browser's session: its cookie is worth nothing from now on, and it gives back control."""
    if session.token is not None:
        raise HTTPException(409, "a program does not sign out: revoke its token")
    parts.sign_in.end(session)
    with contextlib.suppress(RobotRefused, RobotUnreachable):
        if parts.client.status().holder == session.operator:
            parts.watch.learn(parts.client.release(session.operator))
    return SignedOut(True)


@router.post("/invitations", status_code=201)
def invite(order: InvitationOrder, session: NeedsSession, parts: NeedsParts) -> Invitation:
    """Make an address that signs another browser in, to look or to operate."""
    token = parts.sign_in.invite(order.scope)
    parts.audit.note("invite", session.operator, f"{session.operator} invited another browser: {order.scope}")
    return Invitation(f"{parts.sign_in.address.base}/?token={token}", order.scope, INVITATION_S)


@router.post("/pairings", status_code=201)
def pair(order: InvitationOrder, session: NeedsSession, parts: NeedsParts) -> Pairing:
    """Make a short code that signs another browser in, such as a headset's; a code that was made before is void."""
    code = parts.sign_in.pair(order.scope)
    parts.audit.note("invite", session.operator, f"{session.operator} made a code for another browser: {order.scope}")
    return Pairing(code, parts.sign_in.address.base, order.scope, PAIRING_S)


@router.get("/tokens", responses=problems(409))
def tokens(session: NeedsSession, parts: NeedsParts) -> list[TokenRow]:
    """List the tokens of programs, oldest first. Only for who may operate."""
    if session.scope is not Scope.OPERATE:
        raise HTTPException(403, "this session may only look: its scope is `view`")
    return [_row(token, parts) for token in parts.sign_in.tokens.all()]


@router.post("/tokens", status_code=201, responses=problems(409))
def create_token(order: TokenOrder, session: NeedsSession, parts: NeedsParts) -> NewToken:
    """Make a token for a program. The answer has it; it cannot be shown again."""
    if order.panel is not None and order.panel not in parts.panels.packages():
        raise HTTPException(422, f"panel: no installed package offers a panel {order.panel!r}")
    token, word = parts.sign_in.tokens.create(order.name, order.scope, order.panel)
    text = f"{session.operator} made token {token.id} for {token.name}: {order.panel or token.scope}"
    parts.audit.note("token", session.operator, text)
    return NewToken(_row(token, parts), word)


@router.delete("/tokens/{token_id}", responses=problems(404, 409))
def revoke_token(token_id: _Id, session: NeedsSession, parts: NeedsParts) -> TokenRow:
    """Revoke a token: its program is refused from now on, on open connections too."""
    token = parts.sign_in.tokens.revoke(token_id)
    parts.audit.note("token", session.operator, f"{session.operator} revoked token {token.id} of {token.name}")
    return _row(token, parts)


@router.get("/audit")
def audit(parts: NeedsParts, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> list[AuditLine]:
    """Return the newest lines of the audit trail, oldest first: who did what, and when."""
    return parts.audit.newest(limit)


def _row(token: Token, parts: Parts) -> TokenRow:
    return TokenRow(token.id, token.name, token.scope, token.created_s, parts.sign_in.used_s(token.id), token.panel)
