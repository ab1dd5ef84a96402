"""What other people's viewers show of a log by themselves, made from its samples: the topics beside the records'."""

import foxglove
from foxglove.messages import FrameTransforms, PointCloud, SceneUpdate, VoxelGrid
from numpy.typing import NDArray

from rtstack.log.viewers.frames import CellFrames, FrameTree, InstantFinder
from rtstack.log.viewers.shapes import Solids, force_messages
from rtstack.log.viewers.solids import shapes_of
from rtstack.log.viewers.voxels import VOXELS, voxel_messages

TRANSFORMS, SOLIDS, FORCES, FORCE_LINES = "/tf", "/scene", "/forces", "/forces/lines"

Messages = dict[str, list[tuple[int, bytes]]]


def scenery_schemas() -> dict[str, foxglove.Schema]:
    """Return the schema of every topic that is made from the records."""
    kinds = {TRANSFORMS: FrameTransforms, SOLIDS: SceneUpdate, FORCES: SceneUpdate, FORCE_LINES: PointCloud}
    return {topic: kind.get_schema() for topic, kind in kinds.items()} | dict.fromkeys(VOXELS, VoxelGrid.get_schema())


class Scenery:
    """Makes these messages from a run's batches of records."""

    def __init__(self, cell: CellFrames) -> None:
        shapes = shapes_of(cell)
        self._instants = InstantFinder()
        self._tree = FrameTree(cell)
        self._cell, self._solids = cell, Solids(shapes)
        self._voxels = shapes  # until they were said

    def update(self, arms: dict[str, NDArray], poses: NDArray) -> Messages:
        """Return what is due in a batch, as (t_ns, bytes) by topic. arms: ARM_SAMPLE by side; poses: OBJECT_POSE."""
        instants = self._instants.find(arms, poses)
        if not len(instants.t_ns):
            return {}
        first_ns = int(instants.t_ns[0])
        voxels = voxel_messages(self._voxels, first_ns)
        self._voxels = []
        arrows, lines = force_messages(self._cell, instants)
        made = {SOLIDS: self._solids.updates(instants), TRANSFORMS: self._tree.transforms(instants)}
        made |= {FORCES: arrows, FORCE_LINES: lines}
        return made | {topic: [(first_ns, message)] for topic, message in voxels.items()}
