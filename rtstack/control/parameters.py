"""The controller's numbers, each with its source: Table I of the reference-spreading paper unless said otherwise."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hal.base.arrays import Array
from hal.robots import FR3, RobotModel
from rtstack.samples import LawInertia


def _fixed(*values: float) -> Any:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return field(default_factory=lambda: array)


@dataclass(frozen=True, slots=True)
class ControlParameters:
    """Gains and times of all modes. Stiffness (6,): N/m then Nm/rad along the world's axes."""

    period_s: float = 1e-3
    exclusion_s: float = 0.1  # Delta T_r, before and after the impact
    interim_s: float = 0.1  # Delta t_int
    stiffness_teleoperation: Array = _fixed(300.0, 300.0, 300.0, 20.0, 20.0, 20.0)  # K_r
    stiffness: Array = _fixed(2000.0, 2000.0, 2000.0, 20.0, 20.0, 20.0)  # K^a = K^int = K^p
    # (23) of the impact-map paper follows the post-impact reference as soon as an impact is detected; (27) of the
    # reference-spreading paper blends the references, which demonstrated ones need and planned ones do not
    blend_interim: bool = True
    # from the detected impact on, if another: the impact-map paper lowers the orientation's for a grab (VI-B)
    stiffness_after_impact: Array | None = None
    # `stiffness` as gains k_p, k_theta of acceleration tasks, 1/s^2: (15)-(16) of the impact-map paper, instead of (5)
    acceleration_tasks: bool = False
    posture_gain: float = 500.0  # k_pos, 1/s^2
    posture_joint: int = 0  # the paper's choice: joint 1
    weight_impedance: float = 1.0
    weight_posture: float = 1.0
    # ours: keeps the Hessian positive definite at a singular posture; below the solver's tolerance elsewhere
    regularisation: float = 1e-8
    # ours: an impact that is this late does not come any more (30 mm at 0.3 m/s are 0.1 s)
    impact_patience_s: float = 0.3
    # ours, contact_completion alone: where gamma waits for full contact. A simultaneous impact has it by then, so that
    # only other impacts make gamma wait; and how long after the first impact it waits at most, as for the first one
    completion_gamma: float = 0.7
    completion_patience_s: float = 0.3


@dataclass(frozen=True, slots=True)
class DetectorParameters:
    """Appendix B, with the values of the experiments.

    tare_n, largest_tare_n: ours; a mean force between them is an offset of the estimate, N. Below it the law is the
    paper's: of the 5 N that are an impact it leaves 4, of the 4 N that are none 3. What is beyond is contact, and no
    offset. tare_n = inf: the paper's law, whatever the offset.
    """

    force_low_n: float = 4.0
    force_high_n: float = 5.0
    velocity_m_s: float = 0.025
    window_s: float = 0.2
    tare_n: float = 1.0
    largest_tare_n: float = 12.0


@dataclass(frozen=True, slots=True)
class CompletionParameters:
    """When a pad is in lasting contact. Force and speed: those of the impact detector, Appendix B, which tell contact
    from none and motion from rest; hold: ours, longer than a vibrating pad takes to turn round.
    """

    force_n: float = 5.0
    speed_m_s: float = 0.025
    hold_s: float = 0.01


@dataclass(frozen=True, slots=True)
class InertiaParameters:
    """Motor side. B_theta (7,): kg m^2, the robot model's, by default the FR3's. law_inertia: used by the law."""

    B_theta: Array = field(default_factory=lambda: FR3.B_theta)
    # the reference-spreading paper uses M; the impact-map paper adds B_theta and reports that it tracks better
    law_inertia: LawInertia = LawInertia.LINKS_AND_MOTORS
    observer_gain_hz: float = 200.0  # K_O, 1/s: about 5 ms, the bandwidth of the collision-monitoring study

    @property
    def added(self) -> Array:
        """What the law adds to the diagonal of M, kg m^2 (7,)."""
        return np.zeros(7) if LawInertia(self.law_inertia) is LawInertia.LINKS else self.B_theta


@dataclass(frozen=True, slots=True)
class FrictionParameters:
    """Sigmoid friction, by default of the FR3's model (hal/robots):

    tau_fric = p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), Nm.

    gravity_share: what the robot's own gravity compensation lacks, as a share of the arm's gravity torque at each
    joint; in free motion it is seen together with friction, and added to it.
    """

    p1: Array = field(default_factory=lambda: FR3.friction[0])
    p2: Array = field(default_factory=lambda: FR3.friction[1])
    p3: Array = field(default_factory=lambda: FR3.friction[2])
    scale: float = 1.0
    gravity_share: Array = _fixed(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, robot: RobotModel) -> "FrictionParameters":
        """Return what a model's file has."""
        return cls(*robot.friction)
