"""The faults of the matrix, and what has to happen: what a careful operator would ask for, whatever the code does.

An arm that moves is stopped, the reason is said, the log is whole; where only one arm has the fault, both stop. What
the robot itself is to notice (20 lost packets) takes the loop as long as the robot. What is no danger stops nothing. An
idle cell stays idle: nothing moves until the cause is gone. A stop that is under way goes on, and keeps its reason.
"""

from tests.support.faults import injection as injected
from tests.support.faults.model import Expected, Fault, Moment, Performed, Reaction, Recovery, Scripted
from tests.support.faults.stage import Stage

FIRST_TORQUE_TICKS = 50  # more than the 20 after which a robot may give up
LOST_PACKETS = 20  # in a row: the robot's own limit (Franka Control Interface), and the judge's
LOOKS_AT_LOG_TICKS = 16  # how often the loop asks whether the log process lives
FLUSH_TICKS = 400  # the log process writes every quarter of a second, and somewhat later
RING_TICKS = 1024
OVERRUN_TICKS = 10  # half of them: a machine that stalls once is no reason
IDLE_S = 8.0  # what lasts when a run is asked for
STOP, LEAVE, GO_ON, NO_MOTION = (Reaction.STOP,), (Reaction.LEAVE,), (Reaction.GO_ON,), (Reaction.NO_MOTION,)
EITHER = (Reaction.STOP, Reaction.LEAVE)  # judge or robot, whoever is first
STOPPED = "stop requested by the operator"
GOES_ON = Expected(GO_ON, STOPPED)  # the case ends it, as an operator would
SAFETY, LEFT_CONTROL = "safety stop: ", "the robot left torque control: .*"
QP, LOG = "the QP was not solved: ", "the log is not being written"
ONE_SILENT = Expected(EITHER, f"{SAFETY}.*no new state|{LEFT_CONTROL}", LOST_PACKETS)
FROZEN = Expected(STOP, f"{SAFETY}(left: the state is stale|right: the other arm has shown no new state)", LOST_PACKETS)
NO_LOG = Expected(NO_MOTION, "LogError|" + LOG)


def _gap_in_states(stage: Stage) -> bool:
    return stage.largest_gap_ticks() >= 10


def _tracker_is_blind(stage: Stage) -> bool:
    return stage.tick - stage.pose_tick > 100  # frames come every 10 ms


def _was_limited(stage: Stage) -> bool:
    return stage.limited_at is not None


FAULTS = (
    # the link
    Fault(
        "packets lost for 10 ms", "ten states of the left arm do not arrive: fewer than the robot itself tolerates",
        Scripted('kind = "states_lost"\narm = "left"', 0.01),
        GOES_ON, GOES_ON, own_clocks=True, proof=_gap_in_states,
    ),
    Fault(
        "packets lost", "no state of the left arm arrives any more, and both arms share one clock",
        Scripted('kind = "states_lost"\narm = "left"', 0.5, IDLE_S),
        Expected(LEAVE, LEFT_CONTROL), Expected(NO_MOTION, "left|lost|does not answer"), recovery=Recovery.RECONNECT,
        shared_clock=True,
    ),
    Fault(
        "one arm silent", "no state of the left arm arrives any more, and each arm has its own clock",
        Scripted('kind = "states_lost"\narm = "left"', 0.5, IDLE_S),
        ONE_SILENT,
        Expected(NO_MOTION, "left|lost|does not answer"), recovery=Recovery.RECONNECT, own_clocks=True, reflex=True,
    ),
    Fault(
        "answers lost", "the left arm gets no torque of ours any more",
        Scripted('kind = "answers_lost"\narm = "left"', 0.3, IDLE_S),
        Expected(LEAVE, f"{LEFT_CONTROL}communication_constraints_violation", LOST_PACKETS),
        Expected(NO_MOTION, "does not take its torque|communication_constraints_violation", FIRST_TORQUE_TICKS),
        recovery=Recovery.RECONNECT, own_clocks=True,
    ),
    Fault(
        "arm gone", "the left arm closes its connection",
        Scripted('kind = "disconnect"\narm = "left"'),
        Expected(LEAVE, LEFT_CONTROL), Expected(NO_MOTION, "lost|does not answer|closed"), recovery=Recovery.RECONNECT,
        apart=ONE_SILENT,
    ),
    Fault(
        "robot process killed", "kill -9 of the simulated robot, both arms",
        Performed(injected.kill_robot),
        Expected(LEAVE, LEFT_CONTROL), Expected(NO_MOTION, "lost|does not answer|closed"), recovery=Recovery.NEW_ROBOT,
    ),
    # the state
    Fault(
        "frozen state", "the left arm repeats its state under rising time",
        Scripted('kind = "state_frozen"\narm = "left"', 2.0, IDLE_S),
        FROZEN, Expected(NO_MOTION, "the state is stale|no new state|left torque control"), apart=FROZEN,
    ),
    Fault(
        "NaN in the state", "the left arm's joint positions are no numbers",
        Scripted('kind = "state_nan"\narm = "left"\nfield = "q"', 0.5, IDLE_S),
        Expected(STOP, f"{SAFETY}left: .*not finite"), Expected(NO_MOTION, "not finite"),
    ),
    Fault(
        "NaN in the force", "the left arm's estimate of the external wrench is no number",
        Scripted('kind = "state_nan"\narm = "left"\nfield = "O_F_ext_hat_K"', 0.5, IDLE_S),
        Expected(STOP, f"{SAFETY}left: .*not finite"), Expected(NO_MOTION, "not finite"),
    ),
    Fault(
        "time runs backwards (robot)", "the left arm's clock jumps back by 30 s; libfranka ignores what is older",
        Scripted('kind = "time_back"\narm = "left"\nback_ms = 30000.0', 0.3),
        Expected(LEAVE, LEFT_CONTROL), GOES_ON, recovery=Recovery.RECONNECT,
    ),
    Fault(
        "time runs backwards (driver)", "the left arm's states are stamped 5 ms earlier from one tick on",
        Performed(injected.driver_time_back),
        Expected(STOP, f"{SAFETY}left: the robot's time ran backwards"),
        Expected(GO_ON, STOPPED),  # both stamps count from the session's beginning: nothing runs backwards
    ),
    # the robot
    Fault(
        "reflex", "the left arm stops itself, and cannot be recovered for a while",
        Scripted('kind = "reflex"\narm = "left"\nerror = "cartesian_reflex"', 4.0, IDLE_S),
        Expected(LEAVE, f"{LEFT_CONTROL}cartesian_reflex"), Expected(NO_MOTION, "cartesian_reflex|Reflex"),
        recovery=Recovery.RESET,
    ),
    Fault(
        "user stop", "somebody presses the activation device of the left arm",
        Scripted('kind = "user_stop"\narm = "left"', 4.0, IDLE_S),
        Expected(LEAVE, f"(?i){LEFT_CONTROL}(user|emergency)"), Expected(NO_MOTION, "(?i)user|emergency"),
        recovery=Recovery.RESET,
    ),
    Fault(
        "collision", "the left pad is pushed with 300 N for 40 ms: more than the wrist can hold",
        Scripted('kind = "push"\narm = "left"\nforce_N = [-300.0, 0.0, 0.0]', 0.04),
        Expected(EITHER, f"{SAFETY}|{LEFT_CONTROL}"), GOES_ON, physical=True, reflex=True, recovery=Recovery.RECONNECT,
    ),
    Fault(
        "joint pushed to its limit", "20 Nm from outside on joint 6 of the left arm, for 30 ms",
        Scripted('kind = "joint_push"\narm = "left"\ntorque_Nm = [0, 0, 0, 0, 0, 20, 0]', 0.03),
        Expected(EITHER, f"{SAFETY}|{LEFT_CONTROL}"), GOES_ON, physical=True, reflex=True, recovery=Recovery.RECONNECT,
    ),
    Fault(
        "torque sensor spike", "the sensor of joint 2 of the left arm is off by 120 Nm for 5 ms",
        Scripted('kind = "tau_sensor_bias"\narm = "left"\nbias_Nm = [0, 120, 0, 0, 0, 0, 0]', 0.005),
        Expected(EITHER, f"{SAFETY}|{LEFT_CONTROL}"), GOES_ON, physical=True, reflex=True, recovery=Recovery.RECONNECT,
    ),
    Fault(
        "tracker blind", "motion capture has no new frames of the object: the controller does not need them",
        Scripted('kind = "tracker_lost"'),
        GOES_ON, GOES_ON, proof=_tracker_is_blind,
    ),
    # the controller
    Fault(
        "exception in a tick", "the controller raises in the middle of a tick",
        Performed(injected.exception),
        Expected(STOP, "exception.*a defect of the controller"), Expected(NO_MOTION, "a defect of the controller"),
    ),
    Fault(
        "NaN torque", "the controller desires a torque that is no number",
        Performed(injected.nan_torque),
        Expected(STOP, f"{SAFETY}left: joint 3: the desired torque is nan"),
        Expected(NO_MOTION, "the desired torque is nan"),
    ),
    Fault(
        "torque of 200 Nm", "the controller desires 200 Nm of joint 1 for good: limited at once, and then stopped",
        Performed(injected.huge_torque),
        Expected(STOP, SAFETY), Expected(NO_MOTION, SAFETY), proof=_was_limited,
    ),
    Fault(
        "QP infeasible", "no torque keeps all limits", Performed(injected.qp_infeasible),
        Expected(STOP, f"{QP}infeasible"), Expected(NO_MOTION, f"{QP}infeasible"),
    ),
    Fault(
        "QP iterations exhausted", "both solvers come to their end of patience", Performed(injected.qp_exhausted),
        Expected(STOP, f"{QP}iterations_exhausted"), Expected(NO_MOTION, f"{QP}iterations_exhausted"),
    ),
    Fault(
        "QP wrong answer", "both solvers call a wrong answer solved", Performed(injected.qp_wrong),
        Expected(STOP, f"{QP}wrong_answer"), Expected(NO_MOTION, f"{QP}wrong_answer"),
    ),
    Fault(
        "tick overrun", "each tick of the left arm takes 30 ms", Performed(injected.overrun),
        Expected(STOP, "the tick takes longer", OVERRUN_TICKS),
        Expected(NO_MOTION, "the tick takes longer|communication_constraints_violation"),
        own_clocks=True,
        # the robot waits for 20 ms, too, and the residual is of answers that were lost
        apart=Expected(EITHER, f"the tick takes longer|{SAFETY}|{LEFT_CONTROL}", OVERRUN_TICKS),
    ),
    # the surroundings
    Fault(
        "log process killed", "kill -9 of the log process", Performed(injected.kill_log),
        Expected(STOP, LOG, LOOKS_AT_LOG_TICKS), NO_LOG, log_dies=True,
    ),
    Fault(
        "log ring full", "the log process hangs, and nobody reads the ring", Performed(injected.stop_log),
        Expected(STOP, LOG, RING_TICKS), NO_LOG, log_dies=True, small_ring=True,
    ),
    Fault(
        "disk full", "the log's file can grow no further", Performed(injected.fill_disk),
        Expected(STOP, LOG, FLUSH_TICKS), NO_LOG, log_dies=True,
    ),
    Fault(
        "operator gone", "the operator's page gives no sign of life any more", Performed(injected.operator_gone),
        Expected(STOP, "the operator has gone"), Expected(NO_MOTION, "the operator has gone"),
    ),
    Fault(
        "console gone", "the console gives no sign of life any more", Performed(injected.console_gone),
        Expected(STOP, "the console has gone"), Expected(NO_MOTION, "the console has gone"),
    ),
    Fault(
        "parent gone", "the process that started this one is killed", Performed(injected.parent_gone),
        Expected(STOP, "the process that started this one has gone"),
        Expected(NO_MOTION, "the process that started this one has gone"),
    ),
    Fault(
        "stop asked", "somebody presses stop", Performed(injected.stop_asked),
        Expected(STOP, STOPPED), Expected(NO_MOTION, STOPPED),
    ),
)  # fmt: skip


def case_name(fault: Fault, moment: Moment) -> str:
    """Return the name of the case, good for a file."""
    words = "".join(c if c.isalnum() else " " for c in fault.name.lower()).split()
    return f"{'-'.join(words)}.{moment}"
