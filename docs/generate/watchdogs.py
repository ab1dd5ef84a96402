"""Everything that watches for something to go quiet or wrong, in one table, with the constants that the code uses."""

from dataclasses import dataclass

from hal.fci.pair import STALE_S
from hal.limits import COLLISION_TORQUES
from rtstack.log.ring import CAPACITY
from rtstack.log.writing.mcap_writer import FLUSH_NS
from rtstack.loop.end import End
from rtstack.loop.standstill import STOP_TICKS
from rtstack.loop.watchdogs import CLUTCH_S, CONSOLE_S, FIRST_TORQUE_TICKS, OPERATOR_S, OVERRUN_TICKS
from rtstack.safety.arming import LEASE_S
from rtstack.safety.judge import LIMITED_TICKS
from rtstack.safety.limits import LARGEST_GAP_S
from rtstack.safety.reasons import Cause
from rtstack.trials.record import FULL_SHARE, HANG_S
from rtstack.trials.run import ROOM_TICKS

LIBFRANKA_TIMEOUT_S = 1.0  # source: libfranka, network.h: how long it waits for a state
_STOP = "judge's stop"
_ALONE = "judge's stop, the controller is not asked again"
_ROBOT = "the robot brakes and holds by itself"
_MS = 1e3 * LARGEST_GAP_S


@dataclass(frozen=True, slots=True)
class Entry:
    """One watchdog. notices: after how long, in `unit`, it sees what it watches for; the reaction follows at once, the
    judge's first stopping torque at most 2 ticks later."""

    name: str
    watches: str
    notices: float
    unit: str
    reason: str
    reaction: str
    seen_by: str


WATCHDOGS = (
    Entry("stop", "STOP of the console, Ctrl-C, SIGTERM", 1, "tick", End.STOP_REQUESTED, _STOP, "loop"),
    Entry("controller exception", "whatever the controller raises", 1, "tick", End.CONTROLLER_EXCEPTION, _ALONE,
          "loop"),
    Entry("unexpected impact", "an impact when or where none is planned", 1, "tick", End.CRASH,
          "the trial's `--reaction`, then the judge's stop; with `continue` a mark in log and result", "loop"),
    Entry("QP not solved", "INFEASIBLE, ITERATIONS_EXHAUSTED, WRONG_ANSWER (KKT residual)", 1, "tick", End.QP, _STOP,
          "loop"),
    Entry("not a number", "state, residual and desired torque", 1, "tick", Cause.NOT_FINITE.text, _STOP, "judge"),
    Entry("tick overrun", "both arms' turns together longer than a period, in a row; clocks of their own only",
          OVERRUN_TICKS, "ticks", End.TICK_OVERRUN, _ALONE, "loop"),
    Entry("first torque", "one arm shows a torque of ours and the other one none; clocks of their own only",
          FIRST_TORQUE_TICKS, "ticks", End.TORQUE_NOT_TAKEN, _STOP, "loop"),
    Entry("lost answers", "a quarter of the answers to an arm come too late; clocks of their own only", 1, "s",
          End.TORQUE_NOT_TAKEN, _STOP, "loop"),
    Entry("stale state", "a state that does not change", _MS, "ms", Cause.STATE_AGE.text,
          f"{_STOP}; then, since the judge cannot brake by such a state, {_ROBOT}", "judge, loop"),
    Entry("impossible torque", "ticks in a row whose torque the judge had to limit", LIMITED_TICKS, "ticks",
          f"{Cause.TORQUE.text}, {Cause.TORQUE_RATE.text}", _STOP, "judge"),
    Entry("missing states", "the robot's time between two states", _MS, "ms", Cause.STATE_GAP.text, _STOP, "judge"),
    Entry("time", "the robot's time goes on", 1, "tick", Cause.TIME_BACKWARDS.text, _STOP, "judge"),
    Entry("silent arm", "one arm is served and the other one is not", _MS, "ms", Cause.PAIR_SKEW.text, _STOP, "judge"),
    Entry("lost arm", "no state of an arm; clocks of their own only", 1e3 * STALE_S, "ms", End.HARDWARE,
          f"its connection is shut; {_ROBOT}, and so does the other arm", "hal"),
    Entry("simulator gone", "no state of a robot that waits for answers; a connection that closes: at once",
          LIBFRANKA_TIMEOUT_S, "s", End.HARDWARE, "the session ends; a plant that has gone moves nothing", "libfranka"),
    Entry("reflex", "the robot's mode and errors in each state", 1, "tick", End.HARDWARE, f"{_ROBOT}: both",
          "hal"),
    Entry("operator heartbeat", "a word of the mailbox", OPERATOR_S, "s", End.OPERATOR_GONE, _STOP, "loop"),
    Entry("console heartbeat", "a word of the mailbox", CONSOLE_S, "s", End.CONSOLE_GONE, _STOP, "loop"),
    Entry("clutch let go", "a word of the mailbox, during teleoperation", 1, "tick", End.RELEASED,
          "judge's stop; where the operator chose so, a clutch that is released makes the arms brake and hold", "loop"),
    Entry("clutch heartbeat", "a word of the mailbox, while the clutch is held", CLUTCH_S, "s", End.CLUTCH_QUIET, _STOP,
          "loop"),
    Entry("policy", "an answer to an observation that is no older, while the policy leads", CLUTCH_S, "s",
          End.POLICY_QUIET, _STOP, "loop"),
    Entry("parent gone", "the process that started `rtstack trial` or `teach`", 1, "tick", End.PARENT_GONE, _STOP,
          "loop"),
    Entry("log process gone", "its exit", ROOM_TICKS, "ticks", End.LOG_FAILED, _STOP, "loop"),
    Entry("disk full", "a write that is refused", FLUSH_NS * 1e-9, "s", End.LOG_FAILED, _STOP, "log process, loop"),
    Entry("log hangs", "a full ring of a run that may wait: direct, lockstep", HANG_S, "s", End.LOG_FAILED, _STOP,
          "loop"),
    Entry("log ring full", "records that wait, where the robot does not; the other half of the ring takes the stop",
          FULL_SHARE * CAPACITY, "ticks", End.LOG_FAILED, _STOP, "loop"),
    Entry("no rest", "arms that still move after a stop", STOP_TICKS, "ticks", End.NOT_AT_REST, _ROBOT, "loop"),
    Entry("lease", "signs of life of who has control", LEASE_S, "s", "the operator has gone",
          "disarmed; a motion stops, which leaves a fault", "robot process"),
    Entry("supervisor", "its children's exit", 0, "ms", "the robot process died, the console died",
          "it ends the other ones, in order; without a console a motion stops first", "supervisor"),
    Entry("parent watch", "the supervisor's end of a child's standard input", 0, "ms", End.PARENT_GONE, _STOP,
          "robot process, console"),
    Entry("lost packets", "answers that come too late or not at all, in a row", _MS, "ms",
          "communication_constraints_violation", _ROBOT, "robot"),
    Entry("collision",
          f"external torques: {max(COLLISION_TORQUES):g} Nm at the base, {min(COLLISION_TORQUES):g} at the wrist",
          1, "tick", "joint_reflex, cartesian_reflex", _ROBOT, "robot"),
)  # fmt: skip


def watchdogs() -> str:
    """Return the table, in Markdown."""
    lines = ["| watchdog | what it watches | notices after | reason | reaction | who sees it |", "|---" * 6 + "|"]
    for e in WATCHDOGS:
        lines.append(f"| {e.name} | {e.watches} | {e.notices:g} {e.unit} | {e.reason} | {e.reaction} | {e.seen_by} |")
    return "\n".join(lines)
