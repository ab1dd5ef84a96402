"""A log as a ROS 2 bag, without a ROS installation: joint states, wrenches at the pads and the tree of frames.

Its stamps are Unix time, so that it lies beside a bag that was recorded at the same time; the robot's time where the
log has no time of day.

pip install rosbags
python 11_to_a_ros_2_bag.py trial.mcap trial_bag       # then: ros2 bag play trial_bag
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from rtstack.log.reader import read_log
from rtstack.log.time_of_day import time_of_day

TYPES = get_typestore(Stores.ROS2_HUMBLE)
NAMES = {
    kind: TYPES.types[kind]
    for kind in (
        "builtin_interfaces/msg/Time", "std_msgs/msg/Header", "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Wrench",
        "geometry_msgs/msg/Quaternion", "geometry_msgs/msg/Transform", "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage",
    )
}  # fmt: skip
Time, Header, Vector3, Wrench, Quaternion, Transform, TransformStamped, WrenchStamped, JointState, TFMessage = (
    NAMES.values()
)


def header(t_ns: int, frame: str):
    """A time, and a frame."""
    return Header(Time(t_ns // 10**9, t_ns % 10**9), frame)


def transform(t_ns: int, parent: str, child: str, T: np.ndarray):
    """A pose (4, 4) of a frame in another one."""
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    place = Transform(Vector3(*map(float, T[:3, 3])), Quaternion(*map(float, (x, y, z, w))))
    return TransformStamped(header(t_ns, parent), child, place)


def messages(side: str, sample: np.void, t_ns: int):
    """Yield topic, kind and message of one arm's sample, with the stamp t_ns."""
    joints = [f"{side}_joint{k}" for k in range(1, 8)]
    yield (
        f"/{side}/joint_states",
        "sensor_msgs/msg/JointState",
        JointState(header(t_ns, ""), joints, sample["q"].copy(), sample["dq"].copy(), sample["tau_J"].copy()),
    )
    pushed = -sample["O_F_ext_hat_K"]  # positive where the robot pushes: ROS has what the sensor feels
    force, torque = Vector3(*map(float, pushed[:3])), Vector3(*map(float, pushed[3:]))
    yield (
        f"/{side}/wrench",
        "geometry_msgs/msg/WrenchStamped",
        WrenchStamped(header(t_ns, f"{side}_base"), Wrench(force, torque)),
    )
    frame = transform(t_ns, f"{side}_base", f"{side}_pad", sample["O_T_EE"])
    yield "/tf", "tf2_msgs/msg/TFMessage", TFMessage([frame])


def convert(log_path: Path, bag: Path, every: int = 1) -> int:
    """Write the bag; every: of so many samples one. Returns the number of messages."""
    log = read_log(log_path)
    time = time_of_day(log)
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections, count = {}, 0
        for side in ("left", "right"):
            for sample in log.topic(f"/{side}/arm")[::every]:
                t_ns = int(sample["t_ns"]) if time is None else time.unix_ns(int(sample["t_ns"]))
                for topic, kind, message in messages(side, sample, t_ns):
                    if topic not in connections:
                        connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
                    data = TYPES.serialize_cdr(message, kind)
                    writer.write(connections[topic], t_ns, data)
                    count += 1
    return count


if __name__ == "__main__":
    source, target = (Path(argument) for argument in sys.argv[1:3])
    print(f"{convert(source, target, 10)} messages in {target}")
