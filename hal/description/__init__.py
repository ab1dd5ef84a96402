"""The description of the Franka Research 3."""

from hal.robots import FR3


def fr3_urdf() -> str:
    """Return the text of the URDF of a Franka Research 3 (links link0 to link8, joints joint1 to joint7)."""
    return FR3.urdf
