"""Processes are killed, disks are full, folders are moved: what is promised is there, and nothing stays behind.

    make program NAME=killed ARGS="--kills 200 --disks 40 --folders 20 --seed 1"

A kill is of a trial, its log process or a process of `rtstack up`, at a random moment of a run. A disk is a small tmpfs
(root, by unshare) that is full at a random moment, or a full /dev/shm. A folder of logs is moved, removed or replaced
by a link during a run. Afterwards: each log that was promised is whole or recovered as the message says, with
all ticks of its result; no traceback; nothing of it in /dev/shm, among the temporary files, or running. Exit status 1
otherwise.

Takes 10 s a case.
"""

import json
import os
import random
import re
import shutil
import subprocess
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from rtstack.log.errors import LogError
from rtstack.log.file.recover import recover
from rtstack.log.reader import read_log
from tests.programs import program
from tests.support.console.stack import COMMAND, SoakFailed, Stack

PATIENCE_S = 600.0


class Cases:
    """Runs cases in a folder. rows: what came of each."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._draw, self._number = folder, random.Random(seed), 0
        self.rows: list[dict] = []
        self.temporary = folder / "temporary"
        self.temporary.mkdir()
        os.environ["TMPDIR"] = str(self.temporary)
        self.reference = folder / "reference.mcap"
        subprocess.run([COMMAND, "teach", self.reference], check=True, stdout=subprocess.DEVNULL)

    def _trial(self, log: Path, *before: str) -> subprocess.Popen[str]:
        command = [*before, str(COMMAND), "trial", "--reference", str(self.reference), "--log", str(log)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def _moment(self, process: subprocess.Popen[str], log: Path) -> bool:
        """Wait for a random moment of the run; False where the run has ended before."""
        until_s = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < until_s and not (log.exists() and log.stat().st_size):
            time.sleep(0.01)
        with suppress(subprocess.TimeoutExpired):
            process.wait(self._draw.uniform(0.0, 0.9))  # it runs six times as fast as the robot would
        return process.poll() is None

    def _note(self, what: str, log: Path, errors: str, status: int | None, **more: object) -> None:
        """Look at what is left of a case. log: where it was to be."""
        row: dict = {"case": what, "status": status, "errors": errors.strip().splitlines(), **more}
        bad = ["traceback"] * ("Traceback" in errors or "internal error" in errors or "SIGBUS" in errors)
        found, advised = log if log.exists() else None, re.search(r"`rtstack recover ([^`]+)`", errors)
        if found is not None:
            try:
                whole = read_log(found)
            except LogError:
                try:
                    output = recover(found).output
                    row["recovered"], whole = True, read_log(output or found)
                except LogError as error:
                    whole = None
                    if advised or what != "kill both":  # neither was left to promise anything
                        bad.append(f"{'advised, and ' if advised else ''}not recovered: {error}")
            if whole is not None:
                row["ticks"] = len(whole.topic("/left/arm"))
                told = whole.metadata.get("result", {}).get("ticks")
                row["missing"] = None if told is None else int(told) - row["ticks"]
                if row["missing"] and row["missing"] > 0:
                    bad.append(f"{row['missing']} ticks are missing")
        elif advised:
            bad.append("there is no log to recover")
        if empty := [path.name for path in log.parent.glob("*.[mj]*") if not path.stat().st_size]:
            bad.append(f"empty: {', '.join(empty)}")
        row["bad"] = bad
        self.rows.append(row)
        print(json.dumps(row), flush=True)

    def kill(self) -> None:
        """Kill a trial or its log process."""
        self._number += 1
        log, victim = self._folder / f"{self._number}.mcap", self._draw.choice(("trial", "log", "log", "both"))
        process = self._trial(log)
        alive = self._moment(process, log)
        children = psutil.Process(process.pid).children() if alive else []
        writers = [child for child in children if _writes_a_log(child)]
        if victim != "log":
            process.kill()
        if victim != "trial":
            for writer in writers:
                writer.kill()
        _, errors = process.communicate(timeout=PATIENCE_S)
        psutil.wait_procs(children, timeout=30.0)
        killed = bool(writers) or victim == "trial"
        self._note(f"kill {victim}" if alive and killed else "kill too late", log, errors, process.returncode)

    def kill_stack(self) -> None:
        """Kill a process of `rtstack up` in a run."""
        self._number += 1
        logs = self._folder / f"logs{self._number}"
        with open(self._folder / "errors.txt", "w+") as errors:
            stack = Stack(logs, errors=errors.fileno())
            members, name, everything = dict(stack.members), "none", list(stack.members.values())
            with stack.beating(), suppress(SoakFailed):
                for order in ("take", "arm", "jobs/demonstration"):
                    stack.post(order, **({"object": "rice_box"} if "/" in order else {}))
                time.sleep(self._draw.uniform(1.0, 4.0))
                everything = [*members.values(), *members["supervisor"].children(recursive=True)]
                writers = [each for each in everything if _writes_a_log(each)]
                name = self._draw.choice(("supervisor", "rtstack.live.robot", "console", "log"))
                for victim in writers if name == "log" else [members[name]]:
                    victim.kill()
                time.sleep(3.0)
            stack.client.close()
            stack.process.terminate()
            stack.process.communicate(timeout=PATIENCE_S)
            left = [" ".join(each.cmdline()) for each in psutil.wait_procs(everything, timeout=30.0)[1]]
            errors.seek(0)
            said = errors.read()
        for log in logs.glob("*.mcap"):
            self._note(f"kill {name} of up", log, said, stack.process.returncode, running=left)

    def disk(self) -> None:
        """Run a trial with a log, or the shared memory, on a disk that is full at some moment."""
        self._number += 1
        place = self._folder / f"disk{self._number}"
        place.mkdir()
        memory = self._draw.random() < 0.25
        size = 4 << self._draw.randrange(15) if memory else self._draw.randrange(4, 6000, 4)
        kept = self._folder / f"kept{self._number}"
        kept.mkdir()
        mount = f"mount -t tmpfs -o size={size}k tmpfs {'/dev/shm' if memory else place}"
        run = f"{COMMAND} trial --reference {self.reference} --log {place}/a.mcap; status=$?"
        command = ["unshare", "-m", "sh", "-c", f"{mount} && {run}; cp {place}/* {kept}/ 2>/dev/null; exit $status"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        errors = done.stderr.replace(str(place), str(kept))
        self._note(f"{'/dev/shm' if memory else 'disk'} of {size} kB", kept / "a.mcap", errors, done.returncode)

    def folder(self) -> None:
        """Move, remove or replace the folder of a log in its run."""
        self._number += 1
        logs, other = self._folder / f"logs{self._number}", self._folder / f"moved{self._number}"
        logs.mkdir()
        log, change = (
            logs / "a.mcap",
            self._draw.choice(("moved", "removed", "replaced by a link", "replaced by a file")),
        )
        process = self._trial(log)
        alive = self._moment(process, log)
        if change == "removed":
            shutil.rmtree(logs)
        else:
            logs.rename(other)
        if change == "replaced by a link":
            (self._folder / f"elsewhere{self._number}").mkdir()
            logs.symlink_to(self._folder / f"elsewhere{self._number}")
        elif change == "replaced by a file":
            logs.write_text("a file\n")
        _, errors = process.communicate(timeout=PATIENCE_S)
        moved = other / "a.mcap"
        self._note(
            f"folder {change}" + " too late" * (not alive), moved if moved.exists() else log, errors, process.returncode
        )

    def left(self) -> list[str]:
        """Return what the last cases have left, once another program of rtstack has started."""
        subprocess.run(
            [COMMAND, "teach", self._folder / f"last{self._number}.mcap"], check=True, stdout=subprocess.DEVNULL
        )
        found = [path.name for path in Path("/dev/shm").glob("rtstack-*")]
        mine = [each for each in found if (pid := each.split("-")[1]).isdecimal() and not psutil.pid_exists(int(pid))]
        return [*mine, *(path.name for path in self.temporary.glob("rtstack-*"))]


def _writes_a_log(process: psutil.Process) -> bool:
    with suppress(psutil.Error):  # it has just ended
        return "rtstack.log.writing.process" in process.cmdline()
    return False


def main(kills: int = 200, disks: int = 40, folders: int = 20, stacks: int = 20, seed: int = 1) -> int:
    """Run all cases. Returns 1 where something was lost, stays behind, or was not said in one line."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as name:
        cases = Cases(Path(name).resolve(), seed)
        for case, count in (
            (cases.folder, folders),
            (cases.disk, disks),
            (cases.kill_stack, stacks),
            (cases.kill, kills - stacks),
        ):
            for _ in range(count):
                case()
        left = cases.left()
    for case, count in sorted(Counter(re.sub(r"\d+", "N", row["case"]) for row in cases.rows).items()):
        rows = [row for row in cases.rows if re.sub(r"\d+", "N", row["case"]) == case]
        bad = [row["bad"] for row in rows if row["bad"]]
        recovered, logs = sum("recovered" in row for row in rows), sum("ticks" in row for row in rows)
        print(f"{case}: {count}, logs {logs}, of these recovered {recovered}, bad {len(bad)} {bad[:2] or ''}")
    print(f"left behind: {', '.join(left) or 'nothing'}")
    return 1 if left or any(row["bad"] or row.get("running") for row in cases.rows) else 0


if __name__ == "__main__":
    program(main)
