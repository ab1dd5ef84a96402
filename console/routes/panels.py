"""The panels of installed packages: what the function behind each of them says now."""

from fastapi import APIRouter

from console.panels import PanelAnswer
from console.parts import NeedsParts
from console.routes.problems import problems

router = APIRouter(prefix="/api/panels", tags=["panels"])


@router.get("/{name}", responses=problems(404))
def panel(name: str, parts: NeedsParts) -> PanelAnswer:
    """Return a panel's data, at most once in its period anew, or the line that says why there are none."""
    return parts.panels.answer(name)
