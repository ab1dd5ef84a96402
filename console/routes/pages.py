"""The pages."""

from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from console.parts import NeedsParts
from rtstack.trials.specification import Controller

router = APIRouter()

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1] / "pages"), autoescape=True, undefined=StrictUndefined
)


@router.get("/", response_class=HTMLResponse)
def operate(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page Operate, or how to sign in."""
    session = request.state.session
    if session is None:
        refused = getattr(request.state, "refused_token", False)
        page = _TEMPLATES.get_template("sign_in.html").render(csrf=None, refused=refused)
        return HTMLResponse(page, status_code=403 if refused else 401)
    page = _TEMPLATES.get_template("operate.html").render(
        csrf=session.csrf, cell=parts.cell, controllers=[str(name) for name in Controller]
    )
    return HTMLResponse(page)
