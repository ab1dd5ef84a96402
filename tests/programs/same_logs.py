"""The same command again and again, quiet and loaded, direct and lockstep: where do the logs differ but in the clocks?

`python -m tests.programs.same_logs [--runs 10] [--cells direct,lockstep] [--loops 2] [--out DIR]`: each run's log is
compared with the first one of its cell, message by message. A loaded run has as many busy loops beside it.

`--seeds N --out DIR`: instead, for N seeds, controllers and displacements by turns, the trial as a worker of a campaign
runs it (the plant in the process, the log written whole after the run) beside `rtstack trial --cell lockstep` (the
robot's own process and protocol, the log written meanwhile by a third), results and logs; but for mode and success
rate of the first state, which is of before the start where the plant is in the process. DIR/seeds.csv keeps what was
compared; `--for-s` ends it after so long, and the same command goes on.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from rtstack.cells import load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.papers.demonstrations import common_attachments
from rtstack.trials.record import frames, trial_metadata
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from rtstack.trials.whole_run_log import WholeRunLog
from tests.support.log.same_log import RTSTACK, busy_loops, differences, messages


def run(*arguments: object) -> None:
    """Run a command of ours. Raises CalledProcessError."""
    subprocess.run([RTSTACK, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


CONTROLLERS = ("proposed", "no_reference_spreading", "no_velocity_feedback", "no_interim", "contact_completion")
HOSTS = {"cell", "log", "compute_us_p50", "compute_us_p99", "real_time_factor"}  # not the trial's own
SHIFTS_MM = (-30.0, 0.0, 30.0)


def as_a_worker(asked: TrialSpecification, log: Path) -> None:
    """Run a trial as rtstack.papers.reference_spreading.worker does."""
    description, source = load_description(None)
    prepared = prepare_trial(asked, description)
    whole = WholeRunLog(
        log, {"trial": trial_metadata(asked, "direct", prepared.reference)}, common_attachments(source),
        frames(description, asked.object),
    )  # fmt: skip
    cell = open_cell("direct", asked.object, asked.displacement, asked.seed, description, cell_file=source)
    try:
        run_trial(prepared, cell, RunContext(whole))
    finally:
        cell.close()


def seeds(folder: Path, number: int, for_s: float) -> int:
    """Compare the two ways for so many seeds; return how many differ, or are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    reference, kept, began_s = folder / "reference.mcap", folder / "seeds.csv", time.monotonic()
    if not reference.exists():
        run("teach", reference)
    done = {int(line.split(",", 1)[0]): line for line in kept.read_text().splitlines()} if kept.exists() else {}
    for seed in range(number):
        if seed in done:
            continue
        if time.monotonic() - began_s > for_s:
            break
        controller, shift = CONTROLLERS[seed % len(CONTROLLERS)], SHIFTS_MM[seed // len(CONTROLLERS) % len(SHIFTS_MM)]
        fast, slow = folder / f"{seed}-fast.mcap", folder / f"{seed}-slow.mcap"
        fast.unlink(missing_ok=True)
        slow.unlink(missing_ok=True)
        as_a_worker(TrialSpecification(str(reference), controller, displacement_mm=shift, seed=seed), fast)
        words = ("--reference", reference, "--controller", controller, "--displacement-mm", shift, "--seed", seed)
        subprocess.run([RTSTACK, "trial", *map(str, words), "--cell", "lockstep", "--log", str(slow)],
                       stdout=subprocess.DEVNULL, check=False)  # fmt: skip # a baseline that fails is compared, too
        found = differences(fast, slow, started=False)
        results = [read_log(path).metadata["result"] for path in (fast, slow)]
        names = (results[0] | results[1]).keys() - HOSTS
        found += [f"result: {name}" for name in sorted(names) if results[0].get(name) != results[1].get(name)]
        done[seed] = f"{seed},{controller},{shift:g},{len(messages(fast))},{'; '.join(found) or 'nothing'}"
        with open(kept, "a") as file:
            print(done[seed], file=file)
        print(done[seed], flush=True)
        if not found:
            fast.unlink()
            slow.unlink()
    differ = [line for line in done.values() if not line.endswith(",nothing")]
    print(f"{len(done)} of {number} seeds compared, {len(differ)} differ")
    return len(differ) + number - len(done)


def main() -> int:
    """Print a table; 1 where a log differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--cells", default="direct,lockstep")
    parser.add_argument("--loops", type=int, default=2)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--for-s", type=float, default=float("inf"))
    chosen = parser.parse_args()
    if chosen.seeds:
        if chosen.out is None:
            parser.error("--seeds needs --out")
        return min(1, seeds(chosen.out, chosen.seeds, chosen.for_s))
    with TemporaryDirectory() as temporary:
        folder = chosen.out or Path(temporary)
        reference = folder / "reference.mcap"
        run("teach", reference)
        failed = 0
        print("| cell | host | run | messages | differs in |\n|---|---|---|---|---|", flush=True)
        for cell in chosen.cells.split(","):
            first: Path | None = None
            for loops in (0, chosen.loops):
                for number in range(1, chosen.runs + 1):
                    log = folder / f"{cell}-{loops}-{number}.mcap"
                    with busy_loops(loops):
                        run("trial", "--reference", reference, "--cell", cell, "--displacement-mm", -30, "--log", log)
                    first = first or log
                    found = differences(first, log)
                    failed += bool(found)
                    host = f"{loops} busy loops" if loops else "quiet"
                    said = "; ".join(found) or "nothing"
                    print(f"| {cell} | {host} | {number} | {len(messages(log))} | {said} |", flush=True)
                    if chosen.out is None and log != first:
                        log.unlink()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
