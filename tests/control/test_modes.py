"""The mode machine: which mode when, for the proposed controller and its baselines."""

import pytest

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


@pytest.mark.parametrize("strategy", [Strategy.PROPOSED, Strategy.NO_INTERIM])
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
