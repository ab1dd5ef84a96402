"""The commissioning of two arms by the runbook alone: each command, what was waited for, and minutes.

The arms are served as metal on loopback, with Desk. A person is emulated at a terminal, who types the name of the cell,
holds the space bar and answers. The points of the calibration are computed with an error of 0.3 mm, since nobody leads
the pads. Exit status 1 where a step fails, or is refused in its place, or is not refused before it.

Takes five minutes.
"""

import json
import os
import re
import subprocess
import sys
import time
from contextlib import chdir
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

from rtstack.calibration.points import save_points
from rtstack.cells import load_description
from rtstack.cells.commissioning import record_file
from rtstack.teleoperation.stamp import Sender
from tests.programs import program
from tests.support.console.stack import Stack
from tests.support.desk import PASSWORD, USER, desk_address
from tests.support.metal.metal import Metal
from tests.support.wrong_cell import Wrongness, built, touched_points

PRESS_S = 12.0  # by the host's clock: some 0.2 m to the object, and against it
COMMAND = str(Path(sys.executable).with_name("rtstack"))


@dataclass(slots=True)
class Walk:
    """The commands so far. served: options of the robot; failed: what did not come out as it should."""

    metal: Metal
    served: tuple[str, ...]
    rows: list[tuple[str, str, float, str]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def slower(self) -> float:
        """How many times slower than real time the robot runs."""
        return float(self.served[-1]) if "--slower" in self.served else 1.0

    def alone(self, *words: str, status: int = 0) -> str:
        """Give a command that moves nothing; return what it says."""
        began_s = time.monotonic()
        environment = os.environ | {"RTSTACK_DESK_USER": USER, "RTSTACK_DESK_PASSWORD": PASSWORD}
        done = subprocess.run(
            [COMMAND, *words], cwd=self.metal.folder, env=environment, capture_output=True, text=True, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        self._note("", words, began_s, done.returncode, status, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def held(self, *words: str, answer: str = "", statuses: tuple[int, ...] = (0,)) -> None:
        """Give a command that moves the arms, at a terminal where the space bar is held. answer: to its question."""
        began_s = time.monotonic()
        with self.metal.command([*words, "--cell-file", str(self.metal.cell_file)]) as at:

            def until(said: str) -> bool:
                if not answer or "y or n" not in said:
                    return False
                at.terminal._write(f"{answer}\n")
                return True

            status = at.carry_out(lambda: at.terminal.hold(until=until))
        self._note("name, space bar", words, began_s, status, statuses[-1], at.terminal.said, statuses)

    def pressed(self) -> str:
        """Record on the page how both pads are led to the object by hand, and press on it; return the log's path."""
        began_s = runs_s = time.monotonic()
        metal = self.metal
        arms = ("--left", metal.left, "--right", metal.right, "--cell-file", str(metal.cell_file))
        stack, sender = Stack(metal.folder / "logs", arms), Sender()
        inwards = {"left": [0.0, -0.4, 0.0, 0.0, 0.0, 0.0], "right": [0.0, 0.4, 0.0, 0.0, 0.0, 0.0]}
        outwards = {side: [-part for part in way] for side, way in inwards.items()}
        try:
            stack.post("take", operator="Anna")
            stack.post("arm")
            stack.post("jobs/teleoperation", object="rice_box", recorded=True, stop_on_release=True)
            with stack.beating(), stack.socket("/api/teleoperation/hand") as hand:
                while (status := stack.client.get("/api/status").json())["job"]["state"] in ("starting", "running"):
                    way = inwards if time.monotonic() - runs_s < PRESS_S * self.slower else outwards
                    hand.send(json.dumps(sender.stamped({"clutch": True, "speed_m_s": 0.1, "deflection": way})))
                    sender.saw(json.loads(hand.recv()))
                    runs_s = time.monotonic() if status["job"]["state"] == "starting" else runs_s
                    if time.monotonic() - runs_s > 1.8 * PRESS_S * self.slower:
                        hand.send('{"clutch": false, "lost": false}')
                        hand.recv()
                    time.sleep(0.04)
        finally:
            stack.end()
        self._note(
            "C on the page", ("up:", "by hand"), began_s, 0, 0, f"{status['job']['state']}: {status['job']['reason']}"
        )
        return str(metal.folder / "logs" / status["job"]["log"])

    def _note(
        self, person: str, words: tuple[str, ...], began_s: float, status: int | None, wanted: int, said: str,
        also: tuple[int, ...] = (),
    ) -> None:  # fmt: skip
        line = next((line.strip() for line in reversed(said.splitlines()) if re.search("[a-z]{2}", line)), "")
        self.rows.append((" ".join(("rtstack", *words)), person, time.monotonic() - began_s, line[-110:]))
        print(f"{self.rows[-1][2]:6.1f} s  {self.rows[-1][0]}: {status}, {self.rows[-1][3]}", flush=True)
        if status not in (wanted, *also):
            self.failed.append(f"{self.rows[-1][0]}: status {status}, expected {wanted}:\n{said}")


def main(lockstep: bool = False, slower: float = 1.0) -> int:
    """Walk, and print the table.

    Args:
        lockstep: The robot waits for its answers, where the machine is too busy for real time.
        slower: How many times slower than real time the robot runs, where the machine has no CPU for the loop alone.
    """
    os.environ["PYTHONPATH"] = str(Path(__file__).parents[2])  # of the programs that are started in the folder
    with TemporaryDirectory() as folder, chdir(folder):
        metal = Metal(Path(folder), lockstep)
        metal.write_file()
        record_file(metal.cell_file).unlink()
        served = ("--desk", "--profile", "honest", "--seed", "3701", *(() if lockstep else ("--slower", str(slower))))
        walk = Walk(metal, served)
        metal.serve(served)
        try:
            _walk(walk)
        finally:
            metal.end()
    table = Table("command", "person", "s", "last line")
    for command, person, seconds, line in walk.rows:
        table.add_row(command, person, f"{seconds:.1f}", line)
    Console(width=200).print(table)
    print(f"{len(walk.rows)} commands, {sum(row[2] for row in walk.rows) / 60:.1f} minutes")
    for each in walk.failed:
        print("FAILED:", each)
    return int(bool(walk.failed))


def _walk(walk: Walk) -> None:
    metal = walk.metal
    file, kind = metal.cell_file, metal.kind
    own = ("--cell-file", str(file))
    text = file.read_text()
    for side, address in (("left", metal.left), ("right", metal.right)):
        text = text.replace(f"[{side}]\n", f'[{side}]\ndesk = "{desk_address(address)}"\n')
    file.write_text(text)
    walk.alone("check", *own)
    walk.alone("desk", "status", *own)
    walk.alone("desk", "start", *own)
    walk.alone("commission", *own)
    walk.alone("guide", "--cell", kind, *own, status=2)
    for side, address in (("left", metal.left), ("right", metal.right)):
        walk.held("check", f"--{side}", address, "--sign", "Anna")
    walk.held("check", "--left", metal.left, "--right", metal.right)
    for side in ("left", "right"):
        walk.held("wiggle", side, "--cell", kind, "--sign", "Anna", answer="y")
    walk.held("guide", "--cell", kind, "--seconds", "3", "--sign", "Anna")
    description = load_description(file)[0]
    as_it_is = built(description, np.random.default_rng(1), Wrongness(0.0, 0.0, 0.0, 0.0, pad_m=0.0))
    save_points(metal.folder / "points.toml", touched_points(description, as_it_is, 3e-4))
    walk.alone("calibrate", "points.toml", "--write", "--sign", "Anna", *own)
    walk.held("check", "--left", metal.left, "--right", metal.right, "--sign", "Anna")  # the payload was measured
    walk.alone("teach", "simulated.mcap", "--cell", "direct")
    walk.alone("trial", "--reference", "simulated.mcap", "--cell", kind, *own, status=2)
    metal.end()
    metal.serve((*walk.served, "--object", "none"))  # the table is cleared
    walk.alone("desk", "start", *own)
    walk.held("play", "simulated.mcap", "--speed", "0.3", "--cell", kind, "--log", "motion.mcap")
    walk.alone("commission", "motion", "--log", "motion.mcap", "--sign", "Anna", *own)
    metal.end()
    metal.serve(walk.served)  # foam between the pads
    walk.alone("desk", "start", *own)
    log = walk.pressed()
    walk.alone("commission", "foam", "--log", log, "--sign", "Anna", *own)
    walk.held("teach", "object.mcap", "--speed", "0.15", "--cell", kind)
    walk.alone("commission", "object", "--log", "object.mcap", "--sign", "Anna", *own)
    walk.alone("commission", *own)
    walk.held("teach", "reference.mcap", "--cell", kind)  # at the speed that the shipped monitor was tuned for
    walk.held("trial", "--reference", "reference.mcap", "--shadow", "--cell", kind, "--log", "shadow.mcap")
    # the shipped monitor was tuned on other arms, and their friction was identified: it may stop this trial
    walk.held("trial", "--reference", "reference.mcap", "--cell", kind, "--log", "trial.mcap", statuses=(0, 1))


if __name__ == "__main__":
    program(main)
