"""The steps in which the arm is held, led or turned by a degree: the cell's geometry need not have been measured."""

import time
from dataclasses import replace

import numpy as np

from hal.cell import Cell
from hal.errors import CommandRejected, HardwareError
from hal.limits import CollisionBehaviour
from hal.robot_errors import ROBOT_ERRORS
from hal.state import RobotMode
from rtstack.bench.hold import GOOD_RAD
from rtstack.bench.link import GOOD_SUCCESS
from rtstack.identification.sweep import PreparedWiggle
from rtstack.loop.standstill import REST_DQ
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedGuide
from rtstack.trials.specification import GuideSpecification, SweepSpecification
from sim_robot.plant_parameters import load_plant_parameters
from tests.support.hour import figures
from tests.support.hour.lab import Found, Lab, Skipped, ask, recovered, say
from tests.support.hour.recorder import Rows
from tests.support.hour.runs import NOTHING, PreparedHold, PreparedJointsHere, steps, still

STARTS, AFTER_MS = 10, 2000
MOVE_S = 0.1  # aiofranka's examples need 31 ms on real arms; beyond 20 ms another arm has to be answered meanwhile
HOLDS_RAD = 0.01
STEP_RAD = 0.01
GAPS = (1, 2, 5, 10)
FATAL = 25  # 20 packets lost in a row end a motion (the vendor's FCI documentation)
LOST = "communication_constraints_violation"
THRESHOLD_N = 15.0
POSTURES = 3


def hold(lab: Lab) -> Found:
    """Hold the arm softly for ten seconds, as `rtstack check` does."""
    found = Found()
    host = lab.led
    host.what = "hold of the arm"
    result = host.run(PreparedHold(NOTHING, lab.description, lab.ms(10_000, 1500)))
    rows, bench = host.arm.rows, result.link
    found.figures = {"bench": bench.as_dict(), "rest": figures.rest(figures.in_motion(rows), lab.model),
                     "link": figures.link(figures.in_motion(rows))}  # fmt: skip
    found.keep("hold", rows)
    found.claim("the hold stays", f"within {GOOD_RAD:g} rad", f"{bench.hold_rad[0]:.4f} rad, {bench.hold_nm[0]:.1f} Nm",
                bench.hold_rad[0] <= GOOD_RAD)  # fmt: skip
    found.claim("control_command_success_rate", f"{GOOD_SUCCESS:g} at least", f"{bench.success_rate_mean[0]:.3f} mean, "
                f"{bench.success_rate_min[0]:.2f} least", bench.success_rate_mean[0] >= GOOD_SUCCESS)  # fmt: skip
    return found


def starts(lab: Lab) -> Found:
    """Begin and end torque control ten times: how long the box takes, and how it holds the arm afterwards."""
    found, host = Found(), lab.led
    host.what = f"{STARTS} starts and stops"
    run = PreparedHold(NOTHING, lab.description, lab.ms(500, 300), lab.ms(AFTER_MS, 300))
    moves, stops, held = list[float](), list[float](), list[dict]()
    with host.kept_cell(run), host.held() as context:
        for number in range(STARTS):
            host.arm.clear()
            host.link.clear()
            host.run(run)
            moves.append(host.link.starts[0][1])
            stops.append(host.link.stops[0][1])
            held.append(figures.after_stop(host.arm.rows, host.link.stops[0][0]))
            if number == 0:
                found.keep("first", host.arm.rows)
            if context.stop is not None and context.stop.stop_requested:
                raise TrialError("the key was let go")
    found.figures = {"move_s": moves, "stop_move_s": stops, "held_after": held}
    found.claim("Move", f"{1e3 * MOVE_S:g} ms at most", f"{1e3 * min(moves):.1f} to {1e3 * max(moves):.1f} ms",
                max(moves) <= MOVE_S)  # fmt: skip
    found.claim("StopMove", f"{1e3 * MOVE_S:g} ms at most", f"{1e3 * min(stops):.1f} to {1e3 * max(stops):.1f} ms",
                max(stops) <= MOVE_S)  # fmt: skip
    worst = max(each["largest_rad"] for each in held)
    found.claim("the box holds the arm after a stop", f"within {HOLDS_RAD:g} rad", f"{worst:.4f} rad",
                worst <= HOLDS_RAD)  # fmt: skip
    return found


def wiggles(lab: Lab) -> Found:
    """Turn each joint by a degree and back: what tau_J_d shows of what was sent, and when."""
    found, host = Found(), lab.led
    host.what = "each joint by a degree, one after the other"
    first = PreparedWiggle(SweepSpecification("", 1, 0), lab.description, 0)
    echoes = []
    with host.kept_cell(first), host.held():
        for joint in range(1, 8):
            host.arm.clear()
            result = host.run(replace(first, specification=SweepSpecification("", joint, 0)))
            if not result.success:
                raise TrialError(f"joint {joint}: {result.failure_reason}")
            echoes.append(figures.echo(host.arm.rows))
            found.keep(f"joint{joint}", host.arm.rows)
    found.figures = {"echo": echoes}
    ticks = sorted({each["ticks"] for each in echoes})
    off = max(each["largest_off_nm"] for each in echoes)
    found.claim("tau_J_d echoes the torque", "after 1 tick, within 0.001 Nm", f"after {ticks} ticks, {off:.4f} Nm",
                ticks == [1] and off <= 1e-3)  # fmt: skip
    return found


def guide(lab: Lab) -> Found:
    """The person leads the arm to three postures: the estimate by posture, and how late it is."""
    found, host = Found(), lab.led
    host.what = "hand guiding"
    rests, delays = [], []
    for number in range(1, POSTURES + 1):
        say(f"posture {number} of {POSTURES}: push and pull the pad with some 20 N, then leave it at another place")
        prepared = PreparedGuide(GuideSpecification(lab.ms(20_000, 2500) * 1e-3), lab.description)
        result = host.run(prepared)
        rows = figures.in_motion(host.arm.rows)
        if not result.success:
            raise TrialError(str(result.failure_reason))
        found.keep(f"led{number}", rows)
        delays.append(figures.estimate_delay(rows, lab.model))
        say("hands off the arm")
        rests.append(figures.rest(lab.idle(lab.ms(2000, 500)), lab.model))
    found.figures = {"rest": rests, "estimate": delays}
    forces = np.array([each["O_F_ext_mean_n_nm"] for each in rests])[:, :3]
    spread = float(np.linalg.norm(np.ptp(forces, axis=0)))
    found.claim("force at rest by posture", "changes by 2 N at most", f"{spread:.2f} N over {POSTURES} postures",
                spread <= 2.0)  # fmt: skip
    late = [each["ms"] for each in delays if each["ms"] is not None]
    found.claim("the estimate is late by", "5 ms at most", f"{late} ms" if late else "nothing was felt: push harder",
                max(late) <= 5 if late else None)  # fmt: skip
    return found


def weight(lab: Lab) -> Found:
    """Hang a known weight: what the estimate makes of it, and how the box holds it, before and after a motion."""
    grams = ask("mass of the weight, g (500 to 1000); s: leave it out", ("*",))
    if not grams.isdecimal() or not 100 <= int(grams) <= 1500:
        raise Skipped("no weight")
    kg, found, host, ms = 1e-3 * int(grams), Found(), lab.led, lab.ms(2000, 500)
    without = lab.idle(ms)
    ask("hang it at the pad, wait until it hangs still; Enter")
    with_it = lab.idle(ms)
    sag = float(np.abs(with_it.state["q"].mean(axis=0) - without.state["q"].mean(axis=0)).max())
    rotation = lab.model.T_world_base[:3, :3]
    felt = [rows.state["O_F_ext_hat_K"][:, :3].mean(axis=0) for rows in (without, with_it)]
    change = rotation @ (felt[1] - felt[0])
    expected = 9.81 * kg
    found.figures = {"kg": kg, "force_change_n": change, "expected_n": expected, "box_sags_rad": sag}
    found.keep("without", without)
    found.keep("with", with_it)
    found.claim("the estimate of the weight", f"{expected:.1f} N up, within 15 %", f"{change[2]:.1f} N up",
                abs(change[2] - expected) <= 0.15 * expected)  # fmt: skip
    found.claim("the box holds it", "within 0.005 rad", f"{sag:.4f} rad", sag <= 0.005)
    heavier = replace(lab.description.pads[0], mass=lab.description.pads[0].mass + kg)
    mounting = replace(lab.mounting, pad=heavier)
    told = replace(lab.description, **{lab.side: mounting})
    host.what = "hold with the weight, which the box is told of"
    host.run(PreparedHold(NOTHING, told, lab.ms(3000, 500), lab.ms(AFTER_MS, 300)))
    found.keep("told", host.arm.rows)
    held = figures.after_stop(host.arm.rows, host.link.stops[0][0])
    found.figures["held_after"] = held
    found.claim("the box holds the weight after a stop", f"within {HOLDS_RAD:g} rad", f"{held['largest_rad']:.4f} rad",
                held["largest_rad"] <= HOLDS_RAD)  # fmt: skip
    ask("take the weight off; Enter")
    return found


def torque_steps(lab: Lab) -> Found:
    """Step each joint's goal by 0.6 degrees: what swings, and at which frequency."""
    found, host = Found(), lab.led
    host.what = "a step of each joint, as fast as the judge lets a torque rise"
    swings = []
    run = PreparedJointsHere(NOTHING, lab.description, still(0.2))
    with host.kept_cell(run), host.held():
        for joint in range(7):
            host.arm.clear()
            result = host.run(replace(run, path=steps(joint, STEP_RAD, lab.ms(1000, 400) * 1e-3)))
            if not result.success:
                raise TrialError(f"joint {joint + 1}: {result.failure_reason}")
            rows = host.arm.rows
            swings.append(figures.resonance(rows, joint) | {"echo": figures.echo(rows)})
            found.keep(f"joint{joint + 1}", rows)
    found.figures = {"swings": swings}
    hz, expected = np.array([each["hz"] for each in swings]), _swing_hz(lab)
    found.figures["expected_hz"] = expected
    found.claim(
        "flexible joints swing at",
        ", ".join(f"{f:.0f}" for f in expected) + " Hz, within half to twice",
        ", ".join(f"{f:.0f}" for f in hz) + " Hz",
        bool(np.all((hz > 0.5 * expected) & (hz < 2.0 * expected))),
    )
    rates = max(each["echo"]["largest_step_nm"] for each in swings)
    found.claim("torques step by 1 Nm a tick at most", "1 Nm, and the box takes it", f"{rates:.3f} Nm", rates <= 1.0)
    return found


def _swing_hz(lab: Lab) -> np.ndarray:
    """Return the frequencies (7,), Hz, of K (1 / B_theta + 1 / M): motor and link of a joint against its spring."""
    model, stiffness = lab.model, np.array(load_plant_parameters().joints.K)
    model.update(np.array(lab.mounting.home), np.zeros(7))
    motor = np.asarray(lab.mounting.robot.B_theta)
    return np.sqrt(stiffness * (1.0 / motor + 1.0 / np.diag(model.M))) / (2.0 * np.pi)


def losses(lab: Lab) -> Found:
    """Leave out 1, 2, 5 and 10 answers in a row, then 25."""
    found, host = Found(), lab.led
    host.what = "hold, with answers left out on purpose"
    gaps, before = list[figures.Gap](), 400
    run = PreparedHold(NOTHING, lab.description, 1200)
    with host.kept_cell(run), host.held():
        for lost in GAPS:
            host.arm.clear()
            host.arm.lose = frozenset(range(before, before + lost))
            host.run(run)
            gaps.append(figures.gap(host.arm.rows, lost))
            found.keep(f"lost{lost}", host.arm.rows)
    found.figures = {"gaps": [{name: getattr(each, name) for name in each.__slots__} for each in gaps]}
    found.claim("a lost answer repeats the last torque", "up to 10 in a row, and the motion goes on",
                ", ".join(f"{each.lost}: {'repeated' if each.repeated else 'CHANGED'}, {each.rad:.4f} rad"
                          for each in gaps), all(each.repeated and each.went_on for each in gaps))  # fmt: skip
    names = ()
    with host.kept_cell(run), host.held():
        host.arm.clear()
        host.arm.lose = frozenset(range(before, before + FATAL))
        try:
            host.run(run)
        except CommandRejected as error:
            names = error.errors
        rows = host.arm.rows
    found.keep(f"lost{FATAL}", rows)
    unanswered = int(((rows.answered_ns > 0) & ~rows.sent).sum())
    found.figures["fatal"] = {"errors": list(names), "left_out": unanswered, "modes": figures.modes(rows)}
    found.claim(f"{FATAL} lost answers stop the arm", LOST, ", ".join(names) or "nothing", names == (LOST,))
    _recovery(found, lab)
    return found


def _recovery(found: Found, lab: Lab) -> None:
    recovery = recovered(lab)
    found.figures["recovery"] = recovery
    went = recovery["mode_after"] or recovery["refused"]
    found.claim("recovery", "to IDLE within 15 s", f"{went} after {recovery['seconds']:.1f} s",
                recovery["mode_after"] == "IDLE" and recovery["seconds"] <= 15.0)  # fmt: skip


def thresholds(lab: Lab) -> Found:
    """Lower the box's own thresholds to 15 N, and push the pad until it stops by itself."""
    found, host = Found(), lab.led
    host.what = f"hold; push the pad from the side, slowly, until the arm stops at {THRESHOLD_N:g} N"
    run = PreparedJointsHere(NOTHING, lab.description, still(lab.ms(20_000, 2000) * 1e-3))
    names, said = (), ""
    with host.kept_cell(run):
        whole = CollisionBehaviour()
        force = (THRESHOLD_N,) * 3 + (THRESHOLD_N,) * 3
        lower = replace(whole, contact_torques=(8.0,) * 7, collision_torques=(16.0, 16.0, 16.0, 16.0, 12.0, 12.0, 12.0),
                        contact_forces=tuple(0.5 * each for each in force), collision_forces=force)  # fmt: skip
        host.link.tighter = lower
        host.arm.clear()
        result = host.run(run)
        rows = host.arm.rows
        said = result.failure_reason or ""
    names = tuple(name for name in ("cartesian_reflex", "joint_reflex") if name in said)
    state = rows.state
    forces = np.abs(state["O_F_ext_hat_K"][:, :3])
    found.keep("pushed", rows)
    found.figures = {"end": said, "errors": list(names), "largest_component_n": float(forces.max()),
                     "last_force_n_nm": state["O_F_ext_hat_K"][-1],
                     "last_tau_ext_nm": state["tau_ext_hat_filtered"][-1], "modes": figures.modes(rows)}  # fmt: skip
    reached = bool(names)
    found.claim(f"the box's own reflex at {THRESHOLD_N:g} N", f"a reflex at {THRESHOLD_N:g} N, within 3 N",
                f"{', '.join(names) or 'none'}, largest {forces.max():.1f} N",
                abs(float(forces.max()) - THRESHOLD_N) <= 3.0 if reached else None)  # fmt: skip
    if reached:
        _recovery(found, lab)
    return found


def user_stop(lab: Lab) -> Found:
    """Press the activation device while the arm is held; see modes, names, how it stops, and what leads out of it."""
    found, host = Found(), lab.led
    host.what = "hold; press the activation device (user stop) meanwhile, and leave it pressed"
    run = PreparedHold(NOTHING, lab.description, lab.ms(20_000, 4000))
    ended = ""
    with host.kept_cell(run) as cell:
        host.arm.clear()
        try:
            host.run(run)
        except HardwareError as error:
            ended = str(error)
        held = host.arm.count
        say("leave it pressed for two seconds more, then release it")
        released = ""
        seen = _watch(cell, 15.0)
        released = "still pressed" if seen == RobotMode.USER_STOPPED else seen.name
        rows = host.arm.rows
    found.keep("stopped", rows)
    changes = figures.modes(rows)
    found.figures = {"ended": ended, "modes": changes, "held_rows": held, "error_names": _names(rows)}
    pressed = next((k for k in range(len(rows)) if rows.state["robot_mode"][k] == RobotMode.USER_STOPPED), None)
    if pressed is None:
        found.claim("user stop", "mode USER_STOPPED, the motion ends", ended or "it was not pressed", None)
        return found
    fast = np.abs(rows.state["dq"][pressed:]).max(axis=1) > REST_DQ
    found.figures["rest_after_ms"] = int(np.flatnonzero(fast)[-1]) + 1 if fast.any() else 0
    found.claim("user stop", "mode USER_STOPPED, the motion ends", ended or "the motion went on", bool(ended))
    found.claim("released, the arm is", "IDLE", released, released == "IDLE")
    recovery = recovered(lab)
    found.figures["recovery"] = recovery
    went = "; ".join(recovery["from"]) or recovery["refused"]
    found.claim("after it, recovery", "is not needed", went or "nothing to recover", not went)
    again = ""
    try:
        host.what = "a short hold afterwards"
        host.run(PreparedHold(NOTHING, lab.description, lab.ms(1000, 300)))
    except HardwareError as error:
        again = str(error)
    found.claim("and torque control begins again", "yes", again or "yes", not again)
    return found


def _watch(cell: Cell, seconds: float) -> RobotMode:
    """Read an idle arm until it has left the user stop, for so long; return its last mode."""
    end, pressed, mode = time.monotonic() + seconds, False, RobotMode.OTHER
    while time.monotonic() < end:
        try:
            mode = cell.arms[0].read().robot_mode
        except HardwareError:
            mode = RobotMode.REFLEX
        pressed = pressed or mode == RobotMode.USER_STOPPED
        if pressed and mode != RobotMode.USER_STOPPED:
            break
        if not pressed and time.monotonic() > end - seconds + 2.0:
            break
    return mode


def _names(rows: Rows) -> list[str]:
    """Return the vendor's names of all errors that were shown."""
    mask = int(np.bitwise_or.reduce(rows.state["current_errors"])) if len(rows) else 0
    return [name for bit, name in enumerate(ROBOT_ERRORS) if mask >> bit & 1]
