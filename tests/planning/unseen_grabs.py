"""Planned grabs at speeds and heights that nobody has tuned on, with the right and with a wrong post-impact velocity.

    .venv/bin/python tests/planning/unseen_grabs.py [--seeds 20] [--jobs 2] [--folder .unseen-grabs]

Each seed draws speed, rise and height (RANGES) and is the trial's own seed; each is planned and run three times: as the
impact map says, and with the velocities after the impact scaled by 0.8 and 1.2. Prints a table and says for the force
norm (33) in the 200 ms around the impact, and for what feedback adds to the feedforward there, whether the plan as the
map says has less. Goes on where it was ended. Exit status 1 where a grab as planned fails, or where the norm (33) is
not lower than both wrong plans' (95 % interval of the paired difference); 130 after Ctrl-C.
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal

import numpy as np
from rich.progress import track
from scipy import stats

from rtstack.campaign.trial_log import WholeRunLog
from rtstack.cli.cells import default_cell_file, open_cell
from rtstack.model.cell_description import load_cell_description
from rtstack.planning import GrabPlan, plan_grab
from rtstack.planning.file import write_plan
from rtstack.trials.record import frames
from rtstack.trials.run import prepare_trial, run_trial
from rtstack.trials.scoring import FORCE_WINDOW_S
from rtstack.trials.specification import TrialSpecification

OBJECT = "rice_box"
SCALES = (1.0, 0.8, 1.2)
FIRST_SEED = 7000  # nothing was tried out on these seeds
RANGES = {"speed": (0.25, 0.5), "rise": (0.2, 0.35), "height": (0.02, 0.045)}  # m/s, m/s, m
HERE = Path(__file__).resolve().parent


@dataclass(frozen=True, slots=True)
class Grab:
    """What came out of one. norm: mean of (33), feedback: of the same without the feedforward, N; vertical: mean
    feedback of both pads upwards after the impact, N."""

    seed: int
    scale: float
    speed: float
    rise: float
    height: float
    success: bool
    reason: str | None
    norm: float
    feedback: float
    vertical: float
    peak: float


def drawn(seed: int) -> dict[str, float]:
    """Return speed, rise and height of a seed, in mm/s and mm as a person would ask for them."""
    rng = np.random.default_rng(seed)
    return {key: round(float(rng.uniform(*bounds)), 3) for key, bounds in RANGES.items()}


def run(wanted: tuple[int, float]) -> Grab:
    """Plan, write, read back, grab, for a seed and a scale."""
    seed, scale = wanted
    description = load_cell_description(default_cell_file())
    asked = drawn(seed)
    planned = plan_grab(description, OBJECT, GrabPlan(**asked, post_impact_scale=scale))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.mcap"
        write_plan(path, planned, description, default_cell_file())
        prepared = prepare_trial(TrialSpecification(str(path), object=OBJECT, seed=seed), description)
        log = WholeRunLog(Path(folder) / "trial.mcap", {}, [], frames(description, OBJECT))
        cell = open_cell("direct", OBJECT, 0.0, seed)
        try:
            result = run_trial(prepared, cell, log=log)
        finally:
            cell.close()
    assert log.columns is not None
    control = log.columns.control
    t_s = (control[0]["t_ns"] - control[0]["t_ns"][0]) * 1e-9 - result.nominal_impact_time_s
    window = np.abs(t_s) <= FORCE_WINDOW_S + 1e-9
    feedback = control["wrench_desired"] - control["wrench_ff"]
    norm = np.linalg.norm(feedback, axis=(0, 2))[window].mean()
    vertical = feedback[:, window & (t_s > 0.0), 2].mean()
    return Grab(
        seed, scale, **asked, success=result.success, reason=result.failure_reason,
        norm=result.average_force_norm or np.nan, feedback=float(norm), vertical=float(vertical),
        peak=result.peak_force_norm or np.nan,
    )  # fmt: skip


def report(grabs: list[Grab]) -> int:
    """Print the table and what it shows; return the exit status."""
    of = {(grab.seed, grab.scale): grab for grab in grabs}
    seeds = sorted({grab.seed for grab in grabs})
    print(f"{'seed':>5} {'speed':>6} {'rise':>6} {'height':>6} | " + " | ".join(
        f"x {scale:<4}: {'norm':>6} {'feedb.':>6} {'z':>6}" for scale in SCALES))  # fmt: skip
    for seed in seeds:
        row = [of[seed, scale] for scale in SCALES]
        cells = (
            f"{'ok' if grab.success else 'FAIL':>7} {grab.norm:>6.2f} {grab.feedback:>6.2f} {grab.vertical:>6.2f}"
            for grab in row
        )
        asked = f"{row[0].speed:>6.3f} {row[0].rise:>6.3f} {row[0].height:>6.3f}"
        print(f"{seed:>5} {asked} | {' | '.join(cells)}")
    for grab in grabs:
        if not grab.success:
            print(f"seed {grab.seed}, x {grab.scale}: {grab.reason}")
    held = sum(of[seed, 1.0].success for seed in seeds)
    print(f"\ngrabs as planned that succeed: {held} of {len(seeds)}")
    bad = held < len(seeds)
    for name, what, judged in (("norm", "force norm (33)", True), ("feedback", "feedback's share of it", False)):
        for scale in SCALES[1:]:
            more = np.array([getattr(of[seed, scale], name) - getattr(of[seed, 1.0], name) for seed in seeds])
            half = stats.t.ppf(0.975, len(more) - 1) * more.std(ddof=1) / np.sqrt(len(more))
            lower = more.mean() - half > 0.0
            print(f"{what}: with x {scale} {more.mean():+.2f} N, 95 % within {more.mean() - half:+.2f} and "
                  f"{more.mean() + half:+.2f}; more in {np.sum(more > 0)} of {len(more)} seeds: "
                  f"{'lower as planned' if lower else 'NOT lower as planned'}")  # fmt: skip
            bad |= judged and not lower
    return 1 if bad else 0


def main() -> int:
    """Run what is missing; return the exit status."""
    arguments = argparse.ArgumentParser(description="Planned grabs at unseen speeds and heights.")
    arguments.add_argument("--seeds", type=int, default=20)
    arguments.add_argument("--folder", type=Path, default=HERE.parents[1] / ".unseen-grabs")
    arguments.add_argument("--jobs", type=int, default=os.cpu_count())
    options = arguments.parse_args()
    if options.seeds < 2:
        arguments.error("--seeds: two at least, for an interval")
    options.folder.mkdir(exist_ok=True)
    (options.folder / ".gitignore").write_text("*\n")
    results = options.folder / "results.jsonl"
    known = [Grab(**json.loads(line)) for line in results.read_text().splitlines()] if results.exists() else []
    done = {(grab.seed, grab.scale) for grab in known}
    wanted = [(FIRST_SEED + k, scale) for k in range(options.seeds) for scale in SCALES]
    missing = [pair for pair in wanted if pair not in done]
    try:
        with get_context("spawn").Pool(options.jobs, signal, (SIGINT, SIG_IGN)) as processes:
            for grab in track(processes.imap_unordered(run, missing), "grabs", len(missing)):
                known.append(grab)
                with results.open("a") as file:
                    file.write(json.dumps(asdict(grab)) + "\n")
    except KeyboardInterrupt:
        print("ended; the next run goes on from here")
        return 130
    return report([grab for grab in known if (grab.seed, grab.scale) in set(wanted)])


if __name__ == "__main__":
    sys.exit(main())
