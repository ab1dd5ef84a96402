"""A campaign as an operator of the stack: it takes over, orders runs, pauses, and never arms after a STOP by itself."""

import shutil
import tempfile
from pathlib import Path

import pytest

from rtstack.cli.stack_operator import StackOperator
from rtstack.live.client import SOCKET_NAME
from rtstack.live.robot import Service
from rtstack.live.standalone import RINGS
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.safety.arming import Phase
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedMove
from rtstack.trials.placement import object_stands, prepare_placement
from rtstack.trials.specification import HandMotion, MoveSpecification, PlacementSpecification
from tests.support.console.client import wait_for
from tests.support.console.running_robot import CELL, RunningRobot

pytestmark = pytest.mark.alone
DESCRIPTION = load_cell_description(CELL)
START = PreparedMove(MoveSpecification(HandMotion.START, "rice_box"), DESCRIPTION)


@pytest.fixture
def robot(tmp_path):
    running = RunningRobot(tmp_path)
    folder = Path(tempfile.mkdtemp(prefix="rtstack-test-"))  # short: a socket's path has 107 letters at most
    service = Service(running.job_manager, folder / SOCKET_NAME)
    (folder / RINGS).write_text(running.rings.name)
    running.socket = folder / SOCKET_NAME
    yield running
    service.close()
    running.close()
    shutil.rmtree(folder)


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "campaigns" / "one"
    folder.mkdir(parents=True)
    return folder


def armed_by_anna(robot):
    robot.authority.take("anna")
    robot.authority.arm("anna")


def test_it_takes_over_from_who_has_armed_and_its_runs_leave_their_logs_in_its_folder(robot, out):
    operator = StackOperator(robot.socket, "one", out)
    with pytest.raises(TrialError, match="take control and arm the arms on the page first"), operator.watched():
        pass
    armed_by_anna(robot)
    operator = StackOperator(robot.socket, "one", out)
    assert (operator.kind, operator.sets_object) == ("direct", True)
    log = out / "resets" / "first.mcap"
    with operator.kept_cell(START) as cell, operator.watched():
        assert robot.authority.view().holder == "campaign one"
        wait_for(lambda: cell.arms[0].read().record["t_ns"][0] > 0)
        assert abs(object_stands(cell, DESCRIPTION, next(iter(DESCRIPTION.objects))).y_m) < 0.01
        assert operator.carry_out(START, log, {"id": "a case"}).success
        with pytest.raises(TrialError, match="nothing is held"):  # refused by the robot process before it begins
            operator.carry_out(PreparedMove(MoveSpecification(HandMotion.PUT_DOWN), DESCRIPTION), out / "down.mcap")
        assert operator.paused == operator.stopped == ""
    assert read_log(log).metadata["campaign"] == {"id": "a case"}
    assert not list(robot.logs.glob("*.mcap"))
    view = robot.authority.view()
    assert (view.holder, view.phase) == (None, Phase.DISARMED)


def test_after_a_stop_a_person_goes_on_and_one_who_takes_over_ends_it(robot, out):
    armed_by_anna(robot)
    operator = StackOperator(robot.socket, "one", out)
    with operator.watched():
        robot.authority.stop("anna")
        for _ in range(3):
            assert operator.paused.startswith("the arms were disarmed: press Go on")
            assert robot.authority.view().phase is Phase.DISARMED
        (out / "pause.txt").unlink()
        assert operator.paused == ""
        assert robot.authority.view().phase is Phase.ARMED
        (out / "pause.txt").write_text("paused by ben")
        assert operator.paused.startswith("paused by ben: press Go on")
        robot.authority.take("anna", over_from="campaign one")
        wait_for(lambda: operator.stopped == "anna has control now")
        (out / "pause.txt").unlink()
        with pytest.raises(TrialError, match="anna has control"):
            operator.carry_out(START, out / "after.mcap")
    assert robot.authority.view().holder == "anna"
    assert not (out / "after.mcap").exists()


def test_a_folder_that_is_not_among_the_logs_is_refused(robot, tmp_path_factory):
    with pytest.raises(TrialError, match="give a folder in it"):
        StackOperator(robot.socket, "one", tmp_path_factory.mktemp("elsewhere"))


def test_a_placement_is_a_run_of_the_robot_process(robot, out):
    armed_by_anna(robot)
    operator = StackOperator(robot.socket, "one", out)
    prepared = prepare_placement(PlacementSpecification(next(iter(DESCRIPTION.objects)), y_mm=20.0), DESCRIPTION)
    with operator.watched():
        result = operator.carry_out(prepared, out / "placed.mcap")
    assert result.success, result.failure_reason
    assert result.off_mm < 5.0
