"""What has to hold before arms that are not simulated are connected to: the only list of it.

`check_real_cell` compares what files and addresses say; `check_measured` asks whether the geometry was measured, except
where a person leads the arms, so that it is measured; `check_boxes` compares what the control boxes themselves say.

The safety judge, the start motion and the plans believe a cell's geometry, and arms that repeat what was shown to them
cannot see that their bases stand elsewhere. So the file has to be one that a person wrote for these arms, at whatever
address they are (a tunnel's, too), and that says when they were measured.
"""

from collections.abc import Sequence
from contextlib import closing
from datetime import date, timedelta
from ipaddress import ip_address
from pathlib import Path

from hal.desk import Desk, DeskState, Trust
from rtstack.cells.commissioning import digest, known_firmware, signatures
from rtstack.cells.description import default_cell_file
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError

LARGEST_RMS_MM = 3.0  # ours: at 0.4 m/s an object that is 3 mm off is met 7.5 ms early; the runbook aims at 2 mm
_GRACE = timedelta(days=1)  # it was written in another time zone


def on_this_machine(address: str) -> bool:
    """Return whether an address is this machine's alone (loopback). A name is resolved elsewhere, so it is not."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return False


def _real(addresses: Sequence[str]) -> list[str]:
    return [address for address in addresses if not on_this_machine(address)]


def check_real_cell(addresses: Sequence[str], description: CellDescription, cell_file: Path | None) -> None:
    """Refuse arms at these addresses, one of each, that are not this machine's, or that the cell's file does not call
    simulated, unless that file is theirs.

    Connects to nothing. Raises TrialError with one line.
    """
    real = _real(addresses)
    if not real and description.simulated:
        return
    arms = f"the arm at {(real or addresses)[0]} is no simulated one" + (" of this machine" if real else "")
    if cell_file is None or cell_file.resolve() == default_cell_file().resolve():
        raise TrialError(f"{arms}: name the file of its own cell with --cell-file (docs/runbook/calibration.md)")
    if description.simulated:
        raise TrialError(
            f"{arms}, and {cell_file} says simulated = true: measure the cell, then write simulated = false"
        )
    if len(real) == 1 and len(addresses) == 2:
        raise TrialError(f"{arms}, the other arm is: a cell has two real arms, or two simulated ones")
    for side, given, mounting in zip(description.sides, addresses, description.arms, strict=True):
        if given != mounting.address:
            raise TrialError(
                f"the {side} arm is asked for at {given}, and {cell_file} has it at {mounting.address}: "
                f"correct the one that is wrong ([{side}] address)"
            )


def check_measured(addresses: Sequence[str], description: CellDescription, cell_file: Path | None) -> None:
    """Refuse the same arms unless the cell's file, which `check_real_cell` has let pass, says that it was measured,
    not too long ago and well enough. Raises TrialError with one line."""
    if cell_file is None or (description.simulated and not _real(addresses)):
        return
    calibration = description.calibration
    if calibration is None:
        raise TrialError(
            f"{cell_file} does not say when its geometry was measured: measure it (rtstack calibrate --write)"
        )
    today = date.today()
    if calibration.date > today + _GRACE:
        raise TrialError(f"{cell_file}: [calibration] date = {calibration.date} is after today, {today}: correct it")
    ends = calibration.date + timedelta(days=calibration.valid_days)
    if ends < today:
        raise TrialError(
            f"{cell_file}: the calibration of {calibration.date} was valid until {ends}: measure the cell again, "
            "then write the new date under [calibration]"
        )
    if calibration.rms_mm is None:
        raise TrialError(
            f"{cell_file}: [calibration] has no rms_mm, and a date alone is no measurement: rtstack calibrate --write"
        )
    for name, mm in (("rms_mm", calibration.rms_mm), ("uncertainty_mm", calibration.uncertainty_mm)):
        if mm is not None and mm > LARGEST_RMS_MM:
            raise TrialError(f"{cell_file}: [calibration] {name} = {mm:g} is above {LARGEST_RMS_MM:g}: measure again")
    written = date.fromtimestamp(cell_file.stat().st_mtime)
    if written + _GRACE < calibration.date:
        raise TrialError(
            f"{cell_file} was written on {written}, before its calibration of {calibration.date}: "
            "take the measured numbers over into the file"
        )
    if not {"ee_lower", "ee_upper"} <= description.safety.keys():
        raise TrialError(f"{cell_file} has no box for the pads: write ee_lower and ee_upper under [safety]")
    for side, arm in description.mountings.items():
        if not arm.serial and not on_this_machine(arm.address):
            raise TrialError(
                f"{cell_file} does not say which box the {side} arm has: write its serial number, which `rtstack desk "
                f"status` says, under [{side}]"
            )


def box_states(description: CellDescription) -> dict[str, DeskState]:
    """Return what Desk reports of each box whose serial number the cell's file has, by side. Raises HardwareError where
    Desk does not answer or is not trusted."""
    trust, states = Trust(), dict[str, DeskState]()
    for side, arm in description.mountings.items():
        if arm.serial:
            with closing(Desk(arm.desk, trust, name=f"{side} box")) as desk:
                states[side] = desk.state()
    return states


def check_boxes(description: CellDescription, cell_file: Path | None, led: bool) -> None:
    """Compare each box whose serial number the cell's file has with that file: is it that one (exchanged boxes have
    each other's arm behind them), and does it let FCI in? led: a changed firmware is not looked at, since the arms are
    about to be held for the record.

    Raises TrialError with one line, HardwareError as `box_states`.
    """
    mountings, states = description.mountings, box_states(description)
    held = known_firmware(signatures(cell_file)) if cell_file is not None and not led else {}
    for side, state in states.items():
        expected = mountings[side].serial
        if state.serial != expected:
            other = next((name for name, arm in mountings.items() if name != side and arm.serial == state.serial), "")
            why = f"that is the {other} one: they are exchanged" if other else "another box stands there"
            raise TrialError(
                f"the {side} box at {mountings[side].desk} says that it is {state.serial}, and the cell's file has "
                f"{expected}: {why}; correct addresses or cables, and measure the cell again if an arm was moved"
            )
    for side, state in states.items():
        if not state.ready:
            reasons = "; ".join(state.obstacles) or f"brakes {state.brakes}, FCI {state.fci}: `rtstack desk start`"
            raise TrialError(f"the {side} box lets no program move its arm: {reasons}")
        if held.get(side, digest(state.version)) != digest(state.version):
            raise TrialError(
                f"the {side} box has system version {state.version}, and its arm was held with another one: "
                f"rtstack check --{side} {mountings[side].address} --sign NAME, and the steps that it opens"
            )
