"""Finds r_b, epsilon and e_m, and learns the velocities after an impact, on approach angles that the report leaves out.

In this order: the residual's largest rates in free motion; for each candidate, r_b as so many times these, and the
post-impact velocities of the nominal hits (as in the paper, no impact map: the pad's mean velocity over the horizon
xi after the first impact, of hits whose reference keeps what a frictionless platform would leave); the hits of the
coarse grid; and from what each of them needs, epsilon and e_m as in the planar study
(rtstack.papers.aim_aware.tuning). Unlike there, wanted hits that nothing can make expected ((10), (12), a reflex of
the robot) are left out, and counted; and where wanted and unwanted hits overlap, the bounds are what the wanted ones
need, and no more.

The text of the paper does not say which sign an inclination has: a band that is one-sided may lie on either side, and
the tuning takes the candidate and the side with the fewest hits left out, and of these the largest worst separation.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from hal.configuration import ConfigurationError
from rtstack.experiments.seeds import seed_of
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.arm.study import COMMAND, ArmStudy, ArmTuned, Seven, load_arm_study
from rtstack.papers.aim_aware.arm.worker import Twist, hit_case, plan_case
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.grid import Case, Found
from rtstack.papers.aim_aware.planar.plan import approach_velocity
from rtstack.papers.aim_aware.platform.plan import AXES, PERIOD_S
from rtstack.papers.aim_aware.platform.setup import platform_files
from rtstack.papers.aim_aware.tuned import digest_of
from rtstack.papers.aim_aware.tuning import LARGE, Need, need, separate, write_tuning

SETTLED = 50  # ticks: the observer has started
BEFORE = 30  # ticks before the planned impact: nothing can be touched yet


class _Tuner:
    def __init__(self, study: ArmStudy) -> None:
        self._study = study

    def nominal(self, approach_deg: Iterable[float]) -> list[Case]:
        """Return the hits to learn from, on a platform that is as it is meant to be."""
        location_m = self._study.grid.location_m.first
        return [Case(deg, location_m, 0.0, n) for deg in approach_deg for n in range(self._study.tuning.learning)]

    def quiet(self, cases: Iterable[Case]) -> NDArray[np.float64]:
        """Return the residual's largest rates (7,), Nm/s, before anything is touched."""
        until = round(self._study.task.approach_s / PERIOD_S) - BEFORE
        rates = []
        for case in track(cases, "free motion"):
            plan, seed = plan_case(self._study, case, self._prior(case)), self._seed("learning", case)
            deaf = self._monitoring((LARGE * LARGE,) * 7)
            ticks = hit_case(self._study, case, plan, deaf, seed, until).ticks
            rates.append(np.abs(np.diff(ticks["residual"], axis=0))[SETTLED:].max(axis=0) / PERIOD_S)
        return np.max(rates, axis=0)

    def learn(self, cases: Iterable[Case], rates: Seven) -> dict[str, Twist]:
        """Return the pad's velocities after a nominal impact, by approach angle."""
        seen: dict[str, list[NDArray[np.float64]]] = {}
        horizon = round(next(iter(self._study.tunings.values())).horizon_s / PERIOD_S)
        for case in track(cases, "learning"):
            plan, seed = plan_case(self._study, case, self._prior(case)), self._seed("learning", case)
            done = hit_case(self._study, case, plan, self._monitoring(rates), seed)
            first = int(np.argmax(done.ticks["post"]))
            if done.stopped or first == 0:
                raise ConfigurationError(f"a nominal hit at {case.approach_deg:g} deg: {done.stopped or 'no impact'}")
            twist = done.ticks["twist"][first : first + horizon, AXES].mean(axis=0)
            seen.setdefault(f"{case.approach_deg:g}", []).append(twist)
        return {deg: _twist(np.mean(twists, axis=0)) for deg, twists in seen.items()}

    def needs(self, rates: Seven, learned: dict[str, Twist]) -> dict[str, dict[Case, Need]]:
        """Return what each hit of the coarse grid needs to be expected, by tuning."""
        needs: dict[str, dict[Case, Need]] = {name: {} for name in self._study.tunings}
        for case in track(list(self._study.coarse.cases()), "coarse grid"):
            plan = plan_case(self._study, case, learned[f"{case.approach_deg:g}"])
            seed = self._seed("tuning", case)
            done = hit_case(self._study, case, plan, self._monitoring(rates), seed)
            impact = Impact(case, plan, done.ticks)
            for name, column in self._study.tunings.items():
                needs[name][case] = need(impact, column, rates)
        return needs

    def _prior(self, case: Case) -> Twist:
        x, _, _ = approach_velocity(self._study.task, np.radians(case.approach_deg))
        return float(x), 0.0, 0.0

    def _monitoring(self, rates: tuple[float, ...]) -> MonitorParameters:
        return next(iter(self._study.tunings.values())).parameters(rates, LARGE, LARGE)

    def _seed(self, what: str, case: Case) -> int:
        return seed_of(self._study.seed, what, case.id)


def tune(path: Path) -> ArmTuned:
    """Return the tuning of the study at `path`. Raises ConfigurationError where no candidate tells the cases apart."""
    study = load_arm_study(path)
    tuner = _Tuner(study)
    nominal = tuner.nominal(study.coarse.approach_deg.values())
    quiet = tuner.quiet(nominal)
    separations: dict[str, list[float]] = {}
    left_out: dict[str, int] = {}
    best: tuple[tuple[int, float], float, bool, dict[str, Found]] | None = None
    for factor in study.tuning.noise_factor:
        rates = _rates(factor, quiet)
        needs = tuner.needs(rates, tuner.learn(nominal, rates))
        for mirrored in (False, True):
            found, lost = separated(study, needs, mirrored)
            name = f"{factor:g}{', mirrored' * mirrored}"
            separations[name], left_out[name] = [each.separation for each in found.values()], lost
            rank = -lost, min((each.separation for each in found.values()), default=0.0)
            if found and (best is None or rank > best[0]):
                best = rank, factor, mirrored, found
    if best is None:
        raise ConfigurationError(f"{path}: key tuning: no noise_factor tells the wanted cases from the others")
    _, factor, mirrored, found = best
    rates = _rates(factor, quiet)
    learned = tuner.learn(tuner.nominal(study.grid.approach_deg.values()), rates)
    digest = digest_of(path, *platform_files())
    return ArmTuned(digest, factor, _seven(quiet), rates, mirrored, learned, found, separations, left_out)


def separated(
    study: ArmStudy, needs: dict[str, dict[Case, Need]], mirrored: bool
) -> tuple[dict[str, Found], int]:  # fmt: skip
    """Return the tunings for the paper's bands, on this side, none where one does not exist; and how many wanted hits
    were left out."""
    found, lost = {}, 0
    for name, column in study.tunings.items():
        low, high = (column.mirrored() if mirrored else column).band
        hopeless = {
            case for case, need in needs[name].items()
            if low <= case.inclination_deg <= high and not np.isfinite(need.configuration_rad + need.velocity_rad_s)
        }  # fmt: skip
        lost += len(hopeless)
        rest = {case: need for case, need in needs[name].items() if case not in hopeless}
        if not any(low <= case.inclination_deg <= high for case in rest):
            return {}, lost
        each = separate(rest, (low, high), column.ambiguity_deg, overlapping=True)
        if each is None:
            return {}, lost
        found[name] = each
    return found, lost


def _rates(factor: float, quiet: NDArray[np.float64]) -> Seven:
    return _seven(factor * quiet)


def _seven(values: NDArray[np.float64]) -> Seven:
    a, b, c, d, e, f, g = (float(f"{value:.3g}") for value in values)
    return a, b, c, d, e, f, g


def _twist(values: NDArray[np.float64]) -> Twist:
    x, z, turn = (round(float(value), 4) for value in values)
    return x, z, turn


if __name__ == "__main__":
    write_tuning(
        "aim-aware-arm", load_arm_study, tune, COMMAND,
        "noise_factor: r_b over the residual's largest rate in free motion, quiet_nm_s",
        "mirrored: the paper's bands with the sign of the inclinations turned round",
        "learned: by approach, deg: the pad's velocity after a nominal impact, x m/s, z m/s, about y rad/s",
        "left_out: wanted hits that nothing could make expected",
    )  # fmt: skip
