"""A campaign's folder as `rtstack campaign` leaves it: how far it is, its results, figures and report.

Read only, while the campaign writes. Beside the folder stand NAME.json, what was asked, and NAME.txt, what it has said.
"""

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from rtstack.messages import MESSAGE, StrictBool, StrictFloat

# as rtstack.campaign.store and .report name them, which would bring half of the controller along
DATABASE = "campaign.sqlite"
PAGE, FIGURES, NUMBERS = "report.html", "figures", "report.json"
CLAIMS = "claims.json"  # of a preview
FINDINGS = "results.jsonl"  # of a study that keeps lines instead of a table
_REFERENCES = "references"
_PREPARING = (_REFERENCES, "compiling")  # stages before the trials
_STAGE = re.compile(r"^([a-z ]+): (\d+) of (\d+)\b", re.MULTILINE)
_TAIL_BYTES = 65536


@checked(frozen=True, slots=True, config=MESSAGE)
class Asked:
    """What was asked for: a plan by name, all of it or its sample, begun at this Unix time."""

    name: str
    quick: StrictBool
    began_s: StrictFloat


@dataclass(frozen=True, slots=True)
class Stage:
    """What is being done, and how much of it is done; total is None before that was said."""

    label: str
    done: int
    total: int | None


class CampaignFolder:
    """One campaign among LOGS/campaigns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.id = hidden(path.name)

    @property
    def preview(self) -> Path:
        """Where figures are drawn before the campaign has drawn its own."""
        return self.path.with_name(f"{self.path.name}.preview")

    @property
    def said(self) -> Path:
        """What the campaign has said."""
        return self.path.with_name(f"{self.path.name}.txt")

    @property
    def begun(self) -> bool:
        """Whether there is something to resume."""
        return any((self.path / name).exists() for name in (DATABASE, "about.json"))

    @property
    def report(self) -> Path | None:
        """The report, None before it was written."""
        page = self.path / PAGE
        return page if page.is_file() else None

    def keep(self, asked: Asked) -> None:
        """Note what was asked for."""
        self._note.write_text(json.dumps(asdict(asked)), encoding="utf-8")

    def asked(self) -> Asked | None:
        """Return what was asked for, None where that is no campaign of ours."""
        try:
            return TypeAdapter(Asked).validate_json(self._note.read_bytes())
        except (OSError, ValidationError):
            return None

    def last_line(self) -> str:
        """Return the last line that the campaign has said."""
        lines = self._tail().strip().splitlines()
        return lines[-1].strip() if lines else ""

    def stage(self) -> Stage:
        """Return how far it is: the totals as the campaign says them, what is done as its results have it."""
        label, done, total = "starting", 0, None
        for found in _STAGE.finditer(self._tail()):
            label, done, total = found[1], int(found[2]), int(found[3])
        if label == _REFERENCES:
            done = max(done, sum(1 for _ in (self.path / _REFERENCES).glob("*.mcap")))
            done = done if total is None else min(done, total)
        elif label not in _PREPARING:
            done = self.count()
        return Stage(label, done, total)

    @property
    def total(self) -> int | None:
        """How many trials or simulations there are, None before the campaign has said it."""
        stage = self.stage()
        return None if stage.label in _PREPARING else stage.total

    def count(self) -> int:
        """Return the number of results."""
        try:
            with (self.path / FINDINGS).open("rb") as lines:
                return sum(1 for _ in lines)
        except OSError:
            pass
        with self._database() as database:
            return 0 if database is None else database.execute("SELECT COUNT(*) FROM results").fetchone()[0]

    def rows(self, limit: int) -> tuple[list[str], list[dict[str, Any]]]:
        """Return the columns and the newest results."""
        with self._database() as database:
            if database is None:
                return [], []
            found = database.execute("SELECT * FROM results ORDER BY rowid DESC LIMIT ?", (limit,))
            return [column[0] for column in found.description], [dict(row) for row in found]

    def log(self, row_id: str) -> Path | None:
        """Return the log behind a result by the hidden name of its row, None without one."""
        with self._database() as database:
            if database is None:
                return None
            columns = {name for (name,) in database.execute("SELECT name FROM pragma_table_info('results')")}
            if "log" not in columns:
                return None
            for trial, log in database.execute("SELECT id, log FROM results"):
                if log is not None and hidden(trial) == row_id:
                    path = (self.path / log).resolve()
                    return path if path.is_relative_to(self.path.resolve()) and path.is_file() else None
        return None

    def figures(self) -> dict[str, Path]:
        """Return the figures by hidden names: the campaign's own, and until there are any those drawn meanwhile."""
        for folder in (self.path / FIGURES, self.preview):
            drawn = sorted(folder.glob("*.png"))
            if drawn:
                return {hidden(f"{folder.name}/{path.name}"): path for path in drawn}
        return {}

    def claims(self) -> list[dict[str, str]]:
        """Return the paper's claims with their verdicts: the report's, and until there is one those drawn meanwhile."""
        for file in (self.path / NUMBERS, self.preview / CLAIMS):
            try:
                parts = json.loads(file.read_text(encoding="utf-8"))["conditions"]
            except (OSError, ValueError, KeyError):
                continue
            return [{"conditions": part["name"], **claim} for part in parts for claim in part["claims"]]
        return []

    @property
    def _note(self) -> Path:
        return self.path.with_name(f"{self.path.name}.json")

    def _tail(self) -> str:
        try:
            with self.said.open("rb") as file:
                file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
                return file.read().decode("utf-8", "replace")
        except OSError:
            return ""

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection | None]:
        """Open the results to read, None where there are none yet."""
        if not (self.path / DATABASE).exists():
            yield None
            return
        with closing(sqlite3.connect(f"{(self.path / DATABASE).as_uri()}?mode=ro", uri=True)) as database:
            database.row_factory = sqlite3.Row
            try:
                database.execute("SELECT 1 FROM results LIMIT 1")
            except sqlite3.Error:  # the table is being made
                yield None
                return
            yield database


def hidden(name: str) -> str:
    """Return a name that says nothing, by which something is looked up and never opened."""
    return hashlib.blake2b(name.encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()
