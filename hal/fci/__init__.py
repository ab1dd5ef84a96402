"""A Franka Research 3 over the Franka Control Interface, at an address: the only network client of the stack."""

from hal.fci.arm import FciArm
from hal.fci.gripper import FciGripper
from hal.fci.pair import FciPair, open_pair
from hal.fci.setup import CollisionBehaviour, Tool

__all__ = ["CollisionBehaviour", "FciArm", "FciGripper", "FciPair", "Tool", "open_pair"]
