"""The tables of what the simulated robot does: fields of its state, errors, replies; from fidelity.toml beside this."""

import re
import tomllib
from pathlib import Path
from typing import Any

TABLES = Path(__file__).with_name("fidelity.toml")
PROFILES = Path(__file__).parents[2] / "sim_robot/parameters/profiles"
_LINE = re.compile(r"(?:\[(?P<table>\w+)\])|(?P<key>\w+) = (?P<value>[^#]*?)\s*(?:#\s*(?P<why>.*))?$")


def read_tables() -> dict[str, dict[str, dict[str, Any]]]:
    """Return fields, errors and commands: what stands for each name."""
    return tomllib.loads(TABLES.read_text())


def fidelity_fields() -> str:
    """Return the table of RobotState's fields, in Markdown."""
    rows = [f"| `{name}` | {entry['by']} | {_test(entry)} |" for name, entry in read_tables()["fields"].items()]
    return "\n".join(["| field | what fills it | shown by |", "|---|---|---|", *rows])


def fidelity_errors() -> str:
    """Return the table of the 41 errors, in Markdown, under how many of them can come."""
    errors = read_tables()["errors"]
    raised = [entry for entry in errors.values() if "by" in entry]
    head = f"{len(raised)} of {len(errors)} come from physics or from the wire; a faults file (`reflex`) raises any."
    rows = []
    for name, entry in errors.items():
        what = f"{entry['by']} | {_test(entry)}" if "by" in entry else f"never: {entry['never']} | "
        rows.append(f"| `{name}` | {what} |")
    return "\n".join([head, "", "| error | what raises it | shown by |", "|---|---|---|", *rows])


def fidelity_commands() -> str:
    """Return the table of requests and their replies, in Markdown."""
    rows = [
        f"| {name} | {'; '.join(f'{reply}: {when}' for reply, when in entry['replies'].items())} | {_test(entry)} |"
        for name, entry in read_tables()["commands"].items()
    ]
    return "\n".join(["| request | replies | shown by |", "|---|---|---|", *rows])


def fidelity_profiles() -> str:
    """Return the table of the profiles' numbers, in Markdown, with the source that the honest one's file names."""
    read = {name: _profile(PROFILES / f"{name}.toml") for name in ("ideal", "honest", "harsh")}
    rows = [
        f"| `{key}` | {' | '.join(read[name][key][0] for name in read)} | {why} |"
        for key, (_, why) in read["honest"].items()
    ]
    return "\n".join(["| number | ideal | honest | harsh | source of the honest one |", "|---|---|---|---|---|", *rows])


def _profile(path: Path) -> dict[str, tuple[str, str]]:
    """Return value and comment of each key; of a key without one, what stands above its table."""
    found: dict[str, tuple[str, str]] = {}
    table, above, comments = "", "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            comments.append(line.removeprefix("#").strip())
        elif match := _LINE.match(line):
            if match["table"]:
                table, above, comments = match["table"], "", []
                continue
            above, comments = " ".join(comments) or above, []
            values = [float(word) for word in match["value"].strip("[]").split(",")]
            found[f"{table}.{match['key']}"] = ", ".join(f"{value:g}" for value in values), match["why"] or above
    return found


def _test(entry: dict[str, Any]) -> str:
    file, _, function = entry["test"].partition("::")
    return f"`{Path(file).stem}`" + (f" `{function}`" if function else "")
