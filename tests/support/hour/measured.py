"""The steps in which the arm goes somewhere: through the gate of every motion, with a cell that was measured."""

import numpy as np

from rtstack.identification.fit import fit_joint, joint_samples
from rtstack.identification.sweep import BEGIN_S, Sweep, sweep
from rtstack.loop.end import End
from rtstack.loop.plan import SessionPlan
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.run import ARRIVED_RAD
from tests.support.hour import figures
from tests.support.hour.lab import Found, Lab
from tests.support.hour.runs import NOTHING, STOP_AFTER, PreparedJoints, constant_speed, still, sweeps

SPEEDS_M_S = (0.05, 0.10, 0.22)  # the judge's own bound is at 0.25
PEAKS_RAD_S, LEG_S = (0.05, 0.1, 0.25), 1.5
FRICTION_RMS_NM = 0.3
STOP_MS = 300.0
WAY_RAD = 0.03


def _centre(lab: Lab) -> np.ndarray:
    """Return the point (1,) of POINT at which rtstack's own identification moves the joints."""
    arms = arm_controllers(lab.description, cell_parameters(lab.description))
    plan = sweep(lab.description, arms, 0).plan
    return plan.ante[:, round(BEGIN_S / plan.period_s)].copy()


def start_motions(lab: Lab) -> Found:
    """Go to the start pose, then to the middle of the room where the pad works; how far the joints are from the way."""
    found, host = Found(), lab.measured
    for name, start in (("home", None), ("centre", _centre(lab))):
        host.what = f"way to the {'start pose' if start is None else 'middle of the room'}"
        prepared = PreparedJoints(NOTHING, lab.description, still(1.0), start)
        result = host.run(prepared)
        if not result.success:
            raise TrialError(f"way to {name}: {result.failure_reason}")
        rows, starts = host.arm.rows, [row for row, _ in host.link.starts]
        found.keep(name, rows)
        if result.way is None:
            found.figures[name] = "the arm was there already"
            continue
        way = figures.way(result.way.path)
        found.figures[name] = figures.tracking(rows[starts[0] : starts[1]], way)
        found.figures[f"{name}_held"] = figures.tracking(rows[starts[1] :], result.q)
    ways = [found.figures[name] for name in ("home", "centre") if isinstance(found.figures[name], dict)]
    if not ways:
        raise TrialError("the arm stood there already: lead it elsewhere (step 10), then give this step again")
    worst, end = max(each["largest_rad"] for each in ways), max(each["at_the_end_rad"] for each in ways)
    found.claim("the joints follow the way", f"within {WAY_RAD:g} rad", f"{worst:.4f} rad", worst <= WAY_RAD)
    found.claim("and arrive", f"within {ARRIVED_RAD:g} rad", f"{end:.4f} rad", end <= ARRIVED_RAD)
    return found


def friction(lab: Lab) -> Found:
    """Move each joint to and fro, slowly, in the middle of the room: friction, and the estimate meanwhile."""
    found, host = Found(), lab.measured
    host.what = "each joint to and fro, one after the other"
    parameters = cell_parameters(lab.description)
    (arm,) = arm_controllers(lab.description, parameters)
    prepared = PreparedJoints(NOTHING, lab.description, still(0.5), _centre(lab))
    leg_s = LEG_S if lab.share == 1.0 else 0.3
    fits, largest, published = [], 0.0, parameters.friction[0]
    with host.kept_cell(prepared), host.held():
        for joint in range(7):
            host.arm.clear()
            host.link.clear()
            result = host.run(PreparedJoints(NOTHING, lab.description, sweeps(joint, PEAKS_RAD_S, leg_s), _centre(lab)))
            if not result.success:
                raise TrialError(f"joint {joint + 1}: {result.failure_reason}")
            plan = Sweep(joint, result_plan(lab), 0.2, len(result.q) * 1e-3 - 0.2)
            fits.append(fit_joint([joint_samples(result.columns, 0, plan, arm)], published, joint))
            rows = host.arm.rows[host.link.starts[-1][0] :]
            largest = max(largest, float(np.abs(rows.state["tau_ext_hat_filtered"]).max()))
            found.keep(f"joint{joint + 1}", rows)
    found.figures = {
        "p1_nm": [fit.p1 for fit in fits], "p2_s_rad": [fit.p2 for fit in fits], "p3_rad_s": [fit.p3 for fit in fits],
        "gravity_share": [fit.gravity_share for fit in fits], "rms_nm": [fit.rms_nm for fit in fits],
        "published_p1_nm": published.p1, "largest_tau_ext_nm": largest,
    }  # fmt: skip
    ratio = np.array([fit.p1 for fit in fits]) / np.maximum(published.p1, 1e-9)
    found.claim("friction p1, beside the published Panda's", "0.5 to 2 times", ", ".join(f"{r:.2f}" for r in ratio),
                bool(((ratio >= 0.5) & (ratio <= 2.0)).all()))  # fmt: skip
    gravity = 100.0 * max(abs(fit.gravity_share) for fit in fits)
    found.claim("the box's gravity torque", "within 3 % of ours", f"{gravity:.2f} %", gravity <= 3.0)
    rms = max(fit.rms_nm for fit in fits)
    found.claim("what the friction's law leaves", f"{FRICTION_RMS_NM:g} Nm rms at most", f"{rms:.3f} Nm",
                rms <= FRICTION_RMS_NM)  # fmt: skip
    return found


def result_plan(lab: Lab) -> SessionPlan:
    """Return a plan for the record of a sweep, which the fit does not look at."""
    arms = arm_controllers(lab.description, cell_parameters(lab.description))
    return sweep(lab.description, arms, 0).plan


def stops(lab: Lab) -> Found:
    """Stop from three speeds by the stop that STOP asks for: how long and how far the pad goes on."""
    found, host, model = Found(), lab.measured, lab.model
    host.what = "joint 1 at three speeds, each ended by STOP"
    start = _centre(lab)
    first = PreparedJoints(NOTHING, lab.description, still(0.5), start)
    results = []
    with host.kept_cell(first) as cell, host.held():
        if not (result := host.run(first)).success:
            raise TrialError(f"way to the middle: {result.failure_reason}")
        q = cell.arms[0].read().q.copy()
        model.update(q, np.zeros(7))
        place = model.p7 + model.R7 @ model.face
        lever_m = float(np.linalg.norm(model.J0[:3, 0] + np.cross(model.J0[3:, 0], place)))
        for speed in SPEEDS_M_S:
            host.arm.clear()
            host.link.clear()
            path = constant_speed(speed / lever_m)
            result = host.run(PreparedJoints(NOTHING, lab.description, path, start, STOP_AFTER))
            if result.end is not End.STOP_REQUESTED:
                raise TrialError(f"at {speed:g} m/s: {result.failure_reason}")
            rows = host.arm.rows[host.link.starts[-1][0] :]
            moving = figures.in_motion(rows)
            since_ms = (moving.state["t_ns"] - moving.state["t_ns"][0]) // 1_000_000
            stop = figures.stop(moving, int(np.searchsorted(since_ms, STOP_AFTER + 1)), model)
            results.append(stop | {"asked_m_s": speed, "held_after": figures.modes(rows)})
            found.keep(f"speed{round(100 * speed):03d}", rows)
    found.figures = {"stops": results, "lever_m": lever_m}
    for stop in results:
        found.claim(f"the judge's stop from {stop['asked_m_s']:g} m/s", f"within {STOP_MS:g} ms, at rest",
                    f"{stop['ms']:.0f} ms, {stop['mm']:.1f} mm from {stop['pad_m_s']:.3f} m/s",
                    stop["at_rest"] and stop["ms"] <= STOP_MS)  # fmt: skip
    return found
