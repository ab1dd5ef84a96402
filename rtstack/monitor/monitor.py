"""The monitor as an object, tick by tick, and over a whole recording."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hal.base.arrays import numbers
from hal.compilation import compiled
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict, monitor_dtype
from rtstack.monitor.step import monitor_expect, monitor_step

Array = NDArray[np.floating]
SIGNALS = ("residual", "q", "dq", "dq_ref")


@dataclass(frozen=True, slots=True)
class Assessment:
    """What became of a motion. joint: whose envelope left zero outside, -1 for other reasons; see monitor_dtype."""

    verdict: Verdict
    reason: Reason
    joint: int
    margin: float
    impacts: int
    t_first_ns: int
    t_impact_ns: int


class Monitor:
    """The monitor of one arm of n joints. `state` is the record that the log may take.

    Arrays are checked and may be of any layout. Infinite and NaN are taken, and are unexpected where they are judged:
    `q` at an impact; residual, `dq` and `dq_ref` from the delay to the horizon after it.

    Raises:
        TypeError: Parameters of another kind.
    """

    def __init__(self, parameters: MonitorParameters) -> None:
        if not isinstance(parameters, MonitorParameters):
            raise TypeError(f"parameters: expected MonitorParameters, found {type(parameters).__name__}")
        self.parameters = parameters.record()
        self.state = np.zeros(1, monitor_dtype(parameters.joints))

    def expect(self, t_d_ns: int, q_d: Array) -> None:
        """Begin anew: one impact is expected, at t_d_ns in the configuration q_d (n,) rad. Raises ValueError."""
        time = int(numbers(t_d_ns, "t_d_ns", (), np.int64))
        monitor_expect(self.state, time, numbers(q_d, "q_d", (self.parameters["residual_rate"].shape[1],)))

    def update(self, t_ns: int, residual: Array, q: Array, dq: Array, dq_ref: Array) -> Verdict:
        """Take a tick.

        Args:
            t_ns: Its time, later than the one before.
            residual: Estimate of the external joint torques, of either sign (n,) Nm.
            q: Measured configuration (n,) rad.
            dq: Measured joint velocities (n,) rad/s.
            dq_ref: What they are to be after the impact (n,) rad/s: (14).

        Raises:
            ValueError: A value that does not fit; nothing of the tick was taken.
        """
        time, *signals = self._checked(t_ns, residual, q, dq, dq_ref, ticks=())
        monitor_step(self.state, self.parameters, int(time), *signals)
        return Verdict(self.state["verdict"][0])

    def follow(self, t_ns: NDArray[np.int64], residual: Array, q: Array, dq: Array, dq_ref: Array) -> NDArray[np.void]:
        """Take a recording, arrays (ticks,) and (ticks, n): see `update`. Returns the state after each tick."""
        signals = self._checked(t_ns, residual, q, dq, dq_ref)
        trace = np.zeros(len(signals[0]), self.state.dtype)
        _follow(self.state, self.parameters, trace, *signals)
        return trace

    def assess(self, t_ns: NDArray[np.int64], residual: Array, q: Array, dq: Array, dq_ref: Array) -> Assessment:
        """Take a recording, as `follow`. Returns what became of it."""
        signals = self._checked(t_ns, residual, q, dq, dq_ref)
        _follow(self.state, self.parameters, self.state[:0], *signals)
        return self.assessment()

    def _checked(self, t_ns: ArrayLike, *signals: ArrayLike, ticks: tuple[None, ...] = (None,)) -> list[NDArray[Any]]:
        before = self.state["t_ns"][: int(self.state["ticks"][0] > 0)]
        joints = self.parameters["residual_rate"].shape[1]
        times, residual, q, dq, dq_ref = checked_signals(joints, t_ns, *signals, ticks=ticks, before=before)
        if not np.isfinite(residual).all():  # an impact may be missed in it: then the motion is not known, either
            dq = np.where(np.isfinite(residual), dq, np.nan)
        return [times, residual, q, dq, dq_ref]

    def assessment(self) -> Assessment:
        """Return what is known by now."""
        s = self.state[0]
        return Assessment(
            Verdict(s["verdict"]), Reason(s["reason"]), int(s["joint"]), float(s["margin"]), int(s["impacts"]),
            int(s["t_first_ns"]), int(s["t_impact_ns"]),
        )  # fmt: skip


def checked_signals(
    joints: int, t_ns: ArrayLike, *signals: ArrayLike, ticks: tuple[None, ...] = (None,),
    before: ArrayLike = (), finite: bool = False,
) -> list[NDArray[Any]]:  # fmt: skip
    """Return times and SIGNALS as compiled code takes them, which looks at no length. Raises ValueError.

    ticks: shape of the times; before: the time that they have to be later than, if there is one.
    """
    times = numbers(t_ns, "t_ns", ticks, np.int64)
    late = np.append(np.asarray(before, np.int64), times)
    if (wrong := np.flatnonzero(late[1:] <= late[:-1])).size:
        raise ValueError(f"t_ns: expected increasing times, found {late[wrong[0] + 1]} after {late[wrong[0]]}")
    shape = (*times.shape, joints)
    return [times, *(numbers(each, name, shape, finite=finite) for name, each in zip(SIGNALS, signals, strict=True))]


@compiled
def _follow(states, parameters, trace, t_ns, residual, q, dq, dq_ref):
    for k in range(t_ns.shape[0]):
        monitor_step(states, parameters, t_ns[k], residual[k], q[k], dq[k], dq_ref[k])
        if k < trace.shape[0]:
            trace[k] = states[0]
