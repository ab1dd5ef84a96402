"""Finds epsilon, e_m and r_b on the coarse grid. Deterministic; `python -m rtstack.papers.aim_aware.tuning`.

Every case needs bounds of its own to be expected: epsilon_need, the largest distance (11) at an impact, and e_m_need,
what (17) lacks; infinite where (10) or (12), whose bounds are Table 1's, already refuse it. For a tuning

    epsilon_0 = max epsilon_need, e_0 = max e_m_need over the cases with |beta| <= always_deg,

and its separation is the largest factor s for which no case with |beta| >= always_deg + ambiguity_deg is expected with
s epsilon_0 and s e_0. The tuning is sqrt(s) of both: in the middle, on a logarithmic scale, between what would refuse a
wanted case and what would accept an unwanted one. r_b is the candidate whose worst separation among the tunings is the
largest.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from hal.base.configuration import ConfigurationError, toml_text
from rtstack.experiments.registry import plan_file
from rtstack.papers.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.papers.aim_aware.outline import Case, Column, Found, Outline, digest_of, tuning_file
from rtstack.papers.aim_aware.study import Study, Tuned

SEPARATIONS = "separations: of each candidate for r_b, by tuning; none: wanted and unwanted cases cannot be told apart"
LARGE = 1e3  # a bound that is never reached


@dataclass(frozen=True, slots=True)
class Need:
    """The smallest epsilon rad and e_m rad/s with which a case is expected."""

    configuration_rad: float
    velocity_rad_s: float


def need(impact: Impact, column: Column, residual_rate_nm_s: tuple[float, ...]) -> Need:
    """Return the needs of a case with the other bounds of a column."""
    trace = impact.trace(column.parameters(residual_rate_nm_s, LARGE, LARGE))
    hits = np.flatnonzero(trace["impact"])
    if not len(hits) or trace["verdict"][-1] != 1:
        return Need(np.inf, np.inf)
    distances = np.linalg.norm(impact.ticks["q"][hits] - impact.plan.q_d, axis=1)
    return Need(float(distances.max()), float(LARGE * (1.0 - trace["window_margin"][-1])))


def separate(
    needs: Mapping[Case, Need], band: tuple[float, float], ambiguity_deg: float, overlapping: bool = False
) -> Found | None:
    """Return the tuning for a band; None where wanted and unwanted cases cannot be told apart, if not overlapping."""
    low, high = band
    wanted = [need for case, need in needs.items() if low <= case.inclination_deg <= high]
    outside = (low - ambiguity_deg, high + ambiguity_deg)
    unwanted = [need for case, need in needs.items() if not outside[0] < case.inclination_deg < outside[1]]
    configuration = max(each.configuration_rad for each in wanted)
    velocity = max(each.velocity_rad_s for each in wanted)
    if not (np.isfinite(configuration) and configuration > 0.0 and velocity > 0.0):
        return None
    separation = min(max(each.configuration_rad / configuration, each.velocity_rad_s / velocity) for each in unwanted)
    if not (np.isfinite(separation) and (separation > 1.0 or overlapping)):
        return None
    scale = max(1.0, float(np.sqrt(separation)))
    return Found(round(scale * configuration, 4), round(scale * velocity, 4), round(float(separation), 4))


def find(study: Study, residual_rate_nm_s: float) -> dict[str, Found] | None:
    """Return the tunings with this r_b; None if one of them does not exist."""
    needs: dict[str, dict[Case, Need]] = {name: {} for name in study.tunings}
    for place, cases in groupby(study.coarse.cases(), attrgetter("approach_deg", "location_m")):
        plan = plan_case(study, *place)
        for case in cases:
            impact = simulate_case(study, plan, case, residual_rate_nm_s)
            for name, column in study.tunings.items():
                needs[name][case] = need(impact, column, (residual_rate_nm_s,) * 3)
    found = {
        name: separate(needs[name], column.always_deg, column.ambiguity_deg) for name, column in study.tunings.items()
    }
    good = {name: each for name, each in found.items() if each is not None}
    return good if len(good) == len(found) else None


def tune(path: Path) -> Tuned:
    """Return the tuning of the study at `path`. Raises ConfigurationError if no candidate separates the cases."""
    study = Study.load(path)
    candidates = {rate: find(study, rate) for rate in track(study.tuning.residual_rate_nm_s, "candidates for r_b")}
    good = {rate: found for rate, found in candidates.items() if found is not None}
    if not good:
        raise ConfigurationError(f"{path}: key tuning: no residual_rate_nm_s tells the wanted cases from the others")
    best = max(good, key=lambda rate: min(found.separation for found in good[rate].values()))
    separations = {
        f"{rate:g}": [each.separation for each in found.values()] if found else [] for rate, found in candidates.items()
    }
    return Tuned(digest_of(path), best, good[best], separations)


def write_tuning(kind: type[Outline], tune: Callable[[Path], Any], *notes: str) -> None:
    """Command line: tune the study at a path, write deploy/tunings/NAME.toml. notes: comments about its keys."""
    parser = argparse.ArgumentParser(description="Tune a study on its coarse grid.")
    parser.add_argument("study", nargs="?", type=Path, default=plan_file(kind.wanted_kind).path)
    path = parser.parse_args().study
    try:
        name = kind.load(path).name
        found = f"Found by `{kind.command}` on the coarse grid of {name}.toml: run it again, do not edit."
        text = toml_text(asdict(tune(path)), found, SEPARATIONS, *notes)
    except ConfigurationError as error:
        parser.exit(2, f"rtstack: {error}\n")
    except KeyboardInterrupt:
        parser.exit(1, "rtstack: interrupted, nothing was written\n")
    target = tuning_file(name)
    target.write_text(text, encoding="utf-8")
    print(f"{target}\n\n{text}", end="")


if __name__ == "__main__":
    write_tuning(Study, tune)
