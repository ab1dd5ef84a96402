"""The guard in front of every request: Host, Origin, session, CSRF word, security headers. Plain ASGI, so that it
also stands in front of WebSockets.
"""

from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from console.sign_in import Session, SignIn, csrf_matches

CSRF_HEADER = "x-csrf-token"
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_OPEN_PREFIX = "/static/"  # style and script, the same for everybody

# our pages: nothing inline, nothing from elsewhere; the scene's page brings its script inside itself (viser's client
# is one file that unpacks and evaluates itself), and may still speak to this origin only
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
_SCENE_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; worker-src 'self' blob: data:; connect-src 'self' data: blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
SCENE_PREFIX = "/viser/"
FEED_PREFIX = "/foxglove/"


class Guard:
    """Lets through what comes from our own pages, and signs in who brings the token."""

    def __init__(self, app: ASGIApp, sign_in: SignIn, port: int) -> None:
        self._app = app
        self._sign_in = sign_in
        self._hosts = frozenset({f"127.0.0.1:{port}", f"localhost:{port}"})
        self._origins = frozenset(f"http://{host}" for host in self._hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse, or pass on with the session in the scope."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        session = self._sign_in.session(_cookie(headers, self._sign_in.cookie))
        scope.setdefault("state", {})["session"] = session
        refusal = self._refusal(scope, headers, session)
        if scope["type"] == "websocket":
            if refusal is not None:
                await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
                return
            await self._app(scope, receive, send)
            return
        answer = refusal if refusal is not None else self._signing_in(scope, session)
        await (answer or self._app)(scope, receive, _with_security_headers(scope, send))

    def _refusal(self, scope: Scope, headers: Headers, session: Session | None) -> Response | None:
        if headers.get("host") not in self._hosts:
            return _refuse(400, "this console does not answer to that host name")
        origin = headers.get("origin")
        websocket = scope["type"] == "websocket"
        if websocket and scope["path"].startswith(FEED_PREFIX):
            # Foxglove has no cookie and an origin of its own: the word in the address lets it in, to watch only
            known = self._sign_in.may_watch(scope["path"].removeprefix(FEED_PREFIX))
            return None if known else _refuse(403, "this is not the address of the live feed")
        if (websocket or origin is not None) and origin not in self._origins:
            return _refuse(403, "this request comes from another site")
        path = scope["path"]
        if session is None:
            # the front page says itself how to sign in
            if not websocket and (path == "/" or path.startswith(_OPEN_PREFIX)) and scope["method"] in _SAFE_METHODS:
                return None
            return _refuse(401, "not signed in: open the address that `rtstack up` printed")
        if (
            not websocket
            and scope["method"] not in _SAFE_METHODS
            and not csrf_matches(session, headers.get(CSRF_HEADER))
        ):
            return _refuse(403, f"the header {CSRF_HEADER} is missing or wrong: reload the page")
        return None

    def _signing_in(self, scope: Scope, session: Session | None) -> Response | None:
        tokens = parse_qs(scope["query_string"].decode("ascii", "replace")).get("token")
        if scope["path"] != "/" or tokens is None:
            return None
        clean = RedirectResponse("/", status_code=303)  # the token stays in no address bar and in no history
        if session is not None:
            return clean
        new = self._sign_in.redeem(tokens[0])
        if new is None:
            scope["state"]["refused_token"] = True
            return None
        clean.set_cookie(self._sign_in.cookie, new.key, httponly=True, samesite="strict", path="/")
        return clean


def _cookie(headers: Headers, name: str) -> str | None:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return None
    return None if morsel is None else morsel.value


def _refuse(status: int, reason: str) -> Response:
    return JSONResponse({"error": reason}, status_code=status)


def _with_security_headers(scope: Scope, send: Send) -> Send:
    policy = _SCENE_POLICY if scope["path"].startswith(SCENE_PREFIX) else _PAGE_POLICY

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["content-security-policy"] = policy
            headers["x-content-type-options"] = "nosniff"
            headers["referrer-policy"] = "no-referrer"
            headers["cross-origin-opener-policy"] = "same-origin"
            headers["cross-origin-resource-policy"] = "same-origin"
            headers.setdefault("cache-control", "no-store")
        await send(message)

    return send_with_headers
