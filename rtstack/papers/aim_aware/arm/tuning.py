"""Finds r_b, epsilon and e_m, and learns the velocities after an impact, on approach angles that the report leaves out.

For each candidate r_b, a multiple of the residual's largest rates in free motion: the post-impact velocities of the
nominal hits (as in the paper, the pad's mean velocity over the horizon xi after the first impact); the hits of the
coarse grid; and from what each of them needs, epsilon and e_m as in rtstack.papers.aim_aware.tuning. Unlike there,
wanted hits that nothing can make expected ((10), (12), a reflex) are left out and counted; where wanted and unwanted
hits overlap, the bounds are what the wanted ones need.

The paper does not say which sign an inclination has: taken are the candidate and the side of a one-sided band with
the fewest hits left out, and of these the largest worst separation.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from hal.base.arrays import seven
from hal.base.configuration import ConfigurationError
from rtstack.papers.aim_aware.arm.study import ArmStudy, ArmTuned, Rates, platform_files
from rtstack.papers.aim_aware.arm.worker import LARGE, Twist, learn, nominal_hits, prior, tuning_hit
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.outline import Case, Found, digest_of
from rtstack.papers.aim_aware.platform.plan import PERIOD_S
from rtstack.papers.aim_aware.tuning import Need, need, separate, write_tuning

SETTLED = 50  # ticks: the observer has started
BEFORE = 30  # ticks before the planned impact, in which no contact is possible


def _quiet(study: ArmStudy, cases: Iterable[Case]) -> NDArray[np.float64]:
    """Return the largest rates of the residual (7,), Nm/s, before the contact."""
    until, deaf = round(study.task.approach_s / PERIOD_S) - BEFORE, (LARGE * LARGE,) * 7
    rates = []
    for case in track(cases, "free motion"):
        ticks = tuning_hit(study, case, prior(study, case), deaf, until=until)[1].ticks
        rates.append(np.abs(np.diff(ticks["residual"], axis=0))[SETTLED:].max(axis=0) / PERIOD_S)
    return np.max(rates, axis=0)


def _needs(study: ArmStudy, rates: Rates, learned: dict[str, Twist]) -> dict[str, dict[Case, Need]]:
    needs: dict[str, dict[Case, Need]] = {name: {} for name in study.tunings}
    for case in track(list(study.coarse.cases()), "coarse grid"):
        plan, done = tuning_hit(study, case, learned[f"{case.approach_deg:g}"], rates, "tuning")
        for name, column in study.tunings.items():
            needs[name][case] = need(Impact(case, plan, done.ticks), column, rates)
    return needs


def tune(path: Path) -> ArmTuned:
    """Return the tuning of the study at `path`. Raises ConfigurationError if no candidate separates the cases."""
    study = ArmStudy.load(path)
    nominal = nominal_hits(study, study.coarse.approach_deg.values())
    quiet = _quiet(study, nominal)
    separations: dict[str, list[float]] = {}
    left_out: dict[str, int] = {}
    best: tuple[tuple[int, float], float, bool, dict[str, Found]] | None = None
    for factor in study.tuning.noise_factor:
        rates = _seven(factor * quiet)
        needs = _needs(study, rates, learn(study, nominal, rates))
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
    rates = _seven(factor * quiet)
    learned = learn(study, nominal_hits(study, study.grid.approach_deg.values()), rates)
    digest = digest_of(path, *platform_files())
    return ArmTuned(digest, factor, _seven(quiet), rates, mirrored, learned, found, separations, left_out)


def separated(study: ArmStudy, needs: dict[str, dict[Case, Need]], mirrored: bool) -> tuple[dict[str, Found], int]:
    """Return the tunings for the paper's bands, plain or mirrored (none: one does not exist), and the wanted hits left
    out."""
    found, lost = {}, 0
    for name, column in study.tunings.items():
        low, high = (column.mirrored() if mirrored else column).always_deg
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


def _seven(values: NDArray[np.float64]) -> Rates:
    return seven([float(f"{value:.3g}") for value in values])


if __name__ == "__main__":
    write_tuning(
        ArmStudy, tune,
        "noise_factor: r_b over the residual's largest rate in free motion, quiet_nm_s",
        "mirrored: the paper's bands with the sign of the inclinations turned round",
        "learned: by approach, deg: the pad's velocity after a nominal impact, x m/s, z m/s, about y rad/s",
        "left_out: wanted hits that nothing could make expected",
    )  # fmt: skip
