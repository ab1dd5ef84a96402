"""A Franka Research 3 over the Franka Control Interface, at an address: the only network client of the stack."""

from hal.fci.arm import FciArm
from hal.fci.gripper import FciGripper
from hal.fci.own_limits import ask_for_urdf, limits_in
from hal.fci.pair import FciPair, open_pair

__all__ = ["FciArm", "FciGripper", "FciPair", "ask_for_urdf", "limits_in", "open_pair"]
