"""A robot that nobody builds, as the two files that describe it, for tests: shorter and slower than a Franka arm."""

import re
from importlib.resources import files
from pathlib import Path

from hal.robots import FR3
from rtstack.cells import default_cell_file

SHORTER = 0.95  # of some of the arm's lengths
# its pad's face where the grabbing cell's arms have theirs at home; the right arm's is the mirror
HOME = (-0.301958, 0.067801, 0.267025, -2.551376, -1.61049, 1.573128, 1.045714)
MIRROR = (-1, 1, -1, 1, -1, 1, -1)
DQ_MAX = (1.9, 1.8, 1.9, 1.8, 2.2, 2.2, 2.2)


def robot_files(name: str = "shorty") -> tuple[str, str]:
    """Return the TOML and the URDF, NAME.urdf, with names of links and joints of their own."""
    urdf = FR3.urdf.replace('"joint', f'"{name}_joint').replace('"link', f'"{name}_link')
    for length in ("0.333", "0.316", "0.384"):
        urdf = urdf.replace(f"{length} ", f"{SHORTER * float(length)!r} ").replace(
            f'{length}"', f'{SHORTER * float(length)!r}"'
        )
    text = (files("hal.robots") / "fr3.toml").read_text(encoding="utf-8")
    text = with_key(text, "title", f'"{name.title()}"')
    text = with_key(text, "urdf", f'"{name}.urdf"')  # the first one: the other one is among the sources
    text = with_key(text, "joints", str([f"{name}_joint{number}" for number in range(1, 8)]))
    text = with_key(text, "flange", f'"{name}_link8"')
    text = with_key(text, "meshes", None)
    return with_key(text, "dq_max", str(list(DQ_MAX))), urdf


def with_key(text: str, key: str, value: str | None) -> str:
    """Return a TOML with another value for the first key of this name, or without it."""
    line = "" if value is None else f"{key} = {value}\n"
    found, count = re.subn(rf"(?m)^{re.escape(key)} = .*\n", lambda _: line, text, count=1)
    assert count == 1, key
    return found


def write_robot(folder: Path, name: str = "shorty") -> Path:
    """Write both files; return the TOML's path."""
    text, urdf = robot_files(name)
    (folder / f"{name}.urdf").write_text(urdf)
    (folder / f"{name}.toml").write_text(text)
    return folder / f"{name}.toml"


def cell_of(folder: Path, left: str = "fer", right: str = "fer") -> Path:
    """Write the grabbing cell with arms of these models; return its file."""
    lines = default_cell_file().read_text().splitlines()
    for side, model, mirror in (("left", left, (1,) * 7), ("right", right, MIRROR)):
        table = lines.index(f"[{side}]")
        lines.insert(table + 1, f'model = "{model}"')
        if model == "shorty.toml":
            home = next(k for k in range(table, len(lines)) if lines[k].startswith("home = "))
            lines[home] = f"home = {[a * b for a, b in zip(HOME, mirror, strict=True)]}"
    text = "\n".join(lines) + "\n"
    path = folder / "lab.toml"
    path.write_text(text)
    return path
