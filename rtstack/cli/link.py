"""The arms of a cell, held softly by `rtstack check`: whether they stay, what they feel, and how good the link is."""

from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path

import numpy as np

from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.bench.hold import GOOD_RAD, ArmMoved, HoldEnded
from rtstack.bench.link import GOOD_SUCCESS, LinkBenchmark, bench_link
from rtstack.cells import default_cell_file, open_cell
from rtstack.cells.commissioning import sign as sign_step
from rtstack.cells.metal import box_states
from rtstack.check.arm import Felt, resting_findings, torques_finding
from rtstack.check.finding import Finding, finding
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.log.analysis.lateness import Blame, Lateness
from rtstack.loop.session import StopSignal
from rtstack.model.cell_description import CellDescription
from rtstack.model.tracker_description import NO_TRACKER
from rtstack.trials.errors import TrialError
from rtstack.trials.record import free_name
from rtstack.trials.sight import trouble_of

LINK_TICKS = 10_000
GOOD_LATE_SHARE = 1e-3  # ours: with them at random, 20 in a row never come
_LATE = {
    Blame.HOST: "keep the host for the loop: `sudo rtstack host-setup`; `rtstack review LOG` says what it did",
    Blame.WIRE: "a cable from a network card of its own to each box, no switch; see docs/howto/lateness.md",
    Blame.ROBOT: "the box itself was late: its logs in Desk, and Franka's support",
    Blame.ROBOT_OR_WIRE: "look at the cable first: see docs/howto/lateness.md",
}
_TELL_THE_TOOL = "tell robot (Desk) and cell file ([pad]) what is on the flange; do not touch an arm meanwhile"


def link_findings(
    kind: str, description: CellDescription, ticks: int = LINK_TICKS, cell_file: Path | None = None,
    sign: str | None = None, logs: Path = Path("logs"),
) -> list[Finding]:  # fmt: skip
    """Hold the arms of a cell for `ticks` ms, and judge whether they stay, what they feel, and the link.

    Real arms are held while a person holds the key, and need not have been measured. sign: who signs this step, where
    nothing has failed; logs: folder for the samples of real arms.
    """
    try:
        hold = HoldToRun(kind, description, cell_file or default_cell_file(), led=True)
        what = f"hold of the {' and '.join(description.sides)} arm for {ticks * 1e-3:g} s"
        opened = open_cell(kind, "", 0.0, 0, description, cell_file=cell_file, led=True)
        record = None
        if hold.needed:
            with suppress(OSError):  # what is written there says why it cannot be
                logs.mkdir(parents=True, exist_ok=True)
            record = free_name(logs, "check").with_suffix(".npz")
        with closing(opened) as cell, interruptible() as stop, hold.held(what, stop):
            found = [_tracker(cell, description), *held_findings(cell, ticks, description, stop, record)]
        if sign is not None and not any(each.verdict == "fail" for each in found):
            values = {each.name: f"{each.verdict}: {each.value}" for each in found}
            firmware = {side: state.version for side, state in box_states(description).items()}
            for side in description.sides:
                log = "" if record is None else record.name
                sign_step(f"hold {side}", sign, values, description, cell_file, firmware, log)
            found.append(Finding("signature", f"{sign}: hold {' and '.join(description.sides)}", "pass"))
        limits = Finding("limits", cell.warning, "warn", "correct the model, or leave it", "the tighter one holds")
        return found + [limits] * bool(cell.warning)
    except TrialError as error:
        return [Finding("cell for these arms", str(error), "fail", "do what it says", "nothing is connected")]
    except HardwareError as error:
        return [_ended(error)]


def _tracker(cell: Cell, description: CellDescription) -> Finding:
    """Judge what the tracker sends: required is that it can be read; an object need not be there."""
    unreadable = trouble_of(cell, description, "")
    said = unreadable or trouble_of(cell, description, next(iter(description.objects)))
    kind, cost = description.tracker.kind, "a run about an object is refused before the arms move"
    value = said or f"{kind} at {description.tracker.address} is read" * (kind != NO_TRACKER) or NO_TRACKER
    return finding("tracker", value, not said, cost, "docs/howto/tracker.md", required=bool(unreadable))


def held_findings(
    cell: Cell, ticks: int, description: CellDescription, stop: StopSignal | None = None, record: Path | None = None
) -> list[Finding]:
    """Judge an open cell and what its arms say while they are held, then stop them. record: see bench_link."""
    arms, mountings = cell.arms, description.arms
    resting: list[Finding] = []
    try:
        for side, arm, mounting in zip(cell.sides, arms, mountings, strict=True) if cell.link is not None else ():
            resting.append(torques_finding(side, arm.read(), mounting, description.pad))
        figures = bench_link(cell, ticks, description, stop, record)
    except HardwareError as error:
        return [*(each for each in resting if each.verdict != "pass"), _ended(error)]
    value = f"within {max(figures.hold_rad):.4f} rad and {max(figures.hold_rad_s):.3f} rad/s"
    value += f", with {max(figures.hold_nm):.1f} Nm at most"
    cost = "the robot does not carry all of its weight: the arms sag by as much against every reference"
    found = [finding("hold", value, max(figures.hold_rad) <= GOOD_RAD, cost, _TELL_THE_TOOL)]
    found += [_link(figures, cell.sides), *([] if figures.lateness is None else [_late(figures.lateness)])]
    for k, (arm, mounting) in enumerate(zip(arms, mountings, strict=True)):
        means = figures.tau_ext_mean_nm, figures.tau_ext_sd_nm, figures.O_F_ext_mean
        felt = Felt(*(np.array(rows[k]) for rows in means))
        found += resting_findings(cell.sides[k], arm.read(), felt, mounting, description.pad)
    return found


def _ended(error: HardwareError) -> Finding:
    """Return why the arms were not held to the end."""
    if isinstance(error, HoldEnded):
        return Finding("hold", str(error), "fail", "hold the key until it is over", "nothing was judged")
    if isinstance(error, ArmMoved):
        cost = "the arm falls, or rises, as soon as torque control starts"
        return Finding("hold", str(error), "fail", _TELL_THE_TOOL, cost)
    return Finding("link", "broken", "fail", str(error), "no motion")


def _late(lateness: Lateness) -> Finding:
    """Judge who was late: the advice is for whose share is the largest."""
    shares, good = lateness.shares, len(lateness.late) <= GOOD_LATE_SHARE * lateness.cycles
    advice = _LATE[Blame(max(shares, key=lambda name: shares[name]))] if shares else ""
    return finding("late cycles", lateness.line, good, "a late answer is a lost one; 20 in a row stop the arm", advice)


def _link(figures: LinkBenchmark, sides: Sequence[str]) -> Finding:
    means, lows = figures.success_rate_mean, figures.success_rate_min
    each = ", ".join(f"{mean:.3f} {side}" for side, mean in zip(sides, means, strict=True))
    value = f"success rate {each}, at least {min(lows):.2f}"
    value += f"; answered within {max(figures.answer_us_p99):.0f} us at p99"
    if figures.verdict == "pass":
        return Finding("link", value, "pass")
    advice = f"below {GOOD_SUCCESS}: a network and a host for the arms alone"
    return Finding("link", value, figures.verdict, advice, "a lost packet is a torque that comes too late")
