"""The pages' templates: a page for a signed-in session, the page without one, and the page of an error."""

import re
from functools import cache
from hashlib import blake2b
from http import HTTPStatus
from math import ceil
from pathlib import Path, PurePosixPath

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from console.address import Address
from console.parts import Parts
from console.sign_in import UserSession
from rtstack.live.panel import PANELS
from rtstack.palette import MODE_STYLES
from rtstack.trials.start_motion import rooms_mm

STATIC = Path(__file__).parent / "static"
_FOLDER = STATIC / "js"
KEPT = "kept-"  # how the word begins below which files never change
_IMPORT = re.compile(r"""^import\s[^"';]*["'](\.[^"']+)["'];""", re.MULTILINE)


def static() -> str:
    """Return the address of style and scripts. It changes with their content, so browsers keep what is below it."""
    return f"/static/{_digest(max(path.stat().st_mtime_ns for path in STATIC.rglob('*.*')))}"


@cache
def _digest(changed_ns: int) -> str:
    content = blake2b(b"".join(path.read_bytes() for path in sorted(STATIC.rglob("*.*"))), digest_size=6)
    return f"{KEPT}{content.hexdigest()}"


@cache
def imported(name: str) -> tuple[str, ...]:
    """Return the modules that a module imports, and what they import, each once; paths below static/js."""
    found: dict[str, None] = {}
    for other in _IMPORT.findall((_FOLDER / name).read_text()):
        path = (_FOLDER / PurePosixPath(name).parent / other).resolve().relative_to(_FOLDER.resolve()).as_posix()
        found |= dict.fromkeys((path, *imported(path)))
    return tuple(found)


def page_script(name: str) -> Markup:
    """Return the tags for a page's script: what it imports is fetched beside it, not after it."""
    at = f"{static()}/js"
    tags = [Markup('<link rel="modulepreload" href="{}/{}">').format(at, path) for path in imported(name)]
    return Markup("\n  ").join([*tags, Markup('<script type="module" src="{}/{}"></script>').format(at, name)])


TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "pages"), autoescape=True, undefined=StrictUndefined
)
TEMPLATES.globals["mode_words"] = {mode.name: style.word for mode, style in MODE_STYLES.items()}
TEMPLATES.globals |= {"page_script": page_script, "static": static, "panel_names": PANELS.names, "rooms_mm": rooms_mm}

# answers for programs and for the pages' scripts; every other address is a page
_NOT_PAGES = ("/api/", "/static/", "/viser/", "/assets/", "/foxglove/", "/live")


def is_page(method: str, path: str) -> bool:
    """Whether a request asks for a page, so that an error has to be one too."""
    return method in ("GET", "HEAD") and not path.startswith(_NOT_PAGES)


def mode_sheet() -> str:
    """Return the modes' colours as a style sheet: `--mode` below any `data-mode`, and `--mode-NAME` everywhere."""
    dark = " ".join(f"{_variable(mode.name)}: {style.colour};" for mode, style in MODE_STYLES.items())
    light = " ".join(f"{_variable(mode.name)}: {style.light};" for mode, style in MODE_STYLES.items())
    each = "\n".join(f'[data-mode="{mode.name}"] {{ --mode: var({_variable(mode.name)}); }}' for mode in MODE_STYLES)
    return f':root {{ {dark} }}\n:root[data-theme="light"] {{ {light} }}\n{each}\n'


def _variable(name: str) -> str:
    return f"--mode-{name.lower().replace('_', '-')}"


def show(template: str, page: str, request: Request, parts: Parts, **more: object) -> HTMLResponse:
    """Render a page for who is signed in. page: its name in the rail; more: what this template alone needs."""
    session: UserSession = request.state.session
    parts.heartbeats.load(session.operator)
    cell = {"cell": parts.cell, "profile": parts.profile, "two_arms": len(parts.cell.arms) == 2}
    rendered = TEMPLATES.get_template(template).render(
        page=page, csrf=session.csrf, scope=session.scope, **cell, **more
    )
    return HTMLResponse(rendered)


def sign_in_page(
    address: Address, stopper: UserSession | None, status: int, waits_s: float = 0.0, token: str = "",
    operator: str = "",
) -> HTMLResponse:  # fmt: skip
    """Return how to sign in, with STOP for a browser that was signed in before. status: 401; 403 for a wrong token or
    code; 429 where the next code counts after waits_s; 200 for a token to be confirmed, which ends operator's session.
    """
    csrf, scope = ("", "") if stopper is None else (stopper.csrf, stopper.scope)
    page = TEMPLATES.get_template("sign_in.html").render(
        csrf=csrf, scope=scope, base=address.base, status=status, waits_s=ceil(waits_s), token=token, operator=operator
    )
    # with no-referrer, a browser's form would bring no Origin: Fetch, "append a request Origin header"
    headers = {"www-authenticate": "Bearer", "referrer-policy": "same-origin"}
    return HTMLResponse(page, status_code=status, headers=headers)


def error_page(status: int, text: str, request: Request, parts: Parts) -> HTMLResponse:
    """Return a page that says what went wrong, with navigation and STOP."""
    title = "There is no such page" if status == HTTPStatus.NOT_FOUND else HTTPStatus(status).phrase
    text = f"Nothing is at {request.url.path}." if text == HTTPStatus.NOT_FOUND.phrase else text
    answer = show("error.html", "error", request, parts, title=title, text=text)
    answer.status_code = status
    return answer
