"""What a session asks of a controller, and what a controller of another package is made of."""

from collections.abc import Sequence
from typing import Protocol

from numpy import void
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.control.modes import ModeMachine
from rtstack.control.parameters import ControlParameters
from rtstack.control.watch import TrialMonitor
from rtstack.model.arm_model import ArmModel
from rtstack.samples import Mode, QpStatus


class ObservedArm(Protocol):
    """One arm as the tick has observed it. Each record has one element and stays where it is for the whole session.

    sample (1,) of ARM_SAMPLE: the state, libfranka's names and units; a law writes `tau_desired` (7,), Nm without
    gravity. control (1,) of CONTROL_SAMPLE: what the log keeps of the controller. setpoint (1,) of SETPOINT: what is
    asked for in this tick. workspace (1,) of WORKSPACE: pose, twist and Jacobian of the pad's face along the world's
    axes, M, coriolis, gravity, friction, force_world, and tau_previous (7,), Nm: the torque that was applied last.
    impact: whether the impact detector fired in this tick; a law may say otherwise in `observe`.
    """

    impact: bool

    @property
    def sample(self) -> NDArray[void]: ...
    @property
    def control(self) -> NDArray[void]: ...
    @property
    def setpoint(self) -> NDArray[void]: ...
    @property
    def workspace(self) -> NDArray[void]: ...
    @property
    def limits(self) -> NDArray[void]:
        """What a law may ask for, (1,) of CONTROL_LIMITS (rtstack.safety.limits): inside the judge's limits."""
        ...

    @property
    def model(self) -> ArmModel: ...
    @property
    def parameters(self) -> ControlParameters: ...


class Detector(Protocol):
    """An impact detector of one arm, in the place of Appendix B's (rtstack.control.detector).

    What it finds changes the mode and is the impact's time in log and result. The aim-aware monitor has its own
    detection, (8)-(9) of its paper, and does not depend on it.
    """

    def update(self, arm: "ObservedArm") -> bool:
        """Return whether the pad was hit in this tick: True once, in the tick of the detection.

        Called each tick after the arm's observation. It waits for nothing, keeps no memory and raises nothing.

        Args:
            arm: `workspace` has force_world (3,) N, which acts ON the pad, twist (6,) m/s and rad/s; `control`
                momentum_residual (7,) Nm and its rate; `sample` the state.
        """
        ...


class ArmLaw(Protocol):
    """The torque of one arm. `follow` is called before the robot is armed; the rest in the tick, which has 1 ms for
    both arms, judge and log. There a law waits for nothing, writes no file, keeps no more memory from tick to tick, and
    raises nothing: an exception or a late answer stops both arms.
    """

    def follow(self, ante: NDArray[void], post: NDArray[void]) -> None:
        """Take the references (n,) of POINT, a point a tick, that setpoints will be made of."""
        return

    def observe(self) -> None:
        """Take what was just observed of the arm. Called for all arms with a new state before any is commanded."""
        return

    def command(self, mode: Mode) -> QpStatus:
        """Write the arm's `tau_desired` for its setpoint. Called in the modes that move, not while the arms stop.

        What the log is to keep goes to the arm's control record: `wrench_desired` (33 is made of it: a run in which it
        stays 0 has no force norm), `qp_status` and `qp_iterations`, which stay 0 where there is no QP. Returns
        QpStatus.NOT_USED, or a status above SOLVED where there is no answer: then the judge stops both arms.
        """
        ...


class Controller(Protocol):
    """The controller of a cell's arms, left before right, in the order in which a session asks it each tick.

    `side` is an arm's place among `arms`. Arms that share a clock are all observed, then decided on, then commanded;
    with two clocks each arm has its turn. Before an arm moves another instance is called once, on states that are
    thrown away, in the order of a run's first tick: `follow`, `observe` of each arm, `decide`, `command` of each arm,
    `finish`.
    """

    @property
    def arms(self) -> Sequence[ObservedArm]: ...
    @property
    def machine(self) -> ModeMachine: ...
    @property
    def monitor(self) -> TrialMonitor | None: ...
    @property
    def impact_s(self) -> list[float]:
        """When each arm's detector first fired, s since the start of the reference; negative: it has not."""
        ...

    @property
    def first_impact_s(self) -> float:
        """The first of them; negative: there was none."""
        ...

    @property
    def reaction_over(self) -> bool:
        """Whether a reaction to an unexpected impact has come to its end, so that the session stops the arms."""
        ...

    def follow(self, ante: NDArray[void], post: NDArray[void], stiffness: Array) -> None:
        """Take the references (arms, n) of POINT and the plan's stiffness (6,), N/m and Nm/rad, before a clock runs."""

    def observe(self, side: int, elapsed_ns: int) -> None:
        """Take the state in an arm's sample, so long after the arm's first one."""

    def decide(self, t_s: float) -> None:
        """Advance the shared mode. t_s: since the start of the reference."""

    def command(self, side: int, elapsed_ns: int, index: int) -> QpStatus:
        """Choose an arm's setpoint at the reference's tick `index`, and write its `tau_desired`."""
        ...

    def finish(self) -> None:
        """Write what concerns the arms together, once those of this turn are commanded."""
