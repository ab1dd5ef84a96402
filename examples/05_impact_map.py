"""Which velocities follow an impact: two pads hit a box that stands on a table.

The scene is the one of `rtstack impact-map deploy/impacts/grab.toml`; a `Scene` can be written in Python as well.
"""

from dataclasses import replace
from importlib.resources import as_file, files

import numpy as np

from rtstack.impact_map import impact_map, load_scene, problem_from_arrays, single_step

with as_file(files("deploy.impacts") / "grab.toml") as path:
    scene = load_scene(path)

result = impact_map(scene)
for name in ("left", "right", "rice_box"):
    before, after = result.twist_before(name)[:3], result.twist(name)[:3]
    print(f"{name:<8} {before.round(3)} m/s, then {after.round(3)}")
print(f"the map is {result.converged.status}: {result.converged.detail}")

# twice the mass: the pads go on more slowly
heavy = {name: replace(box, mass=2 * box.mass) for name, box in scene.objects.items()}
result = impact_map(replace(scene, objects=heavy))
print(f"with a box of twice the mass the left pad rises at {result.twist('left')[2]:.3f} m/s")

# any bodies whose mass matrix and contact Jacobian are known: a planar arm of two links whose end falls to the floor
M, J = np.array([[3.0, 1.0], [1.0, 1.0]]), np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 1.0]])
impact = single_step(problem_from_arrays(M, J, velocity=[-0.5, -0.5], friction=0.4))
print(f"the arm of two links: {impact.velocity.round(3)} rad/s after the impact, {impact.status}, {impact.states[0]}")
