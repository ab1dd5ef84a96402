"""Wrong set-ups on arms that are served as metal: which are refused, stopped safely, or move what they should not.

Each set-up of tests/support/metal/setups.py is tried by a command at a terminal, where a person confirms and holds the
space bar, in lockstep and in real time. How far the arms moved and what they touched is measured in the plant. The
criterion of a wrong motion is written down in `misdeeds`. Prints each result as it comes, writes table.md, and exits
with 1 where something moved wrongly. Ctrl-C ends it; the same command goes on, unless the sources have changed.

Takes an hour.
"""

import contextlib
import hashlib
import json
import os
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from rtstack.cells import load_description
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from sim_robot.desk.process import PORT
from sim_robot.desk.server import PASSWORD, USER
from sim_robot.plant_parameters import OWN_FILES
from tests.programs import choose, program
from tests.support.console.stack import COMMAND, SoakFailed
from tests.support.metal.metal import AtTerminal, Metal
from tests.support.metal.page import PageOperator
from tests.support.metal.setups import PLAY, TEACH, TRIAL, WRONG, Setup
from tests.support.metal.watched_robot import CLASSES
from tests.support.network.namespaces import Namespace, NotPermitted, permitted
from tests.support.real_cell import commission

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("hal", "sim_robot", "rtstack", "deploy", "tests/support/metal")
REFUSED, STOPPED, WENT_ON, WRONGLY, NOT_HERE = "refused", "stopped safely", "went on", "MOVED WRONGLY", "not here"
PACES = ("lockstep", "real time")
# the criterion of a wrong motion, written before the first run
HARDEST_N = 65.0  # of a link with anything, of a pad with anything but the object
HARDEST_GRAB_N = 300.0  # of a pad on the object: 119 N in the right set-up, and the judge allows 250 N
OUTSIDE_M = 0.005  # beyond the box for the pads, at the end
STILL_RAD = 0.002  # an arm that turned less has not moved
DROPPED_M_S = 1.0  # downwards: 50 mm of free fall
LED_RAD, LED_S = 0.05, 30.0  # by hand, until something happens
TRIES = 3  # of a run in real time that this host has spoiled: packets were lost where the set-up loses none
REAL_PREFIX = "192.0.2"  # of a network that is nobody's (RFC 5737), in a namespace
BY = {
    End.SAFETY: "judge", End.HARDWARE: "robot", End.STOP_REQUESTED: "person", End.RELEASED: "person",
    End.UNEXPECTED_IMPACT: "monitor", End.CRASH: "monitor", End.NO_IMPACT: "trial",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a set-up. by: the part that refused or stopped; said: the command's last line."""

    name: str
    pace: str
    came: str
    by: str = ""
    force_n: float = 0.0  # largest contact but that of a pad on the object
    grab_n: float = 0.0
    turned_rad: float = 0.0
    misdeeds: str = ""
    said: str = ""
    notes: str = ""


def misdeeds(setup: Setup, status: int | None, seen: np.void) -> list[str]:
    """Return what must not have happened: the criterion of a wrong motion."""
    found = [
        f"{name} {force:.0f} N"
        for name, force in zip(CLASSES, seen["contact"], strict=True)
        if force > (HARDEST_GRAB_N if name == "pad on object" else HARDEST_N)
    ]
    safety = load_description(None)[0].safety
    lower, upper = np.array(safety["ee_lower"]), np.array(safety["ee_upper"])

    def outside(pads: np.ndarray) -> np.ndarray:
        return np.maximum(lower - pads, pads - upper).max(axis=1) > OUTSIDE_M

    if (outside(seen["pads"]) & ~outside(seen["began"])).any():
        found.append("a pad ends outside of the box")
    if status == 0 and not setup.harmless:
        found.append("success although it was wrong")
    if status is None:
        found.append("the command hangs")
    return found


def sorted_out(setup: Setup, pace: str, status: int | None, said: str, seen: np.void) -> Outcome:
    """Return what came of a set-up whose command has ended."""
    lines = [line.strip() for line in re.sub(r"\x1b\[[0-9;]*[A-Za-z]|\r", "\n", said).splitlines() if line.strip()]
    last = lines[-1] if lines else ""
    wrong, turned = misdeeds(setup, status, seen), float(seen["turned"].max())
    ends = sorted((last.index(end), end) for end in End if end in last)
    part = BY.get(ends[0][1], "watchdog") if ends else "command"
    if status == 0:
        came, by = WENT_ON, ""
    elif turned < STILL_RAD or not seen["moving_ticks"]:
        came, by = REFUSED, part
    elif ends or status != 1:
        came, by = STOPPED, part
    else:
        came, by = WENT_ON, "to its end, and failed"
    notes = [setup.harmless] if status == 0 else []
    notes += ["TRACEBACK"] * ("Traceback" in said)
    notes += [f"killed by signal {-status}"] if status is not None and status < 0 else []
    notes += [f"the object fell at {seen['falling']:.1f} m/s"] if seen["falling"] > DROPPED_M_S else []
    others, grab = [float(seen["contact"][k]) for k in range(3)], float(seen["contact"][3])
    return Outcome(
        setup.name, pace, WRONGLY if wrong else came, by, round(max(others), 1), round(grab, 1), round(turned, 3),
        "; ".join(wrong), last, "; ".join(notes),
    )  # fmt: skip


def changed(text: str, changes: tuple[tuple[str, str], ...]) -> str:
    """Return a text with its replacements. Raises ValueError where one replaces nothing."""
    for pattern, new in changes:
        text, number = re.subn(pattern, new, text, flags=re.MULTILINE)
        if not number:
            raise ValueError(f"{pattern!r} is not in the file")
    return text


class Trier:
    """Tries set-ups. folder: of all files; reference: a demonstration in the right set-up."""

    def __init__(self, folder: Path, reference: Path) -> None:
        self._folder, self._reference = folder, reference
        self._namespace: Namespace | None = None

    def attempt(self, setup: Setup, pace: str) -> Outcome:
        """Try a set-up, again where this host has spoiled the run."""
        outcome = self._once(setup, pace)
        for _ in range(TRIES - 1):
            if setup.faults or setup.act or pace == "lockstep" or "communication_constraints" not in outcome.said:
                break
            outcome = self._once(setup, pace)
        return outcome

    def _once(self, setup: Setup, pace: str) -> Outcome:
        folder = self._folder / re.sub(r"\W+", "-", f"{setup.name}-{pace}")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        metal = Metal(folder, pace == "lockstep")
        if setup.real_address:
            try:
                metal.namespace, metal.prefix = self._namespace_now(), REAL_PREFIX
            except NotPermitted as error:
                return Outcome(setup.name, pace, NOT_HERE, notes=str(error))
        try:
            try:
                metal.serve(self._prepared(metal, setup), setup.robot)
            except RuntimeError as error:
                return Outcome(setup.name, pace, NOT_HERE, notes=str(error))
            return self._carried_out(metal, setup, pace)
        finally:
            metal.end()

    def _namespace_now(self) -> Namespace:
        if self._namespace is None:
            self._namespace = Namespace()
            for number in (1, 2, 3):
                self._namespace.alias(number, f"{REAL_PREFIX}.{number}")
        return self._namespace

    def _prepared(self, metal: Metal, setup: Setup) -> list[str]:
        """Write the files of a set-up; return the robot's options."""
        text = metal.write_file()
        if setup.desk:
            order = ("right", "left") if setup.desk == "exchanged" else ("left", "right")
            for side, address, serial in zip(("left", "right"), (metal.left, metal.right), order, strict=True):
                desk = f'[{side}]\ndesk = "{address}:{PORT}"\nserial = "simulated-{serial}"\n'
                text = text.replace(f"[{side}]\n", desk)
        options = ["--seed", "3", "--object", "rice_box", *(word.format(metal=metal) for word in setup.options)]
        if setup.plant_file:
            (metal.folder / "plant.toml").write_text(changed(text, setup.plant_file))
            options += ["--cell-file", str(metal.folder / "plant.toml")]
        metal.cell_file.write_text(changed(text, setup.file))
        with contextlib.suppress(Exception):  # a file that cannot be read is not commissioned
            commission(metal.cell_file)
        for option, given, own, name in (
            ("--scene", setup.scene, "scenes/grab.toml", "scene.toml"),
            ("--profile", setup.profile, "parameters/profiles/ideal.toml", "profile.toml"),
        ):
            if given:
                whole = (OWN_FILES / own).read_text()
                whole = f"{whole}\n{given}" if isinstance(given, str) else changed(whole, given)
                (metal.folder / name).write_text(whole)
                options += [option, str(metal.folder / name)]
        if setup.faults:
            (metal.folder / "faults.toml").write_text(setup.faults)
            options += ["--faults", str(metal.folder / "faults.toml")]
        return options + ["--desk"] * bool(setup.desk)

    def _carried_out(self, metal: Metal, setup: Setup, pace: str) -> Outcome:
        os.environ["XDG_CONFIG_HOME"] = str(metal.folder)  # where certificates of Desk are remembered
        os.environ |= {"RTSTACK_DESK_USER": USER, "RTSTACK_DESK_PASSWORD": PASSWORD}
        if setup.desk:
            verb = "status" if setup.desk == "off" else "start"
            words = [str(COMMAND), "desk", verb, "--cell-file", str(metal.cell_file)]
            asked = metal.start(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            asked.wait(60.0)
        if setup.before is not None:
            setup.before(metal)
        if setup.page is not None:
            return self._at_page(metal, setup, setup.page, pace)
        log, reference = str(metal.folder / "log.mcap"), str(self._reference)
        words = {
            TRIAL: [TRIAL, "--reference", reference, "--log", log], TEACH: [TEACH, log],
            PLAY: [PLAY, reference, "--log", log],
        }[setup.command]  # fmt: skip
        words += ["--cell", setup.kind.format(metal=metal), *(word.format(metal=metal) for word in setup.more)]
        words += ["--cell-file", str(metal.cell_file)] if setup.cell_file else []
        with metal.command(words, setup.prelude, leads=setup.hang_up) as running:
            act = setup.act
            status = running.carry_out(
                lambda: hold(metal, setup, running), None if act is None else lambda: act(metal, running)
            )
            said = running.terminal.said
        if setup.hang_up and (metal.folder / "log.mcap").exists():  # nothing more was said there
            said += f"\nfailed: {read_log(metal.folder / 'log.mcap').metadata['result']['failure_reason']}"
        (metal.folder / "said.txt").write_text(f"{' '.join(words)}\nexit status {status}\n{said}")
        time.sleep(0.1)  # the robot's own stop
        return sorted_out(setup, pace, status, said.replace(f"{metal.folder}/", ""), metal.seen.copy())

    def _at_page(self, metal: Metal, setup: Setup, page: Callable[[PageOperator], str], pace: str) -> Outcome:
        operator = PageOperator(metal)
        try:
            operator.begin()
            seen, due_s = metal.seen, time.monotonic() + LED_S
            while seen["turned"].max() < LED_RAD and not operator.reason and time.monotonic() < due_s:
                time.sleep(0.05)
            said = operator.reason or page(operator)
        except SoakFailed as failed:
            said = f"failed: {failed}"
        finally:
            operator.close()
        (metal.folder / "said.txt").write_text(said)
        status = 0 if said.startswith("done") and not any(end in said for end in End) else 3  # a job that was ended
        return sorted_out(setup, pace, status, said, metal.seen.copy())


def hold(metal: Metal, setup: Setup, running: AtTerminal) -> None:
    """Be the person at the terminal."""
    seen, least = metal.seen, setup.let_go_ms
    running.terminal.hold(
        setup.types, lambda _said: least is not None and bool(seen["moving_ticks"] >= least), setup.hang_up
    )


def digest() -> str:
    """Return what results belong to: the state of everything that is tried, and of these set-ups."""
    found = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(path for folder in SOURCES for path in (ROOT / folder).rglob("*")):
        if path.suffix in (".py", ".toml", ".urdf"):
            found.update(path.read_bytes())
    return found.hexdigest()[:16]


def reference_of(folder: Path) -> Path:
    """Return a demonstration in the right set-up, made once."""
    path = folder / "reference.mcap"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run([str(COMMAND), "teach", str(path)], check=True, stdout=subprocess.DEVNULL)
    return path


HEAD = ("set-up", "of", "pace", "what came", "by", "other contact N", "pad on object N", "turned rad", "")


def row(setup: Setup, outcome: Outcome) -> tuple[str, ...]:
    """Return a line of the table."""
    figures = ("", "", "")
    if outcome.came not in (NOT_HERE, REFUSED):
        figures = (f"{outcome.force_n:g}", f"{outcome.grab_n:g}", f"{outcome.turned_rad:g}")
    about = outcome.misdeeds, outcome.notes, "" if outcome.came == NOT_HERE else outcome.said
    return setup.name, setup.origin, outcome.pace, outcome.came, outcome.by, *figures, ". ".join(filter(None, about))


def write_table(rows: list[tuple[str, ...]], path: Path) -> None:
    """Write the table as Markdown, with how often each outcome came."""
    counts = {came: sum(line[3] == came for line in rows) for came in (REFUSED, STOPPED, WENT_ON, NOT_HERE, WRONGLY)}
    lines = ["# Wrong set-ups", "", "; ".join(f"{number} {came}" for came, number in counts.items()), ""]
    lines += ["| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    lines += ["| " + " | ".join(text.replace("|", "/") for text in line) + " |" for line in rows]
    path.write_text("\n".join(lines) + "\n")
    print(f"{lines[2]}: {path}")


@contextlib.contextmanager
def quiet_threads() -> Iterator[None]:
    """Keep a terminal's thread whose program was killed from printing a traceback."""
    before, threading.excepthook = threading.excepthook, lambda _arguments: None
    try:
        yield
    finally:
        threading.excepthook = before


def main(
    setup: Annotated[list[str] | None, typer.Option(help="only this one")] = None,
    pace: Annotated[list[str] | None, typer.Option(help="only this one: lockstep, real time")] = None,
    out: Path = ROOT / "out" / "wrong_setups",
    fresh: Annotated[bool, typer.Option("--fresh", help="try again what is kept")] = False,
) -> int:
    """Try the chosen set-ups, and print what came of each."""
    names, paces = choose(setup, [each.name for each in WRONG]), choose(pace, PACES)
    chosen = [(each, pace) for pace in paces for each in WRONG if each.name in names]
    with contextlib.suppress(NotPermitted):
        if any(each.real_address for each, _ in chosen):
            permitted()
    kept_in = out / digest()
    kept_in.mkdir(parents=True, exist_ok=True)
    trier, rows, wrong = Trier(out / "runs", reference_of(kept_in)), [], 0
    try:
        with quiet_threads():
            for number, (each, pace_now) in enumerate(chosen, 1):
                kept = kept_in / (re.sub(r"\W+", "-", f"{each.name}-{pace_now}") + ".json")
                if kept.exists() and not fresh:
                    outcome = Outcome(**json.loads(kept.read_text()))
                else:
                    outcome = trier.attempt(each, pace_now)
                    kept.write_text(json.dumps(asdict(outcome)))
                rows.append(row(each, outcome))
                wrong += outcome.came == WRONGLY
                print(f"{number}/{len(chosen)} " + " | ".join(filter(None, rows[-1])), flush=True)
    finally:
        write_table(rows, out / "table.md")
    return 1 if wrong else 0


if __name__ == "__main__":
    program(main)
