"""Tables of the documentation name what the code has, and tests that exist."""

import ast
import re
import sys
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest

from hal.robot_errors import ROBOT_ERRORS
from hal.wire import ROBOT_STATE
from rtstack.loop.end import End
from rtstack.safety.reasons import Cause
from sim_robot.faults.file import faults_in
from sim_robot.faults.kinds import KINDS
from sim_robot.fci.protocol import Command, ConnectStatus, MoveStatus, RecoveryStatus, SetStatus, StopStatus

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/generate"))

from fidelity import read_tables  # noqa: E402
from watchdogs import WATCHDOGS  # noqa: E402

STATUSES = {
    Command.CONNECT: ConnectStatus, Command.MOVE: MoveStatus, Command.STOP_MOVE: StopStatus,
    Command.AUTOMATIC_ERROR_RECOVERY: RecoveryStatus,
}  # fmt: skip


def test_every_field_error_and_request_has_its_row() -> None:
    tables = read_tables()
    assert tuple(tables["fields"]) == ROBOT_STATE.names
    assert tuple(tables["errors"]) == ROBOT_ERRORS
    assert list(tables["commands"]) == [command.name for command in Command]
    for name, entry in tables["commands"].items():
        known = set(STATUSES.get(Command[name], SetStatus).__members__)
        assert set(entry["replies"]) <= known, name


@pytest.mark.parametrize("table", ["fields", "errors", "commands"])
def test_the_tests_that_are_named_exist(table: str) -> None:
    for name, entry in read_tables()[table].items():
        if "never" in entry:
            continue
        file, _, function = entry["test"].partition("::")
        functions = {
            node.name for node in ast.parse((ROOT / file).read_text()).body if isinstance(node, ast.FunctionDef)
        }
        assert not function or function in functions, name


def test_an_error_with_a_test_is_named_there() -> None:
    for name, entry in read_tables()["errors"].items():
        if "test" in entry:
            assert name in (ROOT / entry["test"].partition("::")[0]).read_text(), name


def test_every_test_that_a_hazard_names_is_there():
    text = (ROOT / "docs/reference/hazards.md").read_text()
    named = re.findall(r"`(tests/[\w/.]+)`", text)
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).is_file()] == []


FAULT_SCRIPTS = (Path(__file__).parents[2] / "docs" / "fault_scripts.md").read_text()


def test_every_kind_is_in_the_table_with_its_keys():
    rows = dict(re.findall(r"^\| `(\w+)`([^|]*\|[^|]*)\|", FAULT_SCRIPTS, re.MULTILINE))
    kinds = {name: row for name, row in rows.items() if name in KINDS}
    assert kinds.keys() == KINDS.keys()
    for name, row in kinds.items():
        effect = KINDS[name]
        assert set(re.findall(r"`(\w+)`", row)) == {field.name for field in fields(effect)}, name
        assert ("of no arm" in row) == (not effect.of_an_arm), name
        assert ("of the link" in row) == effect.of_the_link, name


def test_the_example_is_taken():
    example = FAULT_SCRIPTS.split("```toml", 1)[1].split("\n", 1)[1].split("```", 1)[0]
    assert [fault.effect.kind for fault in faults_in(tomllib.loads(example), "the page")] == ["push", "reflex"]


def test_every_fault_of_a_session_has_its_watchdog():
    reasons = {entry.reason for entry in WATCHDOGS}
    assert {end for end in End if end.is_fault} - {End.SAFETY} <= reasons
    by_time = (Cause.NOT_FINITE, Cause.STATE_AGE, Cause.STATE_GAP, Cause.TIME_BACKWARDS, Cause.PAIR_SKEW)
    assert {reason.text for reason in by_time} <= reasons
    assert len({entry.name for entry in WATCHDOGS}) == len(WATCHDOGS)
