"""The pages' templates: a page for a signed-in session, the page without one, and the page of an error."""

from http import HTTPStatus
from pathlib import Path

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from console.address import Address
from console.mode_sheet import MODE_WORDS
from console.page_script import page_script
from console.parts import Parts
from console.sign_in import UserSession

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "pages"), autoescape=True, undefined=StrictUndefined
)
TEMPLATES.globals["mode_words"] = MODE_WORDS
TEMPLATES.globals["page_script"] = page_script

# answers for programs and for the pages' scripts; every other address is a page
_NOT_PAGES = ("/api/", "/static/", "/viser/", "/assets/", "/foxglove/", "/live")


def is_page(method: str, path: str) -> bool:
    """Whether a request asks for a page, so that an error has to be one too."""
    return method in ("GET", "HEAD") and not path.startswith(_NOT_PAGES)


def show(template: str, page: str, request: Request, parts: Parts, **more: object) -> HTMLResponse:
    """Render a page for who is signed in. page: its name in the rail; more: what this template alone needs."""
    session: UserSession = request.state.session
    return HTMLResponse(
        TEMPLATES.get_template(template).render(
            csrf=session.csrf, scope=session.scope, page=page, cell=parts.cell, profile=parts.profile, **more
        )
    )


def sign_in_page(address: Address, stopper: UserSession | None, *, refused: bool = False) -> HTMLResponse:
    """Return how to sign in, with STOP for a browser that was signed in before.

    refused: the address's token, or the code, was not good.
    """
    csrf, scope = ("", "") if stopper is None else (stopper.csrf, stopper.scope)
    page = TEMPLATES.get_template("sign_in.html").render(csrf=csrf, scope=scope, base=address.base, refused=refused)
    return HTMLResponse(page, status_code=403 if refused else 401, headers={"www-authenticate": "Bearer"})


def error_page(status: int, text: str, request: Request, parts: Parts) -> HTMLResponse:
    """Return a page that says what went wrong, with navigation and STOP."""
    title = "There is no such page" if status == HTTPStatus.NOT_FOUND else HTTPStatus(status).phrase
    text = f"Nothing is at {request.url.path}." if text == HTTPStatus.NOT_FOUND.phrase else text
    answer = show("error.html", "error", request, parts, title=title, text=text)
    answer.status_code = status
    return answer
