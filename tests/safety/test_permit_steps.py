"""The permit step by step: the lease's boundaries, what each event makes of each phase, and what a refusal says."""

from math import nextafter

import pytest

from rtstack.safety.permit import LEASE_S, Permit, Phase, Refused

OPERATOR, OTHER = "anna", "ben"


def _permit(phase: Phase) -> Permit:
    """Return a permit whose operator has led it to this phase at time 0."""
    permit = Permit()
    permit.take(OPERATOR, 0.0)
    if phase in (Phase.ARMED, Phase.MOVING):
        permit.arm(OPERATOR, 0.0)
    if phase is Phase.MOVING:
        permit.begin(OPERATOR, 0.0)
    if phase in (Phase.FAULT, Phase.RECOVERING):
        permit.fault("reflex")
    if phase is Phase.RECOVERING:
        permit.recover()
    assert permit.phase is phase
    return permit


def _books(permit: Permit) -> tuple[object, ...]:
    return permit.phase, permit.reason, permit.holder, permit.running, permit.stop_wanted


def test_a_new_permit_allows_nothing_and_nobody_has_it():
    assert _books(Permit()) == (Phase.DISARMED, None, None, False, False)
    assert LEASE_S == 2.0


@pytest.mark.parametrize("lease_s", [LEASE_S, 0.5])
@pytest.mark.parametrize("sign_of_life", ["take", "beat"])
def test_a_lease_lasts_exactly_as_long_as_it_says_from_the_last_sign_of_life(lease_s, sign_of_life):
    for since, lost in ((0.0, False), (lease_s, False), (nextafter(lease_s, 99.0), True)):
        permit = Permit(lease_s)
        permit.take(OPERATOR, -0.25)
        getattr(permit, sign_of_life)(OPERATOR, 0.0)
        permit.watch(since)
        assert permit.holder == (None if lost else OPERATOR)


def test_a_beat_that_comes_too_late_or_from_somebody_else_counts_for_nothing():
    permit = _permit(Phase.ARMED)
    permit.beat(OTHER, 1.0)
    permit.beat(OPERATOR, nextafter(LEASE_S, 99.0))
    assert _books(permit) == (Phase.DISARMED, None, None, False, False)
    permit = Permit()
    permit.beat(OPERATOR, 0.0)
    assert permit.holder is None
    # the time of nobody's sign of life is no time of the next holder
    permit.take(OPERATOR, 100.0)
    permit.watch(100.0 + LEASE_S)
    assert permit.holder == OPERATOR


@pytest.mark.parametrize("action", ["arm", "begin"])
def test_what_the_lease_has_ended_needs_control_anew(action):
    """Even where nobody has called watch meanwhile."""
    for who, now_s, said in (
        (OTHER, 0.0, "anna has the robot; take control first"),
        (OPERATOR, nextafter(LEASE_S, 99.0), "no operator has control; take control first"),
    ):
        permit = _permit(Phase.ARMED)
        with pytest.raises(Refused) as refused:
            getattr(permit, action)(who, now_s)
        assert str(refused.value) == said
    assert permit.phase is Phase.DISARMED


def test_control_is_taken_from_nobody_and_only_kept_by_its_holder():
    permit = _permit(Phase.ARMED)
    with pytest.raises(Refused) as refused:
        permit.take(OTHER, LEASE_S)
    assert str(refused.value) == "anna has the robot; ask them to release it"
    assert (permit.holder, permit.phase) == (OPERATOR, Phase.ARMED)
    permit.take(OTHER, nextafter(LEASE_S, 99.0))
    assert (permit.holder, permit.phase) == (OTHER, Phase.DISARMED)


@pytest.mark.parametrize("loss", ["release", "watch"])
def test_who_loses_the_lease_disarms_and_stops_what_runs(loss):
    for phase, left in (
        (Phase.DISARMED, (Phase.DISARMED, None, None, False, False)),
        (Phase.ARMED, (Phase.DISARMED, None, None, False, False)),
        (Phase.MOVING, (Phase.MOVING, None, None, True, True)),
        (Phase.FAULT, (Phase.FAULT, "reflex", None, False, False)),
        (Phase.RECOVERING, (Phase.RECOVERING, "reflex", None, False, False)),
    ):
        permit = _permit(phase)
        permit.release(OTHER)
        assert permit.holder == OPERATOR
        permit.release(OPERATOR) if loss == "release" else permit.watch(99.0)
        assert _books(permit) == left
    # nobody's lease cannot be lost: a permit that nobody holds stays as it is
    permit = _permit(Phase.DISARMED)
    permit.release(OPERATOR)
    permit.watch(99.0)
    permit.release(OTHER)
    assert _books(permit) == (Phase.DISARMED, None, None, False, False)


def test_a_permit_that_nobody_holds_is_not_lost_again():
    permit = _permit(Phase.MOVING)
    permit.release(OPERATOR)
    permit.stop_wanted = False  # its caller has taken note
    permit.watch(99.0)
    permit.release(OTHER)
    assert not permit.stop_wanted


ENDS = {
    Phase.DISARMED: Phase.DISARMED, Phase.ARMED: Phase.ARMED, Phase.MOVING: Phase.ARMED, Phase.FAULT: Phase.FAULT,
    Phase.RECOVERING: Phase.RECOVERING,
}  # fmt: skip


@pytest.mark.parametrize("phase", Phase)
def test_disarm_and_end_in_every_phase(phase):
    permit = _permit(phase)
    permit.end()
    assert (permit.phase, permit.running, permit.stop_wanted) == (ENDS[phase], False, False)
    permit = _permit(phase)
    permit.disarm()
    moving = phase is Phase.MOVING
    assert permit.phase is (Phase.DISARMED if phase is Phase.ARMED else phase)
    assert (permit.running, permit.stop_wanted) == (moving, moving)
    permit.end()
    assert (permit.running, permit.stop_wanted) == (False, False)
    # what had to stop is not armed afterwards
    assert permit.phase is (Phase.DISARMED if phase in (Phase.ARMED, Phase.MOVING) else phase)


@pytest.mark.parametrize("phase", Phase)
def test_arm_and_begin_in_every_phase(phase):
    refusals = {
        Phase.FAULT: "there is a fault: reflex; recover first",
        Phase.MOVING: "the arms are moving; wait for the end",
        Phase.RECOVERING: "the arms are recovering; wait for the end",
    }
    permit = _permit(phase)
    before = _books(permit)
    if phase in refusals:
        with pytest.raises(Refused) as refused:
            permit.arm(OPERATOR, 0.0)
        assert str(refused.value) == refusals[phase]
        assert _books(permit) == before
    else:
        permit.arm(OPERATOR, 0.0)
        assert _books(permit) == (Phase.ARMED, None, OPERATOR, False, False)
    permit = _permit(phase)
    if phase is Phase.ARMED:
        permit.begin(OPERATOR, 0.0)
        assert _books(permit) == (Phase.MOVING, None, OPERATOR, True, False)
        return
    with pytest.raises(Refused) as refused:
        permit.begin(OPERATOR, 0.0)
    assert str(refused.value) == f"the arms are {phase}; arm them first"
    assert _books(permit) == before


def test_a_motion_begins_without_the_wish_to_stop_the_last_one():
    permit = _permit(Phase.ARMED)
    permit.stop_wanted = True
    permit.begin(OPERATOR, 0.0)
    assert not permit.stop_wanted


@pytest.mark.parametrize("phase", Phase)
def test_a_fault_latches_with_its_first_reason_and_stops_what_runs(phase):
    permit = _permit(phase)
    permit.fault("lost")
    moving = phase is Phase.MOVING
    reason = "reflex" if phase is Phase.FAULT else "lost"
    assert _books(permit) == (Phase.FAULT, reason, OPERATOR, moving, moving)
    permit.end()
    assert _books(permit) == (Phase.FAULT, reason, OPERATOR, False, False)


@pytest.mark.parametrize("phase", Phase)
def test_recovery_in_every_phase(phase):
    permit = _permit(phase)
    if phase is Phase.FAULT:
        permit.recover()
        assert permit.phase is Phase.RECOVERING
    else:
        before = _books(permit)
        with pytest.raises(Refused) as refused:
            permit.recover()
        assert str(refused.value) == f"nothing to recover from: the arms are {phase}"
        assert _books(permit) == before
    for outcome, left in (("recovered", (Phase.DISARMED, None)), ("not_recovered", (Phase.FAULT, "persists"))):
        permit = _permit(phase)
        before = _books(permit)
        permit.recovered() if outcome == "recovered" else permit.not_recovered("persists")
        assert _books(permit) == ((*left, OPERATOR, False, False) if phase is Phase.RECOVERING else before)


def test_arms_that_still_come_to_rest_are_not_recovered():
    permit = _permit(Phase.MOVING)
    permit.fault("reflex")
    with pytest.raises(Refused) as refused:
        permit.recover()
    assert str(refused.value) == "the arms have not come to rest yet; wait a moment"
    assert permit.phase is Phase.FAULT
    permit.end()
    permit.recover()
    assert permit.phase is Phase.RECOVERING
