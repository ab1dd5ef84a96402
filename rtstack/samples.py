"""The records of a tick, the same in compiled code, rings, log and plots; rtstack.topics says where they go.

Units are SI, wrenches and twists are [linear, angular] along the world's axes about the pad's face; `wrench_desired` is
the wrench that the controller wants to act on the end effector.
"""

from enum import IntEnum, StrEnum

from hal.base.record import JOINTS, POSE, TWIST, WRENCH, Field, record_of
from hal.state import ARM_STATE_FIELDS
from rtstack.monitor.records import Reason, Verdict

SIDES: tuple[str, str] = ("left", "right")
"""The sides of arms, in the order of every array of arms."""


class Mode(IntEnum):
    """What the controller is doing. The three impact modes are the paper's."""

    IDLE = 0
    TELEOPERATION = 1
    ANTE_IMPACT = 2
    INTERIM = 3
    POST_IMPACT = 4
    STOPPING = 5
    STOPPED = 6
    HOLDING = 7  # reactions to an impact that was not meant
    RETREATING = 8


class QpStatus(IntEnum):
    """How the torque of this tick was found."""

    NOT_USED = 0
    UNCONSTRAINED = 1  # the unconstrained minimiser satisfies every limit
    SOLVED = 2  # the solver ran, and its answer satisfies the optimality conditions
    INFEASIBLE = 3
    ITERATIONS_EXHAUSTED = 4
    WRONG_ANSWER = 5  # the solver says solved, the optimality conditions say no


class QpSolver(StrEnum):
    """Which library answers."""

    PROXQP = "proxqp"
    DAQP = "daqp"


class Reaction(StrEnum):
    """What an unexpected verdict leads to."""

    CONTINUE = "continue"  # nothing but a mark in log and result
    STOP = "stop"  # the judge's controlled stop
    HOLD = "hold"  # the setpoint stays where it is
    RETREAT = "retreat"  # back the way it came, unless the object may have been lifted: then it holds


class LawInertia(StrEnum):
    """Which mass matrix the controller's law uses."""

    LINKS = "M"  # (4), (8) and (14) of the reference-spreading paper
    LINKS_AND_MOTORS = "M+B_theta"  # (10) of the impact-map paper


# hal's state and the torques: what the controller wanted, and what the safety judge let through
ARM_FIELDS = (
    *ARM_STATE_FIELDS,
    Field(
        "tau_desired",
        "Torques that the controller wanted, {unit}, gravity excluded.",
        "Nm",
        JOINTS,
        plain="joint torque, wanted",
    ),
    Field(
        "tau_applied",
        "Torques that the safety judge let through, {unit}, gravity excluded.",
        "Nm",
        JOINTS,
        plain="joint torque, applied",
    ),
)
ARM_SAMPLE = record_of(ARM_FIELDS)
"""A sample of /left/arm and /right/arm: see the page of the log's format for fields and units."""

_AXES = "along the world's axes"
CONTROL_FIELDS = (
    Field("mode", "What the controller is doing.", enum=Mode, plain="mode"),
    Field(
        "gamma", "Blending parameter of the interim mode, 0 to 1.", plain="blending"
    ),  # (29): 0 outside of its ramp, 1 after it
    Field(  # (5), (22), (27)
        "wrench_desired",
        f"Wrench wanted at the end effector {_AXES}: force N, torque Nm.",
        "N, Nm",
        WRENCH,
        "world",
        plain="wanted force and torque",
        reference="wrench_ff",
    ),
    Field(
        "pose_ref",
        "Reference pose T_world_ee: x y z in m, then the quaternion qw qx qy qz.",
        "m",
        POSE,
        "world",
        plain="reference pose",
    ),
    Field(
        "twist_ref",
        f"Reference twist {_AXES}: linear m/s, angular rad/s.",
        "m/s, rad/s",
        TWIST,
        "world",
        plain="reference velocity",
    ),
    Field(
        "wrench_ff",
        "Feedforward part of wrench_desired: force N, torque Nm.",
        "N, Nm",
        WRENCH,
        "world",
        plain="reference force and torque",
    ),
    Field("beta", "Posture acceleration, {unit}.", "rad/s^2", plain="posture acceleration"),  # (10), (24), (31)
    Field("qp_status", "How the torque of this tick was found.", enum=QpStatus, plain="how the torque was found"),
    Field("qp_iterations", "Iterations of the solver.", kind="i8", plain="iterations of the solver"),
    Field(
        "momentum_residual",
        "Momentum observer's residual, {unit}, with the sign of tau_ext_hat_filtered.",
        "Nm",
        JOINTS,
        plain="momentum residual",
    ),
    Field("residual_rate", "Rate of the residual, {unit}.", "Nm/s", JOINTS, plain="rate of the residual"),
    Field("force_norm", "Norm of the interaction wrenches of both arms.", plain="force norm (Eq. 33)"),  # (33)
    # of the aim-aware monitor (rtstack.monitor)
    Field("impact_verdict", "Whether this arm's impact was the one that was meant.", enum=Verdict, plain="verdict"),
    Field(
        "impact_reason", "The first condition of this arm that was not met.", enum=Reason, plain="reason of the verdict"
    ),
    Field(
        "impact_margin",
        "1 where all is as meant, 0 at the bound of this arm's nearest condition, negative beyond it.",
        plain="margin to the bound",
    ),
    Field(
        "pair_verdict",
        "Whether the impact of both arms was the one that was meant.",
        enum=Verdict,
        plain="verdict of both arms",
    ),
    Field(
        "pair_reason",
        "The first condition of either arm, or of both, that was not met.",
        enum=Reason,
        plain="reason for both arms",
    ),
    Field("pair_margin", "As impact_margin, of both arms and their net force.", plain="margin of both arms"),
)
CONTROL_SAMPLE = record_of(CONTROL_FIELDS)
"""A sample of /left/control and /right/control."""

TIMING_FIELDS = (
    Field("period_us", "Time since the last tick, {unit}.", "us", host_clock=True, plain="time between ticks"),
    Field(
        "compute_us", "Time from the state's arrival to the command, {unit}.", "us", host_clock=True,
        plain="computing time",
    ),
    Field("lateness_us", "How late the state was, {unit}.", "us", host_clock=True, plain="lateness of the state"),
    Field("missed_deadlines", "Ticks missed since the start.", kind="i8", plain="missed ticks"),
    Field(
        "pair_skew_us",
        "Between the arrivals of the two arms' newest states, {unit}; 0 where both come together.", "us",
        host_clock=True, plain="skew of the arms' states",
    ),
)  # fmt: skip
TIMING_SAMPLE = record_of(TIMING_FIELDS)
"""A sample of /timing."""


class Level(IntEnum):
    """Severity of an event, as foxglove.Log counts it."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4
    FATAL = 5


EVENT_FIELDS = (
    Field("level", "Severity.", enum=Level),
    Field("name", "The source: mode, impact, verdict, safety, operator. ASCII, cut to fit.", kind="S24"),
    Field("text", "What happened. ASCII, cut to fit.", kind="S200"),
)
EVENT = record_of(EVENT_FIELDS)
