"""No sequence of events reaches motion without arming, or leaves a fault without a recovery.

The machine beside the arming keeps its own, simpler books: who was last heard of when, whether anybody has armed since
the last reason to disarm, whether a fault is open. `RTSTACK_SEQUENCES=10000` explores as many sequences.
"""

import os

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from rtstack.safety.arming import LEASE_S, ArmingStateMachine, Phase, Refused

OPERATORS = ("anna", "ben")
operators = st.sampled_from(OPERATORS)
# boundaries of the lease first
waits = st.sampled_from([0.0, LEASE_S, LEASE_S * 1.001, LEASE_S / 2, 0.1, 100.0]) | st.floats(0.0, 3.0 * LEASE_S)


class PermitMachine(RuleBasedStateMachine):
    """Everything that can happen to it, in any order."""

    @initialize()
    def start(self) -> None:
        self.arming, self.now_s = ArmingStateMachine(), 0.0
        self.holder: str | None = None
        self.heard_s = 0.0
        self.armed = self.faulty = self.recovering = self.moving = self.must_stop = False

    def _forget_the_gone(self) -> None:
        if self.holder is not None and self.now_s - self.heard_s > LEASE_S:
            self._nobody_holds()

    def _nobody_holds(self) -> None:
        self.holder, self.armed = None, False
        self.must_stop = self.must_stop or self.moving

    def _tries(self, action, allowed: bool) -> None:
        if allowed:
            action()
        else:
            with pytest.raises(Refused) as refusal:
                action()
            assert "\n" not in str(refusal.value)

    @rule(wait_s=waits)
    def time_passes(self, wait_s: float) -> None:
        self.now_s += wait_s

    @rule()
    def somebody_watches(self) -> None:
        self.arming.watch(self.now_s)
        self._forget_the_gone()

    @rule(who=operators)
    def takes_control(self, who: str) -> None:
        self._forget_the_gone()
        allowed = self.holder in (None, who)
        self._tries(lambda: self.arming.take(who, self.now_s), allowed)
        if allowed:
            self.holder, self.heard_s = who, self.now_s

    @rule(who=operators)
    def gives_a_sign_of_life(self, who: str) -> None:
        self.arming.beat(who, self.now_s)
        self._forget_the_gone()
        if who == self.holder:
            self.heard_s = self.now_s

    @rule(who=operators)
    def releases(self, who: str) -> None:
        self.arming.release(who)
        if who == self.holder:
            self._nobody_holds()

    @rule(who=operators)
    def arms(self, who: str) -> None:
        self._forget_the_gone()
        allowed = who == self.holder and not (self.faulty or self.recovering or self.moving)
        self._tries(lambda: self.arming.arm(who, self.now_s), allowed)
        self.armed = self.armed or allowed

    @rule()
    def disarms(self) -> None:
        self.arming.disarm()
        self.armed = False
        self.must_stop = self.must_stop or self.moving

    @rule(who=operators)
    def begins(self, who: str) -> None:
        self._forget_the_gone()
        allowed = who == self.holder and self.armed and not (self.faulty or self.recovering or self.moving)
        self._tries(lambda: self.arming.begin(who, self.now_s), allowed)
        self.moving = self.moving or allowed
        if allowed:
            self.must_stop = False

    @rule(who=operators)
    def leads_by_hand(self, who: str) -> None:
        """What a hand leads needs the lease, arms at rest, and arming or a fault; the fault stays."""
        self._forget_the_gone()
        at_rest = not (self.recovering or self.moving)
        allowed = who == self.holder and at_rest and (self.armed or self.faulty)
        self._tries(lambda: self.arming.begin_by_hand(who, self.now_s), allowed)
        if allowed:
            self.moving, self.must_stop = True, False

    @rule(who=operators)
    def goes_for_it(self, who: str) -> None:
        """The way that leads furthest, so that what comes after a motion is explored as well."""
        self.takes_control(who)
        self.arms(who)
        self.begins(who)

    @rule(who=operators, wait_s=waits)
    def arms_and_is_heard_of_again_after_a_while(self, who: str, wait_s: float) -> None:
        self.takes_control(who)
        self.arms(who)
        self.time_passes(wait_s)
        self.gives_a_sign_of_life(who)

    @rule()
    def recovers_at_once(self) -> None:
        self.somebody_recovers()
        self.the_robot_has_recovered()

    @rule()
    def the_motion_ends(self) -> None:
        self.arming.end()
        self.moving = self.must_stop = False

    @rule(reason=st.sampled_from(["reflex", "lost"]))
    def a_fault_comes(self, reason: str) -> None:
        self.arming.fault(reason)
        self.must_stop = self.must_stop or self.moving
        self.faulty, self.recovering, self.armed = True, False, False

    @rule()
    def somebody_recovers(self) -> None:
        allowed = self.faulty and not self.recovering and not self.moving
        self._tries(self.arming.recover, allowed)
        if allowed:
            self.faulty, self.recovering = False, True

    @rule()
    def the_robot_has_recovered(self) -> None:
        self.arming.recovered()
        self.recovering = False

    @rule()
    def the_robot_refuses_the_recovery(self) -> None:
        self.arming.not_recovered("persists")
        if self.recovering:
            self.faulty, self.recovering = True, False

    @invariant()
    def motion_needs_arming_and_no_fault(self) -> None:
        phase = self.arming.phase
        if phase is Phase.MOVING:
            assert self.moving
            assert not self.faulty
            assert not self.recovering
        assert (phase is Phase.FAULT) == self.faulty
        assert (phase is Phase.RECOVERING) == self.recovering
        assert (self.arming.reason is not None) == (self.faulty or self.recovering)
        if phase is Phase.ARMED:
            assert self.armed
            assert self.arming.holder is not None

    @invariant()
    def a_motion_that_must_stop_says_so(self) -> None:
        if self.moving:
            assert self.arming.stop_wanted == self.must_stop


PermitMachine.TestCase.settings = settings(
    max_examples=int(os.environ.get("RTSTACK_SEQUENCES", "200")), stateful_step_count=40, deadline=None
)
TestPermit = PermitMachine.TestCase
