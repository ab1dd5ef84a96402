"""Where a plant's object is."""

from hal.base.arrays import Array
from sim_robot.plant import Plant


def object_pose(plant: Plant) -> tuple[Array, Array]:
    """Return the object's centre in the world (3,) m and its quaternion wxyz (4,), copied."""
    pose = plant.data.qpos[plant.first_of_object :]
    return pose[:3].copy(), pose[3:].copy()
