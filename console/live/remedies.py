"""What to do about a fault: the runbook's page "Recovery by error", to which `recovery.md` is a link."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_PAGE = Path(__file__).with_name("recovery.md")
_ROW = re.compile(r"\| `(?P<name>[^`]+)` \|(?P<cells>.+)\|$")


@dataclass(frozen=True, slots=True)
class Remedy:
    """A row of the runbook. anchor: of its row on the page /recovery; todo: what to do, without a stop at its end."""

    name: str
    anchor: str
    cause: str
    todo: str


@dataclass(frozen=True, slots=True)
class Chapter:
    """A table of the runbook's page, with its title."""

    title: str
    rows: tuple[Remedy, ...]


@cache
def chapters() -> tuple[Chapter, ...]:
    """Return the tables of the page, in its order."""
    found: list[Chapter] = []
    for part in _PAGE.read_text().split("\n## ")[1:]:
        title, _, text = part.partition("\n")
        rows: list[Remedy] = []
        for match in filter(None, map(_ROW.match, text.splitlines())):
            cells = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", match["cells"]).replace("`", "")  # without Markdown's marks
            *cause, todo = (cell.strip() for cell in cells.split(" | "))
            anchor = re.sub(r"\W+", "-", match["name"].lower()).strip("-")
            rows.append(Remedy(match["name"], anchor, "".join(cause), todo))
        if rows:
            found.append(Chapter(title, tuple(rows)))
    return tuple(found)


def remedy_of(reason: str | None) -> Remedy | None:
    """Return what the runbook says of a fault's reason: the most special row whose name is in it, None for none."""
    rows = [row for chapter in chapters() for row in chapter.rows if reason is not None and row.name in reason]
    rows = [row for row in rows if not any(row.name in other.name for other in rows if other is not row)]
    # the vendor's and the judge's names come first on the page, and say more than how the session ended
    return rows[0] if rows else None
