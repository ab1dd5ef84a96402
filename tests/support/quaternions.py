"""Quaternions of one sign, made one after another: what the exports are compared with."""

import numpy as np


def of_one_sign(quaternions):
    """Each with the sign of the one before; in the first one the first component of at least 0.25 is positive. Zeros
    are passed over."""
    made, before = [], None
    for q in quaternions:
        if before is None:
            before = np.eye(4)[np.flatnonzero(np.abs(q) >= 0.25 * np.linalg.norm(q))[0]]
        made.append(-q if q @ before < 0 else q)
        before = made[-1] if q.any() else before
    return np.array(made)


def columns_of_one_sign(columns):
    """The columns of a log, by topic, with all quaternions of one sign."""
    columns = {name: records.copy() for name, records in columns.items()}
    for topic, field, first in (
        ("/left/control", "pose_ref", 3), ("/right/control", "pose_ref", 3), ("/object/pose", "orientation_wxyz", 0),
        ("/hand", "asked_left", 3), ("/hand", "asked_right", 3),
    ):  # fmt: skip
        values = columns[topic][field]
        values[:, first : first + 4] = of_one_sign(values[:, first : first + 4])
    return columns


def changes_of_sign(quaternions):
    """How often a quaternion is closer to the negative of the one before."""
    return int((np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) < 0).sum())
