"""A tuning from arrays, for any number of joints and any period: what it follows from, and what it then finds."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.monitor.monitor import Monitor
from rtstack.monitor.records import Reason, Verdict
from rtstack.monitor.tuning import GoodMotion, tune_monitor

T_D_S = 0.5


def motion(seed, joints=2, period_s=1e-3, hit_s=T_D_S, swing=0.1, start_ns=0):
    """A motion with an impact at hit_s, after which the joints swing about their reference."""
    rng, t_s = np.random.default_rng(seed), np.arange(round(1.0 / period_s)) * period_s
    since = np.maximum(t_s - hit_s, 0.0)[:, None]
    residual = 0.02 * rng.standard_normal((len(t_s), joints)) + 5.0 * (since > 0.0)
    dq = swing * np.exp(-since / 0.05) * np.sin(since * 2.0 * np.pi / 0.012) + 0.01 * rng.standard_normal(
        residual.shape
    )
    q = np.ones(joints) + 0.01 * np.sin(t_s)[:, None]
    t_ns = start_ns + np.round(t_s * 1e9).astype(np.int64)
    t_d_ns = start_ns + round(T_D_S * 1e9)
    return GoodMotion(f"run {seed}", t_ns, residual, q, dq, np.zeros_like(dq), t_d_ns, np.ones(joints))


def verdict(run, tuning):
    monitor = Monitor(tuning)
    monitor.expect(run.t_d_ns, run.q_d)
    return monitor.assess(run.t_ns, run.residual, run.q, run.dq, run.dq_ref)


@pytest.mark.parametrize(("joints", "period_s"), [(1, 1e-3), (2, 2e-3), (6, 1e-3)])
def test_good_motions_of_other_seeds_are_expected_and_wrong_ones_are_not(joints, period_s):
    hits = (0.48, 0.49, 0.5, 0.51, 0.52)
    tuning = tune_monitor([motion(k, joints, period_s, hit) for k, hit in enumerate(hits)], 1.5)
    assert tuning.joints == joints
    assert tuning.period_s == period_s
    assert tuning.window == round(0.013 / period_s)
    assert tuning.time_s == pytest.approx(1.5 * 0.02, abs=1.6 * period_s)
    for seed in range(100, 110):
        assert verdict(motion(seed, joints, period_s, 0.507), tuning).verdict is Verdict.EXPECTED
    late = verdict(motion(200, joints, period_s, 0.58), tuning)
    assert (late.verdict, late.reason) == (Verdict.UNEXPECTED, Reason.NO_IMPACT)
    good = motion(201, joints, period_s)
    for changed, reason in (
        (replace(good, q=good.q + 0.5), Reason.CONFIGURATION),
        (replace(good, dq=good.dq + 1.0), Reason.ENVELOPE),
    ):
        found = verdict(changed, tuning)
        assert (found.verdict, found.reason) == (Verdict.UNEXPECTED, reason)


def test_a_clock_that_counts_from_1970_changes_nothing():
    early = [motion(k) for k in range(4)]
    late = [motion(k, start_ns=1_790_000_000_000_000_000) for k in range(4)]
    assert tune_monitor(late, 1.5) == tune_monitor(early, 1.5)


def test_what_does_not_fit_is_refused_in_one_line():
    good = motion(1)
    for name, value, message in (
        ("residual", good.residual[:10], r"residual: expected shape \(1000, 2\), found \(10, 2\)"),
        ("q", np.where(good.t_ns[:, None] > 0, good.q, np.nan), "q: expected finite numbers, found nan"),
        ("t_ns", good.t_ns * 1e-9, "t_ns: expected whole numbers"),
        ("t_ns", good.t_ns // 2_000_000, "t_ns: expected increasing times, found 0 after 0"),
        ("t_d_ns", 0.5, "t_d_ns: expected whole numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(good, **{name: value})
    for motions, sensitivity, message in (
        ([], 1.5, "1 to 100.0, found 0"),
        ([good], np.inf, "sensitivity: expected finite numbers"),
        ([good], 0.5, "found 1, 0.5"),
        ([good, replace(good, name="flat", residual=0.0 * good.residual)], 1.5, "flat: no impact"),
        ([replace(good, t_ns=good.t_ns // 10, t_d_ns=50_000_000)], 1.5, "run 1: expected more than 0.15 s"),
        ([replace(good, q=1e200 * good.q)], 1.5, "configuration_rad: expected finite numbers, found inf"),
        ([good, motion(2, joints=3)], 1.5, "run 2: expected 2 joints, found 3"),
    ):
        with pytest.raises(ValueError, match=message):
            tune_monitor(motions, sensitivity)
    with pytest.raises(TypeError, match="motions: expected GoodMotion, found NoneType"):
        tune_monitor([None], 1.5)
    with pytest.raises(ValueError, match=r"t_ns: expected ticks of 0\.00022 to 0\.005 s, found 0\.01 s"):
        tune_monitor([replace(good, t_ns=10 * good.t_ns, t_d_ns=5_000_000_000)], 1.5)
