"""A campaign's folder as `rtstack campaign` leaves it, read only. Beside it: NAME.json, what was asked; NAME.txt."""

import hashlib
import json
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from rtstack.messages import MESSAGE, StrictBool, StrictFloat

# what a campaign writes; a test compares them with the names of rtstack.experiments, which would bring Dask along
DATABASE, PROGRESS, PAUSE = "campaign.sqlite", "progress.json", "pause.txt"
PAGE, FIGURES, NUMBERS = "report.html", "figures", "report.json"
_TAIL_BYTES = 4096


@checked(frozen=True, slots=True, config=MESSAGE)
class Asked:
    """A plan by name, all of it or its sample, begun at this Unix time; on_cell: on the stack's arms, not simulated."""

    name: str
    quick: StrictBool
    began_s: StrictFloat
    on_cell: StrictBool = False


@dataclass(frozen=True, slots=True)
class Stage:
    """What is done, how far; total is None before it is known. says: what a person is to do; next: case after it."""

    label: str
    done: int
    total: int | None
    says: str = ""
    next: str = ""


class CampaignFolder:
    """One campaign among LOGS/campaigns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.id = hidden(path.name)
        self.said = path.with_name(f"{path.name}.txt")  # what the campaign has said
        self.pause = path / PAUSE  # pauses a campaign on arms between two runs, while it is there; it says why
        self.note = path.with_name(f"{path.name}.json")  # what was asked for

    @property
    def begun(self) -> bool:
        """Whether there is something to resume."""
        return (self.path / DATABASE).exists()

    @property
    def report(self) -> Path | None:
        """The report, None before it was written."""
        page = self.path / PAGE
        return page if page.is_file() else None

    def asked(self) -> Asked | None:
        """Return what was asked for, None where that is no campaign of ours."""
        try:
            return TypeAdapter(Asked).validate_json(self.note.read_bytes())
        except (OSError, ValidationError):
            return None

    def last_line(self) -> str:
        """Return the last line that the campaign has said."""
        try:
            with self.said.open("rb") as file:
                file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
                lines = file.read().decode("utf-8", "replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1].strip() if lines else ""

    def stage(self) -> Stage:
        """Return how far it is, as the campaign has noted it."""
        try:
            noted = json.loads((self.path / PROGRESS).read_bytes())
            words = str(noted.get("says", "")), str(noted.get("next", ""))
            return Stage(str(noted["stage"]), int(noted["done"]), int(noted["total"]), *words)
        except (OSError, ValueError, KeyError, TypeError):
            return Stage("starting", 0, None)

    def rows(self, limit: int) -> tuple[list[str], list[dict[str, Any]]]:
        """Return the columns and the newest results, none where there are none yet; limit: -1 for all."""
        if not self.begun:
            return [], []
        with closing(sqlite3.connect(f"{(self.path / DATABASE).as_uri()}?mode=ro", uri=True)) as database:
            database.row_factory = sqlite3.Row
            try:
                found = database.execute("SELECT * FROM results ORDER BY rowid DESC LIMIT ?", (limit,))
            except sqlite3.Error:  # the table is being made
                return [], []
            return [column[0] for column in found.description], [dict(row) for row in found]

    def log(self, row_id: str) -> Path | None:
        """Return the log behind a result by the hidden name of its row, None without one."""
        for row in self.rows(-1)[1]:
            if row.get("log") is not None and hidden(row["id"]) == row_id:
                path = (self.path / row["log"]).resolve()
                return path if path.is_relative_to(self.path.resolve()) and path.is_file() else None
        return None

    def figures(self) -> dict[str, Path]:
        """Return the figures by hidden names: as long as there is no report, those of the results so far."""
        return {hidden(f"{FIGURES}/{path.name}"): path for path in sorted((self.path / FIGURES).glob("[!.]*.png"))}

    def claims(self) -> list[dict[str, str]]:
        """Return the claims with their verdicts: as long as there is no report, about the results so far."""
        try:
            parts = json.loads((self.path / NUMBERS).read_bytes())["conditions"]
            return [{"conditions": part["name"], **claim} for part in parts for claim in part["claims"]]
        except (OSError, ValueError, KeyError):
            return []


def hidden(name: str) -> str:
    """Return a name that says nothing, by which something is looked up and never opened."""
    return hashlib.blake2b(name.encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()
