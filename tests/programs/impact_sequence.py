"""What follows a grab's single time step: further steps, and plants whose corners are separate, beside both maps.

The scene of a grab of the validation's plan. Its configuration stands still, and gravity is left out, as the
feedforward carries it. Velocities are those of both pads upwards on average, in % of the converged map's.

steps     The nonsmooth simulation goes on, in steps of 1 ms: the law at all corners, with the gaps that have opened,
          while the pads are pressed together with the plan's squeeze or not at all. closed: the number of the step
          from which on all corners of the pads stay closed.
plants    Each corner is a spring and a damper of its own, in steps of 0.05 ms. The velocity is the mean of the last
          0.25 s of 0.4 s. Without a squeeze the pads bounce off, and have no common velocity with the object.
after     Twists of pads and object, (vx, vy, vz, wx, wy, wz), after the single step and of the converged map.

Takes a minute.
"""

import json
from typing import Annotated

import numpy as np
import typer

from rtstack.cells import load_description
from rtstack.experiments.registry import plan_file
from rtstack.impact_map.scene import ReflectedInertia, joint_inertia
from rtstack.impact_map.solvers import Solver, solve
from rtstack.papers.impact_maps.plan import load_validation_plan
from rtstack.planning import plan_grab
from rtstack.planning.grab import SQUEEZE_S
from rtstack.planning.impact_loads import JOINT_DAMPING, JOINT_STIFFNESS, SLIP_DAMPING, _contacts
from rtstack.references.motion import Motion
from rtstack.samples import SIDES
from tests.programs import program

BOXES = ("box_060", "box_130", "box_220")
PLAN = "impact-map-validation"
STEP_S = 1e-3  # of the nonsmooth simulation
AFTER = (1, 2, 3, 5, 10, 20, 50, 100, 200)
OPEN_M = 1e-9
FINE_S, PLANT_S = 5e-5, 0.4
MEAN_S = 0.25  # period of the slowest vibration


def squeezing(problem, force):
    """Return the generalised force (nv,) of a squeeze: each pad along its contact's normal, evenly over its corners."""
    corners = np.zeros((len(problem.friction), 3))
    for k, rows in enumerate(problem.points):
        if problem.contacts[k].between[0] in SIDES:
            corners[rows, 2] = -force / (rows.stop - rows.start)
    # on the arms alone: what presses is the controller, what is pressed only feels the contact
    generalised = problem.J.T @ corners.ravel()
    for name, where in zip(problem.names, problem.slices, strict=True):
        if name not in SIDES:
            generalised[where] = 0.0
    return generalised


def upwards(problem, velocity):
    """Return the mean velocity of both pads along z, m/s."""
    its = [problem.names.index(side) for side in SIDES]
    return float(np.mean([problem.bodies[k].twist(velocity[problem.slices[k]])[2] for k in its]))


def steps(problem, force, count, step_s=STEP_S):
    """Return the pads' velocity after each of so many steps (count,), m/s, and from which step on their corners stay
    closed (0: from the first on; count: never)."""
    velocity, gap = problem.velocity.copy(), np.zeros(len(problem.friction))
    pushed = np.linalg.solve(problem.M, squeezing(problem, force)) * step_s
    L, G = np.linalg.inv(problem.whitening), problem.A.T @ problem.A
    touching = zip(problem.contacts, problem.points, strict=True)
    pads = np.concatenate([np.r_[rows] for contact, rows in touching if contact.between[0] in SIDES])
    found, last_open = np.empty(count), 0
    for k in range(count):
        w, s = (velocity + pushed) @ L, problem.s.copy()
        s[2::3] -= gap / step_s  # a corner that is open may approach until it touches
        impulses = solve(Solver.ADMM, G, problem.A.T @ w - s, problem.friction).impulses
        velocity = problem.coloured(w + problem.A @ impulses.ravel())
        gap = np.maximum(gap + step_s * (problem.J @ velocity)[2::3], 0.0)
        found[k] = upwards(problem, velocity)
        if (gap[pads] > OPEN_M).any():
            last_open = k + 1
    return found, last_open


def plant(problem, give, mass, force, flexible=False, late_m=0.0):
    """Return the pads' velocity upwards at the end, m/s. late_m: distance of the right pad to the object at first."""
    its = [problem.names.index(side) for side in SIDES]
    joints = np.concatenate([np.r_[problem.slices[k]] for k in its])
    motors = np.concatenate([joint_inertia(ReflectedInertia.B_THETA, problem.bodies[k].robot) for k in its])
    M = problem.M.copy()
    M[joints, joints] -= flexible * motors
    compliance, squeeze = np.linalg.inv(M), squeezing(problem, force)
    stiffness, damping, pressed = _contacts(problem, give, mass)
    pressed[:] = 0.0
    for contact, rows in zip(problem.contacts, problem.points, strict=True):
        if contact.between[0] == "right":
            pressed[rows] = -late_m
    normal, along = problem.J[2::3], np.delete(problem.J, np.s_[2::3], axis=0)
    velocity, motor, twist = problem.velocity.copy(), problem.velocity[joints].copy(), np.zeros(len(joints))
    found = np.empty(round(PLANT_S / FINE_S))
    for k in range(len(found)):
        push = np.where(pressed > 0.0, np.maximum(stiffness * pressed - damping * (normal @ velocity), 0.0), 0.0)
        slip = (along @ velocity).reshape(-1, 2)
        speed = np.hypot(slip[:, 0], slip[:, 1]) + 1e-12
        held = np.minimum(problem.friction * push, SLIP_DAMPING * speed) / speed
        total = normal.T @ push - along.T @ (held[:, None] * slip).ravel()
        commanded = squeeze * min(k * FINE_S / SQUEEZE_S, 1.0)
        if flexible:
            spring = JOINT_STIFFNESS * twist + JOINT_DAMPING * (motor - velocity[joints])
            total[joints] += spring
            motor += FINE_S * (commanded[joints] - spring) / motors
            twist += FINE_S * (motor - velocity[joints])
        else:
            total += commanded
        velocity += FINE_S * (compliance @ total)
        pressed -= FINE_S * (normal @ velocity)
        found[k] = upwards(problem, velocity)
    return float(found[-round(MEAN_S / FINE_S) :].mean())


def measured(description, scenario, thing, case):
    """Return the figures of one object."""
    planned = plan_grab(description, thing, scenario.request(case, 1.0, True))
    result, request = planned.map, planned.request
    problem, force, give, mass = result.problem, request.squeeze, request.give, description.objects[thing].mass
    converged = upwards(problem, result.converged.velocity)

    def percent(value):
        return round(100.0 * float(value) / converged, 2)

    pressed, closed = steps(problem, force, AFTER[-1])
    free, free_closed = steps(problem, 0.0, AFTER[-1])
    plants = {
        "squeezed": plant(problem, give, mass, force),
        "squeezed, flexible joints": plant(problem, give, mass, force, flexible=True),
        "squeezed, pads ten times as stiff": plant(problem, give / 10.0, mass, force),
        "squeezed, right pad 1 mm late": plant(problem, give, mass, force, late_m=1e-3),
        "not squeezed": plant(problem, give, mass, 0.0),
    }
    return {
        "converged_m_s": round(converged, 4),
        "single_step": percent(upwards(problem, result.single_step.velocity)),
        "pressing_ns": [round(float(ns), 2) for ns in result.converged.pressing_ns],
        "squeeze_n": force,
        "steps": {n: percent(pressed[n - 1]) for n in AFTER},
        "closed": closed,
        "steps_without_squeeze": {n: percent(free[n - 1]) for n in AFTER},
        "closed_without_squeeze": free_closed,
        "plants": {name: percent(value) for name, value in plants.items()},
        "after": {
            name: [result.twist(name, impact).round(3).tolist() for impact in (result.single_step, result.converged)]
            for name in problem.names
        },
    }


def main(
    case: str = "1", objects: list[str] | None = None, as_json: Annotated[bool, typer.Option("--json")] = False
) -> None:
    """Measure and print."""
    description, _ = load_description(None)
    scenario = load_validation_plan(plan_file(PLAN).path).scenario(Motion.GRAB)
    found = {thing: measured(description, scenario, thing, case) for thing in objects or BOXES}
    if as_json:
        print(json.dumps(found))
        return
    for thing, figures in found.items():
        print(thing)
        for name, value in figures.items():
            print(f"  {name:26} {value}")


if __name__ == "__main__":
    program(main)
