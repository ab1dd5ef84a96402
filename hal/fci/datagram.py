"""A state as it is on the wire, into our record, in one compiled call.

libfranka gives the same values as lists of Python's, which takes a third of the time from a state to its answer.
Source of the layout: libfranka's public headers (research_interface/robot/rbk_types.h), version 10: packed,
little-endian.
"""

import numpy as np

from hal.compilation import compiled

_PLACES = {
    "message_id": ("<i8", 0),  # the robot's time, ms
    "O_T_EE": (("<f4", 16), 8),  # column-major
    "tau_J": (("<f4", 7), 512),
    "tau_J_d": (("<f4", 7), 540),
    "dtau_J": (("<f4", 7), 568),
    "q": (("<f4", 7), 596),
    "dq": (("<f4", 7), 652),
    "tau_ext_hat_filtered": (("<f4", 7), 840),
    "O_F_ext_hat_K": (("<f4", 6), 868),
    "theta": (("<f4", 7), 1088),
    "dtheta": (("<f4", 7), 1116),
    "errors": (("u1", 41), 1290),
    "robot_mode": ("u1", 1372),
    "control_command_success_rate": ("<f4", 1373),
}
DATAGRAM = np.dtype(
    {
        "names": list(_PLACES),
        "formats": [kind for kind, _ in _PLACES.values()],
        "offsets": [offset for _, offset in _PLACES.values()],
        "itemsize": 1377,
    }
)
BYTES = DATAGRAM.itemsize


@compiled
def unpack(datagrams, size, states, number):
    """Write datagrams[0], of so many bytes, to states[0], of ARM_STATE; return its robot mode.

    -1, and nothing is written, for one that is not state `number`, of another layout, or of a robot with errors.
    """
    told = datagrams[0]
    if size != BYTES or told.message_id != number:
        return -1
    for i in range(41):
        if told.errors[i] != 0:
            return -1
    state = states[0]
    state.t_ns = number * 1_000_000
    for i in range(7):
        state.q[i] = told.q[i]
        state.dq[i] = told.dq[i]
        state.tau_J[i] = told.tau_J[i]
        state.tau_J_d[i] = told.tau_J_d[i]
        state.dtau_J[i] = told.dtau_J[i]
        state.theta[i] = told.theta[i]
        state.dtheta[i] = told.dtheta[i]
        state.tau_ext_hat_filtered[i] = told.tau_ext_hat_filtered[i]
    for i in range(4):
        for j in range(4):
            state.O_T_EE[i, j] = told.O_T_EE[4 * j + i]
    for i in range(6):
        state.O_F_ext_hat_K[i] = told.O_F_ext_hat_K[i]
    state.control_command_success_rate = told.control_command_success_rate
    state.robot_mode = told.robot_mode
    state.current_errors = 0
    return int(told.robot_mode)
