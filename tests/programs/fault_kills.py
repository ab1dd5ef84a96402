"""kill -9 of each process in real time: who stops the arms, what becomes of the log, what is left behind.

    python -m tests.programs.fault_kills [--kill NAME] [--out DIR] [--profile honest --phase-us 400 --drift-ppm 50]

Part of `make faults`, after the matrix. Exit status 1 where anything was missed.
"""

import argparse
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil
from mcap.exceptions import McapError

from hal.errors import HardwareError
from rtstack.cells import IDEAL
from rtstack.log.errors import LogError
from tests.support.faults.evidence import MOST_LOST_S, read_evidence
from tests.support.faults.kill_scenes import LONGEST_END_S, Robots, SceneFailed, Stack, Trial
from tests.support.faults.model import CaseResult
from tests.support.faults.process import take_charge
from tests.support.faults.table import write_table

ROOT = Path(__file__).resolve().parents[2]
TRIES = 3  # a machine that does not keep time may not get the arms into motion
WATCHDOG = "communication_constraints_violation"
GRACE_S = 15.0


@dataclass(frozen=True, slots=True)
class Kill:
    """A process to kill. says: what who is left says; status: of `rtstack`, None where it was killed.

    by_robot: the robot's own packet watchdog is what stops the arms.
    """

    scene: str
    who: str
    says: str
    status: int | None
    by_robot: bool = False

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"{self.who} of {self.scene}"


KILLS = (
    Kill("rtstack trial", "robots", "the robot left torque control", 1),
    Kill("rtstack trial", "trial", "", None, by_robot=True),
    Kill("rtstack trial", "log", "the log .*killed by signal 9", 1),
    Kill("rtstack up", "robots", "the robot left torque control", 0),
    Kill("rtstack up", "supervisor", "", None),
    Kill("rtstack up", "robot process", "the robot process died: killed by SIGKILL", 1, by_robot=True),
    Kill("rtstack up", "console", "the console died: killed by SIGKILL", 1),
    Kill("rtstack up", "log", "the log .*killed by signal 9", 0),
)


class Scene:
    """One kill, from robots that stand still to robots that stand still again."""

    def __init__(self, kill: Kill, reference: Path, folder: Path, robot: Sequence[str]) -> None:
        self._kill, self._folder = kill, folder
        self._result = CaseResult(f"kill -9: {kill.who}", kill.scene, "arms at rest, log kept, nobody left behind")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self._robots = Robots(folder, robot)
        self._runs: Trial | Stack | None = None
        try:
            trial = kill.scene == "rtstack trial"
            self._runs = Trial(self._robots, reference, folder) if trial else Stack(self._robots, folder)
            self._runs.wait_until_moving()
        except BaseException:
            self.close()
            raise

    def play(self) -> CaseResult:
        """Kill, wait for the end, and look at everything."""
        runs, kill, result = self._runs, self._kill, self._result
        assert runs is not None
        everybody = list(runs.processes().values())
        shared = [process.pid for process in (runs.loop, psutil.Process(runs.process.pid))]
        if kill.who == "robots":
            self._robots.process.kill()
            self._robots.process.wait()
        else:
            runs.processes()[kill.who].send_signal(signal.SIGKILL)
        last_t_ns = runs.watched.last_t_ns
        said, status = self._end()
        result.said = said
        if not re.search(kill.says, said):
            result.misses.append(f"it says {said!r}, and nothing like {kill.says!r}")
        if kill.status is not None and status != kill.status:
            result.misses.append(f"exit status {status}, not {kill.status}")
        if kill.who != "log":
            last_t_ns = runs.watched.last_t_ns
        self._look_for_orphans(everybody, shared)
        self._look_at_robots()
        self._look_at_log(runs.log, last_t_ns)
        result.seen = "as expected" if not result.misses else "missed"
        return result

    def _end(self) -> tuple[str, int]:
        """Wait until the run has come to its end, which a stack does by Ctrl-C where it lives on."""
        runs = self._runs
        assert runs is not None
        said = ""
        if isinstance(runs, Stack) and self._kill.who in ("log", "robots"):
            said = runs.reason()
            runs.process.send_signal(signal.SIGINT)
        try:
            rest, _ = runs.process.communicate(timeout=LONGEST_END_S)
        except subprocess.TimeoutExpired:
            self._result.misses.append(f"it did not end within {LONGEST_END_S:g} s")
            runs.process.kill()
            rest, _ = runs.process.communicate()
        return " ".join((said + "\n" + rest).split()), runs.process.returncode

    def _look_for_orphans(self, everybody: list[psutil.Process], owners: list[int]) -> None:
        _, orphans = psutil.wait_procs(everybody, timeout=GRACE_S)
        for orphan in orphans:
            if orphan.status() != psutil.STATUS_ZOMBIE:
                self._result.misses.append(f"process left behind: {' '.join(orphan.cmdline()[:4])}")
            orphan.kill()
        time.sleep(0.5)  # who unlinks shared memory for a process that was killed notices its end first
        for pid in dict.fromkeys(owners):
            for path in Path("/dev/shm").glob(f"rtstack-{pid}-*"):
                self._result.misses.append(f"shared memory left behind: {path.name}")
                path.unlink(missing_ok=True)
        if isinstance(self._runs, Stack) and self._runs.run.exists():
            self._result.misses.append(f"folder left behind: {self._runs.run}")
            shutil.rmtree(self._runs.run, ignore_errors=True)

    def _look_at_robots(self) -> None:
        if self._kill.who == "robots":
            self._result.robot = "gone"
            return
        try:
            words, still = self._robots.look()
        except HardwareError as error:
            self._result.misses.append(f"the arms cannot be opened again: {error}")
            return
        self._result.robot, self._result.recovered = words, "yes"
        if not still:
            self._result.misses.append("the arms are not at rest")
        if self._kill.by_robot and WATCHDOG not in words:
            self._result.misses.append("the robot's own watchdog has not stopped the arms")

    def _look_at_log(self, path: Path, last_t_ns: int) -> None:
        try:
            evidence = read_evidence(path)
        except (LogError, McapError) as error:
            self._result.misses.append(f"the log cannot be read: {error}")
            return
        lost_s = max(0.0, (last_t_ns - evidence.last_t_ns) * 1e-9)
        self._result.log = f"{'recovered' if evidence.recovered else 'complete'}, {1e3 * lost_s:.0f} ms missing"
        if evidence.recovered != (self._kill.who == "log"):
            self._result.misses.append(f"the log is {'cut off' if evidence.recovered else 'whole'}")
        if lost_s > MOST_LOST_S:
            self._result.misses.append(f"{lost_s:.3f} s of the log are missing")

    def close(self) -> None:
        """End what still runs."""
        if self._runs is not None:
            self._runs.close()
        self._robots.close()


def play_kill(kill: Kill, reference: Path, folder: Path, robot: Sequence[str]) -> CaseResult:
    """Play a kill, again where its moment was not reached. robot: options of `rtstack sim`."""
    began_s, failures = time.monotonic(), []
    for _ in range(TRIES):
        try:
            scene = Scene(kill, reference, folder, robot)
        except (SceneFailed, HardwareError) as failed:
            failures.append(str(failed))
            continue
        try:
            result = scene.play()
        finally:
            scene.close()
        break
    else:
        result = CaseResult(f"kill -9: {kill.who}", kill.scene, "arms at rest, log kept, nobody left behind")
        result.misses.append(f"the moment was not reached: {failures[-1]}")
    result.seconds = round(time.monotonic() - began_s, 1)
    return result


def main(arguments: list[str] | None = None) -> int:
    """Play the chosen kills. Returns the exit status."""
    from tests.programs.fault_matrix import INTERRUPTED, MISSED, make_ground, sources_digest

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kill", action="append", choices=[kill.name for kill in KILLS], help="only this one")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "faults")
    parser.add_argument("--profile", default=IDEAL, help="of the simulated robot: ideal, honest, harsh")
    parser.add_argument("--phase-us", default="0", help="how much later the right arm's clock ticks")
    parser.add_argument("--drift-ppm", default="0", help="how much faster the right arm's clock is")
    options = parser.parse_args(arguments)
    robot = [f"--profile={options.profile}", f"--phase-us={options.phase_us}", f"--drift-ppm={options.drift_ppm}"]
    chosen = [kill for kill in KILLS if not options.kill or kill.name in options.kill]
    take_charge()
    results: list[CaseResult] = []
    began_s = time.monotonic()
    try:
        ground = make_ground(options.out / "ground" / f"{sources_digest()[:16]}-{options.profile}", options.profile)
        reference = Path(ground.prepared.specification.reference)
        for number, kill in enumerate(chosen, 1):
            result = play_kill(kill, reference, options.out / "kills" / kill.name.replace(" ", "-"), robot)
            results.append(result)
            left_s = (time.monotonic() - began_s) / number * (len(chosen) - number)
            said = f"MISSED: {'; '.join(result.misses)}" if result.misses else "ok"
            print(f"{number}/{len(chosen)}, about {left_s / 60:.1f} min left | {kill.name}: {said}", flush=True)
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        print(write_table(results, len(chosen), options.out, "kills"), flush=True)
    return MISSED if any(result.misses for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
