"""What a log says, read by the readers of others: the mcap package and protobuf, without a line of rtstack.log.

And from which tick it shows what a limit of the judge forbids, by the judge's oracle in plain Python.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hal.robots import FR3
from rtstack.log.errors import LogError
from rtstack.log.file.recover import recover
from rtstack.model.cell_description import CellDescription
from rtstack.safety.judge import Base, Cause
from rtstack.safety.limits import ForcePhase
from rtstack.trials.tightening import limits_of_arms
from tests.support.safety.judge_oracle import arm_reason, joint_reason

FIELDS = ("q", "dq", "tau_J", "tau_ext_hat_filtered", "tau_applied", "momentum_residual")
MOST_LOST_S = 0.5
TICK_NS = 1_000_000
STEP_NM = FR3.limits.tau_rate_max * 1e-3 + 1e-6
OTHERS = {"tau_desired": np.zeros((1, 7)), "O_F_ext_hat_K": np.zeros((1, 6)), "O_T_EE": np.zeros((1, 4, 4))}


@dataclass(frozen=True, slots=True)
class Evidence:
    """One log. arms: a dict of arrays (n, 7) for left and right, log times (n,) as t_ns. recovered: it was cut off."""

    arms: dict[str, dict[str, np.ndarray]]
    events: tuple[str, ...]
    metadata: dict[str, dict[str, str]]
    recovered: bool

    @property
    def last_t_ns(self) -> int:
        """The newest tick in the log, 0 where there is none."""
        return max((int(arm["t_ns"][-1]) for arm in self.arms.values() if len(arm["t_ns"])), default=0)

    @property
    def text(self) -> str:
        """Everything that it says in words."""
        words = [*self.events, *(value for record in self.metadata.values() for value in record.values())]
        return "\n".join(words)


def read_evidence(path: Path) -> Evidence:
    """Read a log, which is recovered first where it was cut off. Raises LogError and McapError."""
    try:
        return _read(path, recovered=False)
    except McapError:
        summary = recover(path)
        if summary.output is None:
            raise LogError(f"{path} cannot be read, and there is nothing to recover") from None
        return _read(summary.output, recovered=True)


def _read(path: Path, recovered: bool) -> Evidence:
    rows: dict[str, dict[str, list]] = {side: {name: [] for name in ("t_ns", *FIELDS)} for side in ("left", "right")}
    events: list[str] = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        if reader.get_summary() is None:
            raise McapError(f"{path} has no summary")
        topics = ["/left/arm", "/right/arm", "/left/control", "/right/control", "/events"]
        for _, channel, message, decoded in reader.iter_decoded_messages(topics):
            if channel.topic == "/events":
                events.append(decoded.message)
                continue
            side, kind = channel.topic[1:].split("/")
            if kind == "arm":
                rows[side]["t_ns"].append(message.log_time)
            for name in FIELDS[:-1] if kind == "arm" else FIELDS[-1:]:
                rows[side][name].append(getattr(decoded, name))
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    arms = {side: {name: np.array(values) for name, values in columns.items()} for side, columns in rows.items()}
    return Evidence(arms, tuple(events), metadata, recovered)


def beyond_limits(evidence: Evidence) -> list[str]:
    """Return which published limits of the FR3 the arms or our torques have left, in words."""
    found = []
    for side, arm in evidence.arms.items():
        if not len(arm["t_ns"]):
            continue
        tau, q, dq = arm["tau_applied"], arm["q"], arm["dq"]
        if not np.isfinite(tau).all():
            found.append(f"{side}: a torque that is no number was sent")
        elif (np.abs(tau) > FR3.limits.tau_max).any():
            found.append(f"{side}: a torque beyond tau_max was sent")
        elif (jump := _largest_jump(arm["t_ns"], tau)) > STEP_NM:
            found.append(f"{side}: a torque jumped by {jump:.3f} Nm")
        if ((q < FR3.limits.q_lower) | (q > FR3.limits.q_upper)).any():
            found.append(f"{side}: a joint left its range")
        if (np.abs(dq) > FR3.limits.dq_max).any():
            found.append(f"{side}: a joint left its velocity limit")
    return found


def _largest_jump(t_ns: np.ndarray, tau: np.ndarray) -> float:
    """Return the largest change from one tick to the next one. Ticks that share a stamp have no order in the log."""
    times, first, count = np.unique(t_ns, return_index=True, return_counts=True)
    next_ms = (np.diff(times) == TICK_NS) & (count[1:] == 1) & (count[:-1] == 1)
    jumps = np.abs(np.diff(tau[first], axis=0))[next_ms]
    return float(jumps.max(initial=0.0))


def first_violation(evidence: Evidence, description: CellDescription, begin: int, phase: ForcePhase) -> int | None:
    """Return the first tick from `begin` on in which a state or a residual is beyond a limit, None where none is.

    phase: of the forces; the pad's is not looked at.
    """
    limits = limits_of_arms(description)[0]
    limits = limits.tightened({"tau_ext_max": limits.tau_ext_by_phase[phase].tolist()})
    found = []
    for side, mounting in zip(description.sides, description.arms, strict=True):
        base = Base(mounting.base_position, mounting.base_orientation_wxyz)
        arm = evidence.arms[side]
        for tick in range(begin, len(arm["t_ns"])):
            sample = {name: arm[name][tick : tick + 1] for name in ("q", "dq", "tau_J", "tau_ext_hat_filtered")}
            sample |= OTHERS
            reason = joint_reason(sample, arm["momentum_residual"][tick], limits)[0]
            if reason is not Cause.NONE or arm_reason(sample, base, limits)[0] is not Cause.NONE:
                found.append(tick)
                break
    return min(found, default=None)
