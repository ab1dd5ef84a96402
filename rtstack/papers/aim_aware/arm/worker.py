"""The work of a worker: the repetitions of a hit, each judged by every tuning.

A hit has a cell of its own; the pad's velocity after an impact is learned from nominal hits.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Seven, seven
from hal.base.configuration import ConfigurationError
from hal.pad import Pad
from rtstack.experiments.experiment import DIRECT, CellRun, Row
from rtstack.experiments.seeds import seed_of
from rtstack.log.reader import Log
from rtstack.loop.end import End
from rtstack.model.cell_description import ArmMounting
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.arm.study import ArmRun, ArmStudy, Rates, Setup, platform_cell_file, platform_files
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.planar.parameters import Task
from rtstack.papers.aim_aware.planar.plan import approach_velocity
from rtstack.papers.aim_aware.platform.hit import Hit, PreparedHit, hit_parameters, ticks_of
from rtstack.papers.aim_aware.platform.plan import AXES, PERIOD_S, HitPlan, plan_hit
from rtstack.papers.aim_aware.worker import verdict_columns, verdicts
from rtstack.papers.demonstrations import campaign_record, record_of
from rtstack.papers.simulated_cell import BuiltCell
from rtstack.trials.carry_out import carry_out
from rtstack.trials.record import RunLog, cell_attachments, whole_run_log
from rtstack.trials.review import log_columns
from rtstack.trials.specification import HitSpecification
from sim_robot.plant_parameters import PlantParameters, load_plant_parameters
from sim_robot.scene import Scene, load_scene

PLATFORM_DRAW = 3  # beside 0 arms and placement, 1 sensors, 2 tracker (sim_robot)
Twist = tuple[float, float, float]
LARGE = 1e3  # a bound that is never reached
NOTHING = "nothing"


@lru_cache(maxsize=1)
def _simulated() -> tuple[Scene, PlantParameters]:
    """The scene's file has a second arm far away, which takes no part."""
    return load_scene(platform_files()[0]).only(("left",)), load_plant_parameters()


def hit_scene(setup: Setup, home: Seven, inclination_deg: float, seed: int) -> Scene:
    """Return the scene of a hit, the arm at rest at home (7,), rad. seed: of how exactly the platform is set up."""
    scene, _ = _simulated()
    assert scene.platform is not None
    draw = np.random.default_rng(np.random.SeedSequence([seed, PLATFORM_DRAW])).standard_normal(2)
    x, y, z = scene.platform.centre
    platform = replace(
        scene.platform,
        centre=(x, y, z + 1e-3 * setup.height_mm * float(draw[0])),
        inclination_deg=inclination_deg + setup.inclination_deg * float(draw[1]),
        stiffness=setup.stiffness or scene.platform.stiffness,
        damping=setup.damping or scene.platform.damping,
    )
    pad = replace(scene.pad, friction=setup.friction or scene.pad.friction)
    return replace(scene, platform=platform, pad=pad, left=replace(scene.arms[0], home=home))


@lru_cache(maxsize=16)
def _planned(
    mounting: ArmMounting, pad: Pad, task: Task, approach_deg: float, location_m: float, twist: Twist
) -> HitPlan:
    return plan_hit(mounting, pad, task, np.radians(approach_deg), location_m, np.array(twist))


def plan_case(study: ArmStudy, case: Case, twist: Twist) -> HitPlan:
    """Plan the impact of a case. twist: learned velocity of the pad after it."""
    return _planned(study.mounting, study.pad, study.task, case.approach_deg, case.location_m, twist)


def prepare_hit(
    study: ArmStudy, case: Case, plan: HitPlan, monitoring: MonitorParameters, seed: int, until: int | None = None
) -> PreparedHit:
    """Return the run of one hit, for `until` ticks at most."""
    specification = HitSpecification(case.id, case.inclination_deg, study.setup.robot, seed)
    return PreparedHit(specification, study.description, study.gains, plan, monitoring, until)


def hit_case(study: ArmStudy, case: Case, prepared: PreparedHit, log: RunLog | None = None, kind: str = DIRECT) -> Hit:
    """Run one hit on a cell with the study's robot; the seed draws noise and set-up. kind: see BuiltCell."""
    setup, seed = study.setup, prepared.specification.seed
    scene = hit_scene(setup, seven(prepared.plan.q_start), case.inclination_deg, seed)
    return carry_out(prepared, BuiltCell(scene, _simulated()[1], NOTHING, seed, arms_seed=setup.robot).host(kind, log))


def nominal_hits(study: ArmStudy, approach_deg: Iterable[float]) -> list[Case]:
    """Return the hits to learn from: inclination 0, `learning` repetitions of each approach angle."""
    location_m = study.grid.location_m.first
    return [Case(deg, location_m, 0.0, n) for deg in approach_deg for n in range(study.tuning.learning)]


def tuning_hit(
    study: ArmStudy, case: Case, twist: Twist, rates: tuple[float, ...], seeds: str = "learning",
    until: int | None = None,
) -> tuple[HitPlan, Hit]:  # fmt: skip
    """Run a hit whose monitor has these rates, and bounds that are never reached. seeds: a name of their own."""
    plan, monitoring = plan_case(study, case, twist), next(iter(study.tunings.values())).parameters(rates, LARGE, LARGE)
    return plan, hit_case(
        study, case, prepare_hit(study, case, plan, monitoring, seed_of(study.seed, seeds, case.id), until)
    )


def learn(study: ArmStudy, cases: Iterable[Case], rates: Rates) -> dict[str, Twist]:
    """Return the pad's velocities after a nominal impact, by approach angle."""
    seen: dict[str, list[NDArray[np.float64]]] = {}
    horizon = round(next(iter(study.tunings.values())).horizon_s / PERIOD_S)
    for case in cases:
        _, done = tuning_hit(study, case, prior(study, case), rates)
        first = int(np.argmax(done.ticks["post"]))
        if done.stopped or first == 0:
            raise ConfigurationError(f"a nominal hit at {case.approach_deg:g} deg: {done.stopped or 'no impact'}")
        twist = done.ticks["twist"][first : first + horizon, AXES].mean(axis=0)
        seen.setdefault(f"{case.approach_deg:g}", []).append(twist)
    return {deg: _twist(np.mean(twists, axis=0)) for deg, twists in seen.items()}


def prior(study: ArmStudy, case: Case) -> Twist:
    """Return the velocity that a frictionless platform would leave."""
    x, _, _ = approach_velocity(study.task, np.radians(case.approach_deg))
    return float(x), 0.0, 0.0


def _twist(values: NDArray[np.float64]) -> Twist:
    x, z, turn = (round(float(value), 4) for value in values)
    return x, z, turn


def columns(run: ArmRun) -> dict[str, Any]:
    known: dict[str, Any] = {
        "approach_deg": float, "location_m": float, "inclination_deg": float, "repetition": int, "seed": int,
        "contact": int, "stopped": str, "impacts": int, "first_ms": float, "last_ms": float,
    }  # fmt: skip
    return known | verdict_columns(run.monitors())


def _prepared(run: ArmRun, case: Case) -> PreparedHit:
    plan = plan_case(run.study, case, run.tuned.learned[f"{case.approach_deg:g}"])
    monitoring = next(iter(run.monitors().values()))  # all tunings have the same detection
    return prepare_hit(run.study, case, plan, monitoring, _seed(run, case))


def _seed(run: ArmRun, case: Case) -> int:
    return seed_of(run.study.seed, "judged", case.id)


def judged_case(run: ArmRun, case: Case) -> tuple[Impact[HitPlan], Hit]:
    """Return a case of the report: the impact and the hit. Writes the hit's log where the run has a folder for logs."""
    prepared, log = _prepared(run, case), None
    if run.logs is not None:
        log = whole_run_log(
            run.logs.path / f"{case.id}.mcap", prepared.specification, prepared.description,
            cell_attachments(platform_cell_file(), prepared.description), run.cell,
            campaign=campaign_record(case, run.logs.digest),
        )  # fmt: skip
    done = hit_case(run.study, case, prepared, log, run.cell)
    if log is not None and not log.path.exists():
        raise OSError(done.failure_reason)
    return Impact(case, prepared.plan, done.ticks), done


def on_arms(run: ArmRun, case: Case, path: Path) -> CellRun:
    """Return a hit as a run on a cell's arm, which goes to the start of the plan by itself. path: of its log."""
    setup = f"set the platform to {case.inclination_deg:g} degrees"
    return CellRun(_prepared(run, case), path, record_of(case), setup=setup)


def row_of_log(run: ArmRun, case: Case, log: Log) -> Row:
    reason = log.metadata["result"]["failure_reason"]
    prepared, end = _prepared(run, case), End.in_reason(reason)
    parameters = hit_parameters(prepared.description, prepared.gains, prepared.plan)
    ticks = ticks_of(log_columns(log), prepared.description, parameters, end)
    followed = end is End.COMPLETED or len(ticks) == len(prepared.plan.ante)
    stopped = "" if followed else reason.removeprefix(f"{end}: ")
    return _row(run, Impact(case, prepared.plan, ticks), stopped) | {"cpu_s": None}


def _row(run: ArmRun, impact: Impact[HitPlan], stopped: str) -> Row:
    case = impact.case
    row: Row = {"id": case.id, **asdict(case), "seed": _seed(run, case), "stopped": stopped}
    return row | verdicts(impact, run.monitors())


def learned_at(run: ArmRun, case: Case) -> tuple[ArmRun, str]:
    """Return the study with the contact of a case and the velocity learned with it; the reason if that failed."""
    at, failed = run.at(case.contact), ""
    if not case.contact:
        return at, failed
    try:
        learned = learn(at.study, nominal_hits(at.study, [case.approach_deg]), run.tuned.residual_rate_nm_s)
    except ConfigurationError as error:
        learned, failed = {f"{case.approach_deg:g}": prior(at.study, case)}, str(error)
    return replace(at, tuned=replace(at.tuned, learned=learned)), failed


def run_cases(run: ArmRun, cases: Sequence[Case]) -> list[Row]:
    """Return a row for each case. stopped: reason if the robot or the safety judge ended the hit."""
    began_s = time.process_time()
    rows: list[Row] = []
    run, failed = learned_at(run, cases[0])
    for case in cases:
        impact, done = judged_case(run, case)
        rows.append(_row(run, impact, failed or done.stopped))
    cpu_s = (time.process_time() - began_s) / len(rows)
    return [row | {"cpu_s": cpu_s} for row in rows]
