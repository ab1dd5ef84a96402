"""What other people's viewers show of a log by themselves, made from its samples: the topics beside the records'."""

import foxglove
from foxglove.messages import FrameTransforms, PointCloud, SceneUpdate
from numpy.typing import NDArray

from rtstack.log.cell_urdf import cell_urdf, shapes_of
from rtstack.log.frames import CellFrames, FrameTree
from rtstack.log.instants import InstantFinder
from rtstack.log.ros_messages import ENCODING, JOINT_STATE, STRING, joint_states, string_message
from rtstack.log.shapes import Forces, Solids

TRANSFORMS, SOLIDS, FORCES, FORCE_LINES = "/tf", "/scene", "/forces", "/forces/lines"
JOINT_STATES, ROBOT_DESCRIPTION = "/joint_states", "/robot_description"

Messages = dict[str, list[tuple[int, bytes]]]


def scenery_schemas() -> dict[str, foxglove.Schema]:
    """Return the schema of every topic that is made from the records."""
    return {
        TRANSFORMS: FrameTransforms.get_schema(),
        SOLIDS: SceneUpdate.get_schema(),
        FORCES: SceneUpdate.get_schema(),
        FORCE_LINES: PointCloud.get_schema(),
        JOINT_STATES: foxglove.Schema(name=JOINT_STATE[0], encoding=ENCODING, data=JOINT_STATE[1].encode()),
        ROBOT_DESCRIPTION: foxglove.Schema(name=STRING[0], encoding=ENCODING, data=STRING[1].encode()),
    }


class Scenery:
    """Makes these messages from a run's batches of records."""

    def __init__(self, cell: CellFrames, arm_urdf: str) -> None:
        urdf = cell_urdf(cell, arm_urdf)
        self._instants = InstantFinder()
        self._tree = FrameTree(cell, arm_urdf)
        self._solids, self._forces = Solids(shapes_of(urdf)), Forces(cell)
        self._description = [string_message(urdf)]

    def update(self, arms: dict[str, NDArray], poses: NDArray) -> Messages:
        """Return the messages that are due in a batch, as (t_ns, bytes) by topic.

        arms: the batch's ARM_SAMPLE records of each side; poses: its OBJECT_POSE records.
        """
        instants = self._instants.find(arms, poses)
        if not len(instants.t_ns):
            return {}
        first, self._description = self._description, []
        arrows, lines = self._forces.messages(instants)
        return {
            ROBOT_DESCRIPTION: [(int(instants.t_ns[0]), message) for message in first],
            SOLIDS: self._solids.updates(instants),
            TRANSFORMS: self._tree.transforms(instants),
            FORCES: arrows,
            FORCE_LINES: lines,
            JOINT_STATES: joint_states(instants),
        }
