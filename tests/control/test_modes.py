"""The mode machine: which mode when, for the proposed controller and its baselines."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.control.modes import ModeMachine, Strategy
from rtstack.control.parameters import ControlParameters
from rtstack.samples import Mode

P = ControlParameters()


def _run(strategy: Strategy, impact_s: float | None, end_s: float = 1.2) -> list[tuple[Mode, float, float]]:
    machine = ModeMachine(strategy, P, 0.5)
    machine.begin(Mode.ANTE_IMPACT)
    seen = []
    for k in range(round(end_s * 1000)):
        machine.update(k * 1e-3, impact_s is not None and k == round(impact_s * 1000))
        seen.append((machine.mode, machine.gamma, machine.velocity_weight))
    return seen


def test_proposed_goes_through_the_interim_mode_with_gamma_as_velocity_weight():
    seen = _run(Strategy.PROPOSED, 0.4)
    assert seen[399] == (Mode.ANTE_IMPACT, 0.0, 1.0)
    assert seen[400] == (Mode.INTERIM, 0.0, 0.0)
    for k in range(400, 500):
        assert seen[k][0] is Mode.INTERIM
        assert seen[k][1] == pytest.approx((k - 400) / 100)
        assert seen[k][2] == seen[k][1]
    assert all(state == (Mode.POST_IMPACT, 1.0, 1.0) for state in seen[500:])


def test_no_interim_switches_at_the_impact():
    seen = _run(Strategy.NO_INTERIM, 0.4)
    assert {s[0] for s in seen[:400]} == {Mode.ANTE_IMPACT}
    assert set(seen[400:]) == {(Mode.POST_IMPACT, 1.0, 1.0)}


@pytest.mark.parametrize("impact_s", [None, 0.4, 0.6])
def test_no_reference_spreading_switches_at_the_nominal_time_whatever_happens(impact_s):
    seen = _run(Strategy.NO_REFERENCE_SPREADING, impact_s)
    assert set(seen[:500]) == {(Mode.ANTE_IMPACT, 0.0, 1.0)}
    assert set(seen[500:]) == {(Mode.POST_IMPACT, 1.0, 1.0)}


def test_no_velocity_feedback_is_without_it_around_the_nominal_time():
    seen = _run(Strategy.NO_VELOCITY_FEEDBACK, 0.45)
    without = [k for k, state in enumerate(seen) if state[2] == 0.0]
    assert without == list(range(400, 601))
    assert seen[499][0] is Mode.ANTE_IMPACT
    assert seen[500][0] is Mode.POST_IMPACT


RISE = 1e-3 / P.interim_s  # of gamma in a tick


def _completed(impact_tick: int, complete: list[bool], ticks_ms: list[int]) -> list[tuple[int, Mode, float, float]]:
    """The completion's mode machine from the impact on: ms, mode, gamma, velocity weight of each tick."""
    machine = ModeMachine(Strategy.CONTACT_COMPLETION, P, 0.5)
    machine.begin(Mode.ANTE_IMPACT)
    seen, ms = [], impact_tick
    for k in range(1000):
        machine.update(ms * 1e-3, k == 0, complete[min(k, len(complete) - 1)])
        seen.append((ms, machine.mode, machine.gamma, machine.velocity_weight))
        ms += ticks_ms[k % len(ticks_ms)]
    return seen


@given(
    impact_tick=st.integers(300, 700),
    complete=st.lists(st.booleans(), min_size=1, max_size=400),
    ticks_ms=st.lists(st.sampled_from([0, 1, 1, 1, 2, 5]), min_size=1, max_size=20).filter(any),
)
def test_gamma_rises_steadily_to_one_whatever_the_detector_says(impact_tick, complete, ticks_ms):
    """Never down, never above 1, never faster than (29), and over when patience and the rest of the ramp are."""
    longest_ms = 1e3 * (P.completion_patience_s + (1.0 - P.completion_gamma) * P.interim_s)
    for (ms, _, gamma, _), (later_ms, mode, later, weight) in pairwise(_completed(impact_tick, complete, ticks_ms)):
        assert gamma <= later <= 1.0
        assert later - gamma <= RISE * (later_ms - ms) + 1e-9
        assert weight == later
        after_ms = later_ms - impact_tick
        if mode is Mode.INTERIM:
            assert after_ms < longest_ms + max(ticks_ms)
        else:
            assert mode is Mode.POST_IMPACT
            assert later == 1.0
            assert after_ms >= 1e3 * P.interim_s


@pytest.mark.parametrize("completed_ms", [0, 30, 70, 71, 160, 299])
def test_the_ramp_goes_on_when_contact_is_complete(completed_ms):
    seen = _completed(400, [False] * completed_ms + [True], [1])
    held_ms = max(0, completed_ms - round(1e3 * P.completion_gamma * P.interim_s))
    for k, (_, mode, gamma, _) in enumerate(seen):
        ramp = min(k * RISE, P.completion_gamma) if k <= completed_ms else (k - held_ms) * RISE
        assert gamma == pytest.approx(min(1.0, ramp), abs=1e-9)
        assert (mode is Mode.INTERIM) == (k < 100 + held_ms)


def test_without_full_contact_the_interim_mode_ends_all_the_same():
    machine = ModeMachine(Strategy.CONTACT_COMPLETION, P, 0.5)
    machine.begin(Mode.ANTE_IMPACT)
    for k in range(400, 700):
        machine.update(k * 1e-3, k == 400)
        assert machine.waiting
        assert machine.gamma <= P.completion_gamma
    modes = []
    for k in range(700, 740):
        machine.update(k * 1e-3, False)
        modes.append(machine.mode)
    assert modes == [Mode.INTERIM] * 30 + [Mode.POST_IMPACT] * 10
    assert machine.completion_s < 0.0


def test_completion_is_what_the_proposed_controller_is_where_contact_is_complete_in_time():
    proposed = _run(Strategy.PROPOSED, 0.4)[400:]
    completed = [state[1:] for state in _completed(400, [False] * 60 + [True], [1])]
    for ours, theirs in zip(completed, proposed, strict=False):
        assert ours == (theirs[0], pytest.approx(theirs[1]), pytest.approx(theirs[2]))


@pytest.mark.parametrize("strategy", [Strategy.PROPOSED, Strategy.NO_INTERIM, Strategy.CONTACT_COMPLETION])
def test_patience_ends(strategy):
    machine = ModeMachine(strategy, P, 0.5)
    machine.begin(Mode.ANTE_IMPACT)
    machine.update(0.5 + P.impact_patience_s, False)
    assert not machine.patience_over
    machine.update(0.5 + P.impact_patience_s + 0.002, False)
    assert machine.patience_over
    assert machine.mode is Mode.ANTE_IMPACT


def test_nothing_leads_out_of_a_stop_but_rest():
    machine = ModeMachine(Strategy.PROPOSED, P, 0.5)
    machine.begin(Mode.ANTE_IMPACT)
    machine.stop()
    machine.update(0.4, True)
    machine.begin(Mode.ANTE_IMPACT)
    assert machine.mode is Mode.STOPPING
    machine.rest()
    machine.stop()
    machine.begin(Mode.TELEOPERATION)
    machine.update(0.9, True)
    assert machine.mode is Mode.STOPPED
