"""The arming state machine step by step: the lease's boundaries, the effect of each event, the text of a refusal."""

from math import nextafter

import pytest

from rtstack.safety.arming import LEASE_S, ArmingStateMachine, Phase, Refused

OPERATOR, OTHER = "anna", "ben"


def _arming(phase: Phase) -> ArmingStateMachine:
    """Return a state machine whose operator has led it to this phase at time 0."""
    arming = ArmingStateMachine()
    arming.take(OPERATOR, 0.0)
    if phase in (Phase.ARMED, Phase.MOVING):
        arming.arm(OPERATOR, 0.0)
    if phase is Phase.MOVING:
        arming.begin(OPERATOR, 0.0)
    if phase in (Phase.FAULT, Phase.RECOVERING):
        arming.fault("reflex")
    if phase is Phase.RECOVERING:
        arming.recover()
    assert arming.phase is phase
    return arming


def _books(arming: ArmingStateMachine) -> tuple[object, ...]:
    return arming.phase, arming.reason, arming.holder, arming.running, arming.stop_wanted


def test_a_new_permit_allows_nothing_and_nobody_has_it():
    assert _books(ArmingStateMachine()) == (Phase.DISARMED, None, None, False, False)
    assert LEASE_S == 2.0


@pytest.mark.parametrize("lease_s", [LEASE_S, 0.5])
@pytest.mark.parametrize("sign_of_life", ["take", "beat"])
def test_a_lease_lasts_exactly_as_long_as_it_says_from_the_last_sign_of_life(lease_s, sign_of_life):
    for since, lost in ((0.0, False), (lease_s, False), (nextafter(lease_s, 99.0), True)):
        arming = ArmingStateMachine(lease_s)
        arming.take(OPERATOR, -0.25)
        getattr(arming, sign_of_life)(OPERATOR, 0.0)
        arming.watch(since)
        assert arming.holder == (None if lost else OPERATOR)


def test_a_beat_that_comes_too_late_or_from_somebody_else_counts_for_nothing():
    arming = _arming(Phase.ARMED)
    arming.beat(OTHER, 1.0)
    arming.beat(OPERATOR, nextafter(LEASE_S, 99.0))
    assert _books(arming) == (Phase.DISARMED, None, None, False, False)
    arming = ArmingStateMachine()
    arming.beat(OPERATOR, 0.0)
    assert arming.holder is None
    # the time of nobody's sign of life is no time of the next holder
    arming.take(OPERATOR, 100.0)
    arming.watch(100.0 + LEASE_S)
    assert arming.holder == OPERATOR


@pytest.mark.parametrize("action", ["arm", "begin"])
def test_what_the_lease_has_ended_needs_control_anew(action):
    """Even where nobody has called watch meanwhile."""
    for who, now_s, said in (
        (OTHER, 0.0, "anna has control; take control first"),
        (OPERATOR, nextafter(LEASE_S, 99.0), "no operator has control; take control first"),
    ):
        arming = _arming(Phase.ARMED)
        with pytest.raises(Refused) as refused:
            getattr(arming, action)(who, now_s)
        assert str(refused.value) == said
    assert arming.phase is Phase.DISARMED


def test_control_is_taken_from_nobody_and_only_kept_by_its_holder():
    arming = _arming(Phase.ARMED)
    with pytest.raises(Refused) as refused:
        arming.take(OTHER, LEASE_S)
    assert str(refused.value) == "anna has control; ask them to release it"
    assert (arming.holder, arming.phase) == (OPERATOR, Phase.ARMED)
    arming.take(OTHER, nextafter(LEASE_S, 99.0))
    assert (arming.holder, arming.phase) == (OTHER, Phase.DISARMED)


@pytest.mark.parametrize("loss", ["release", "watch"])
def test_who_loses_the_lease_disarms_and_stops_what_runs(loss):
    for phase, left in (
        (Phase.DISARMED, (Phase.DISARMED, None, None, False, False)),
        (Phase.ARMED, (Phase.DISARMED, None, None, False, False)),
        (Phase.MOVING, (Phase.MOVING, None, None, True, True)),
        (Phase.FAULT, (Phase.FAULT, "reflex", None, False, False)),
        (Phase.RECOVERING, (Phase.RECOVERING, "reflex", None, False, False)),
    ):
        arming = _arming(phase)
        arming.release(OTHER)
        assert arming.holder == OPERATOR
        arming.release(OPERATOR) if loss == "release" else arming.watch(99.0)
        assert _books(arming) == left
    # a lease that is not held cannot be lost: the state stays as it is
    arming = _arming(Phase.DISARMED)
    arming.release(OPERATOR)
    arming.watch(99.0)
    arming.release(OTHER)
    assert _books(arming) == (Phase.DISARMED, None, None, False, False)


def test_a_permit_that_nobody_holds_is_not_lost_again():
    arming = _arming(Phase.MOVING)
    arming.release(OPERATOR)
    arming.stop_wanted = False  # its caller has taken note
    arming.watch(99.0)
    arming.release(OTHER)
    assert not arming.stop_wanted


ENDS = {
    Phase.DISARMED: Phase.DISARMED, Phase.ARMED: Phase.ARMED, Phase.MOVING: Phase.ARMED, Phase.FAULT: Phase.FAULT,
    Phase.RECOVERING: Phase.RECOVERING,
}  # fmt: skip


@pytest.mark.parametrize("phase", Phase)
def test_disarm_and_end_in_every_phase(phase):
    arming = _arming(phase)
    arming.end()
    assert (arming.phase, arming.running, arming.stop_wanted) == (ENDS[phase], False, False)
    arming = _arming(phase)
    arming.disarm()
    moving = phase is Phase.MOVING
    assert arming.phase is (Phase.DISARMED if phase is Phase.ARMED else phase)
    assert (arming.running, arming.stop_wanted) == (moving, moving)
    arming.end()
    assert (arming.running, arming.stop_wanted) == (False, False)
    # what had to stop is not armed afterwards
    assert arming.phase is (Phase.DISARMED if phase in (Phase.ARMED, Phase.MOVING) else phase)


@pytest.mark.parametrize("phase", Phase)
def test_arm_and_begin_in_every_phase(phase):
    refusals = {
        Phase.FAULT: "there is a fault: reflex; recover first",
        Phase.MOVING: "the arms are moving; wait for the end",
        Phase.RECOVERING: "the arms are recovering; wait for the end",
    }
    arming = _arming(phase)
    before = _books(arming)
    if phase in refusals:
        with pytest.raises(Refused) as refused:
            arming.arm(OPERATOR, 0.0)
        assert str(refused.value) == refusals[phase]
        assert _books(arming) == before
    else:
        arming.arm(OPERATOR, 0.0)
        assert _books(arming) == (Phase.ARMED, None, OPERATOR, False, False)
    arming = _arming(phase)
    if phase is Phase.ARMED:
        arming.begin(OPERATOR, 0.0)
        assert _books(arming) == (Phase.MOVING, None, OPERATOR, True, False)
        return
    with pytest.raises(Refused) as refused:
        arming.begin(OPERATOR, 0.0)
    assert str(refused.value) == f"the arms are {phase}; arm them first"
    assert _books(arming) == before


@pytest.mark.parametrize("phase", Phase)
def test_what_a_hand_leads_in_every_phase(phase):
    arming = _arming(phase)
    before = _books(arming)
    refusals = {OTHER: "anna has control; take control first"}
    if phase not in (Phase.ARMED, Phase.FAULT):
        refusals[OPERATOR] = f"the arms are {phase}; arm them first"
    for who, said in refusals.items():
        with pytest.raises(Refused) as refused:
            arming.begin_by_hand(who, 0.0)
        assert str(refused.value) == said
        assert _books(arming) == before
    if OPERATOR in refusals:
        return
    arming.begin_by_hand(OPERATOR, 0.0)
    fault = phase is Phase.FAULT
    led = (Phase.FAULT, "reflex") if fault else (Phase.MOVING, None)
    assert _books(arming) == (*led, OPERATOR, True, False)
    for again in (lambda: arming.begin_by_hand(OPERATOR, 0.0), arming.recover):
        with pytest.raises(Refused) as refused:
            again()
        assert not fault or str(refused.value) == "the arms have not come to rest yet; wait a moment"
    arming.release(OPERATOR)
    assert arming.stop_wanted
    arming.end()
    assert _books(arming) == ((Phase.FAULT, "reflex") if fault else (Phase.DISARMED, None)) + (None, False, False)


def test_a_motion_begins_without_the_wish_to_stop_the_last_one():
    arming = _arming(Phase.ARMED)
    arming.stop_wanted = True
    arming.begin(OPERATOR, 0.0)
    assert not arming.stop_wanted


@pytest.mark.parametrize("phase", Phase)
def test_a_fault_latches_with_its_first_reason_and_stops_what_runs(phase):
    arming = _arming(phase)
    arming.fault("lost")
    moving = phase is Phase.MOVING
    reason = "reflex" if phase is Phase.FAULT else "lost"
    assert _books(arming) == (Phase.FAULT, reason, OPERATOR, moving, moving)
    arming.end()
    assert _books(arming) == (Phase.FAULT, reason, OPERATOR, False, False)


@pytest.mark.parametrize("phase", Phase)
def test_recovery_in_every_phase(phase):
    arming = _arming(phase)
    if phase is Phase.FAULT:
        arming.recover()
        assert arming.phase is Phase.RECOVERING
    else:
        before = _books(arming)
        with pytest.raises(Refused) as refused:
            arming.recover()
        assert str(refused.value) == f"nothing to recover from: the arms are {phase}"
        assert _books(arming) == before
    for outcome, left in (("recovered", (Phase.DISARMED, None)), ("not_recovered", (Phase.FAULT, "persists"))):
        arming = _arming(phase)
        before = _books(arming)
        arming.recovered() if outcome == "recovered" else arming.not_recovered("persists")
        assert _books(arming) == ((*left, OPERATOR, False, False) if phase is Phase.RECOVERING else before)


def test_arms_that_still_come_to_rest_are_not_recovered():
    arming = _arming(Phase.MOVING)
    arming.fault("reflex")
    with pytest.raises(Refused) as refused:
        arming.recover()
    assert str(refused.value) == "the arms have not come to rest yet; wait a moment"
    assert arming.phase is Phase.FAULT
    arming.end()
    arming.recover()
    assert arming.phase is Phase.RECOVERING
