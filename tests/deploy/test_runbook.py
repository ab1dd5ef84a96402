"""The runbook knows every error of the code, every light of the page, and only pages and commands that exist."""

import re
import sys
from pathlib import Path

import pylibfranka
import pytest
from typer.testing import CliRunner

from hal.robot_errors import ROBOT_ERRORS
from rtstack.cli.app import app
from rtstack.loop.end import End
from rtstack.palette import MODE_STYLES
from rtstack.safety.arming import Phase
from rtstack.safety.reasons import Cause

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/generate"))

from watchdogs import WATCHDOGS  # noqa: E402

RUNBOOK = ROOT / "docs/runbook"
PAGES = sorted(RUNBOOK.glob("*.md"))
# what a watchdog only passes on, or says in other words
SAID = {name for entry in WATCHDOGS for name in re.split(r", (?=the |joint|cartesian)", str(entry.reason))}


# what libfranka says where it does not get as far as a motion, and types of a recovery on Desk
REFUSALS = (
    "Connection to FCI refused",
    "Connection timeout",
    "Incompatible library version",
    "UDP receive",
    "TCP connection got interrupted",
    "command not possible in the current mode",
    "command rejected due to activated safety function",
    "manual error recovery required",
)
DESK = ("SelfTestsElapsed", "SafetyError")


def rows(page: str) -> dict[str, list[str]]:
    """Return the table rows of a page by their first cell."""
    found = {}
    for line in (RUNBOOK / page).read_text().splitlines():
        if line.startswith("| ") and not line.startswith("|---"):
            first, *rest = (cell.strip() for cell in line.strip("|").split(" | "))
            assert first not in found or page != "recovery.md" or first in ("reason", "name", "message"), (
                f"{first} is there twice"
            )
            found[first.strip(" `")] = rest
    return found


@pytest.mark.parametrize(
    "names",
    [ROBOT_ERRORS, [reason.text for reason in Cause if reason is not Cause.NONE], list(End), sorted(SAID)],
    ids=["robot", "judge", "ends", "watchdogs"],
)
def test_every_error_has_a_cause_and_an_answer(names):
    known = rows("recovery.md")
    assert [name for name in map(str, names) if not all(known.get(name, [""]))] == []


def test_no_error_is_told_that_nobody_can_raise():
    known = set(rows("recovery.md")) - {"name", "reason", "end", "message"}
    assert known - {*ROBOT_ERRORS, *(reason.text for reason in Cause), *End, *SAID, *REFUSALS, *DESK} == set()


def test_what_connecting_is_refused_with_are_the_words_of_the_vendor_s_library():
    assert pylibfranka.__file__ is not None
    package = Path(pylibfranka.__file__).parent
    folders = (package, package.with_name("pylibfranka.libs"))
    library = b"".join(file.read_bytes() for folder in folders for file in folder.glob("*.so*"))
    # two of them have a word in between: "command rejected: command not possible ..."
    assert [words for words in REFUSALS if words.removeprefix("TCP ").encode() not in library] == []
    known = rows("recovery.md")
    assert [words for words in (*REFUSALS, *DESK) if not all(known.get(words, [""]))] == []


def test_every_light_has_its_meaning():
    known = {word for first in rows("lights.md") for word in first.split(", ")}
    bar = (ROOT / "console/static/js/bar.js").read_text()
    table = bar[bar.index("const ROBOT_WORDS") :]
    words = re.findall(r'[A-Z_]+: "([a-z -]+)"', table[: table.index("};")])
    assert len(words) == 8
    modes = {style.word for style in MODE_STYLES.values()}
    assert {*words, *map(str, Phase), "waiting", "fault", *modes} - known == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_page_that_is_named_is_there(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert (RUNBOOK / target).is_file(), target
    assert page.name == "index.md" or f"({page.name})" in (RUNBOOK / "index.md").read_text()


def test_every_command_and_option_that_is_named_is_there():
    commands = set()
    for page in PAGES:
        text = page.read_text()
        code = [*re.findall(r"`([^`]+)`", text), *re.findall(r"^(?:    )+(.*)$", text, re.MULTILINE)]
        for line in (re.sub(r"\s+", " ", part) for part in code):
            commands |= set(re.findall(r"(?:^|/|sudo |then )rtstack ((?:logs |desk )?[a-z][a-z-]+)(.*)", line))
    assert len(commands) > 12
    help_of: dict[str, str] = {}
    for name, rest in sorted(commands):
        if name not in help_of:
            done = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "400"})
            assert done.exit_code == 0, name
            help_of[name] = done.stdout
        for option in re.findall(r"--[a-z-]+", rest):
            assert re.search(rf"{option}\b", help_of[name]), (name, option)
