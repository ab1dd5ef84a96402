"""The monitor as an object, tick by tick, and over a whole recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict, monitor_dtype
from rtstack.monitor.step import monitor_expect, monitor_step

Array = NDArray[np.floating]


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
    """The monitor of one arm. `state` is the record that the log may take."""

    def __init__(self, parameters: MonitorParameters) -> None:
        self.parameters = parameters.record()
        self.state = np.zeros(1, monitor_dtype(parameters.joints))

    def expect(self, t_d_ns: int, q_d: Array) -> None:
        """Begin anew: one impact is expected, at t_d_ns in the configuration q_d (n,) rad."""
        monitor_expect(self.state, t_d_ns, q_d)

    def update(self, t_ns: int, residual: Array, q: Array, dq: Array, dq_ref: Array) -> Verdict:
        """Take a tick, see `monitor_step`."""
        monitor_step(self.state, self.parameters, t_ns, residual, q, dq, dq_ref)
        return Verdict(self.state["verdict"][0])

    def follow(self, t_ns: NDArray[np.int64], residual: Array, q: Array, dq: Array, dq_ref: Array) -> NDArray[np.void]:
        """Take a recording, arrays (ticks,) and (ticks, n). Returns the state after each tick (ticks,)."""
        trace = np.zeros(len(t_ns), self.state.dtype)
        _follow(self.state, self.parameters, t_ns, residual, q, dq, dq_ref, trace)
        return trace

    def assess(self, t_ns: NDArray[np.int64], residual: Array, q: Array, dq: Array, dq_ref: Array) -> Assessment:
        """Take a recording. Returns what became of it."""
        _follow(self.state, self.parameters, t_ns, residual, q, dq, dq_ref, self.state[:0])
        return self.assessment()

    def assessment(self) -> Assessment:
        """Return what is known by now."""
        s = self.state[0]
        return Assessment(
            Verdict(s["verdict"]), Reason(s["reason"]), int(s["joint"]), float(s["margin"]), int(s["impacts"]),
            int(s["t_first_ns"]), int(s["t_impact_ns"]),
        )  # fmt: skip


@compiled
def _follow(states, parameters, t_ns, residual, q, dq, dq_ref, trace):
    for k in range(t_ns.shape[0]):
        monitor_step(states, parameters, t_ns[k], residual[k], q[k], dq[k], dq_ref[k])
        if k < trace.shape[0]:
            trace[k] = states[0]
