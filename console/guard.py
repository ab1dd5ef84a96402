"""The guard in front of every request: Host, Origin, session, CSRF word, scope, size, security headers. Plain ASGI, so
that it also stands in front of WebSockets.

A browser has a cookie, and has to show that a change comes from our own page: Origin, and the session's word. A program
has a bearer token, which no browser sends by itself, and needs neither.
"""

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import cookie_parser
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from console.address import Address
from console.connections import OF_ONE_SESSION, welcome
from console.sign_in import SignIn, UserSession, csrf_matches
from console.templates import is_page, sign_in_page
from rtstack.access.tokens import Scope as Right

CSRF_HEADER = "x-csrf-token"
MAX_BODY_BYTES = 256 << 10  # orders are a few hundred bytes, and nothing is uploaded
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_STOP = "/api/stop"
SIGN_IN = "/sign-in"  # where our forms bring a token or a code
_FOR_VIEWERS = (_STOP, "/api/sign-out", SIGN_IN)  # changes that a viewer may ask for
_STREAMS_FOR_VIEWERS = ("/live", "/viser/", "/api/logs/", "/api/cameras/")
_OPEN_PREFIX = "/static/"  # style and script, the same for everybody

# our pages: nothing inline, nothing from elsewhere; the scene's page brings its script inside itself (viser's client
# is one file that unpacks and evaluates itself), and may still speak to this origin only
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
_SCENE_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; worker-src 'self' blob: data:; connect-src 'self' data: blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
# no frame of another site gets a headset or a device by us, and none of ours what it has no use for
_DEVICE_POLICY = "xr-spatial-tracking=(self), hid=(self), gamepad=(self), camera=(), microphone=(), geolocation=()"
_TOO_LONG = f"a request may have {MAX_BODY_BYTES >> 10} KiB"
SCENE_PREFIX = "/viser/"
FEED_PREFIX = "/foxglove/"


class Guard:
    """Lets through what comes from our own pages."""

    def __init__(self, app: ASGIApp, sign_in: SignIn, address: Address) -> None:
        self._app = app
        self._sign_in = sign_in
        self._address = address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse, or pass on with the session in the scope."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        bearer = headers.get("authorization")
        stopper = None
        if bearer is None:
            cookies = cookie_parser(headers.get("cookie", ""))
            session = self._sign_in.browser(cookies.get(self._sign_in.cookie))
            if session is None:  # it has ended; a browser that might stop the arms may still do so
                stopper = self._sign_in.stopper(cookies.get(self._sign_in.stop_cookie))
                session = stopper if scope["path"] == _STOP else None
        else:
            kind, _, word = bearer.partition(" ")
            word = word.strip() if kind.lower() == "bearer" else ""
            session = self._sign_in.program(word)
            if session is None and scope["path"] == _STOP:
                session = self._sign_in.stopping_program(word)
            if session is None:
                await run_in_threadpool(self._sign_in.refused, "a bearer token", (scope.get("client") or ("",))[0])
        if scope["type"] == "websocket" and scope["path"].startswith(FEED_PREFIX):
            # Foxglove has no cookie and an origin of its own: the word in the address lets it in, to watch only
            session = self._sign_in.watching(scope["path"].removeprefix(FEED_PREFIX))
        state = scope.setdefault("state", {})
        state.update(session=session, stopper=stopper)
        refusal = self._refusal(scope, headers, session)
        connections = 1
        if session is not None and refusal is None:
            connections = welcome(state["stream"], session.key or session.operator)
        if scope["type"] == "websocket":
            if refusal is not None or connections > OF_ONE_SESSION:
                await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
                return
            scene = scope["path"].startswith(SCENE_PREFIX)
            await self._app(scope, receive if scene else _text_only(receive, send), send)
            return
        await (refusal or self._app)(scope, _capped(receive), _with_security_headers(scope, send))

    def _refusal(self, scope: Scope, headers: Headers, session: UserSession | None) -> Response | None:
        if headers.get("host") not in self._address.hosts:
            return _refuse(400, "this console does not answer to that host name")
        if "transfer-encoding" in headers and "content-length" in headers:
            return _refuse(400, "two lengths: a request has either content-length or transfer-encoding")  # smuggling
        origin, path = headers.get("origin"), scope["path"]
        websocket, bearer = scope["type"] == "websocket", "authorization" in headers
        if websocket and path.startswith(FEED_PREFIX):
            return None if session is not None else _refuse(403, "this is not the address of the live feed")
        if origin not in self._address.origins and (origin is not None or (websocket and not bearer)):
            return _refuse(403, "this request comes from another site")
        changes = not websocket and scope["method"] not in _SAFE_METHODS
        if session is None:
            if bearer:
                return _refuse(401, "this bearer token is not known, or was revoked")
            # the front page says itself how to sign in
            by_address = path == "/" and bool(scope["query_string"])  # perhaps a token or a code
            if not websocket and (path == SIGN_IN if changes else by_address or path.startswith(_OPEN_PREFIX)):
                return None
            if not websocket and is_page(scope["method"], path):
                return sign_in_page(self._address, scope["state"]["stopper"], 401)
            return _refuse(401, "not signed in: open the address that `rtstack up` printed, or bring a bearer token")
        if changes and not bearer and path != SIGN_IN and not csrf_matches(session, headers.get(CSRF_HEADER)):
            return _refuse(403, f"the header {CSRF_HEADER} is missing or wrong: reload the page")
        if session.panel is not None and path not in (f"/api/panels/{session.panel}", _STOP):
            return _refuse(403, f"this token is for /api/panels/{session.panel} alone")
        if session.scope is not Right.OPERATE and (
            (changes and path not in _FOR_VIEWERS) or (websocket and not path.startswith(_STREAMS_FOR_VIEWERS))
        ):
            return _refuse(403, "this session may only look: its scope is `view`")
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > MAX_BODY_BYTES:
            return _refuse(413, _TOO_LONG)
        return None


def _refuse(status: int, reason: str) -> Response:
    headers = {"www-authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": reason}, status_code=status, headers=headers)


def _capped(receive: Receive) -> Receive:
    """Receive no body that is too long without a length: FastAPI's own limit would answer in another form."""
    received = 0

    async def receive_capped() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        if received > MAX_BODY_BYTES:
            raise HTTPException(413, _TOO_LONG)
        return message

    return receive_capped


def _text_only(receive: Receive, send: Send) -> Receive:
    """Receive no bytes on a WebSocket whose messages are JSON: a client that sends some is disconnected."""

    async def receive_text() -> Message:
        message = await receive()
        if message.get("bytes") is None:
            return message
        await send({"type": "websocket.close", "code": 1003, "reason": "messages are text"})
        return {"type": "websocket.disconnect", "code": 1003}

    return receive_text


def _with_security_headers(scope: Scope, send: Send) -> Send:
    policy = _SCENE_POLICY if scope["path"].startswith(SCENE_PREFIX) else PAGE_POLICY

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("content-security-policy", policy)  # a report has a stricter one
            headers["x-content-type-options"] = "nosniff"
            headers.setdefault("referrer-policy", "no-referrer")
            headers["cross-origin-opener-policy"] = "same-origin"
            headers["cross-origin-resource-policy"] = "same-origin"
            headers["permissions-policy"] = _DEVICE_POLICY
            headers.setdefault("cache-control", "no-store")
        await send(message)

    return send_with_headers
