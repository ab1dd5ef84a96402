"""Which reference counts now: the references of (22), (24), (27), (28) and (31) as one setpoint an arm."""

from hal.compilation import compiled
from rtstack.model.rotation import exp_so3, log_so3, multiply, transpose_multiply


@compiled
def copy_point(point, setpoint):
    """Ask for a point of a reference as it is."""
    for i in range(3):
        setpoint.position[i] = point.position[i]
        for j in range(3):
            setpoint.rotation[i, j] = point.rotation[i, j]
    for i in range(6):
        setpoint.twist[i] = point.twist[i]
        setpoint.wrench_ff[i] = point.wrench_ff[i]
    setpoint.xi = point.xi
    setpoint.dxi = point.dxi
    setpoint.beta = point.beta


@compiled
def blend_points(ante, post, gamma, setpoint, work):
    """Interim mode: ante-impact references at gamma = 0, post-impact ones at gamma = 1, (27), (28), (31).

    The velocity reference is the post-impact one: with the weight gamma, gamma (v_p - v) is what (27) asks for.
    """
    for i in range(3):
        setpoint.position[i] = (1.0 - gamma) * ante.position[i] + gamma * post.position[i]
    transpose_multiply(ante.rotation, post.rotation, work.relative)
    log_so3(work.relative, work.three)
    exp_so3(work.three, gamma, work.turn)
    multiply(ante.rotation, work.turn, setpoint.rotation)
    for i in range(6):
        setpoint.twist[i] = post.twist[i]
        setpoint.wrench_ff[i] = (1.0 - gamma) * ante.wrench_ff[i] + gamma * post.wrench_ff[i]
    setpoint.xi = (1.0 - gamma) * ante.xi + gamma * post.xi
    setpoint.dxi = post.dxi
    setpoint.beta = (1.0 - gamma) * ante.beta + gamma * post.beta


@compiled
def choose(setpoints, work, samples, controls, ante, post, index, blend, mode, gamma, velocity_weight):
    """Write setpoints[0] from the points ante[index] and post[index]; blend: 0 ante, 1 interim, 2 post.

    What was chosen in which mode goes to controls[0], with the time of samples[0].
    """
    setpoint = setpoints[0]
    controls[0].t_ns = samples[0].t_ns
    controls[0].mode = mode
    controls[0].gamma = gamma
    if blend == 0:
        copy_point(ante[index], setpoint)
    elif blend == 2:
        copy_point(post[index], setpoint)
    else:
        blend_points(ante[index], post[index], gamma, setpoint, work[0])
    setpoint.velocity_weight = velocity_weight
