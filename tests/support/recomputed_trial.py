"""A trial's numbers from its MCAP file alone, with none of our code: the columns of results.csv that the report uses.

What each number is, is said in the issue, in the paper and in the report; written anew from there.
"""

import json
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

ANTE_IMPACT, INTERIM, POST_IMPACT, STOPPING = 2, 3, 4, 5  # rtstack.Mode in the log's own descriptors
# Appendix B of the paper, with the values of its experiments: N, N, m/s, ticks
FORCE_LOW, FORCE_HIGH, APPROACH, WINDOW = 4.0, 5.0, 0.025, 200
STIFFNESS = 2000.0  # Table I of the paper, N/m
UNCONSTRAINED = 1  # rtstack.QpStatus in the log's own descriptors
MOST_STEP = 0.9998  # Nm a tick, docs/limits.md
TAU_MAX = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # Nm, the FR3's data sheet
SIDES = ("left", "right")


class Log:
    """The arrays of one log: arm and control (2, n) by field, object poses (m,), and what stands beside them."""

    def __init__(self, path: Path) -> None:
        rows = {f"/{side}/{kind}": [] for side in SIDES for kind in ("arm", "control")}
        self.pose_ns, pose = [], []
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            self.about = {record.name: record.metadata for record in reader.iter_metadata()}
            attached = {record.name: record.data for record in reader.iter_attachments()}
            for _, channel, message, decoded in reader.iter_decoded_messages([*rows, "/object/pose"]):
                if channel.topic == "/object/pose":
                    p, q = decoded.pose.position, decoded.pose.orientation
                    self.pose_ns.append(message.log_time)
                    pose.append((p.x, p.y, p.z, q.w, q.x, q.y, q.z))
                elif channel.topic.endswith("arm"):
                    values = (decoded.q, decoded.dq, decoded.tau_J, decoded.tau_desired, decoded.tau_applied,
                              decoded.O_T_EE, decoded.O_F_ext_hat_K)  # fmt: skip
                    rows[channel.topic].append((message.log_time, np.concatenate([np.array(v) for v in values])))
                else:
                    values = np.concatenate(
                        [
                            [decoded.mode],
                            decoded.wrench_desired,
                            decoded.pose_ref,
                            decoded.wrench_ff,
                            [decoded.beta, decoded.qp_status],
                        ]
                    )
                    rows[channel.topic].append((message.log_time, values))
        self.cell = tomllib.loads(attached["cell.toml"].decode())
        self.urdf = ElementTree.fromstring(next(data for name, data in attached.items() if name.endswith(".urdf")))
        self.pose_ns, self.pose = np.array(self.pose_ns, np.int64), np.array(pose).reshape(-1, 7)
        self.t_ns = np.array([t for t, _ in rows["/left/arm"]], np.int64)
        self.t_s = (self.t_ns - self.t_ns[0]) * 1e-9
        arm, control = (
            np.array([[values for _, values in rows[f"/{side}/{kind}"]] for side in SIDES])
            for kind in ("arm", "control")
        )
        self.q, self.dq, self.tau_J, self.tau_desired, self.tau_applied = (
            arm[:, :, 7 * k : 7 * k + 7] for k in range(5)
        )
        self.T = arm[:, :, 35:51].reshape(2, -1, 4, 4).transpose(0, 1, 3, 2)  # column-major in the log
        self.push = arm[:, :, 51:57]
        self.mode = control[0, :, 0].astype(int)
        self.wrench, self.pose_ref, self.wrench_ff = control[:, :, 1:7], control[:, :, 7:14], control[:, :, 14:20]
        self.beta, self.qp_status = control[:, :, 20], control[:, :, 21].astype(int)

    def mounting(self, arm: int) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and place (3,) of an arm's base in the world."""
        mount = self.cell[SIDES[arm]]
        return rotation_of(np.array([mount["base_orientation_wxyz"]]))[0], np.array(mount["base_position"])


def rotation_of(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4)."""
    w, x, y, z = wxyz.T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]  # fmt: skip
    return np.moveaxis(np.array(rows), 2, 0)


def pad_velocity(log: Log, arm: int) -> np.ndarray:
    """Velocity of the pad's face in the base (n, 3), from q, dq and the URDF in the log: sum of dq z x (p - o)."""
    n = log.q.shape[1]
    R, o = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    axes, origins, k = [], [], 0
    for joint in log.urdf.iter("joint"):
        place = joint.find("origin")
        words = {} if place is None else place.attrib
        x, y, z = (float(word) for word in words.get("rpy", "0 0 0").split())
        o = o + R @ np.array([float(word) for word in words.get("xyz", "0 0 0").split()])
        half = np.array([[np.cos(x / 2), np.sin(x / 2), 0, 0], [np.cos(y / 2), 0, np.sin(y / 2), 0],
                         [np.cos(z / 2), 0, 0, np.sin(z / 2)]])  # fmt: skip
        Rx, Ry, Rz = rotation_of(half)
        R = R @ (Rz @ Ry @ Rx)
        if joint.get("type") == "revolute":
            axes.append(R[:, :, 2])  # the FR3's joints all turn about z
            origins.append(o)
            turn = np.zeros((n, 4))
            turn[:, 0], turn[:, 3] = np.cos(log.q[arm, :, k] / 2), np.sin(log.q[arm, :, k] / 2)
            R, k = R @ rotation_of(turn), k + 1
    face = o + log.cell["pad"]["flange_to_face"] * R[:, :, 2]
    each = [log.dq[arm, :, j : j + 1] * np.cross(axes[j], face - origins[j]) for j in range(7)]
    return np.sum(each, axis=0)


def detection(log: Log) -> int | None:
    """First tick at which Appendix B's three conditions hold on either arm."""
    hits = []
    for arm in range(2):
        force = -log.push[arm, :, :3]  # on the pad, in the base
        norm = np.linalg.norm(force, axis=1)
        velocity = pad_velocity(log, arm)
        now, before = slice(WINDOW, None), slice(None, -WINDOW)
        against = np.einsum("ni,ni->n", velocity[before], force[now])
        hit = (norm[before] < FORCE_LOW) & (norm[now] > FORCE_HIGH) & (against < -APPROACH * norm[now])
        hits += (np.flatnonzero(hit)[:1] + WINDOW).tolist()
    return min(hits, default=None)


def geometry(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place along y of the pads' faces, their gaps to the object, and how far they rose beyond it, (2, n), m."""
    size = log.cell["objects"][log.about["trial"]["object"]]["size"]
    w, x, y, z = log.pose[:, 3:].T
    seen = np.column_stack([log.pose[:, :3], 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    seen[:20] = np.median(seen[:20], axis=0)
    at = np.column_stack([np.interp(log.t_ns, log.pose_ns, column) for column in seen.T])
    face_y, gap, slip = [], [], []
    for arm in range(2):
        R, place = log.mounting(arm)
        position = log.T[arm, :, :3, 3] @ R.T + place
        slip.append((position[:, 2] - position[0, 2]) - (at[:, 2] - at[0, 2]))
        tilt = np.einsum("ni,nij->nj", at[:, 3:], R @ log.T[arm, :, :3, :3])[:, :2]
        reach = np.abs(tilt) @ (np.array(log.cell["pad"]["size"][:2]) / 2)
        distance = np.abs(np.einsum("ni,ni->n", at[:, 3:], position - at[:, :3]))
        face_y.append(position[:, 1])
        gap.append(distance - size[1] / 2 - reach)
    return np.array(face_y), np.array(gap), np.array(slip)


def first(condition: np.ndarray) -> int | None:
    """First true tick."""
    ticks = np.flatnonzero(condition)
    return int(ticks[0]) if len(ticks) else None


def held(log: Log, detected: int | None, release_s: float, criterion: dict[str, float]) -> bool:
    """Whether the object followed the pads' rise from `lifted_m` on until the release."""
    margin = criterion["release_margin_s"]
    if detected is None or log.t_s[-1] < release_s - margin:
        return False
    pads = log.T[:, :, 2, 3].mean(axis=0)
    pose_s = (log.pose_ns - log.t_ns[0]) * 1e-9
    rise = np.interp(pose_s, log.t_s, pads - pads[detected])
    lift = log.pose[:, 2] - np.median(log.pose[:20, 2])
    carried = (pose_s > log.t_s[detected]) & (pose_s < release_s - margin) & (rise > criterion["lifted_m"])
    return bool(carried.any() and (lift[carried] > rise[carried] - criterion["slip_m"]).all())


def recompute(path: Path, criterion: dict[str, float]) -> dict[str, float | bool | None]:
    """Return the numbers of one trial by their column's name. criterion: [success] of the plan."""
    log = Log(path)
    t_s, mode, norm = log.t_s, log.mode, np.linalg.norm(log.wrench, axis=(0, 2))
    nominal_s, release_s = (float(log.about["trial"][name]) for name in ("nominal_impact_s", "release_s"))
    displacement = json.loads(log.about["trial"]["specification"])["displacement_mm"]
    detected, moving = detection(log), mode != STOPPING
    window = (np.abs(t_s - nominal_s) <= 0.1 + 1e-9) & moving
    forces = np.linalg.norm(log.wrench[:, :, :3], axis=(0, 2))
    changed = (log.tau_applied != log.tau_desired).any(axis=(0, 2)) & moving
    out: dict[str, float | bool | None] = {
        "success": "fault" not in log.about and not changed.any() and held(log, detected, release_s, criterion),
        "average_force_norm": norm[window].mean() if window.any() else None,
        "average_force_norm_linear_n": forces[window].mean() if window.any() else None,
        "peak_in_window": norm[window].max() if window.any() else None,
        "peak_force_norm": norm.max(),
        "max_lift_mm": 1e3 * (log.pose[:, 2].max() - np.median(log.pose[:20, 2])),
        "peak_torque_ratio": np.max(np.abs(log.tau_J) / TAU_MAX),
        "ticks": len(t_s),
        "nominal_impact_time_s": nominal_s,
        "detected_impact_time_s": None if detected is None else t_s[detected],
    }
    face_y, gap, slip = geometry(log)
    contacts = [first(gap[arm] <= 0.0) for arm in range(2)]
    ticks = sorted(tick for tick in contacts if tick is not None)
    contact = ticks[0] if ticks else None
    out["first_contact_s"] = None if contact is None else t_s[contact]
    out["second_contact_s"] = t_s[ticks[1]] if len(ticks) == 2 else None
    switch = None if detected is None else min(detected, int(np.argmax(mode != ANTE_IMPACT)))
    known = contact is not None and detected is not None
    out["detection_delay_ms"] = 1e3 * (t_s[detected] - t_s[contact]) if known else None
    out["delay_peak"] = out["delay_peak_velocity_share"] = None
    if contact is not None and switch is not None and contact < switch:
        top = contact + int(np.argmax(norm[contact:switch]))
        arm = 0 if contacts[0] == contact else 1
        force = log.wrench[arm, :, 1]
        feedback = force - log.wrench_ff[arm, :, 1] - STIFFNESS * (log.pose_ref[arm, :, 1] - face_y[arm])
        change = force[top] - force[contact]
        out["delay_peak"] = norm[top] - norm[contact]
        out["delay_peak_velocity_share"] = (
            (feedback[top] - feedback[contact]) / change if abs(change) > 1e-6 else None
        )  # fmt: skip
    hit = 0 if displacement > 0.0 else 1
    steps, other = np.zeros(len(t_s)), np.zeros(len(t_s))
    steps[1:] = np.linalg.norm(np.diff(log.wrench, axis=1), axis=(0, 2))
    other[1:] = np.linalg.norm(np.diff(log.wrench[1 - hit], axis=0), axis=1)
    earlier = nominal_s if detected is None else min(nominal_s, t_s[detected])
    around = (t_s > earlier - 0.05) & (t_s < nominal_s + 0.3) & moving
    largest = int(np.argmax(np.where(around, steps, 0.0))) if around.any() else None
    out["largest_step"] = None if largest is None else steps[largest]
    out["largest_step_other"] = other[around].max() if around.any() else None
    out["posture_peak"] = np.abs(log.beta[hit][window]).max() if window.any() else None
    out["limited_ticks"] = float(((log.qp_status != UNCONSTRAINED).any(axis=0) & moving).sum())
    out["rate_limited_ticks"] = float(
        ((np.abs(np.diff(log.tau_desired, axis=1)) >= MOST_STEP - 1e-9).any(axis=(0, 2)) & moving[1:]).sum()
    )
    out["largest_step_ms"] = None if largest is None else 1e3 * (t_s[largest] - nominal_s)
    for name, which in (("step_to_interim", INTERIM), ("step_to_post", POST_IMPACT)):
        tick = first(mode == which)
        out[name] = None if tick is None else steps[tick]
    begin, end = first(mode == INTERIM), first(mode == POST_IMPACT)
    out["interim_ms"] = None if begin is None or end is None else 1e3 * (t_s[end] - t_s[begin])
    out["settled_ms"], out["slip_mm"] = settled(t_s, slip, contact)
    out["lost_ms"] = lost_ms(log, contact)
    swing = (t_s >= nominal_s) & (t_s < nominal_s + 0.15) & moving
    for name, arm in (("swing_m_s", hit), ("swing_other_m_s", 1 - hit)):
        velocity = np.zeros(len(t_s))
        velocity[2:-2] = (face_y[arm, 4:] - face_y[arm, :-4]) / (1e-9 * (log.t_ns[4:] - log.t_ns[:-4]))
        out[name] = np.ptp(velocity[swing]) if swing.sum() > 1 else None
    return out


def settled(t_s: np.ndarray, slip: np.ndarray, contact: int | None) -> tuple[float | None, float | None]:
    """Time from the first contact until the slip stays within 1 mm of where it is 0.5 s later, and that slip in mm.

    The time is None where the slip still changes in the last 50 ms, both are None where the log ends before.
    """
    if contact is None or t_s[-1] - t_s[contact] < 0.5:
        return None, None
    since = t_s - t_s[contact]
    soon = (since >= 0.0) & (since <= 0.5)
    some, when = slip[:, soon], since[soon]
    off = np.flatnonzero((np.abs(some - some[:, -1:]) > 1e-3).any(axis=0))
    last = when[off[-1]] if len(off) else 0.0
    return (1e3 * last if last < 0.45 else None), 1e3 * (some[:, -1] - some[:, 0]).max()


def lost_ms(log: Log, contact: int | None) -> float | None:
    """For how long a pad felt less than 4 N in the 0.5 s after both had felt 5 N, the longer of both, ms."""
    if contact is None:
        return None
    felt, norms = [], []
    for arm in range(2):
        force = log.push[arm, :, :3]
        norms.append(np.linalg.norm(force - force[max(0, contact - 50)], axis=1))
        felt.append(first(norms[-1][contact:] > FORCE_HIGH))
    if None in felt:
        return None
    since = log.t_s - log.t_s[contact + max(felt)]
    soon = (since >= 0.0) & (since <= 0.5)
    return 1e3 * max(np.mean(norm[soon] < FORCE_LOW) for norm in norms) * np.ptp(log.t_s[soon])
