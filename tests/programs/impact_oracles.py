"""The rigid impact map against oracles of its own kind, over random configurations.

`python -m tests.programs.impact_oracles --configurations 1000 [--seed 0]`: exit status 1 where one of them fails. Each
configuration is a scene (impact_scenes) with its own mass matrix and Jacobian (impact_system). What is checked:

  model          mass matrix, Jacobian and velocity, by other routes
  law            Coulomb's law, written once more, to 1e-8; the converged map with its pressing, too
  momentum       M (v+ - v-) = J^T lambda to 1e-10
  energy         never grows
  solvers        ADMM and PGS agree, or the result says that velocities are not unique
  quadratic      without friction, the QP of Gauss's principle (daqp) to 1e-8
  closed form    without friction, the bilateral impact on the active set to 1e-8
  mujoco         one step of MuJoCo against Pinocchio's convex relaxation, and the map where both laws agree, to 0.1 %

Takes some minutes.
"""

import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Annotated

import daqp
import numpy as np
import typer

from rtstack.impact_map import Status, impact_map
from tests.programs import program
from tests.support.impact_map.mujoco import mujoco_velocity, relaxed_velocity
from tests.support.impact_map.scenes import frictionless, random_scene
from tests.support.impact_map.system import System, system_of

LAW = 1e-8  # m/s, N s, J
QUADRATIC = 1e-8  # m/s, rad/s
MOMENTUM = 1e-10  # N s
ENERGY = 1e-12  # J, relative to what there was
SAME = 1e-6
MUJOCO = 1e-3  # of the largest velocity change


@dataclass
class Tally:
    """What was seen: the worst of each check, failures as lines, and how often each thing happened."""

    worst: Counter = field(default_factory=Counter)
    counts: Counter = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def check(self, seed: int, name: str, error: float, bound: float) -> None:
        """Note an error, and a failure where it is above its bound (or no number)."""
        self.worst[name] = max(self.worst[name], error)
        if not error <= bound:
            self.failures.append(f"configuration {seed}: {name}: {error:.3g}, allowed {bound:.3g}")


def check_configuration(seed: int, tally: Tally) -> None:
    """Compute the maps of one configuration and hold them against every oracle."""
    scene = random_scene(seed)
    result = impact_map(scene)
    system = system_of(scene, result.problem)
    _check_model(seed, system, result.problem, tally)
    for name, impact in (("single step", result.single_step), ("converged", result.converged)):
        tally.counts[f"{name}: {impact.status.value}"] += 1
        tally.counts[f"{name}: impulses {'unique' if impact.impulses_unique else 'not unique'}"] += 1
        if impact.status is Status.INFEASIBLE and name == "converged":
            continue
        if impact.second_opinion_m_s is None:
            tally.counts[f"{name}: PGS not precise"] += 1
        agreed = impact.second_opinion_m_s is not None and impact.second_opinion_m_s <= SAME
        if impact.status is Status.NOT_UNIQUE:
            tally.counts[f"{name}: not unique, {impact.detail.split(',')[0]}"] += 1
        confirmed = agreed or impact.status is Status.NOT_UNIQUE or impact.second_opinion_m_s is None
        tally.check(seed, f"{name}: solvers", 0.0 if confirmed and impact.status is not Status.UNSOLVED else 1.0, 0.0)
        _check_impact(seed, name, system, result.problem, impact, tally)
    _check_frictionless(seed, frictionless(scene), tally)
    _check_mujoco(seed, scene, result, tally)


def _check_model(seed, system, problem, tally):
    tally.check(seed, "model: mass", np.abs(system.M - problem.M).max(), 1e-12)
    tally.check(seed, "model: Jacobian", np.abs(system.J.reshape(problem.J.shape) - problem.J).max(), 1e-12)
    tally.check(seed, "model: velocity", np.abs(system.v - problem.velocity).max(), 1e-10)


def _check_impact(seed, name, system, problem, impact, tally):
    change = system.M @ (impact.velocity - system.v)
    given = np.einsum("ick,ic->k", system.J, impact.impulses)
    tally.check(seed, f"{name}: momentum", np.abs(change - given).max(), MOMENTUM)
    before, after = system.energy(system.v), system.energy(impact.velocity)
    tally.check(seed, f"{name}: energy", (after - before) / max(before, 1.0), ENERGY)
    told = max(abs(before - impact.kinetic_energy_before_j), abs(after - impact.kinetic_energy_after_j))
    tally.check(seed, f"{name}: energy as told", told, MOMENTUM)
    # the pressing closes the cone: with it, every corner obeys the law
    loads = impact.impulses.copy()
    for points, pressing in zip(problem.points, impact.pressing_ns, strict=True):
        loads[points, 2] += pressing / (points.stop - points.start)
    velocities = np.einsum("ick,k->ic", system.J, impact.velocity)
    tally.check(seed, f"{name}: law", law_error(loads, velocities, system.friction), LAW)


def law_error(impulses, velocities, friction):
    """Return by how much Coulomb's law is broken, point by point, in the plainest way."""
    worst = 0.0
    for (*push, normal), (*slip, v_normal), mu in zip(impulses, velocities, friction, strict=True):
        worst = max(worst, -v_normal, -normal, abs(normal * v_normal), np.hypot(*push) - mu * normal)
        speed = np.hypot(*slip)
        for p, s in zip(push, slip, strict=True):  # at a slip the force is mu N against it
            worst = max(worst, abs(p * speed + mu * normal * s))
    return worst


def _check_frictionless(seed, scene, tally):
    result = impact_map(scene)
    system = system_of(scene, result.problem)
    impact = result.single_step
    normals = system.J[:, 2]
    upper = np.full(len(normals), 1e30)
    gradient = -system.M @ system.v
    v, _, flag, _ = daqp.solve(system.M, gradient, normals, upper, np.zeros(len(normals)), primal_tol=1e-12)
    tally.check(seed, "quadratic: flag", abs(flag - 1.0), 0.0)
    tally.check(seed, "quadratic", np.abs(v - impact.velocity).max(), QUADRATIC)
    active = impact.impulses[:, 2] > 1e-9
    closed = closed_form(system, active)
    tally.check(seed, "closed form", np.abs(closed - impact.velocity).max(), QUADRATIC)
    scale = max(np.abs(v - system.v).max(), 0.1)
    stepped = mujoco_velocity(scene, result.problem)
    if stepped is None:
        tally.counts["mujoco: its step did not converge"] += 1
        return
    tally.check(seed, "mujoco: frictionless", np.abs(stepped - impact.velocity).max() / scale, MUJOCO)


def closed_form(system: System, active):
    """Return v+ of (4): the bilateral impact at the active contacts, their impulses eliminated."""
    J = system.J[active, 2]
    if len(J) == 0:
        return system.v
    Minv_Jt = np.linalg.solve(system.M, J.T)
    return system.v - Minv_Jt @ np.linalg.lstsq(J @ Minv_Jt, J @ system.v, rcond=1e-12)[0]


def _check_mujoco(seed, scene, result, tally):
    relaxed, stepped = relaxed_velocity(result.problem), mujoco_velocity(scene, result.problem)
    if stepped is None:
        tally.counts["mujoco: its step did not converge"] += 1
        return
    scale = max(np.abs(stepped - result.problem.velocity).max(), 0.1)
    if relaxed is None:
        tally.counts["mujoco: the relaxation, by ADMM, did not converge"] += 1
    else:
        tally.check(seed, "mujoco: relaxation", np.abs(stepped - relaxed).max() / scale, MUJOCO)
    # a solution of Coulomb's law is one of the relaxation, too, where contacts open as fast as they slip, or faster
    impact = result.single_step
    slip = np.hypot(impact.velocities[:, 0], impact.velocities[:, 1])
    if np.all(impact.velocities[:, 2] >= result.problem.friction * slip - 1e-9):
        tally.counts["mujoco: both laws say the same"] += 1
        tally.check(seed, "mujoco: map", np.abs(stepped - impact.velocity).max() / scale, MUJOCO)


def main(
    configurations: int = 1000, seed: Annotated[int, typer.Option(help="the first one's; the others follow")] = 0
) -> int:
    """Check as many configurations as asked, with a line every two seconds, and say what was seen."""
    tally = Tally()
    from rich.progress import track

    for k in track(range(configurations), "configurations", disable=not sys.stderr.isatty()):
        check_configuration(seed + k, tally)
        if not sys.stderr.isatty() and (k + 1) % 100 == 0:
            print(f"{k + 1} configurations, {len(tally.failures)} failures", file=sys.stderr)
    print(f"{configurations} configurations from seed {seed}")
    for name, count in sorted(tally.counts.items()):
        print(f"  {name:<34} {count}")
    for name, worst in sorted(tally.worst.items()):
        print(f"  worst of {name:<25} {worst:.2e}")
    for failure in tally.failures[:20]:
        print(failure)
    print("every oracle agrees" if not tally.failures else f"{len(tally.failures)} failures")
    return 1 if tally.failures else 0


if __name__ == "__main__":
    program(main)
