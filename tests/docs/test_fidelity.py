"""The page of what the simulated robot does names what the code has, and tests that exist."""

import ast
import sys
from pathlib import Path

import pytest

from hal.robot_errors import ROBOT_ERRORS
from sim_robot.fci.protocol import ROBOT_STATE, Command, ConnectStatus, MoveStatus, RecoveryStatus, SetStatus

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/generate"))

from fidelity import read_tables  # noqa: E402

STATUSES = {
    Command.CONNECT: ConnectStatus,
    Command.MOVE: MoveStatus,
    Command.AUTOMATIC_ERROR_RECOVERY: RecoveryStatus,
}


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
