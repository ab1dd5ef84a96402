"""What a log keeps of a fault: the reason, the last second, the QP without an answer, the controller's traceback."""

from io import BytesIO
from typing import Any

import numpy as np

from rtstack.log.job import Attachment, Evidence
from rtstack.loop.fault import FailedQp, Fault
from rtstack.loop.history import Columns
from rtstack.samples import QpSolver

BEFORE_NS, AFTER_NS = 1_000_000_000, 100_000_000  # of the last second: the fault's tick, and how the stop begins
_NPZ = "application/x-npz"


def evidence_of(fault: Fault, columns: Columns, solver: QpSolver) -> Evidence:
    """Return what the log keeps of a fault. columns: what the run has published, whatever the rings have lost of it.

    last_second.npz: arm and control (2, n), timing (n,) and object (m,), records of rtstack.samples, and t_ns, the
    fault's. qp.npz: min 1/2 x^T H x + g^T x, lower <= x <= upper, tau_lower <= M x <= tau_upper, x (7,) rad/s^2.
    """
    attachments = [Attachment("last_second.npz", _NPZ, _last_second(fault.t_ns, columns))]
    if fault.qp is not None:
        attachments.append(Attachment("qp.npz", _NPZ, _qp(fault.qp, solver)))
    if fault.traceback:
        attachments.append(Attachment("traceback.txt", "text/plain", fault.traceback.encode()))
    trip = fault.trip
    record = {
        "end": str(trip.end),
        "detail": trip.detail,
        "side": trip.side,
        "joint": str(trip.joint or ""),
        "value": "" if np.isnan(trip.value) else repr(trip.value),
        "bound": "" if np.isnan(trip.bound) else repr(trip.bound),
        "t_ns": str(fault.t_ns),
        "reaction_ticks": "" if fault.reaction_ticks is None else str(fault.reaction_ticks),
        "evidence": ", ".join(attachment.name for attachment in attachments),
    }
    return Evidence(record, tuple(attachments))


def _last_second(t_ns: int, columns: Columns) -> bytes:
    def near(times: Any) -> Any:
        return (times >= t_ns - BEFORE_NS) & (times <= t_ns + AFTER_NS)

    rows = near(columns.timing["t_ns"])
    return _npz(
        arm=columns.arm[:, rows],
        control=columns.control[:, rows],
        timing=columns.timing[rows],
        object=columns.object[near(columns.object["t_ns"])],
        t_ns=t_ns,
    )


def _qp(qp: FailedQp, solver: QpSolver) -> bytes:
    problem = qp.problem[0]
    return _npz(
        H=problem["H"], g=problem["gradient"], lower=problem["lower"], upper=problem["upper"], M=problem["M"],
        tau_lower=problem["tau_lower"], tau_upper=problem["tau_upper"], x=problem["ddq"], side=qp.side,
        status=qp.status.name, iterations=qp.iterations, solver=str(solver),
    )  # fmt: skip


def _npz(**arrays: Any) -> bytes:
    file = BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
