"""The description of the arm: our own URDF of the Franka Research 3, from published numbers."""

from importlib.resources import files


def fr3_urdf() -> str:
    """Return the text of the URDF of a Franka Research 3 (links link0 to link8, joints joint1 to joint7)."""
    return (files("hal.description") / "fr3.urdf").read_text(encoding="utf-8")
