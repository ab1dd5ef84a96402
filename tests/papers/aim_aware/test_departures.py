"""The departures from the collision-monitoring paper, each with what it changes: the figures that the page names."""

import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from rtstack.control.observer import momentum_residual
from rtstack.papers.aim_aware.classification import plan_case, simulate_case
from rtstack.papers.aim_aware.outline import Case

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "docs/generate"))

from departures.aim_aware import DEPARTURES


def to_the_letter(impact, p, window_behind: bool = True, again: bool = True) -> str:
    """Algorithm 1 as it is printed, on the ticks of an impact; returns the last value of Impact.

    window_behind: m_k begins with 1 in the tick of an impact, so that the next window reaches one tick behind it.
    again: a later impact is judged anew.
    """
    ticks, dt = impact.ticks, p.period_s
    rate = np.abs(np.diff(ticks["residual"], axis=0, prepend=ticks["residual"][:1])) / dt
    bound = np.array(p.residual_rate_nm_s)
    hit = np.any((rate[1:] >= bound) & (rate[:-1] < bound), axis=1)
    error = ticks["dq"] - impact.plan.dq_post
    impact_now, inst, post = "unknown", "unknown", "off"
    m, last, low, high = 1, None, error[0], error[0]
    for k in range(1, len(ticks)):
        t = ticks["t_ns"][k]
        if hit[k - 1]:
            m = 1
            in_time = abs(t - impact.t_d_ns) <= p.time_s * 1e9
            in_place = np.linalg.norm(ticks["q"][k] - impact.plan.q_d) <= p.configuration_rad
            together = last is None or t - last <= p.spacing_s * 1e9
            expected = in_time and in_place and together and (again or inst != "unexpected")
            inst, post = ("expected", "unknown") if expected else ("unexpected", "unexpected")
            low = high = error[k]
            last = t
            start = k - 1 if window_behind else k
        elif last is not None:
            begin = max(k - m, start)
            past = error[begin : k + 1]
            least, most = past.min(axis=0), past.max(axis=0)
            low = np.minimum(least, (1.0 - p.decay_1_s * dt) * low + p.decay_1_s * dt * least)
            high = np.maximum(most, (1.0 - p.decay_1_s * dt) * high + p.decay_1_s * dt * most)
        if last is not None:
            since = t - last
            if post == "unknown":
                outside = np.any(low - p.velocity_rad_s > 0.0) or np.any(high + p.velocity_rad_s < 0.0)
                if outside and since >= round(p.delay * dt * 1e9):
                    post = "unexpected"
                elif since > p.horizon_s * 1e9:
                    post = "expected"
            if post in ("expected", "unexpected") and since > p.horizon_s * 1e9:
                impact_now = "expected" if inst == post == "expected" else "unexpected"
        m = min(m + 1, p.window)
    return impact_now


@pytest.fixture(scope="module")
def impacts(study_run):
    """One place of each approach of the sample, all inclinations."""
    study, rate = study_run.study, study_run.tuned.residual_rate_nm_s
    made = []
    for approach_deg in study.quick.approach_deg.values():
        plan = plan_case(study, approach_deg, 0.30)
        for deg in study.quick.inclination_deg.values():
            made.append(simulate_case(study, plan, Case(approach_deg, 0.30, deg), rate))
    return made


@pytest.mark.long
def test_algorithm_1_to_the_letter_gives_the_same_verdicts_on_the_sample(study_run, impacts):
    monitors = study_run.monitors()
    assert len(impacts) * len(monitors) == 630
    for impact in impacts:
        for p in monitors.values():
            ours = impact.assess(p).verdict.name.lower()
            for behind, again in product((False, True), repeat=2):
                assert to_the_letter(impact, p, behind, again) == ours, (impact.case.id, behind, again)


def test_an_observer_that_begins_with_zero_is_the_same_within_62_ticks():
    work_dtype = [
        ("gravity", "f8", 3),
        ("momentum_integral", "f8", 3),
        ("residual_previous", "f8", 3),
        ("observed", "i8"),
    ]
    control_dtype = [("momentum_residual", "f8", 3), ("residual_rate", "f8", 3)]
    runs = {}
    for zero in (False, True):
        work, control = np.zeros(1, work_dtype), np.zeros(1, control_dtype)
        work["gravity"], work["observed"] = (0.0, 30.0, 10.0), int(zero)  # tau_J without gravity
        for _ in range(63):
            momentum_residual(
                work[0], np.eye(3), np.zeros((3, 3)), np.zeros(3), np.zeros(3), 200.0, 1e-3, control[0]
            )  # fmt: skip
            runs.setdefault(zero, []).append(control["momentum_residual"][0].copy())
    apart = np.abs(np.array(runs[True]) - np.array(runs[False])).max(axis=1)
    assert apart[-1] < 1e-6 * apart[0]


def test_each_departure_is_said_with_the_settings_that_run(study_run):
    assert all(all((d.equation, d.paper_does, d.we_do, d.why, d.effect)) for d in DEPARTURES)
    assert not any("@" in d.effect for d in DEPARTURES)
    text = " ".join(d.we_do for d in DEPARTURES)
    for name, found in study_run.tuned.tunings.items():
        column = study_run.study.tunings[name]
        values = (found.configuration_rad, found.velocity_rad_s, column.configuration_rad, column.velocity_rad_s)
        assert "7({}) {:g} rad, {:g} rad/s ({:g}, {:g})".format(name, *values) in text
    assert f"{study_run.study.task.speed_m_s:g} m/s" in text
