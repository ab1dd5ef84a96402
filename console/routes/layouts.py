"""Layouts of the review under names, for all pages and programs of this console."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path

from console.parts import NeedsParts, NeedsSession
from console.review.layouts import LAYOUT_NAME, Layout
from console.routes.problems import problems

router = APIRouter(prefix="/api/layouts", tags=["logs"], responses=problems(409))

_Name = Annotated[str, Path(**LAYOUT_NAME)]


@dataclass(frozen=True, slots=True)
class Removed:
    """Says that the layout is gone."""

    removed: bool


@router.get("")
def layouts(parts: NeedsParts) -> dict[str, Layout]:
    """Return all layouts by name. `/logs/ID?layout=NAME` opens a log with one."""
    return parts.layouts.all()


@router.post("/{name}")
def save(name: _Name, layout: Layout, session: NeedsSession, parts: NeedsParts) -> Layout:
    """Keep a layout under a name, in the place of one that has it."""
    parts.layouts.put(name, layout)
    return layout


@router.delete("/{name}", responses=problems(404))
def remove(name: _Name, session: NeedsSession, parts: NeedsParts) -> Removed:
    """Forget a layout."""
    parts.layouts.remove(name)
    return Removed(True)
