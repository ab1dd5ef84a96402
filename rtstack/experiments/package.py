"""A campaign's folder as a data set to publish: datapackage.json (a Frictionless Data Package) and SHA256SUMS."""

import csv
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from hal.base.files import write_whole
from rtstack.experiments.report import NUMBERS, PAGE
from rtstack.experiments.store import ATTEMPTS, DATABASE, RESULTS, TIMES, campaign_database
from rtstack.trials.errors import TrialError

SUMS, README, DESCRIPTION = "SHA256SUMS", "README.md", "datapackage.json"
# how a column's name ends -> its unit; the longest that fits counts
UNITS = {
    "m": "m", "mm": "mm", "m_s": "m/s", "s": "s", "ms": "ms", "us": "us", "n": "N", "nm": "Nm", "ns": "Ns",
    "n_m": "N/m", "deg": "degree", "rad": "rad", "us_p50": "us", "us_p99": "us",
}  # fmt: skip
_WORDS = {RESULTS: "a line a case", TIMES: "what the host made of each case", ATTEMPTS: "a line an attempt on the arms"}


def pack(folder: Path, progress: Callable[[float], None] | None = None) -> Path:
    """Write README.md, datapackage.json and SHA256SUMS into a campaign's folder; return the last one's path.

    progress: called with the share of checksums done. Raises TrialError for a folder without a campaign or report.
    """
    with campaign_database(folder) as connection:
        if not (folder / PAGE).exists():
            raise TrialError(f"{folder} has no report yet: run its campaign to the end with --resume")
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")  # all is in the one file
        about = dict(connection.execute("SELECT name, value FROM campaign").fetchall())
    tables = {name: _schema(folder / name) for name in _WORDS if (folder / name).exists()}
    write_whole(folder / DESCRIPTION, json.dumps(_description(about, tables), indent=1) + "\n")
    write_whole(folder / README, _readme(about, tables))
    files = sorted(_files(folder))
    lines = []
    for k, path in enumerate(files):
        if progress is not None:
            progress(k / len(files))
        with open(path, "rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.relative_to(folder).as_posix()}\n")
    write_whole(folder / SUMS, "".join(lines))
    return folder / SUMS


def unit_of(column: str) -> str:
    """Return the unit that a column's name ends with, "" for none."""
    fits = [ending for ending in UNITS if column.endswith(f"_{ending}")]
    return UNITS[max(fits, key=len)] if fits else ""


def _files(folder: Path) -> Iterator[Path]:
    for path in folder.rglob("*"):
        aside = path.name.startswith(".") or path.name.startswith(f"{DATABASE}-") or path == folder / SUMS
        if path.is_file() and not aside:
            yield path


def _schema(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        seen: dict[str, set[str]] = {name: set() for name in reader.fieldnames or ()}
        for row in reader:
            for name, text in row.items():
                seen[name].add(_type_of(text))
    return [
        {"name": name, "type": _common(kinds - {""})} | ({"unit": unit} if (unit := unit_of(name)) else {})
        for name, kinds in seen.items()
    ]


def _type_of(text: str) -> str:
    if text in ("True", "False"):
        return "boolean"
    for kind, read in (("integer", int), ("number", float)):
        try:
            read(text)
        except ValueError:
            continue
        return kind
    return "string" if text else ""


def _common(kinds: set[str]) -> str:
    if len(kinds) == 1:
        return kinds.pop()
    return "number" if kinds and kinds <= {"integer", "number"} else "string"


def _description(about: Mapping[str, str], tables: Mapping[str, list[dict[str, str]]]) -> dict[str, Any]:
    resources = [
        {
            "name": path.removesuffix(".csv"), "path": path, "title": _WORDS[path], "profile": "tabular-data-resource",
            "schema": {"fields": fields},
        }
        for path, fields in tables.items()
    ]  # fmt: skip
    return {
        "name": about["name"], "title": about.get("title", about["name"]), "profile": "tabular-data-package",
        "resources": resources,
        "rtstack": {key: about[key] for key in ("digest", "plan_digest", "plan_commit")}
        | {"made_by": json.loads(about.get("version", "{}"))},
    }  # fmt: skip


def _readme(about: Mapping[str, str], tables: Mapping[str, list[dict[str, str]]]) -> str:
    lines = [
        f"# {about.get('title', about['name'])}", "",
        f"The campaign `{about['name']}` of rtstack: plan fixed by commit `{about['plan_commit']}`, SHA-256 of its "
        f"file `{about['plan_digest']}`, digest of all that rows depend on `{about['digest']}`.", "",
        f"- `report.html`, `{NUMBERS}`, `figures/`: claims, tables, figures.",
        "- `sources/`: the plan and the files of cell and robot that rows depend on, as they were.",
        "- `logs/`, `references/`: MCAP files, a trial or a recording each; their metadata has the settings, the cell "
        "and the versions of all packages.",
        f"- `{DATABASE}`: the tables below, as SQLite.",
        f"- `{DESCRIPTION}`: the tables' columns as a Frictionless Data Package.",
        "", "Check the files with `sha256sum --check --quiet SHA256SUMS`.",
    ]  # fmt: skip
    for path, fields in tables.items():
        lines += ["", f"## {path}: {_WORDS[path]}", "", "| column | type | unit |", "|---|---|---|"]
        lines += [f"| {field['name']} | {field['type']} | {field.get('unit', '')} |" for field in fields]
    return "\n".join(lines) + "\n"
