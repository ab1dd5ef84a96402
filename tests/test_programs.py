"""Programs and studies: each says what it shows and how long it takes, and one helper makes their command lines."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from tests.programs import BAD_INPUT, INTERRUPTED, program
from tests.programs.__main__ import programs
from tests.studies.__main__ import NAMES, kind_of

ROOT = Path(__file__).resolve().parents[1]


def act(what: str, times: int = 1, loud: bool = False) -> int:
    """Do what is asked."""
    if what == "wait":
        raise KeyboardInterrupt
    if what == "refuse":
        raise typer.BadParameter("not this")
    return times + 10 * loud


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["x"], 1, ""), (["x", "--times", "0"], 0, ""), (["x", "--loud"], 11, ""),
        (["wait"], INTERRUPTED, "test_programs: ended"), (["refuse"], BAD_INPUT, "test_programs: .*not this"),
        (["x", "--times", "two"], BAD_INPUT, "test_programs: .*--times"), ([], BAD_INPUT, "test_programs: Missing"),
        (["x", "--no-loud"], BAD_INPUT, "test_programs: .*--no-loud"),
    ],
)  # fmt: skip
def test_a_signature_is_a_command_line_and_its_ends_are_one_line(words, status, said, capsys, monkeypatch):
    monkeypatch.setattr("tests.programs.signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        program(act, words)
    assert ended.value.code == status
    errors = capsys.readouterr().err
    assert errors.count("\n") == bool(said)
    assert re.match(said, errors)


def test_the_list_says_of_each_what_it_shows_and_how_long_it_takes():
    found = programs()
    assert {path.stem for path in (ROOT / "tests/programs").glob("[!_]*.py")} <= set(found)
    for name, (shows, takes) in found.items():
        assert shows.endswith((".", "?")), name
        assert takes.startswith("Takes "), name
    assert all(kind_of(name).COLUMNS for name in NAMES)


def test_an_unknown_program_is_one_line():
    command = [sys.executable, "-m", "tests.programs", "no-such"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (BAD_INPUT, 1)
