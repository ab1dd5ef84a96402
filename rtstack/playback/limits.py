"""Whether a log's path may be played at a speed: asked before anything is opened, and answered with the reason.

The margins are those of a plan (rtstack.planning.feasibility): what feedback needs beside the references.
"""

from dataclasses import dataclass

import numpy as np

from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import POSITION_MARGIN_RAD, TORQUE_SHARE, VELOCITY_SHARE, near_misses
from rtstack.playback.pace import FASTEST, RAMP_S, SLOWEST
from rtstack.playback.path import STEP_S, ArmPath
from rtstack.safety.limits import PairLimits, SafetyLimits
from rtstack.samples import SIDES
from rtstack.trials.errors import TrialError

SPEED_STEP = 0.05


@dataclass(frozen=True, slots=True)
class Load:
    """What playing asks of an arm at its hardest moment, as a share of what is allowed; 1 is just allowed.

    what: in words; at_s: of the log.
    """

    what: str
    share: float
    at_s: float


def check_speed(speed: float) -> None:
    """Check that the speed factor is in the allowed range. Raises TrialError."""
    if not SLOWEST <= speed <= FASTEST:  # no number is neither
        raise TrialError(f"speed {speed:g}: choose {SLOWEST:g} to {FASTEST:g} times the log's own")


def check_playback(
    paths: tuple[ArmPath, ArmPath],
    speed: float,
    limits: PairLimits,
    description: CellDescription,
) -> None:
    """Refuse what cannot be played at this speed, and what cannot be played at all. Raises TrialError with one line."""
    check_speed(speed)
    for path, side, allowed in zip(paths, SIDES, limits, strict=True):
        for load in (*places(path, allowed), *loads(path, speed, allowed)):
            if load.share > 1.0:
                raise TrialError(f"{side} arm, {load.at_s:.2f} s into the log: {load.what}")
    stations = np.stack([path.stations for path in paths])
    for near in near_misses(description, [path.q for path in paths], stations):
        what = (
            f"the {near.side} arm would touch the table" if near.side else "the arms would come too near to each other"
        )
        raise TrialError(f"{what}, {near.tick * STEP_S:.2f} s into the log: it cannot be played on this cell")


def fastest(paths: tuple[ArmPath, ArmPath], limits: PairLimits, description: CellDescription) -> float:
    """Return the largest speed that may be played, a multiple of SPEED_STEP. Raises TrialError where there is none."""
    check_playback(paths, SLOWEST, limits, description)  # what cannot be played at all says why
    low, high = round(SLOWEST / SPEED_STEP), round(FASTEST / SPEED_STEP)
    while low < high:
        middle = (low + high + 1) // 2
        within = all(
            load.share <= 1.0
            for path, allowed in zip(paths, limits, strict=True)
            for load in loads(path, middle * SPEED_STEP, allowed)
        )
        low, high = (middle, high) if within else (low, middle - 1)
    return round(low * SPEED_STEP, 2)


def places(path: ArmPath, limits: SafetyLimits) -> list[Load]:
    """Return how near joints and pad come to where they must not be, whatever the speed."""
    room = np.minimum(path.q - limits.q_lower, np.asarray(limits.q_upper) - path.q)
    place = path.stations["position"]
    outside = np.maximum(np.asarray(limits.ee_lower) - place, place - np.asarray(limits.ee_upper))
    found = []
    for over, what in (
        (POSITION_MARGIN_RAD - room, "joint {} is too near to its limit"),
        (outside, "the pad leaves the cell's box (ee_lower, ee_upper) along axis {}"),
    ):
        k, which = np.unravel_index(int(over.argmax()), over.shape)
        words = f"{what.format(int(which) + 1)}: it cannot be played on this cell"
        found.append(Load(words, 1.0 + float(over[k, which]), float(k) * STEP_S))
    return found


def loads(path: ArmPath, speed: float, limits: SafetyLimits) -> list[Load]:
    """Return the hardest moments at a speed: a ramp may be anywhere, since a soft stop may be asked for at any time."""
    ramp = 1.5 * speed / RAMP_S  # largest |d2s/dt2| of a ramp
    dq = speed * path.dq
    upper, lower = limits.dq_upper(path.q), limits.dq_lower(path.q)
    quick = np.where(dq > 0.0, dq / np.maximum(upper, 1e-9), dq / np.minimum(lower, -1e-9))
    moved = np.einsum("nij,nj->ni", path.M, path.ddq) + path.coriolis
    pushed = np.einsum("nij,nj->ni", path.M, path.dq)
    torque = np.abs(speed**2 * moved + path.gravity) + ramp * np.abs(pushed)
    change = speed * np.abs(np.gradient(speed**2 * moved, STEP_S, axis=0))  # gravity is the robot's own
    pad = speed * np.linalg.norm(path.stations["along"][:, :3], axis=1)
    found = []
    for share, allowed, what in (
        (quick, VELOCITY_SHARE, "joint {} would be at {:.2f} times its velocity limit, {:g} is allowed"),
        (torque / limits.tau_max, TORQUE_SHARE, "joint {} would need {:.2f} of its torque, {:g} is allowed"),
        (change / limits.tau_rate_max, TORQUE_SHARE, "joint {}'s torque would change at {:.2f} of its rate, not {:g}"),
        (pad[:, None] / limits.ee_speed_max, VELOCITY_SHARE, "the pad would be at {1:.2f} of ee_speed_max, not {2:g}"),
    ):  # fmt: skip
        k, joint = np.unravel_index(int(share.argmax()), share.shape)
        worst = float(share[k, joint])
        words = what.format(int(joint) + 1, worst, allowed) + f" at speed {speed:g}: play it more slowly"
        found.append(Load(words, worst / allowed, float(k) * STEP_S))
    return found
