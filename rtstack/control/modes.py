"""The mode machine: which mode the controller is in, as a pure function of time and impact.

The paper's part IV and V: the proposed controller goes ante -> interim at the detected impact -> post after the interim
duration; the baselines differ in when they switch and in what they feed back.
"""

from dataclasses import dataclass
from enum import IntEnum

from rtstack.control.parameters import ControlParameters
from rtstack.samples import Mode


class Strategy(IntEnum):
    """How the controller goes through an impact: the proposed one, a baseline, or our extension of the proposed one.

    CONTACT_COMPLETION is the paper's future work (part VI): the interim mode waits for full contact.
    """

    PROPOSED = 0
    NO_REFERENCE_SPREADING = 1
    NO_VELOCITY_FEEDBACK = 2
    NO_INTERIM = 3
    CONTACT_COMPLETION = 4


# looked up once: an enumeration's member costs 0.1 us
_ANTE, _INTERIM, _POST = Mode.ANTE_IMPACT, Mode.INTERIM, Mode.POST_IMPACT
_ON_THE_WAY = (_ANTE, _INTERIM, _POST)
_REACTIONS = (Mode.HOLDING, Mode.RETREATING)
_BY_TIME = (Strategy.NO_REFERENCE_SPREADING, Strategy.NO_VELOCITY_FEEDBACK)
_NO_VELOCITY_FEEDBACK, _NO_INTERIM = Strategy.NO_VELOCITY_FEEDBACK, Strategy.NO_INTERIM


@dataclass(slots=True)
class ModeMachine:
    """Mode of the trial, shared by both arms. Times in s since the start of the reference.

    `update` moves through the paper's modes, `react` out of them; `begin` and `stop` are the only other ways to change
    `mode`. Once stopping, nothing but `rest` (when the arms are at rest) changes it: a new trial needs a new machine.
    """

    strategy: Strategy
    parameters: ControlParameters
    nominal_impact_s: float
    mode: Mode = Mode.IDLE
    gamma: float = 0.0
    velocity_weight: float = 1.0
    impact_s: float = -1.0
    patience_over: bool = False
    waiting: bool = False  # in interim mode, for full contact
    completion_s: float = -1.0  # when contact was complete
    _ramp_s: float = -1.0
    _ramp_from: float = 0.0

    def begin(self, mode: Mode) -> None:
        """Leave idle: to teleoperation or to the ante-impact mode. Ignored in any other mode."""
        if self.mode is Mode.IDLE and mode in (Mode.TELEOPERATION, Mode.ANTE_IMPACT):
            self.mode = mode

    def stop(self) -> None:
        """Enter the controlled stop, from any mode that moves."""
        if self.mode is not Mode.STOPPED:
            self.mode = Mode.STOPPING

    def react(self, mode: Mode) -> None:
        """Hold, or retreat, from any of the paper's modes; what follows is a stop."""
        if mode in _REACTIONS and self.mode in _ON_THE_WAY:
            self.mode = mode

    @property
    def reacting(self) -> bool:
        """Whether the arms do what an unexpected impact has led to."""
        return self.mode in _REACTIONS

    def rest(self) -> None:
        """The arms have come to rest after a stop."""
        if self.mode is Mode.STOPPING:
            self.mode = Mode.STOPPED

    def update(self, t_s: float, impact: bool, complete: bool = False) -> None:
        """Advance to the time t_s; impact: the detector fired in this tick, on either arm; complete: full contact."""
        if self.mode not in _ON_THE_WAY:
            return
        if impact and self.impact_s < 0.0:
            self.impact_s = t_s
        if self.strategy in _BY_TIME:
            if self.mode is _ANTE and t_s >= self.nominal_impact_s:
                self._enter_post()
        else:
            self._on_impact(t_s, complete)
        if self.strategy is _NO_VELOCITY_FEEDBACK:
            around = abs(t_s - self.nominal_impact_s) <= self.parameters.interim_s
            self.velocity_weight = 0.0 if around else 1.0

    def _on_impact(self, t_s: float, complete: bool) -> None:
        if self.mode is _ANTE:
            if self.impact_s < 0.0:
                self.patience_over = t_s > self.nominal_impact_s + self.parameters.impact_patience_s
            elif self.strategy is _NO_INTERIM:
                self._enter_post()
            else:
                self.mode = _INTERIM
                self._ramp_s = self.impact_s
                self.waiting = self.strategy is Strategy.CONTACT_COMPLETION
        if self.mode is _INTERIM:
            self.gamma = self._ramp_from + (t_s - self._ramp_s) / self.parameters.interim_s  # (29)
            if self.waiting:
                self._wait(t_s, complete)
            if self.gamma >= 1.0 - 1e-9:
                self._enter_post()
            else:
                self.velocity_weight = self.gamma

    def _wait(self, t_s: float, complete: bool) -> None:
        """Hold gamma where it may go without full contact. Once that is there, or patience is over, (29) goes on."""
        self.gamma = min(self.gamma, self.parameters.completion_gamma)
        if complete:
            self.completion_s = t_s
        if complete or t_s - self.impact_s >= self.parameters.completion_patience_s - 1e-9:
            self.waiting = False
            self._ramp_s, self._ramp_from = t_s, self.gamma

    def _enter_post(self) -> None:
        self.mode = _POST
        self.gamma = 1.0
        self.velocity_weight = 1.0
