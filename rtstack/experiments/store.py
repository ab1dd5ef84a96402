"""Where results are kept: one SQLite table, a transaction for the rows of a task, and CSV made from it."""

import csv
import json
import shutil
import sqlite3
import sys
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from hal.base.files import locked, replacing
from hal.extensions import blaming
from rtstack.experiments.attempts import Attempt
from rtstack.experiments.experiment import Case, Experiment, Row
from rtstack.experiments.registration import PLAN_DIGEST, file_digest
from rtstack.experiments.version import Version, present
from rtstack.trials.errors import TrialError

VERSION = "version"  # what a store calls it; "version 2" is the next one, of an invocation that resumed
DATABASE = "campaign.sqlite"
RESULTS = "results.csv"
TIMES = "times.csv"
ATTEMPTS = "attempts.csv"
SOURCES = "sources"  # the folder of the files on which results depend: the plan, cells, parameters
# what a host makes of a trial, and not the trial: in a table of their own when written as CSV
OF_THE_HOST = ("wall_s", "cpu_s", "worker", "compute_us_p50", "compute_us_p99", "real_time_factor")
PROVENANCE: dict[str, Any] = {"git_commit": str, "digest": str, "wall_s": float, "worker": str}


def columns_of(*records: type) -> dict[str, Any]:
    """Return the fields of these dataclasses as columns: name -> type."""
    columns: dict[str, Any] = {}
    for record in records:
        hints = typing.get_type_hints(record)
        columns |= {field.name: hints[field.name] for field in fields(record)}
    return columns


def stored(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return all columns of a table: an experiment's, and where a result comes from."""
    return {"id": str, **columns} | PROVENANCE


def _sql_type(kind: Any) -> str:
    kinds = set(typing.get_args(kind)) or {kind}
    if float in kinds:
        return "REAL"
    return "INTEGER" if kinds & {int, bool} else "TEXT"


class Store(AbstractContextManager["Store"]):
    """The results in a campaign's folder. A context manager: one program at a time works on a folder."""

    def __init__(self, out: Path, columns: Mapping[str, Any]) -> None:
        """Open or create the table of an experiment's columns. Raises TrialError where another program works here."""
        self.out = out
        columns = self._columns = stored(columns)
        self._lock = ExitStack()
        try:
            self._lock.enter_context(locked(out / ".lock", wait=False))
        except BlockingIOError:
            raise TrialError(f"another campaign is running in {out}: wait for it, or choose another folder") from None
        self._database = sqlite3.connect(out / DATABASE)
        self._database.row_factory = sqlite3.Row
        self._database.execute("PRAGMA journal_mode=WAL")
        declared = ", ".join(f"{name} {_sql_type(kind)}" for name, kind in columns.items() if name != "id")
        with self._database as database:
            database.execute(f"CREATE TABLE IF NOT EXISTS results (id TEXT PRIMARY KEY, {declared})")
            database.execute("CREATE TABLE IF NOT EXISTS campaign (name TEXT PRIMARY KEY, value TEXT)")
            numbers = "trials INTEGER, robot_s REAL, wall_s REAL, workers INTEGER"
            database.execute(f"CREATE TABLE IF NOT EXISTS invocations ({numbers})")
            declared = ", ".join(f"{name} {_sql_type(kind)}" for name, kind in columns_of(Attempt).items())
            database.execute(f"CREATE TABLE IF NOT EXISTS attempts ({declared})")

    def __exit__(self, *_: object) -> None:
        self._database.close()
        self._lock.close()

    def claim(self, experiment: Experiment[Any, Any]) -> None:
        """Note whose results these are and by which version; copy their sources. The plan counts as before the first
        result.
        """
        values = _identity(experiment) | {"plan_commit": experiment.request.file.commit}
        values |= {"title": experiment.specification.title}
        if experiment.request.logs is not None:
            values["logs"] = experiment.request.logs
        known, mine = self.versions(), present()
        if mine not in known:
            values[VERSION if not known else f"{VERSION} {len(known) + 1}"] = json.dumps(asdict(mine))
        if known and mine != known[0]:
            what = known[0].difference(mine)
            print(f"rtstack: warning: another version than the campaign was begun with: {what}", file=sys.stderr)
        with self._database as database:
            database.executemany("INSERT OR IGNORE INTO campaign VALUES (?, ?)", values.items())
            if database.execute("SELECT 1 FROM results LIMIT 1").fetchone() is None:
                noted = (PLAN_DIGEST, file_digest(experiment.request.file.path))
                database.execute("INSERT OR REPLACE INTO campaign VALUES (?, ?)", noted)
        kept = self.out / SOURCES
        kept.mkdir(exist_ok=True)
        shutil.copyfile(experiment.request.file.path, kept / "plan.toml")
        for path, _ in experiment.sources:
            shutil.copyfile(path, kept / f"{path.parent.name}-{path.name}")

    def note_invocation(self, trials: int, robot_s: float, wall_s: float, workers: int) -> None:
        """Keep how fast so many trials went."""
        if trials:
            with self._database as database:
                database.execute("INSERT INTO invocations VALUES (?, ?, ?, ?)", (trials, robot_s, wall_s, workers))

    def invocations(self) -> list[Row]:
        return [dict(row) for row in self._database.execute("SELECT * FROM invocations")]

    def note_attempt(self, attempt: Attempt) -> None:
        values = asdict(attempt)
        with self._database as database:
            marks = ", ".join(f":{name}" for name in values)
            database.execute(f"INSERT INTO attempts ({', '.join(values)}) VALUES ({marks})", values)

    def attempts(self) -> list[Attempt]:
        """Return what `note_attempt` kept, in order."""
        found = self._database.execute("SELECT * FROM attempts ORDER BY rowid")
        return [Attempt(**{**row, "counts": bool(row["counts"])}) for row in map(dict, found)]

    def about(self) -> dict[str, str]:
        return {row["name"]: row["value"] for row in self._database.execute("SELECT name, value FROM campaign")}

    def versions(self) -> list[Version]:
        """Return the versions that this campaign was run with, in order."""
        return [_version(value) for name, value in self.about().items() if name.partition(" ")[0] == VERSION]

    def add(self, *rows: Row, made_by: Sequence[object] = ()) -> None:
        """Keep results, all of them or none. A second one of the same case replaces the first.

        Raises TrialError for a row of another author without a column, or with what none takes. made_by: see `raised`.
        """
        names = self._columns
        with blaming("a row cannot be kept", *made_by, error=TrialError):
            if missing := [name for name in names if any(name not in row for row in rows)]:
                raise TypeError(f"there is no {', no '.join(missing)}")
            marks = ", ".join(f":{name}" for name in names)
            with self._database as database:
                values = [{name: row[name] for name in names} for row in rows]
                try:
                    database.executemany(
                        f"INSERT OR REPLACE INTO results ({', '.join(names)}) VALUES ({marks})", values
                    )
                except sqlite3.ProgrammingError as error:
                    raise TypeError(str(error)) from error

    def rows(self, cases: Iterable[Case] | None = None) -> list[Row]:
        """Return all results by id, or those of these cases in their order."""
        found = {row["id"]: self._row(row) for row in self._database.execute("SELECT * FROM results ORDER BY id")}
        return list(found.values()) if cases is None else [found[case.id] for case in cases if case.id in found]

    def write_csv(self, rows: list[Row]) -> None:
        """Write the results, and in files of their own what depends on the host, and what was attempted on arms."""
        results = [name for name in self._columns if name not in OF_THE_HOST]
        times = ["id", *(name for name in OF_THE_HOST if name in self._columns)]
        attempts = [asdict(attempt) for attempt in self.attempts()]
        files = [(RESULTS, results, rows), (TIMES, times, rows)]
        files += [(ATTEMPTS, list(columns_of(Attempt)), attempts)] if attempts else []
        for file, names, lines in files:
            with replacing(self.out / file) as new, open(new, "w", newline="", encoding="utf-8") as out:
                writer = csv.DictWriter(out, names, extrasaction="ignore", lineterminator="\n")
                writer.writeheader()
                writer.writerows(lines)

    def _row(self, row: sqlite3.Row) -> Row:
        return {name: bool(row[name]) if kind is bool else row[name] for name, kind in self._columns.items()}


def check_folder(experiment: Experiment[Any, Any], resume: bool) -> None:
    """Raise TrialError where the request's folder cannot be this campaign's. Nothing is written."""
    out, logs = experiment.request.out, experiment.request.logs
    if out.exists() and not out.is_dir():
        raise TrialError(f"{out} is not a folder")
    if not out.parent.is_dir() and not out.exists():
        raise TrialError(f"cannot make {out}: the folder {out.parent} does not exist")
    database = out / DATABASE
    if not database.exists():
        if resume:
            raise TrialError(f"there is nothing to resume in {out}: leave --resume out to begin there")
        if out.is_dir() and any(entry.name != ".lock" for entry in out.iterdir()):
            raise TrialError(f"{out} is not empty: choose another folder")
        return
    about, columns = _read(database)
    mine = _identity(experiment)
    theirs = {name: about.get(name, value) for name, value in mine.items()}
    same = about.get("name") == mine["name"] and VERSION in about
    if same and (other := present().plug_ins.difference(_version(about[VERSION]).plug_ins)):
        raise TrialError(
            f"{out} was begun with the plug-in {other}: results would be mixed; install that one again, or begin anew "
            "in another folder"
        )
    if theirs != mine:
        quick = " --quick" * (theirs["quick"] == "true")
        what = f"{theirs['name']}{quick}"
        if theirs["digest"] != mine["digest"] and theirs["name"] == mine["name"]:
            what += f" with other parameters (digest {theirs['digest']}, now {mine['digest']})"
        raise TrialError(f"{out} has another campaign, {what}: choose another folder")
    if columns and columns != set(stored(experiment.columns)):
        raise TrialError(f"{out} was begun by a version of rtstack with other columns: choose another folder")
    if not resume:
        raise TrialError(f"{out} has results of this campaign: go on with --resume, or choose another folder")
    if (begun := about.get("logs")) != logs:
        raise TrialError(f"this campaign keeps its logs {f'at {begun}: give --logs {begun}' if begun else f'in {out}'}")


def _version(noted: str) -> Version:
    record = json.loads(noted)
    return Version(tuple(map(tuple, record.pop("packages"))), **record)


def _identity(experiment: Experiment[Any, Any]) -> dict[str, str]:
    specification = experiment.specification
    return {"name": specification.name, "quick": json.dumps(specification.quick), "digest": experiment.digest}


def _read(database: Path) -> tuple[dict[str, str], set[str]]:
    try:
        with closing(sqlite3.connect(f"file:{database}?mode=rw", uri=True)) as connection:
            about = dict(connection.execute("SELECT name, value FROM campaign").fetchall())
            columns = {name for (name,) in connection.execute("SELECT name FROM pragma_table_info('results')")}
    except sqlite3.Error as error:
        raise TrialError(f"{database} cannot be read ({error}): choose another folder") from None
    return about, columns


@contextmanager
def campaign_database(folder: Path) -> Iterator[sqlite3.Connection]:
    """Give the database of a campaign's folder. Raises TrialError where it has none, or where that cannot be read."""
    database = folder / DATABASE
    if not database.exists():
        raise TrialError(f"{folder} is no campaign's folder: it has no {DATABASE}")
    try:
        with closing(sqlite3.connect(database)) as connection:
            yield connection
    except sqlite3.Error as error:
        raise TrialError(f"{database} cannot be read: {error}") from None
