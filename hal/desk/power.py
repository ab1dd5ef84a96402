"""The way of one box from switched on to FCI let in, and back: the steps that a person clicks on the Desk page."""

import json
from collections.abc import Iterator
from pathlib import Path

from hal.base.files import write_whole
from hal.desk.client import Control, Desk, DeskError, Trust


def control_file(trust: Trust, address: str) -> Path:
    return trust.folder / f"{address}.control"


def adopt(desk: Desk, trust: Trust, address: str) -> bool:
    """Go on with control that was kept, where it still counts. Raises DeskError, NotTrusted."""
    try:
        kept = json.loads(control_file(trust, address).read_text())
        desk.control = Control(str(kept["token"]), int(kept["number"]))
    except (OSError, ValueError, KeyError, TypeError):
        return False
    if not desk.has_control():
        desk.control = None
    return desk.control is not None


def start(desk: Desk, trust: Trust, address: str, self_test: bool = False) -> Iterator[str]:
    """Take control, unlock the brakes, change to Execution, activate FCI; give a line for each step that was needed.

    Control is kept for `stop`. self_test: run it before, also where it is overdue. Raises NotTrusted, DeskError with
    what a person has to do first.
    """
    state = desk.state()
    if state.obstacles and not (self_test and state.recovery == "SelfTestsElapsed"):
        raise DeskError(f"{desk.called}: {'; '.join(state.obstacles)}")
    if state.ready and not self_test:
        yield "FCI is active already"
        return
    yield from _control(desk, trust, address)
    if self_test:
        if state.fci == "Active":
            desk.deactivate_fci()
        desk.lock()
        yield "the safety self-test runs: it takes minutes"
        desk.self_test()
        state = desk.state()
        yield "the self-test is over"
    if state.brakes != "unlocked":
        desk.unlock()
        yield "brakes unlocked"
    if state.operating_mode != "Execution":
        desk.execution()
        yield "Execution"
    desk.activate_fci()
    yield "FCI active"
    if not (after := desk.state()).ready:
        raise DeskError(f"{desk.called}: brakes {after.brakes}, FCI {after.fci}: look at its Desk page")
    if after.warning:
        yield f"warning: {after.warning}"


def stop(desk: Desk, trust: Trust, address: str, shut_down: bool = False) -> Iterator[str]:
    """End FCI, lock the brakes, give control back; shut the box down where that is asked for. Raises as `start`."""
    yield from _control(desk, trust, address)
    state = desk.state()
    if state.fci != "Inactive":
        desk.deactivate_fci()
        yield "FCI ended"
    if state.brakes != "locked":
        desk.lock()
        yield "brakes locked"
    if shut_down:
        desk.shut_down()
        yield "it shuts down: wait until the lights at its base are off, then switch the box off"
    else:
        desk.release_control()
        control_file(trust, address).unlink(missing_ok=True)
        yield "control given back"


def _control(desk: Desk, trust: Trust, address: str) -> Iterator[str]:
    if not (desk.has_control() or adopt(desk, trust, address)):
        control = desk.take_control()
        content = json.dumps({"token": control.token, "number": control.number})
        write_whole(control_file(trust, address), content, mode=0o600)
        yield "control taken"
