"""The client of Desk against the simulated robot's Desk, over HTTPS."""

import contextlib
import json
import shutil

import pytest

from hal.desk import DeskError, NotTrusted, SignIn, Trust
from hal.desk.client import Desk, fingerprint
from hal.desk.power import start, stop
from hal.desk.state import state_of
from tests.support.desk import desk_address, desk_of
from tests.support.fci.server import serve


@pytest.fixture
def trust(tmp_path):
    return Trust(tmp_path)


@pytest.fixture
def left(boxes, trust):
    with contextlib.closing(desk_of(boxes.left, trust)) as desk:
        yield desk
        list(stop(desk, trust, desk_address(boxes.left)))


def test_a_box_that_was_switched_on_is_locked_and_lets_no_fci_in(left):
    state = left.state()
    assert (state.status, state.operating_mode) == ("Started", "Execution")
    assert (state.brakes, state.fci) == ("locked", "Inactive")
    assert (state.version, state.serial, state.control) == ("5.9.2", "simulated-left", "")
    assert state.self_test == "OK"
    assert 86_000 < (state.self_test_s or 0) <= 86_400
    assert not state.ready


def test_who_starts_a_box_keeps_control_until_it_is_stopped(boxes, trust, left):
    address = desk_address(boxes.left)
    assert list(start(left, trust, address)) == ["control taken", "brakes unlocked", "FCI active"]
    assert (left.state().ready, left.state().control) == (True, "rtstack")
    with contextlib.closing(desk_of(boxes.left, trust)) as later:
        assert list(start(later, trust, address)) == ["FCI is active already"]
        assert list(stop(later, trust, address)) == ["FCI ended", "brakes locked", "control given back"]
    assert (left.state().fci, left.state().brakes, left.state().control) == ("Inactive", "locked", "")


def test_control_that_another_program_has_is_named(boxes, trust, left, tmp_path):
    with contextlib.closing(desk_of(boxes.left, trust)) as other:
        other.take_control()
        with pytest.raises(DeskError, match="control is with rtstack: give it back there"):
            left.take_control(0.1)
        other.release_control()
    assert left.take_control(0.1).number


def test_fci_needs_open_brakes_and_control(left):
    with pytest.raises(DeskError, match="X-Control-Token is missing"):
        left.activate_fci()
    left.take_control()
    with pytest.raises(DeskError, match=r"BrakesClosed.*unlock the joints first"):
        left.activate_fci()
    left.release_control()


def test_the_self_test_locks_the_brakes_while_it_runs(boxes, trust, left):
    address = desk_address(boxes.left)
    list(start(left, trust, address))
    said = list(start(left, trust, address, self_test=True))
    assert said[-3:] == ["the self-test is over", "brakes unlocked", "FCI active"]


def test_a_box_whose_self_test_is_overdue_starts_with_it_alone(trust):
    with serve("--lockstep", "--desk", "--self-test-due-s=0") as served:
        address = desk_address(served.right)
        with contextlib.closing(desk_of(served.right, trust)) as desk:
            assert desk.state().recovery == "SelfTestsElapsed"
            with pytest.raises(DeskError, match="self-test is overdue: run it"):
                list(start(desk, trust, address))
            assert "FCI active" in list(start(desk, trust, address, self_test=True))
            assert not desk.state().recovery


def test_reading_needs_no_password_and_changing_does(boxes, trust):
    with contextlib.closing(desk_of(boxes.left, trust, sign_in=None)) as reader:
        assert reader.state().status == "Started"
        with pytest.raises(DeskError, match="user or password is wrong, or missing"):
            reader.take_control()
    with (
        contextlib.closing(desk_of(boxes.left, trust, SignIn("franka", "guess"))) as wrong,
        pytest.raises(DeskError, match="user or password is wrong"),
    ):
        wrong.state()


def test_a_certificate_is_remembered_at_first_use_and_no_other_one_accepted(boxes, trust, tmp_path):
    left, right = map(desk_address, (boxes.left, boxes.right))
    with pytest.raises(NotTrusted, match="not used before"):
        Desk(left, trust)
    assert trust.remember(left) == fingerprint(trust.file(left).read_text())
    assert trust.file(left).stat().st_mode & 0o077 == 0
    trust.remember(right)
    shutil.copy(trust.file(right), trust.file(left))
    with (
        contextlib.closing(Desk(left, trust, SignIn("franka", "secret"))) as desk,
        pytest.raises(NotTrusted, match=rf"another certificate than before.*remove {trust.file(left)}"),
    ):
        desk.state()


def test_a_box_that_does_not_answer_is_named(trust, boxes):
    trust.remember(desk_address(boxes.left))
    shutil.copy(trust.file(desk_address(boxes.left)), trust.file("127.0.0.1:9"))
    with (
        contextlib.closing(Desk("127.0.0.1:9", trust, name="left box")) as desk,
        pytest.raises(DeskError, match=r"Desk of the left box at 127.0.0.1:9 does not answer: .*refused"),
    ):
        desk.state()


def test_control_is_kept_where_its_user_alone_can_read_it(boxes, trust, left):
    list(start(left, trust, desk_address(boxes.left)))
    file = trust.folder / f"{desk_address(boxes.left)}.control"
    assert file.stat().st_mode & 0o077 == 0
    assert left.control is not None
    assert json.loads(file.read_text()) == {"token": left.control.token, "number": left.control.number}
    assert left.control.token not in repr(left.control)


@pytest.mark.parametrize("answer", [None, [], {}, 5, "text", {"status": 7, "operatingMode": []}, [{"brakeStatus": {}}]])
def test_what_an_answer_lacks_is_unknown(answer):
    state = state_of(*[answer] * 7)
    assert not state.ready
    assert {state.fci, state.operating_mode} == {"unknown"} or answer == {"status": 7, "operatingMode": []}
