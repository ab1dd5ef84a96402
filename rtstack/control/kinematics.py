"""Pose, twist and Jacobian of the pad's face from the model's arrays at the world's origin."""

from hal.compilation import compiled


@compiled
def end_effector(work, J0, dJ0, R7, p7, face, R_joint_ee, dq):
    """Write position, rotation, J (6, 7), twist and dJ dq (6,) of the end effector, along the world's axes (1)-(2).

    The classical acceleration at zero ddq: a = dv0 + alpha x p + w x v, with dv0 and alpha of the point of the body
    at the world's origin.
    """
    for i in range(3):
        work.position[i] = p7[i] + R7[i, 0] * face[0] + R7[i, 1] * face[1] + R7[i, 2] * face[2]
        for j in range(3):
            work.rotation[i, j] = (
                R7[i, 0] * R_joint_ee[0, j] + R7[i, 1] * R_joint_ee[1, j] + R7[i, 2] * R_joint_ee[2, j]
            )
    x = work.position[0]
    y = work.position[1]
    z = work.position[2]
    for i in range(6):
        work.twist[i] = 0.0
        work.dJdq[i] = 0.0
    for k in range(7):
        wx = J0[3, k]
        wy = J0[4, k]
        wz = J0[5, k]
        work.J[0, k] = J0[0, k] + wy * z - wz * y
        work.J[1, k] = J0[1, k] + wz * x - wx * z
        work.J[2, k] = J0[2, k] + wx * y - wy * x
        work.J[3, k] = wx
        work.J[4, k] = wy
        work.J[5, k] = wz
        for i in range(6):
            work.twist[i] += work.J[i, k] * dq[k]
            work.dJdq[i] += dJ0[i, k] * dq[k]
    a = work.dJdq
    v = work.twist
    ax = a[0] + (a[4] * z - a[5] * y) + (v[4] * v[2] - v[5] * v[1])
    ay = a[1] + (a[5] * x - a[3] * z) + (v[5] * v[0] - v[3] * v[2])
    az = a[2] + (a[3] * y - a[4] * x) + (v[3] * v[1] - v[4] * v[0])
    a[0] = ax
    a[1] = ay
    a[2] = az
