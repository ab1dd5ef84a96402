"""The compiled monitor agrees with the plain one, sample by sample, and each condition decides alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.base.configuration import ConfigurationError, from_document
from rtstack.monitor.monitor import Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict


@dataclass(slots=True)
class PlainMonitor:
    """Algorithm 1 as the paper words it, with the resolutions that step.py names."""

    parameters: MonitorParameters
    t_d_ns: int
    q_d: Sequence[float]
    t: list[int] = field(default_factory=list)
    r: list[list[float]] = field(default_factory=list)
    e_vel: list[list[float]] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    impacts: list[int] = field(default_factory=list)  # k_j
    unmet: list[str] = field(default_factory=list)  # of (10)-(12), in the order of the impacts
    window: str = "off"  # Post-Impact
    verdict: str = "none"
    reason: str = "none"

    def update(self, t_ns: int, r: Sequence[float], q: Sequence[float], dq: Sequence[float], ref: Sequence[float]):
        """Take a tick."""
        self.t.append(t_ns)
        self.r.append(list(r))
        self.e_vel.append([a - b for a, b in zip(dq, ref, strict=True)])
        k, p = len(self.t) - 1, self.parameters
        hit = any(
            self._rate(k, i) >= bound and self._rate(k - 1, i) < bound for i, bound in enumerate(p.residual_rate_nm_s)
        )
        if hit:
            self.impacts.append(k)
            self.lower, self.upper = list(self.e_vel[k]), list(self.e_vel[k])
        elif self.impacts:
            self._filter(k)
        if self.verdict == "unexpected":
            return
        if hit:
            self._at_impact(q)
        self._after(t_ns)

    def _rate(self, k: int, i: int) -> float:
        """|(8)|, zero where there is no tick before."""
        return abs((self.r[k][i] - self.r[k - 1][i]) / ((self.t[k] - self.t[k - 1]) * 1e-9)) if k > 0 else 0.0

    def _filter(self, k: int) -> None:
        m = min(self.parameters.window, k - self.impacts[-1])
        a_dt = min(1.0, self.parameters.decay_1_s * (self.t[k] - self.t[k - 1]) * 1e-9)
        for i in range(len(self.lower)):
            x = [sample[i] for sample in self.e_vel[k - m : k + 1]]
            self.lower[i] = min(min(x), (1.0 - a_dt) * self.lower[i] + a_dt * min(x))
            self.upper[i] = max(max(x), (1.0 - a_dt) * self.upper[i] + a_dt * max(x))

    def _at_impact(self, q: Sequence[float]) -> None:
        p, t = self.parameters, [self.t[k] for k in self.impacts]
        distance = math.sqrt(sum((a - b) ** 2 for a, b in zip(q, self.q_d, strict=True)))
        if abs(t[-1] - self.t_d_ns) > round(p.time_s * 1e9):
            self.unmet.append("time")
        elif distance / p.configuration_rad > 1.0:
            self.unmet.append("configuration")
        elif len(t) > 1 and t[-1] - t[-2] > round(p.spacing_s * 1e9):
            self.unmet.append("spacing")
        self.window = "unexpected" if self.unmet else "unknown"
        self.reason = self.unmet[0] if self.unmet else "none"

    def _after(self, t_ns: int) -> None:
        p = self.parameters
        if not self.impacts:
            if t_ns - self.t_d_ns > round(p.time_s * 1e9):
                self.verdict, self.reason = "unexpected", "no_impact"
            return
        since = t_ns - self.t[self.impacts[-1]]
        if self.window == "unknown":
            met = all(
                low / p.velocity_rad_s <= 1.0 and high / p.velocity_rad_s >= -1.0
                for low, high in zip(self.lower, self.upper, strict=True)
            )
            if not met and since >= round(p.delay * p.period_s * 1e9):
                self.window, self.reason = "unexpected", "envelope"
            elif since > round(p.horizon_s * 1e9):
                self.window = "expected"
        if self.window in ("expected", "unexpected") and since > round(p.horizon_s * 1e9):
            self.verdict = "expected" if self.window == "expected" and not self.unmet else "unexpected"


P = MonitorParameters(
    residual_rate_nm_s=(300.0, 300.0, 300.0), window=15, delay=15, decay_1_s=18.0, configuration_rad=0.067,
    time_s=0.1, horizon_s=0.1, velocity_rad_s=0.1, spacing_s=0.1,
)  # fmt: skip
MS = 1_000_000


@st.composite
def _tunings(draw, joints):
    milliseconds = st.integers(1, 60).map(lambda ms: ms * 1e-3)
    horizon = draw(st.integers(5, 60))
    return MonitorParameters(
        residual_rate_nm_s=tuple(draw(st.lists(st.floats(150.0, 600.0), min_size=joints, max_size=joints))),
        window=draw(st.integers(1, 63)),
        delay=draw(st.integers(0, horizon)),
        decay_1_s=draw(st.floats(1.0, 400.0)),
        configuration_rad=draw(st.floats(0.05, 1.0)),
        time_s=draw(milliseconds),
        horizon_s=horizon * 1e-3,
        velocity_rad_s=draw(st.floats(0.02, 2.0)),
        spacing_s=draw(milliseconds),
    )


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(st.data(), st.sampled_from([1, 3, 7]), st.integers(0, 2**32 - 1))
def test_it_agrees_with_the_plain_one_in_every_tick_of_random_signals(data, joints, seed):
    p = data.draw(_tunings(joints))
    random = np.random.default_rng(seed)
    n = 250
    t_ns = MS * np.cumsum(np.where(random.random(n) < 0.02, random.integers(2, 20, n), 1))  # some ticks are missing
    jumps = (random.random((n, 1)) < data.draw(st.sampled_from([0.0, 0.005, 0.02, 0.2]))) * random.normal(0, 1, (n, 1))
    residual = np.cumsum(jumps, axis=0) * np.ones(joints) + random.normal(0, 0.02, (n, joints))
    swing = np.exp(-np.arange(n)[:, None] / 80.0) * np.sin(np.arange(n)[:, None] * random.uniform(0.1, 1.0, joints))
    dq = data.draw(st.sampled_from([0.05, 0.5])) * (swing + random.normal(0, 0.3, joints))
    q, ref = random.normal(0, 0.1, (n, joints)), random.normal(0, 0.01, (n, joints))
    t_d_ns, q_d = int(t_ns[100]), np.zeros(joints)

    monitor, plain = Monitor(p), PlainMonitor(p, t_d_ns, q_d.tolist())
    monitor.expect(t_d_ns, q_d)
    trace = monitor.follow(t_ns, residual, q, dq, ref)
    for k in range(n):
        plain.update(int(t_ns[k]), residual[k], q[k], dq[k], ref[k])
        state = trace[k]
        assert state["impacts"] == len(plain.impacts)
        assert Verdict(state["verdict"]).name == plain.verdict.upper()
        assert Reason(state["reason"]).name == plain.reason.upper()
        if plain.impacts:
            np.testing.assert_allclose(state["lower"], plain.lower, rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(state["upper"], plain.upper, rtol=1e-12, atol=1e-15)
        if state["verdict"] != Verdict.NONE and (k == 0 or trace[k - 1]["verdict"] != state["verdict"]):
            assert (state["margin"] < 0.0) == (state["verdict"] == Verdict.UNEXPECTED)


def _motion(impacts=(200,), error=0.0, offset=0.0, ticks=500):
    """A motion with impacts at these ticks, a velocity error rad/s after them, and an offset of the configuration."""
    t_ns = MS * np.arange(ticks)
    residual, q, dq = np.zeros((ticks, 3)), np.zeros((ticks, 3)), np.zeros((ticks, 3))
    for k in impacts:
        residual[k:, 1] += 1.0
        dq[k:, 1] = error
    q[:, 0] = offset
    return t_ns, residual, q, dq, np.zeros((ticks, 3))


def _assess(motion, p=P, expected_at=200):
    monitor = Monitor(p)
    monitor.expect(expected_at * MS, np.zeros(3))
    return monitor.assess(*motion)


@pytest.mark.parametrize(
    ("motion", "verdict", "reason"),
    [
        ({}, Verdict.EXPECTED, Reason.NONE),
        ({"impacts": (200, 260)}, Verdict.EXPECTED, Reason.NONE),
        ({"impacts": (100, 200, 300)}, Verdict.EXPECTED, Reason.NONE),  # at the bounds of (10) and (12)
        ({"impacts": (99,)}, Verdict.UNEXPECTED, Reason.TIME),
        ({"impacts": (310,)}, Verdict.UNEXPECTED, Reason.NO_IMPACT),
        ({"impacts": ()}, Verdict.UNEXPECTED, Reason.NO_IMPACT),
        ({"offset": 0.066}, Verdict.EXPECTED, Reason.NONE),
        ({"offset": 0.068}, Verdict.UNEXPECTED, Reason.CONFIGURATION),
        ({"impacts": (150, 251)}, Verdict.UNEXPECTED, Reason.SPACING),
        ({"error": 0.099}, Verdict.EXPECTED, Reason.NONE),
        ({"error": -0.101}, Verdict.UNEXPECTED, Reason.ENVELOPE),
    ],
)
def test_each_condition_decides_alone(motion, verdict, reason):
    found = _assess(_motion(**motion))
    assert (found.verdict, found.reason) == (verdict, reason)
    assert found.joint == (1 if reason is Reason.ENVELOPE else -1)


def test_a_later_impact_makes_no_good_one_of_an_early_one():
    assert _assess(_motion((99, 199))).verdict is Verdict.UNEXPECTED


def test_an_envelope_counts_from_the_last_impact_on():
    motion = _motion((200, 250))
    motion[3][200:250] = 0.5  # between the two impacts nothing is judged that counts in the end
    assert _assess(motion).verdict is Verdict.EXPECTED


def test_an_oscillation_about_the_expected_velocity_is_expected_and_about_another_one_is_not():
    swing = 0.4 * np.exp(-np.arange(300) / 40.0) * np.cos(np.arange(300) * 2 * np.pi / 12)
    for shift, verdict in ((0.0, Verdict.EXPECTED), (0.5, Verdict.UNEXPECTED)):
        motion = _motion()
        motion[3][200:, 2] = swing + shift
        assert _assess(motion).verdict is verdict


def test_the_verdict_comes_a_tick_after_the_horizon_and_what_is_certain_is_known_before():
    monitor = Monitor(P)
    monitor.expect(200 * MS, np.zeros(3))
    trace = monitor.follow(*_motion(error=0.2))
    assert list(np.flatnonzero(trace["impact"])) == [200]
    assert np.flatnonzero(trace["verdict"])[0] == 301
    assert np.flatnonzero(trace["post_impact"])[0] == 215  # (18)
    assert trace["margin"][-1] == pytest.approx(-1.0)


def test_what_is_no_number_was_not_meant():
    for index, reason in ((2, Reason.CONFIGURATION), (3, Reason.ENVELOPE)):
        motion = _motion()
        motion[index][190:] = np.nan
        found = _assess(motion)
        assert (found.verdict, found.reason) == (Verdict.UNEXPECTED, reason)


def test_nothing_is_judged_before_something_is_expected():
    monitor = Monitor(P)
    assert monitor.assess(*_motion((50, 400), error=3.0)).verdict is Verdict.NONE
    assert monitor.assessment().impacts == 2


@pytest.mark.parametrize(
    "change",
    [
        {"window": 0},
        {"window": 64},
        {"delay": 101},
        {"velocity_rad_s": 0.0},
        {"time_s": float("nan")},
        {"delay": -1},
        {"window": 13.5},
        {"spacing_s": 1e300},
        {"residual_rate_nm_s": ()},
        {"decay_1_s": "19"},
        {"horizon_s": 10**400},
    ],
)
def test_a_tuning_that_makes_no_sense_is_refused_by_name(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(P, **change)


def test_a_tuning_comes_from_a_document_with_the_offending_key_in_the_message():
    document = {name: getattr(P, name) for name in P.__slots__}
    assert from_document(document, MonitorParameters, "here") == P
    with pytest.raises(ConfigurationError, match="here: key e_m"):
        from_document(document | {"e_m": 0.1}, MonitorParameters, "here")
