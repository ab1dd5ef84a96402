"""The dual-arm tick and its parts, without an active limit and with one.

The states come from a walk around the cell's home pose. In every other constrained tick the torque limit of one
joint is lowered below what it carries, so that the solver has to answer.
"""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from hal.base.arrays import Array
from rtstack.control.modes import ModeMachine, Strategy
from rtstack.control.records import POINT
from rtstack.control.tick import CellController
from rtstack.control.watch import TrialMonitor
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.expected import ExpectedImpact
from rtstack.samples import Mode, QpStatus
from rtstack.trials.assembly import Parameters, arm_controllers, safety_judges
from rtstack.trials.monitoring import tuning_of

OBJECT = "rice_box"  # whose monitor is timed: all are alike
WARM_UP = 200  # ticks that are not counted
PARTS = ("model", "observe", "monitor", "modes", "command", "judge")  # the model is a part of the observation, too


class _Pair:
    """Both arms' tick, fed with states."""

    def __init__(self, description: CellDescription, parameters: Parameters, rng: np.random.Generator) -> None:
        description = replace(description, safety={})  # the walk leaves the cell's box
        self.arms = arm_controllers(description, parameters)
        machine = ModeMachine(Strategy.PROPOSED, parameters.control, 1e9)
        machine.begin(Mode.ANTE_IMPACT)
        self.controller = CellController(self.arms, machine, _monitor(parameters.control.period_s))
        self.judges = safety_judges(description)
        self._tau_J_max = float(self.arms[0].limits["tau_J_max"][0, 1])
        self.homes = [np.array(mounting.home) for mounting in description.arms]
        stiffness = np.array(parameters.control.stiffness)
        for arm in self.arms:
            arm.pursue(stiffness, arm.parameters.posture_gain)
        self.points = [np.zeros(1, POINT) for _ in range(2)]
        self.residuals = [arm.control["momentum_residual"][0] for arm in self.arms]
        for arm, point in zip(self.arms, self.points, strict=True):
            arm.follow(point, point)
        self._rng = rng
        self._now_ns = 0
        self._phase = rng.uniform(0.0, 2 * np.pi, (2, 7))

    def pose(self, k: int, constrain: bool) -> int:
        """Give both arms the k-th state; return how long their models took, ns."""
        self._now_ns += 1_000_000  # of a clock that never goes back: the judge would stop
        model_ns = 0
        for a, arm in enumerate(self.arms):
            t = 1e-3 * k
            q = self.homes[a] + 0.1 * np.sin(2.0 * t + self._phase[a])
            dq = 0.2 * np.cos(2.0 * t + self._phase[a])
            noise = self._rng.normal(size=13)
            point = self.points[a]
            began_ns = time.perf_counter_ns()
            arm.model.update(q, dq)
            model_ns += time.perf_counter_ns() - began_ns
            point["position"][0] = arm.model.p7 + arm.model.R7 @ arm.model.face + 0.01 * np.sin(t + self._phase[a, :3])
            point["rotation"][0] = arm.model.R7 @ arm.model.R_joint_ee
            point["twist"][0, :3] = 0.02 * np.cos(t + self._phase[a, :3])
            point["xi"][0] = q[0]
            # less than the joint needs to carry the arm: the torque row is active whatever is wanted
            arm.limits["tau_J_max"][0, 1] = 0.5 * abs(arm.model.g[1]) if constrain else self._tau_J_max
            sample = arm.sample
            sample["t_ns"][0] = self._now_ns
            sample["q"][0], sample["dq"][0] = q, dq
            sample["tau_J"][0] = arm.workspace["gravity"][0] + noise[:7] * 0.05
            sample["O_F_ext_hat_K"][0] = noise[7:] * 0.2
        return model_ns

    def tick(self) -> tuple[list[int], int]:
        """Run a tick; return when each of its parts began, and its end, ns, and the worst QP status."""
        marks = [time.perf_counter_ns()]
        for arm in self.arms:
            arm.observe()
        marks.append(time.perf_counter_ns())
        for side in range(2):
            self.controller.watch(side, self._now_ns)
        marks.append(time.perf_counter_ns())
        self.controller.decide(0.0)
        for arm in self.arms:
            arm.choose(0, self.controller.machine)
        marks.append(time.perf_counter_ns())
        worst = max(arm.command(Mode.ANTE_IMPACT) for arm in self.arms)
        self.controller.finish()
        marks.append(time.perf_counter_ns())
        for arm, judge, residual in zip(self.arms, self.judges, self.residuals, strict=True):
            judge.judge(arm.sample, residual=residual)
            arm.applied()
        return [*marks, time.perf_counter_ns()], worst


def bench_tick(description: CellDescription, parameters: Parameters, ticks: int, seed: int = 0) -> dict[str, Any]:
    """Measure `ticks` ticks without an active limit, and as many with one in half of them.

    Returns:
        Times in us. tick_*: of the whole dual-arm tick, no limit active; constrained_*: a limit active in half of the
        ticks; model, observe, monitor, modes, command, judge: parts of the tick without a limit, p50.
    """
    pair = _Pair(description, parameters, np.random.default_rng(seed))
    times: dict[bool, list[list[int]]] = {False: [], True: []}
    solved = unsolved = 0
    for constrained in (False, True):
        for k in range(WARM_UP + ticks):
            model_ns = pair.pose(k, constrained and k % 2 == 1)
            marks, worst = pair.tick()
            if k < WARM_UP:
                continue
            times[constrained].append([marks[-1] - marks[0], model_ns, *np.diff(marks).tolist()])
            if constrained:
                solved += worst >= QpStatus.SOLVED
                unsolved += worst > QpStatus.SOLVED
    free, bounded = (1e-3 * np.array(times[constrained]) for constrained in (False, True))
    return {
        "ticks": ticks,
        "solver": str(parameters.solver),
        "tick_us_p50": _percentile(free[:, 0], 50),
        "tick_us_p99": _percentile(free[:, 0], 99),
        "constrained_tick_us_p50": _percentile(bounded[:, 0], 50),
        "constrained_tick_us_p99": _percentile(bounded[:, 0], 99),
        "constrained_share": solved / ticks,
        "unsolved": unsolved,
        **{f"{part}_us_p50": _percentile(free[:, k], 50) for k, part in enumerate(PARTS, 1)},
    }


def _monitor(period_s: float) -> TrialMonitor:
    """A monitor that has seen an impact and follows its envelopes for ever: its most expensive tick."""
    still = np.zeros((2, 1, 7))
    impact = ExpectedImpact(0.0, np.zeros((2, 7)), np.zeros((2, 7)), still, np.zeros((1, 3)), 1e6, 2e6)
    tuning = tuning_of(OBJECT)
    assert tuning is not None  # it is committed
    monitor = TrialMonitor(tuning.monitor, impact, period_s)
    monitor.arms["impacts"], monitor.arms["t_impact_ns"] = 1, 1 << 61
    return monitor


def _percentile(values: Array, share: float) -> float:
    return round(float(np.percentile(values, share)), 3)
