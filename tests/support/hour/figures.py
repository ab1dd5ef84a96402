"""From what an arm has shown to the figures of the hour: a function takes Rows and gives numbers by their names."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import savgol_filter, welch

from hal.base.arrays import Array
from hal.state import RobotMode
from rtstack.check.arm import missing_payload
from rtstack.loop.standstill import REST_DQ
from rtstack.model.arm_model import ArmModel
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.start_motion import JointPath
from tests.support.hour.recorder import Rows

PERIOD_S = 1e-3
LAGS = range(6)  # ticks in which an echo is looked for
QUIET_TICKS = 40  # a run ends once the arm has rested for 50
LONGEST_DELAY = 60  # ms, of the estimate
FELT_NM = 2.0  # smaller changes of an external torque say nothing of its delay
BAND_HZ = (12.0, 300.0)  # below it the law of the joints itself swings


def rounded(value: Any, digits: int = 5) -> Any:
    """Return a number, an array or a table of them with so many significant digits, JSON-ready."""
    if isinstance(value, dict):
        return {str(name): rounded(each, digits) for name, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [rounded(each, digits) for each in value]
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.{digits}g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def contiguous(rows: Rows) -> bool:
    """Return whether each state is a millisecond after the one before."""
    return bool((np.diff(rows.state["t_ns"]) == 1_000_000).all())


def link(rows: Rows) -> dict[str, Any]:
    """Return how states came: missed ones, their spacing here, and how fast the box's clock runs beside this one."""
    t, here = rows.state["t_ns"].astype(float), rows.read_ns.astype(float)
    spacing_us = np.diff(here) * 1e-3
    missed = int((np.diff(rows.state["t_ns"]) // 1_000_000 - 1).sum())
    found: dict[str, Any] = {"states": len(rows), "missed": missed}
    found["spacing_us_p50_p99_max"] = [*np.percentile(spacing_us, (50, 99)), spacing_us.max()]
    half = len(rows) // 2
    if half > 1000:  # the earliest of each 100 states: the others waited
        first = np.array([np.argmin(here[k : k + 100] - t[k : k + 100]) + k for k in range(0, 2 * half - 100, 100)])
        slopes = [np.polyfit(here[part] - here[0], t[part] - t[0], 1)[0] - 1.0 for part in np.array_split(first, 2)]
        found["clock_ppm"] = 1e6 * (np.polyfit(here[first] - here[0], t[first] - t[0], 1)[0] - 1.0)
        found["clock_ppm_halves_differ"] = 1e6 * abs(slopes[0] - slopes[1])
    return found


def rest(rows: Rows, model: ArmModel) -> dict[str, Any]:
    """Return what an arm at rest says of itself: external torques and force with their noise and drift, and what
    payload would explain them."""
    state, n = rows.state, len(rows) // 4
    tau, force = state["tau_ext_hat_filtered"], state["O_F_ext_hat_K"]
    q = state["q"].mean(axis=0)
    model.update(q, np.zeros(7))
    kg, left_nm = missing_payload(model, q, tau.mean(axis=0))
    centred = tau - tau.mean(axis=0)
    rho = np.array([np.dot(x[1:], x[:-1]) / max(np.dot(x, x), 1e-30) for x in centred.T])
    return {
        "q_rad": q, "tau_ext_mean_nm": tau.mean(axis=0), "tau_ext_sd_nm": tau.std(axis=0),
        "O_F_ext_mean_n_nm": force.mean(axis=0), "O_F_ext_sd_n_nm": force.std(axis=0),
        "force_n": float(np.linalg.norm(force[:, :3].mean(axis=0))),
        "force_drift_n": float(np.linalg.norm((force[-n:] - force[:n]).mean(axis=0)[:3])),
        "payload_off_kg": kg, "payload_left_nm": left_nm,
        "tau_J_minus_gravity_nm": state["tau_J"].mean(axis=0) - model.g,
        "tau_J_sd_nm": state["tau_J"].std(axis=0), "dq_sd_rad_s": state["dq"].std(axis=0),
        # Assumes white noise behind a first-order low-pass; a bound where the noise is not white
        "estimate_filter_ms": np.where(rho > 0.05, -1.0 / np.log(np.clip(rho, 1e-3, 0.99999)), np.nan),
        "success_rate_idle": float(state["control_command_success_rate"].max()),
    }  # fmt: skip


def in_motion(rows: Rows) -> Rows:
    """Return the rows from the first state that was answered to the last one."""
    answered = np.flatnonzero(rows.answered_ns)
    return rows[answered[0] : answered[-1] + 1] if len(answered) else rows[:0]


def echo(rows: Rows) -> dict[str, Any]:
    """Return after how many ticks tau_J_d shows what was sent, and how exactly."""
    rows = in_motion(rows)
    seen, sent = rows.state["tau_J_d"], rows.tau
    n = len(rows) - max(LAGS)
    off = [float(np.abs(seen[lag : lag + n] - sent[:n])[n // 20 :].max()) for lag in LAGS]
    rms = [float(np.sqrt(np.mean((seen[lag : lag + n] - sent[:n])[n // 20 :] ** 2))) for lag in LAGS]
    best = int(np.argmin(rms))
    moved = float(np.abs(np.diff(sent, axis=0)).max())
    return {"ticks": best, "largest_off_nm": off[best], "rms_nm": rms[best], "rms_nm_by_ticks": rms,
            "largest_step_nm": moved, "told_apart": bool(sorted(rms)[1] > 2.0 * rms[best])}  # fmt: skip


def after_stop(rows: Rows, stop_row: int) -> dict[str, Any]:
    """Return how far the arm goes while its box holds it, from the first state after a stop was asked for."""
    rows = rows[stop_row:]
    q = rows.state["q"]
    away = np.abs(q - q[0])
    return {
        "seconds": len(rows) * PERIOD_S, "largest_rad": float(away.max()), "last_rad": float(away[-1].max()),
        "by_joint_rad": away.max(axis=0), "largest_rad_s": float(np.abs(rows.state["dq"]).max()),
        "modes": modes(rows),
    }  # fmt: skip


def modes(rows: Rows) -> list[list[Any]]:
    """Return each change of the robot's mode or errors: s since the first row, mode, errors as a bit mask."""
    mode, errors = rows.state["robot_mode"], rows.state["current_errors"]
    changes = np.flatnonzero((np.diff(mode) != 0) | (np.diff(errors) != 0)) + 1
    t_s = (rows.state["t_ns"] - rows.state["t_ns"][0]) * 1e-9
    return [[float(t_s[k]), RobotMode(int(mode[k])).name, int(errors[k])] for k in (0, *changes)]


def tracking(rows: Rows, wanted: Array) -> dict[str, Any]:
    """Return how far the joints were from a path (n, 7), rad, a row a millisecond from the first answered state."""
    rows = in_motion(rows)
    at = ((rows.state["t_ns"] - rows.state["t_ns"][0]) // 1_000_000).clip(0, len(wanted) - 1)
    off = np.abs(rows.state["q"] - wanted[at])
    return {
        "seconds": len(rows) * PERIOD_S, "largest_rad": float(off.max()), "by_joint_rad": off.max(axis=0),
        "rms_rad": float(np.sqrt(np.mean(off**2))), "at_the_end_rad": float(off[-1].max()),
        "torque_nm": np.abs(rows.tau).max(axis=0), "rad_s": np.abs(rows.state["dq"]).max(axis=0),
    }  # fmt: skip


def way(path: JointPath) -> Array:
    """Return the rows (n, 7), rad, of the way of a cell's only arm."""
    return np.array([path.at(t)[0] for t in np.arange(0.0, path.duration_s + PERIOD_S, PERIOD_S)])


def pad_speed(rows: Rows, model: ArmModel) -> Array:
    """Return the places (n, 3) of the pad's face, m."""
    return np.array([end_effector_pose(model, q)[0] for q in rows.state["q"]])


def stop(rows: Rows, row: int, model: ArmModel) -> dict[str, Any]:
    """Return how long and how far the arm goes on after row, at which the judge's stop begins."""
    before, rows = rows[max(0, row - 50) : row + 1], rows[row:]
    fast = np.abs(rows.state["dq"]).max(axis=1) >= REST_DQ
    still = len(rows)
    for k in range(len(rows) - QUIET_TICKS + 1):
        if not fast[k : k + QUIET_TICKS].any():
            still = k
            break
    places = pad_speed(rows[: still + 1], model)
    lead = pad_speed(before, model)
    return {
        "pad_m_s": float(np.linalg.norm(lead[-1] - lead[0]) / max(1, len(lead) - 1) / PERIOD_S),
        "ms": float(rows.state["t_ns"][min(still, len(rows) - 1)] - rows.state["t_ns"][0]) * 1e-6,
        "mm": 1e3 * float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()),
        "at_rest": still < len(rows), "torque_nm": float(np.nanmax(np.abs(rows.tau))),
    }  # fmt: skip


def resonance(rows: Rows, joint: int) -> dict[str, Any]:
    """Return where the measured torque of a joint (0 to 6) swings most, Hz, and by how much more than beside it."""
    rows = in_motion(rows)
    torque = rows.state["tau_J"][:, joint] - savgol_filter(rows.state["tau_J"][:, joint], 301, 2)
    hz, power = welch(torque, 1.0 / PERIOD_S, nperseg=min(1024, len(torque)))
    band = (hz >= BAND_HZ[0]) & (hz <= BAND_HZ[1])
    best = int(np.argmax(np.where(band, power, 0.0)))
    return {"hz": float(hz[best]), "times_the_median": float(power[best] / np.median(power[band])),
            "swing_nm": float(torque.std()), "resolution_hz": float(hz[1])}  # fmt: skip


def estimate_delay(rows: Rows, model: ArmModel) -> dict[str, Any]:
    """Return how late tau_ext_hat_filtered is behind what the measured torques leave unexplained by the model, ms.

    Both are compared as they change; the joint that felt most counts. None where nothing was felt.
    """
    state = rows.state
    felt = state["tau_ext_hat_filtered"]
    joint = int(np.argmax(np.ptp(felt, axis=0)))
    found: dict[str, Any] = {"joint": joint + 1, "felt_nm": float(np.ptp(felt[:, joint])), "ms": None}
    found["largest_force_n"] = float(np.linalg.norm(state["O_F_ext_hat_K"][:, :3], axis=1).max())
    if found["felt_nm"] < FELT_NM or len(rows) < 1000:
        return found
    dq = np.asarray(savgol_filter(state["dq"], 21, 3, axis=0))
    ddq = np.asarray(savgol_filter(state["dq"], 21, 3, deriv=1, delta=PERIOD_S, axis=0))
    own = np.empty(len(rows))
    for k in range(len(rows)):
        model.update(state["q"][k], dq[k])
        own[k] = (state["tau_J"][k] - model.M @ ddq[k] - model.C @ dq[k] - model.g)[joint]
    sign = np.sign(np.corrcoef(own, felt[:, joint])[0, 1])
    a, b = (np.diff(np.asarray(savgol_filter(each, 21, 2))) for each in (sign * own, felt[:, joint]))
    n = len(a) - LONGEST_DELAY
    scores = np.array([np.corrcoef(a[:n], b[lag : lag + n])[0, 1] for lag in range(LONGEST_DELAY)])
    best = int(np.argmax(scores))
    return found | {"ms": best, "correlation": float(scores[best]), "sign": float(sign)}


@dataclass(frozen=True, slots=True)
class Gap:
    """What became of so many lost answers in a row. repeated: tau_J_d stayed the last torque that was sent."""

    lost: int
    rad: float
    rad_s: float
    success_rate: float
    repeated: bool
    went_on: bool


def gap(rows: Rows, lost: int) -> Gap:
    """Return what became of the one gap of these rows."""
    missing = np.flatnonzero((rows.answered_ns > 0) & ~rows.sent)
    first, last = int(missing[0]), int(missing[-1])
    after = rows[first : last + 300]
    q = after.state["q"]
    echoed = rows.state["tau_J_d"][first + 1 : last + 2]
    return Gap(
        lost, float(np.abs(q - q[0]).max()), float(np.abs(after.state["dq"]).max()),
        float(after.state["control_command_success_rate"].min()),
        bool(np.abs(np.diff(echoed, axis=0)).max(initial=0.0) < 1e-6),
        bool(rows.sent[last + 1 :].any() and (after.state["robot_mode"] == RobotMode.MOVE).all()),
    )  # fmt: skip
