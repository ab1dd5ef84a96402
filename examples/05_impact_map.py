"""Which velocities follow an impact: two pads hit a box that stands on a table.

The scene is the one of `rtstack impact-map deploy/impacts/grab.toml`; a `Scene` can be written in Python as well.
"""

from dataclasses import replace
from importlib.resources import as_file, files

from rtstack.impact_map import impact_map, load_scene

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
