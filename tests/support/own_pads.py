"""The grabbing cell with a pad of its own on each arm: angled and heavy on one side, offset and turned on the other."""

from pathlib import Path

from rtstack.cells import default_cell_file

# the pads' faces are at home where those of the grabbing cell are
LEFT = """
[left.pad]  # on an angled bracket whose mass is not in the pad's middle
size = [0.1, 0.1, 0.03]
mass = 0.5
flange_to_face = 0.06
offset_xy = [0.04, 0.0]
orientation_wxyz = [0.976296, -0.2164396, 0.0, 0.0]  # -25 deg about the flange's x
centre = [0.015, 0.005, 0.03]
inertia = [1.2e-3, 1.1e-3, 9e-4, 5e-5, 0.0, 0.0]
"""
RIGHT = """
[right.pad]  # on an arm of 50 mm, turned by 45 deg
size = [0.1, 0.1, 0.03]
mass = 0.42
flange_to_face = 0.05
offset_xy = [0.0, 0.05]
orientation_wxyz = [0.9238795, 0.0, 0.0, 0.3826834]
"""
HOMES = {
    "left": "[-0.301958, -0.20658, 0.207857, -2.730622, -1.356569, 2.012818, 0.889423]",
    "right": "[0.301958, -0.110165, -0.321633, -2.700155, 1.537481, 1.591224, -1.809548]",
}


def cell_with_own_pads(folder: Path) -> Path:
    """Write the cell's file; return its path."""
    lines, side = default_cell_file().read_text(encoding="utf-8").splitlines(), ""
    for k, line in enumerate(lines):
        side = line.strip("[]") if line in ("[left]", "[right]") else side
        if line.startswith("home = "):
            lines[k] = f"home = {HOMES[side]}"
    path = folder / "lab.toml"
    path.write_text("\n".join(lines) + "\n" + LEFT + RIGHT, encoding="utf-8")
    return path
