"""A day of the robot in an hour: a campaign that does not end, and the slopes of what its processes take.

    make program NAME=robot_hours ARGS="--hours 24 --workers 2"

Runs `rtstack campaign` with a plan of thousands of trials, each with its log, until the trials have lasted so many
hours of the robot's time, then ends it as Ctrl-C does. Every 20 s it notes memory (USS) and descriptors of all
processes, entries of this project in /dev/shm and among temporary files, and the files of the campaign's folder
without its logs. Logs are deleted once their rows are kept. Exit status 1 where a slope since the first tenth is above
its standard error by three and would add 5 % in a day (files: one), where a trial could not be run, or where something
is left behind.

Takes an hour for 24 hours of the robot, on two quiet cores.
"""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import psutil
import typer

from rtstack.experiments.registry import plan_file
from rtstack.experiments.store import DATABASE
from tests.programs import program
from tests.support.growth import Growth, descriptors, memory_mb, shared_files

PLAN = "reference-spreading"
NAME = "robot-hours"
PERIOD_S = 20.0
FRESH_LOGS = 200  # logs that stay; older ones have their rows
DAY_H = 24.0
MOST_GROWTH = 0.05  # in a day
SURE = 3.0  # standard errors


def main(
    hours: Annotated[float, typer.Option(help="of the robot's time")] = 24.0,
    workers: int = 2,
    json_file: Annotated[Path | None, typer.Option("--json", help="write the report here, too")] = None,
) -> int:
    """Run, watch, report. Returns 0 where all stayed flat, else 1."""
    before, growths = shared_files(), defaultdict(Growth)
    with TemporaryDirectory() as folder:
        out, plans = Path(folder) / "campaign", Path(folder) / "config" / "rtstack" / "campaigns"
        plans.mkdir(parents=True)
        text = plan_file(PLAN).path.read_text(encoding="utf-8").replace(f'name = "{PLAN}"', f'name = "{NAME}"', 1)
        (plans / f"{NAME}.toml").write_text(text.replace("repetitions = ", "repetitions = 40 # "), encoding="utf-8")
        command = [sys.executable, "-m", "rtstack", "campaign", NAME, "--out", str(out)]
        environment = os.environ | {"XDG_CONFIG_HOME": str(Path(folder) / "config")}
        campaign = subprocess.Popen([*command, "--workers", str(workers)], env=environment)
        trials, robot_h = 0, 0.0
        try:
            while campaign.poll() is None and robot_h < hours:
                time.sleep(PERIOD_S)
                trials, robot_h = _progress(out / DATABASE)
                _delete_old_logs(out / "logs")
                if robot_h:
                    _note(growths, robot_h, campaign.pid, out)
                print(f"{trials} trials, {robot_h:.2f} of {hours:g} h", file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            print("ended early: what there is so far")
        finally:
            early = campaign.poll() is not None
            campaign.send_signal(signal.SIGINT)
            campaign.wait(60.0)
        report, trouble = _report(growths, trials, robot_h)
    if early:
        trouble.append(f"the campaign ended by itself, with exit status {campaign.returncode}")
    if (left := shared_files() - before) > 0:
        trouble.append(f"{left} entries are left in /dev/shm or the folder of temporary files")
    print(json.dumps(report | {"trouble": trouble}, indent=2))
    if json_file is not None:
        json_file.write_text(json.dumps(report | {"trouble": trouble}) + "\n")
    return 1 if trouble else 0


def _progress(database: Path) -> tuple[int, float]:
    """Return how many trials there are, and how many hours of the robot they lasted."""
    if not database.exists():
        return 0, 0.0
    with closing(sqlite3.connect(database)) as connection:
        trials, ticks = connection.execute("SELECT count(*), coalesce(sum(ticks), 0) FROM results").fetchone()
    return trials, ticks / 3.6e6


def _delete_old_logs(folder: Path) -> None:
    logs = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime) if folder.is_dir() else []
    for path in logs[:-FRESH_LOGS]:
        path.unlink()


def _note(growths: dict[str, Growth], robot_h: float, pid: int, out: Path) -> None:
    main_process = psutil.Process(pid)
    workers = main_process.children(recursive=True)
    growths["memory of the campaign, MB"].note(robot_h, memory_mb([main_process]))
    growths["memory of the workers, MB"].note(robot_h, memory_mb(workers))
    growths["descriptors"].note(robot_h, descriptors([main_process, *workers]))
    growths["processes"].note(robot_h, 1 + len(workers))
    growths["shared files"].note(robot_h, shared_files())
    growths["files without logs"].note(robot_h, sum(1 for path in out.rglob("*") if path.suffix != ".mcap"))


def _report(growths: dict[str, Growth], trials: int, robot_h: float) -> tuple[dict, list[str]]:
    rows, trouble = {}, []
    for name, growth in growths.items():
        begin = 0.1 * robot_h
        if (found := growth.slope(begin)) is None:
            trouble.append(f"{name}: too few samples")
            continue
        slope, error = found
        first, last = growth.ends(begin)
        rows[name] = {"first": first, "last": last, "slope_per_hour": slope, "standard_error": error}
        if slope > SURE * error and DAY_H * slope > max(MOST_GROWTH * first, 1.0):
            trouble.append(f"{name}: grows by {slope:.3g} an hour of the robot")
    return {"trials": trials, "robot_hours": round(robot_h, 3), "slopes": rows}, trouble


if __name__ == "__main__":
    program(main)
