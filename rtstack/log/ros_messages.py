"""The two messages of ROS 2 in a log, for viewers that know them: the cell's URDF, and both arms' joints.

Foxglove draws a URDF from std_msgs/msg/String and Rerun does; sensor_msgs/msg/JointState becomes scalars that Rerun
plots by itself, which foxglove.JointStates does not (rerun-sdk 0.41). Encoded by hand, in little-endian CDR, as ROS 2
does it: OMG DDS-XTypes 1.3, 7.4.1; numbers are aligned to their size, counted from behind the header of four bytes.
"""

import numpy as np
from numpy.typing import NDArray

from rtstack.log.instants import Instants
from rtstack.samples import SIDES

ENCODING = "ros2msg"  # of the schemas, https://mcap.dev/spec/registry
MESSAGE_ENCODING = "cdr"
STRING = ("std_msgs/msg/String", "string data\n")
_SEPARATOR = "=" * 80 + "\n"
JOINT_STATE = (
    "sensor_msgs/msg/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    f"{_SEPARATOR}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{_SEPARATOR}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
)
JOINTS = [f"{side}_joint{k}" for side in SIDES for k in range(1, 8)]
_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little-endian
_NS = 1_000_000_000
_COUNT = len(JOINTS)


def string_message(text: str) -> bytes:
    """Return a std_msgs/msg/String."""
    return _HEADER + _string(b"", text)


def joint_states(instants: Instants) -> list[tuple[int, bytes]]:
    """Return (t_ns, sensor_msgs/msg/JointState) for each of the instants at which both arms are known.

    Position rad, velocity rad/s, effort the measured torque tau_J, Nm, of the joints of rtstack.log.cell_urdf.
    """
    if any(side not in instants.known for side in SIDES):
        return []
    rows = np.intersect1d(instants.known["left"].rows, instants.known["right"].rows)
    # as bytes: numpy copies the fields of a record only, not what lies between them
    messages = np.tile(_TEMPLATE.view(np.uint8), (len(rows), 1)).view(_TEMPLATE.dtype)[:, 0]
    t_ns = np.maximum(instants.t_ns[rows], 0)
    messages["sec"], messages["nanosec"] = t_ns // _NS, t_ns % _NS
    for field, name in (("position", "q"), ("velocity", "dq"), ("effort", "tau_J")):
        for k, side in enumerate(SIDES):
            known = instants.known[side]
            messages[field][:, 7 * k : 7 * k + 7] = known.records[name][np.isin(known.rows, rows)]
    size, data = _TEMPLATE.itemsize, messages.tobytes()
    return [(t, data[k * size : (k + 1) * size]) for k, t in enumerate(instants.t_ns[rows].tolist())]


def _aligned(data: bytes, size: int) -> bytes:
    return data + bytes(-len(data) % size)


def _string(before: bytes, text: str) -> bytes:
    encoded = text.encode() + b"\x00"
    return _aligned(before, 4) + len(encoded).to_bytes(4, "little") + encoded


def _template() -> NDArray[np.void]:
    body = bytes(8)  # the stamp
    body = _aligned(_string(body, "world"), 4) + _COUNT.to_bytes(4, "little")
    for name in JOINTS:
        body = _string(body, name)
    parts: dict[str, int] = {}
    for field in ("position", "velocity", "effort"):
        body = _aligned(_aligned(body, 4) + _COUNT.to_bytes(4, "little"), 8)
        parts[field] = len(body)
        body += bytes(8 * _COUNT)
    start = len(_HEADER)
    layout = np.dtype(
        {
            "names": ["sec", "nanosec", *parts],
            "formats": ["<i4", "<u4", *[("<f8", _COUNT)] * len(parts)],
            "offsets": [start, start + 4, *(start + offset for offset in parts.values())],
            "itemsize": start + len(body),
        }
    )
    return np.frombuffer(_HEADER + body, layout)


_TEMPLATE: NDArray[np.void] = _template()
