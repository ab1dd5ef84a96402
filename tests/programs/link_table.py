"""What the link between control PC and robot stands: a trial a row, in two network namespaces joined by a bad cable.

Robot and control PC are namespaces of their own; the trial is `rtstack trial`, the robot `rtstack sim`. A row is right
when the trial succeeded, or ended with the vendor's name of what the link did, the arms at rest and a log that can be
read. Exit status 0 where every row is right and those that have to succeed do, 1 otherwise, 3 without namespaces.

Takes a quarter of an hour.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from tests.programs import program
from tests.support.network import relay
from tests.support.network.namespaces import Namespace, permitted
from tests.support.network.relay import Cable
from tests.support.real_cell import write_cell_file
from tests.support.terminal import Terminal

BIN = Path(sys.executable).parent
LEFT, RIGHT, CONTROL = "10.77.1.11", "10.77.1.12", "10.77.1.1"
TRACKER = f"{CONTROL}:1341"
PATIENCE_S = 240.0
TRIAL_S = 120.0  # a trial takes six, and compiling may come before
VENDOR = "communication_constraints_violation"
# of the robot's or of the stack: each of them stops the arms, and says what the link did
CLEAN = (VENDOR, "has sent no state", "states are missing", "the other arm has shown no new state", "does not answer")
AT_REST = 0.02  # rad/s, of the measured joint velocities, with their noise
MIDDLE = 5000  # packets to the robot until the way to it is cut: a third of the trial


@dataclass(frozen=True, slots=True)
class Row:
    """A cable and a robot. expected: success, vendor (the vendor's name), clean (either, as the machine keeps time)."""

    name: str
    cable: Cable
    expected: str
    lockstep: bool = False


ROWS = (
    # a robot that waits for answers: what the link does to the order of packets, on any machine
    Row("waiting, 1 ms, jitter, duplicates", Cable(1.0, 0.5, 0.0, 0.05), "success", lockstep=True),
    Row("plain", Cable(), "clean"),
    Row("0.1 ms", Cable(0.1), "clean"),
    Row("0.1 ms, jitter 0.1", Cable(0.1, 0.1), "clean"),
    Row("0.1 ms, jitter 0.3", Cable(0.1, 0.3), "clean"),
    Row("0.3 ms", Cable(0.3), "clean"),
    Row("0.3 ms, jitter 0.3", Cable(0.3, 0.3), "clean"),
    Row("1 % lost", Cable(0.1, 0.0, 0.01), "clean"),
    Row("5 % lost", Cable(0.1, 0.0, 0.05), "clean"),
    Row("20 % lost", Cable(0.1, 0.0, 0.2), "clean"),
    Row("60 % lost", Cable(0.1, 0.0, 0.6), "clean"),
    Row("5 % twice", Cable(0.1, 0.0, 0.0, 0.05), "clean"),
    Row("1 % overtaken", Cable(0.1, 0.0, 0.0, 0.0, 0.01), "clean"),
    Row("5 % overtaken", Cable(0.1, 0.0, 0.0, 0.0, 0.05), "clean"),
    Row("all of it", Cable(0.1, 0.1, 0.01, 0.01, 0.01), "clean"),
    Row("0.5 ms: answers come when the next state is due", Cable(0.5), "clean"),
    Row("1 ms: every answer comes too late", Cable(1.0), "vendor"),
    Row("answers are lost from the middle on", Cable(0.1, after=MIDDLE), "vendor"),
    Row("the way to the robot is cut, requests too", Cable(0.1, after=MIDDLE, cut="left"), "vendor"),
    Row("both ways are cut", Cable(0.1, after=MIDDLE, cut="all"), "clean"),
)


@dataclass(slots=True)
class Outcome:
    """What came of a row. lost: answers that came too late; rest: both arms were at rest afterwards."""

    row: Row
    success: bool = False
    begun: bool = False  # a log was begun
    said: str = ""
    lost: int = 0
    least_rate: float = 0.0
    ticks: int = 0
    modes: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    rest: bool = False
    wrong: str = ""

    def judge(self) -> None:
        """Say in `wrong` what is not as it has to be, nothing where all is."""
        refused = not self.begun and any(words in self.said for words in CLEAN)  # in one line, before anything moved
        if not self.ticks and not refused:
            self.wrong = "the log cannot be read"
        elif not self.rest:
            self.wrong = "an arm moves after the end"
        elif self.row.expected == "success" and (not self.success or self.lost):
            self.wrong = f"it has to succeed without a lost answer: {self.lost} lost"
        elif self.row.expected == "vendor" and (self.success or VENDOR not in self.said):
            self.wrong = f"it has to end with {VENDOR}"
        elif not self.success and not any(words in self.said for words in CLEAN):
            self.wrong = "it does not say what the link did"


class Lab:
    """Robot and control PC, with a cable between them."""

    def __init__(self, seed: int) -> None:
        self.robot, self.control = Namespace(), Namespace()
        ends = (self.robot.connect(LEFT, RIGHT), self.control.connect(CONTROL))
        self._relay = subprocess.Popen(
            [sys.executable, relay.__file__, *map(str, ends), str(seed)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=ends,
        )  # fmt: skip
        for end in ends:
            os.close(end)

    def set(self, cable: Cable) -> None:
        """Change the cable. Raises RuntimeError where the relay has ended."""
        assert self._relay.stdin is not None
        assert self._relay.stdout is not None
        self._relay.stdin.write(json.dumps(asdict(cable)) + "\n")
        self._relay.stdin.flush()
        if self._relay.stdout.readline() != "ready\n":
            raise RuntimeError("the relay has ended")

    def close(self) -> None:
        """End all of it."""
        self._relay.communicate(timeout=PATIENCE_S)
        self.robot.close()
        self.control.close()


def run_row(row: Row, reference: Path, cell_file: Path, out: Path, seed: int) -> Outcome:
    """Run one trial over one cable, and look at what is left."""
    lab = Lab(seed)
    robot = lab.robot.start(
        BIN / "rtstack", "sim", "--left", LEFT, "--right", RIGHT, "--tracker", TRACKER, "--displacement-mm=-30",
        *["--lockstep"] * row.lockstep, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert robot.stdout is not None
        if not robot.stdout.readline().startswith("serving"):
            raise RuntimeError("the simulated robot did not start")
        lab.set(row.cable)
        log = out / f"{ROWS.index(row) if row in ROWS else 0:02d}.mcap"
        log.unlink(missing_ok=True)
        outcome = Outcome(row)
        terminal = Terminal()
        trial = lab.control.start(
            BIN / "rtstack", "trial", "--reference", reference, "--cell", f"fci:{LEFT},{RIGHT}",
            "--cell-file", cell_file, "--displacement-mm=-30", "--seed", "1", "--log", log, "--json",
            stdin=terminal.theirs, stdout=subprocess.PIPE, stderr=terminal.theirs, text=True,
        )  # fmt: skip
        person = threading.Thread(target=terminal.hold, daemon=True)
        person.start()
        try:
            answer, _ = trial.communicate(timeout=TRIAL_S)
            person.join(PATIENCE_S)
            complaint = terminal.said
        except subprocess.TimeoutExpired:
            trial.kill()
            trial.communicate()
            outcome.wrong = f"it has not ended within {TRIAL_S:g} s"
            return outcome
        result = json.loads(answer) if answer.startswith("{") else {}
        outcome.success = bool(result.get("success"))
        outcome.said = result.get("failure_reason") or complaint.strip().rpartition("\n")[2]
        if "Traceback" in complaint:
            outcome.said = "a traceback"
        outcome.begun = log.exists()
        lab.set(Cable())
        _ask_arms(lab, outcome)
        _read_log(log, outcome)
        outcome.judge()
        return outcome
    finally:
        robot.send_signal(signal.SIGTERM)
        robot.communicate(timeout=PATIENCE_S)
        lab.close()


_PROBE = """
import json, sys, time
from hal.errors import HardwareError
from hal.fci import FciArm
from hal.state import RobotMode
until_s = time.monotonic() + 15.0
def opened(address):
    while True:
        try:
            return FciArm(address)
        except HardwareError:  # a client whose end the cable has swallowed is still there, for some seconds
            if time.monotonic() > until_s:
                raise
            time.sleep(0.5)
for address in sys.argv[1:]:
    arm = opened(address)
    errors = arm.reflex()
    arm._robot and None
    state = arm._robot.read_once()
    print(json.dumps([RobotMode(int(state.robot_mode)).name, list(errors), max(map(abs, state.dq))]))
    arm.close()
"""


def _ask_arms(lab: Lab, outcome: Outcome) -> None:
    """Ask both arms, over a good cable, how they are."""
    asked = lab.control.run(
        sys.executable, "-c", _PROBE, LEFT, RIGHT, stdout=subprocess.PIPE, text=True, timeout=PATIENCE_S
    )
    found = [json.loads(line) for line in asked.stdout.splitlines()]
    outcome.modes = [mode for mode, _, _ in found]
    outcome.errors = sorted({name for _, names, _ in found for name in names})
    outcome.rest = len(found) == 2 and all(mode != "MOVE" and speed < AT_REST for mode, _, speed in found)


def _read_log(log: Path, outcome: Outcome) -> None:
    from rtstack.log.errors import LogError
    from rtstack.log.reader import read_log
    from rtstack.samples import SIDES

    try:
        read = read_log(log)
        arms = [read.topic(f"/{side}/arm") for side in SIDES]
        texts = [text.decode() for text in read.topic("/events")["text"]]
    except LogError:
        return
    outcome.ticks = min(map(len, arms))
    rates = [arm["control_command_success_rate"][100:] for arm in arms]
    outcome.least_rate = float(min((rate.min() for rate in rates if len(rate)), default=0.0))
    outcome.lost = sum(int(text.split()[0]) for text in texts if "answers came too late" in text)


def table(outcomes: list[Outcome]) -> str:
    """Return the table in Markdown."""
    head = ("link", "delay ms", "jitter ms", "lost", "twice", "overtaken", "trial", "lost answers", "rate", "said", "")
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for one in outcomes:
        cable = one.row.cable
        shares = (f"{100 * share:g} %" for share in (cable.loss, cable.duplication, cable.reordering))
        lines.append(
            f"| {one.row.name} | {cable.delay_ms:g} | {cable.jitter_ms:g} | {' | '.join(shares)} | "
            f"{'success' if one.success else 'stopped'} | {one.lost} | {one.least_rate:.2f} | {one.said or '-'} | "
            f"{f'WRONG: {one.wrong}' if one.wrong else 'right'} |"
        )
    return "\n".join(lines)


def main(
    rows: Annotated[list[int] | None, typer.Option(help="by number")] = None,
    reference: Annotated[Path | None, typer.Option(help="a recording with the rice box; else one is made")] = None,
    out: Annotated[Path | None, typer.Option(help="folder for logs and table")] = None,
    seed: int = 0,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> int:
    """Run the rows."""
    print(f"two network namespaces, {permitted()}", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        if reference is None:
            reference = Path(scratch) / "ref.mcap"
            subprocess.run([BIN / "rtstack", "teach", reference], check=True, stdout=subprocess.DEVNULL)
        cell_file = Path(scratch) / "cell.toml"
        write_cell_file(cell_file, LEFT, RIGHT, TRACKER)
        outcomes: list[Outcome] = []
        for number in rows or range(len(ROWS)):
            outcomes.append(run_row(ROWS[number], reference, cell_file, folder, seed + number))
            print(table(outcomes[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
        if out:
            (out / "link.md").write_text(table(outcomes) + "\n")
    print(json.dumps([asdict(one) for one in outcomes]) if as_json else table(outcomes))
    return int(any(one.wrong for one in outcomes))


if __name__ == "__main__":
    program(main)
