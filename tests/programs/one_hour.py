"""One hour on one FR3: what rtstack counts on and no arm has shown yet, beside what is found.

The steps have the numbers of docs/runbook/unproven.md. Before each one stands what happens and what you do; Enter
begins it, s leaves it out, q ends for now. A step that is in the folder is not run again: the same command goes on.
Nothing moves unless you hold the space bar; torques go through the judge, below 0.25 m/s and 65 N. Steps in which
answers are lost, a torque steps, or a stop is needed ask for a word first. Steps 1 to 15 take an arm whose cell was not
measured; from 16 on it has to be.

At the end stand a table and one zip, without names of users, PCs or networks. It is for `rtstack sim` too: with --short
a rehearsal.

Takes an hour, and a person; with --short and a simulated arm ten minutes.
"""

import traceback
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from hal.errors import HardwareError
from hal.fci.faults import VENDOR
from rtstack.cells import load_description
from rtstack.trials.errors import TrialError
from tests.programs import program
from tests.support.hour import held, measured, still
from tests.support.hour.lab import (
    Found,
    HourTerminal,
    Lab,
    Skipped,
    Step,
    ask,
    at_a_terminal,
    in_reflex,
    recovered,
    say,
)
from tests.support.hour.pack import Results
from tests.support.hour.runs import capped

STEPS = (
    Step(1, "host", "this PC", 3, "Looks at versions and kernel, and compiles the controller as on a new PC.",
         "Nothing.", still.host, moves=False),
    Step(2, "connection", "connection", 1, "Connects seven times, and reads the box's limits.", "Nothing.",
         still.connection, moves=False),
    Step(3, "desk", "Desk", 1, "Reads Desk without a password, where the cell's file names it.", "Nothing.", still.desk,
         moves=False),
    Step(4, "settings", "settings", 1, "Sets load, end effector and thresholds, and reads them back.", "Nothing.",
         still.settings, moves=False),
    Step(5, "rest", "arm at rest", 1, "Reads the arm for 20 s.", "Do not touch it.", still.resting, moves=False),
    Step(6, "gripper", "hand", 1, "Asks whether a Franka Hand answers. Nothing moves.", "Nothing.", still.gripper,
         moves=False),
    Step(7, "hold", "hold", 2, "Holds the arm softly where it stands, 10 s.", "Hold the space bar until it is over.",
         held.hold),
    Step(8, "starts", "start and stop", 3, "Begins and ends torque control ten times, where the arm stands.",
         "Hold the space bar until it is over.", held.starts),
    Step(9, "echo", "each joint by a degree", 3, "Turns each joint by a degree and back.",
         "Look that there is room for a degree. Hold the space bar until it is over.", held.wiggles),
    Step(10, "guide", "led by hand", 5, "The arm has no torque but damping; three times 20 s.",
         "Hold the space bar with one hand; push, pull and lead the pad with the other one. At last leave it 30 cm "
         "away from everything.", held.guide),
    Step(11, "weight", "a known weight", 5, "Reads the arm with a weight at its pad, then holds it softly.",
         "Have 0.5 to 1 kg and a strap ready, and its mass in g. Nothing below it, and no foot.", held.weight),
    Step(12, "steps", "steps of the torque", 3, "Steps each joint's goal by 0.6 degrees: a short knock.",
         "Hold the space bar until it is over.", held.torque_steps, "knock"),
    Step(13, "losses", "lost answers", 4, "Holds, and leaves out 1, 2, 5, 10 answers; then 25: the arm brakes hard.",
         "Hold the space bar; look at the arm, then let it recover.", held.losses, "lose"),
    Step(14, "thresholds", "the box's own reflex", 3, "Lowers the box's thresholds to 15 N, and holds for 20 s.",
         "Hold the space bar; push the pad from the side with the other hand, slowly, until it stops.", held.thresholds,
         "push"),
    Step(15, "user-stop", "user stop", 4, "Holds for 20 s; then reads the arm.",
         "Hold the space bar and press the activation device with the other hand.", held.user_stop, "user-stop"),
    Step(16, "ways", "way to the start", 4, "Goes to the start pose of the cell's file, then to the middle.",
         "The table is empty. Hold the space bar until each is over.", measured.start_motions),
    Step(17, "friction", "friction", 5, "Moves each joint by 6 degrees to and fro, in the middle of the room.",
         "Hold the space bar until it is over.", measured.friction),
    Step(18, "stops", "STOP", 3, "Moves the pad sideways at 0.05, 0.10 and 0.22 m/s, and stops it in the middle.",
         "Hold the space bar until it is over.", measured.stops),
    Step(19, "rest-again", "arm at rest, once more", 1, "Reads the arm for 20 s.", "Do not touch it.", still.resting,
         moves=False),
)  # fmt: skip
_ERRORS = (HardwareError, TrialError, *VENDOR)


def main(
    out: Annotated[Path, typer.Argument(metavar="FOLDER", help="Results; the same folder goes on.")],
    cell_file: Annotated[Path, typer.Option(help="The cell's file.")],
    left: Annotated[str | None, typer.Option(help="Address of the left arm.")] = None,
    right: Annotated[str | None, typer.Option(help="Address of the right arm.")] = None,
    only: Annotated[str, typer.Option(help="Numbers of steps: 5,7. They are run again.")] = "",
    short: Annotated[bool, typer.Option("--short", help="A tenth of each duration: a rehearsal.")] = False,
) -> int:
    """Ask for each step, run it, and pack what was found."""
    if (left is None) == (right is None):
        raise typer.BadParameter("one arm: give --left ADDRESS or --right ADDRESS")
    chosen = _chosen(only)
    lab = _lab(out, cell_file, "left" if right is None else "right", str(left or right), 0.1 if short else 1.0)
    lab.led.check()
    at_a_terminal()
    out.mkdir(parents=True, exist_ok=True)
    results = Results(lab)
    for step in chosen or STEPS:
        if not chosen and (record := results.read(step)) is not None and not (record["failed"] or record["skipped"]):
            say(f"{step.number} {step.title}: done")
            continue
        if not _step(step, lab, results):
            break
    path = results.zipped(STEPS, lab.side)
    print(results.table(STEPS))
    print(f"send this back: {path}")
    failed = [step.number for step in STEPS if (record := results.read(step)) is not None and record["failed"]]
    return 1 if failed else 0


def _chosen(only: str) -> tuple[Step, ...]:
    numbers = [word.strip() for word in only.split(",") if word.strip()]
    for word in numbers:
        if word not in {str(step.number) for step in STEPS}:
            raise typer.BadParameter(f"there is no step {word!r}: 1 to {STEPS[-1].number}")
    return tuple(step for step in STEPS if str(step.number) in numbers)


def _lab(out: Path, cell_file: Path, side: str, address: str, share: float) -> Lab:
    kind = f"fci:{address}" if side == "left" else f"fci:,{address}"
    description, source = load_description(cell_file, kind)
    if description.sides != (side,):
        raise TrialError(f"{cell_file} has no {side} arm")
    description = capped(description)
    led = HourTerminal(kind, description, source, "", led=True)
    return Lab(side, address, kind, description, source, share, led, HourTerminal(kind, description, source, ""), out)


def _step(step: Step, lab: Lab, results: Results) -> bool:
    """Ask, run a step and write what was found. Returns whether to go on."""
    say(f"\n--- {step.number} {step.title} (some {step.minutes} min)\n{step.does}\nYou: {step.you}")
    begin = f'type "{step.word}" to begin' if step.word else "Enter: begin"
    answer = ask(f"{begin}; s: leave it out; q: end for now", (step.word, "s", "q"))
    if answer == "q":
        return False
    found, failed, skipped = Found(), "", ""
    if answer == "s":
        skipped = "left out"
    else:
        found, failed, skipped = _run(step, lab)
    results.write(step, found, failed, skipped)
    for claim in found.claims:
        say(f"  {claim.what}: claimed {claim.claimed}; found {claim.found}")
    return True


def _run(step: Step, lab: Lab) -> tuple[Found, str, str]:
    """Run a step; return what was found, why it failed and why it was left out. A reflex is recovered from."""
    hosts, found = (lab.led, lab.measured), Found()
    for host in hosts:
        host.forget()
    try:
        return step.run(lab), "", ""
    except Skipped as error:
        return found, "", str(error)
    except _ERRORS as error:  # and with it the traceback, which keeps the robot's only client connected
        failed = " ".join(str(error).split())
    except Exception as error:  # a defect here must not cost what the arm has shown
        traceback.print_exc()
        failed = f"a defect of this program: {type(error).__name__}: {error}"
    say(f"not completed: {failed}")
    for host in hosts:
        host.keep(found, "until_then")
    with suppress(HardwareError):
        if step.moves and in_reflex(lab):
            found.figures["recovery"] = recovered(lab)
    return found, failed, ""


if __name__ == "__main__":
    program(main)
