"""A campaign on served arms that is broken off at random moments: no row is lost, none is there twice, none is wrong.

    make program NAME=interrupted_campaign ARGS="--moments 40 --seed 1 --out DIR"

Each moment has one of: kill -9 of the campaign, of a process that it started (but Python's resource tracker), of the
robot; a cut cable (the robot stands still for a second), STOP (Ctrl-C), a tracker that sends nothing for six seconds,
or the PC's power (everything is killed, and the campaign goes on in a copy of its folder). After each it goes on with
--resume.

Takes 20 s a moment, on two cores.
"""

import csv
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import psutil

from rtstack.cells import default_cell_file
from rtstack.experiments.registry import plan_file
from rtstack.log.reader import read_log
from tests.programs import program

FAULTS = ("campaign", "child", "robot", "cable", "STOP", "tracker", "power")
LEFT, RIGHT = "127.93.7.1", "127.93.7.2"
RTSTACK = str(Path(sys.executable).with_name("rtstack"))


class Tracker:
    """Passes the simulated tracker's datagrams on, unless it is `blind`."""

    def __init__(self) -> None:
        self.blind, self.over = False, False
        self._from, self._to = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._from.bind(("127.0.0.1", 0))
        self._from.settimeout(0.2)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.target = probe.getsockname()
        self.source = self._from.getsockname()
        threading.Thread(target=self._pass_on, daemon=True).start()

    def _pass_on(self) -> None:
        while not self.over:
            with suppress(TimeoutError):
                datagram = self._from.recv(2048)
                if not self.blind:
                    self._to.sendto(datagram, self.target)


def served(tracker: Tracker, cell_file: Path, seed: int) -> subprocess.Popen[str]:
    """Start the arms, and wait until they are there."""
    where = f"{tracker.source[0]}:{tracker.source[1]}"
    command = [
        RTSTACK,
        "sim",
        "--lockstep",
        "--profile",
        "honest",
        "--seed",
        str(seed),
        "--left",
        LEFT,
        "--right",
        RIGHT,
    ]
    command += ["--tracker", where, "--cell-file", str(cell_file)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("serving"), "the simulated arms did not start"
    return process


def children(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return what a process started, without Python's resource tracker, which complains where it is killed."""
    every = psutil.Process(process.pid).children(recursive=True)
    return [each for each in every if "resource_tracker" not in " ".join(each.cmdline())]


def end_all(process: subprocess.Popen[str]) -> None:
    """Kill a process, what it started, and wait."""
    every = [*psutil.Process(process.pid).children(recursive=True)] if process.poll() is None else []
    process.kill()
    for each in every:
        with suppress(psutil.NoSuchProcess):
            each.kill()
    process.wait()


def main(moments: int = 40, seed: int = 1, out: Path = Path("out/interrupted")) -> int:
    """Run the program; exit status 1 where a row is lost, there twice, or wrong."""
    draw, root = random.Random(seed), out.resolve()
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    tracker, cell_file, out = Tracker(), root / "cell.toml", root / "campaign"
    cell_file.write_text(default_cell_file().read_text().replace("127.0.0.1:1341", "{}:{}".format(*tracker.target)))
    plan = root / "plan.toml"
    text = plan_file("reference-spreading-cell").path.read_text()
    plan.write_text(text.replace("repetitions = 3", f"repetitions = {max(1, moments // 14)}", 1))
    robot = served(tracker, cell_file, seed)
    done: Counter[str] = Counter()
    said: Counter[str] = Counter()
    folders = recoveries = 0
    status = None
    while status not in (0, 1):
        command = [RTSTACK, "campaign", str(plan), "--out", str(out), "--workers", "1", "--cell-file", str(cell_file)]
        command += ["--cell", f"fci:{LEFT},{RIGHT}"] + ["--resume"] * (out / "campaign.sqlite").exists()
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
        fault = draw.choice(FAULTS) if sum(done.values()) < moments else ""
        with suppress(subprocess.TimeoutExpired):
            process.wait(draw.uniform(6.0, 18.0) if fault else 1800.0)
        if process.poll() is None:
            done[fault] += 1
            if fault == "campaign":
                process.kill()
            elif fault == "child":
                with suppress(psutil.NoSuchProcess):
                    draw.choice(children(process) or [process]).kill()
            elif fault == "robot":
                end_all(robot)
            elif fault == "cable":
                robot.send_signal(signal.SIGSTOP)
                time.sleep(1.0)
                robot.send_signal(signal.SIGCONT)
            elif fault == "STOP":
                process.send_signal(signal.SIGINT)
            elif fault == "tracker":
                tracker.blind = True
                time.sleep(6.0)
                tracker.blind = False
            else:
                folders += 1
                copy = root / f"copy{folders}"
                shutil.copytree(out, copy, ignore_dangling_symlinks=True)
                end_all(process)
                shutil.rmtree(out)
                copy.rename(out)
        if fault in ("tracker", "child", "cable", "robot"):  # it may go on by itself; a robot that is gone does not
            with suppress(subprocess.TimeoutExpired):
                process.wait(20.0)
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=60.0)
        except subprocess.TimeoutExpired:
            print(f"after {fault}: it did not end by Ctrl-C", flush=True)
            end_all(process)
            errors = ""
        lines = errors.strip().splitlines()
        status = process.returncode if not fault else None
        if "recover it first" in errors:
            subprocess.run([RTSTACK, "recover-arms", "--cell", f"fci:{LEFT},{RIGHT}"], check=False, capture_output=True)
            recoveries += 1
        said[lines[-1][:90] if lines else f"status {process.returncode}"] += 1
        if any("Traceback" in line or "internal error" in line for line in lines):
            print(errors, flush=True)
            said["TRACEBACK"] += 1
        print(f"{sum(done.values())}: {fault or 'to the end'}: {lines[-1][:140] if lines else ''}", flush=True)
        if robot.poll() is not None:
            robot = served(tracker, cell_file, seed)
    end_all(robot)
    tracker.over = True
    rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
    wanted = {path.stem for path in (out / "simulated" / "logs").glob("*.mcap")}
    ids = Counter(row["id"] for row in rows)
    wrong = [row["id"] for row in rows if _differs(row, out / row["log"])]
    lost, twice = wanted - set(ids), [name for name, count in ids.items() if count > 1]
    print(
        f"{sum(done.values())} moments ({', '.join(f'{k} {v}' for k, v in done.items())}): {len(rows)} rows; ", end=""
    )
    print(f"lost {len(lost)}, twice {len(twice)}, wrong {len(wrong)}; tracebacks {said['TRACEBACK']}; ", end="")
    print(f"a person gave `rtstack recover-arms` {recoveries} times, and `--resume`")
    return 1 if lost or twice or wrong or said["TRACEBACK"] else 0


def _differs(row: dict[str, str], log: Path) -> bool:
    """Whether a row is not what its log says, or is of an aborted run."""
    metadata = read_log(log).metadata
    result = metadata["result"]
    same = metadata["campaign"]["id"] == row["id"] and result["success"] == row["success"].lower()
    return not same or result["ticks"] != row["ticks"] or "aborted" in log.name


if __name__ == "__main__":
    program(main)
