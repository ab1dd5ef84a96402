"""Both arms and what is in between: every way to an unexpected verdict, and the one to an expected one."""

import numpy as np
import pytest

from rtstack.monitor.pair import (
    AFTER,
    IMPACT,
    PAIR,
    TARE,
    TIMES,
    NetForceParameters,
    PairParameters,
    expected_dtype,
    pair_expect,
    pair_step,
)
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict, monitor_dtype
from rtstack.samples import ARM_SAMPLE

MS = 1_000_000
T_D, DECIDED = 500, 800  # ms
ARM = MonitorParameters((300.0,) * 7, 13, 5, 19.0, 0.2, 0.1, 0.05, 0.2, 0.1)
NET = NetForceParameters(0.0, 0.1, (50.0, 5.0), (50.0, 5.0), (50.0, 5.0), 3)
PAIR_OF = PairParameters(ARM, 0.03, NET)
WEIGHT = np.array([0.0, 0.0, 12.0])
BIAS = np.array([0.4, -0.3, 0.2])


def run(hits=(500, 505), force=lambda ms: WEIGHT / 2 * (ms > 500), until=1000, phase=None):
    """Let both arms be hit at these ms (None: never), each pad feel `force(ms)`. Returns (pair, its verdicts by ms)."""
    pairs, states = np.zeros(1, PAIR), np.zeros(2, monitor_dtype(7))
    pair_expect(pairs, states, T_D * MS, np.zeros((2, 7)))
    parameters, sample, verdicts = ARM.record(), np.zeros(1, ARM_SAMPLE), []
    times, expected = np.zeros(1, TIMES), np.zeros(until, expected_dtype(7))
    times[0] = MS, DECIDED * MS, round(PAIR_OF.later_s * 1e9), NET.patience
    expected["bound"] = NET.bounds((np.arange(until) - T_D) * 1e-3)
    expected["net_force"][T_D + 1 :] = WEIGHT
    expected["phase"] = [phase(ms) if phase else TARE if ms < 300 else IMPACT for ms in range(until)]
    for ms in range(until):
        for side in range(2):
            residual = np.full(7, 1.0 if hits[side] is not None and ms >= hits[side] else 0.0)
            pair_step(
                pairs, states, side, parameters, times[0], expected[ms], sample[0], residual, BIAS + force(ms), ms * MS
            )
        verdicts.append(int(pairs[0]["verdict"]))
    return pairs[0], verdicts


def test_what_was_meant_is_expected_once_it_was_carried() -> None:
    pair, verdicts = run()
    assert pair["verdict"] == Verdict.EXPECTED
    assert verdicts.index(Verdict.EXPECTED) == DECIDED
    assert pair["tare"] == pytest.approx(np.array([BIAS, BIAS]))
    assert 0.0 < pair["margin"] <= 1.0


@pytest.mark.parametrize(
    ("hits", "reason", "side", "at"),
    [
        ((350, 505), Reason.TIME, 0, 350),  # at once: nothing can make it expected any more
        ((500, 350), Reason.TIME, 1, 350),
        ((460, 465), Reason.PAIR_TIME, -1, 465),
        ((535, 500), Reason.PAIR_TIME, -1, 535),
        ((500, None), Reason.ONE_SIDE, 1, 601),
        ((None, None), Reason.NO_IMPACT, 0, 601),
    ],
)
def test_impacts_that_were_not_meant(hits, reason, side, at) -> None:
    pair, verdicts = run(hits)
    assert pair["verdict"] == Verdict.UNEXPECTED
    assert (pair["reason"], pair["side"]) == (reason, side)
    assert verdicts.index(Verdict.UNEXPECTED) == at
    assert pair["t_verdict_ns"] == at * MS


@pytest.mark.parametrize(("weight", "wrong"), [(1.0, False), (1.3, False), (3.0, True), (1.0 / 3.0, True)])
def test_the_weight_is_felt(weight, wrong) -> None:
    pair, verdicts = run(force=lambda ms: weight * WEIGHT / 2 * (ms > 500))
    assert (pair["reason"] == Reason.LOAD) == wrong
    if wrong:
        # 100 ms after the impact the bound is tight; from then on it has to be exceeded for some ticks
        assert verdicts.index(Verdict.UNEXPECTED) == T_D + 100 + NET.patience


def test_a_push_is_found_after_the_verdict_and_when_all_is_over() -> None:
    push = np.array([40.0, 0.0, 0.0]) / 2
    pair, verdicts = run(force=lambda ms: WEIGHT / 2 * (ms > 500) + push * (ms > 900))
    assert verdicts[900] == Verdict.EXPECTED
    assert pair["verdict"] == Verdict.UNEXPECTED
    assert verdicts.index(Verdict.UNEXPECTED) == 901 + NET.patience
    after = lambda ms: TARE if ms < 300 else IMPACT if ms < 850 else AFTER  # noqa: E731
    pair, verdicts = run(hits=(500, 505), force=lambda ms: WEIGHT / 2 * (ms > 500) + push * (ms > 900), phase=after)
    assert pair["reason"] == Reason.LOAD


def test_a_moment_out_of_bounds_is_none() -> None:
    pair, _ = run(force=lambda ms: WEIGHT / 2 * (ms > 500) + 20.0 * (700 <= ms < 699 + NET.patience))
    assert pair["verdict"] == Verdict.EXPECTED


def test_parameters_are_checked() -> None:
    with pytest.raises(ValueError, match="later_s"):
        PairParameters(ARM, 0.0, NET)
    with pytest.raises(ValueError, match="as many bounds"):
        NetForceParameters(0.0, 0.1, (1.0,), (1.0,), (1.0, 2.0), 1)
    with pytest.raises(ValueError, match="positive"):
        NetForceParameters(0.0, 0.1, (1.0,), (-1.0,), (1.0,), 1)
    assert NET.bounds(np.array([-9.0, 0.1 - 1e-12, 9.0]))[:, 0].tolist() == [50.0, 5.0, 5.0]
