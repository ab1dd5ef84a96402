"""Layouts of the review under names, for all pages and programs of this console."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path
from fastapi.exceptions import HTTPException

from console.parts import NeedsParts, NeedsSession
from console.review.layouts import Layout, Layouts, LayoutsError
from console.routes.problems import problems

router = APIRouter(prefix="/api/layouts", tags=["logs"], responses=problems(409))

_Name = Annotated[str, Path(min_length=1, max_length=60, pattern=r"^[^\p{C}/\\\s]([^\p{C}/\\]*[^\p{C}/\\\s])?$")]


@dataclass(frozen=True, slots=True)
class Removed:
    """Says that the layout is gone."""

    removed: bool


@router.get("")
def layouts(parts: NeedsParts) -> dict[str, Layout]:
    """Return all layouts by name. `/logs/ID?layout=NAME` opens a log with one."""
    return _known(parts.layouts)


@router.post("/{name}")
def save(name: _Name, layout: Layout, session: NeedsSession, parts: NeedsParts) -> Layout:
    """Keep a layout under a name, in the place of one that has it."""
    try:
        parts.layouts.put(name, layout)
    except LayoutsError as error:
        raise HTTPException(409, str(error)) from None
    return layout


@router.delete("/{name}", responses=problems(404))
def remove(name: _Name, session: NeedsSession, parts: NeedsParts) -> Removed:
    """Forget a layout."""
    try:
        if not parts.layouts.remove(name):
            raise HTTPException(404, "there is no layout of this name")
    except LayoutsError as error:
        raise HTTPException(409, str(error)) from None
    return Removed(True)


def _known(layouts: Layouts) -> dict[str, Layout]:
    try:
        return layouts.all()
    except LayoutsError as error:
        raise HTTPException(409, str(error)) from None
