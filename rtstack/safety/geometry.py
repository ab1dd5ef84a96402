"""Where an arm is and how far from the other one: compiled, in the memory's own arrays, without allocation.

Fields are indexed by name, as plain Python can too: so the tests run and mutate the very source that is compiled.
"""

import math

from hal.compilation import compiled
from rtstack.safety.body import LINKS


@compiled
def place_arm(q, dq, rule, memory):
    """Write face_world, face_velocity and ends_world of the arm at q (7,) rad, dq (7,) rad/s."""
    turn, following, place = memory["turn"], memory["next"], memory["place"]
    for a in range(3):
        place[a] = rule["base_position"][a]
        for b in range(3):
            turn[a, b] = rule["base_rotation"][a, b]
    for link in range(LINKS):
        if link > 0:
            _next_joint(q[link - 1], link - 1, rule, memory, turn, following, place)
        for c in range(rule["first"][link], rule["first"][link + 1]):
            for end in range(2):
                _point(rule["ends"][c, end], turn, place, memory["ends_world"][c, end])
    _point(rule["face"], turn, place, memory["face_world"])
    face, velocity = memory["face_world"], memory["face_velocity"]
    for a in range(3):
        velocity[a] = 0.0
    for j in range(7):
        axis, origin = memory["axes"][j], memory["origins"][j]
        x, y, z = face[0] - origin[0], face[1] - origin[1], face[2] - origin[2]
        velocity[0] += dq[j] * (axis[1] * z - axis[2] * y)
        velocity[1] += dq[j] * (axis[2] * x - axis[0] * z)
        velocity[2] += dq[j] * (axis[0] * y - axis[1] * x)
    memory["placed"] = 1


@compiled
def _next_joint(angle, j, rule, memory, turn, following, place):
    """Go on from one link's frame to the next one's: translation, fixed rotation, then `angle` about z."""
    sine, cosine = math.sin(angle), math.cos(angle)
    _point(rule["translation"][j], turn, place, place)
    fixed = rule["rotation"][j]
    for a in range(3):
        for b in range(3):
            following[a, b] = turn[a, 0] * fixed[0, b] + turn[a, 1] * fixed[1, b] + turn[a, 2] * fixed[2, b]
    for a in range(3):
        turn[a, 0] = cosine * following[a, 0] + sine * following[a, 1]
        turn[a, 1] = cosine * following[a, 1] - sine * following[a, 0]
        turn[a, 2] = following[a, 2]
        memory["axes"][j, a] = following[a, 2]
        memory["origins"][j, a] = place[a]


@compiled
def _point(local, turn, place, out):
    """Write a point of the present link's frame in the world's to `out`, which may be `place` itself."""
    for a in range(3):
        out[a] = place[a] + turn[a, 0] * local[0] + turn[a, 1] * local[1] + turn[a, 2] * local[2]


@compiled
def segment_distance(a, b, c, d):
    """Return the distance of segments a b and c d, none a point (Ericson, Real-Time Collision Detection, 5.1.9)."""
    uu = uv = vv = ur = vr = 0.0
    for k in range(3):
        u, v, r = b[k] - a[k], d[k] - c[k], a[k] - c[k]
        uu += u * u
        uv += u * v
        vv += v * v
        ur += u * r
        vr += v * r
    square = uu * vv - uv * uv
    s = 0.0  # parallel: any point will do to begin with
    if square > 1e-12 * uu * vv:
        s = min(max((uv * vr - ur * vv) / square, 0.0), 1.0)
    t = (uv * s + vr) / vv
    if t < 0.0:
        t = 0.0
        s = min(max(-ur / uu, 0.0), 1.0)
    elif t > 1.0:
        t = 1.0
        s = min(max((uv - ur) / uu, 0.0), 1.0)
    total = 0.0
    for k in range(3):
        gap = a[k] + s * (b[k] - a[k]) - c[k] - t * (d[k] - c[k])
        total += gap * gap
    return math.sqrt(total)


@compiled
def arm_distance(mine, other, rule, enough):
    """Return the smallest distance of two capsules, one of each arm, or `enough` where none is closer."""
    closest = enough
    for i in range(rule["first"][LINKS]):
        a, b = mine["ends_world"][i, 0], mine["ends_world"][i, 1]
        for j in range(rule["other_capsules"]):
            c, d = other["ends_world"][j, 0], other["ends_world"][j, 1]
            # twice the distance of the middles; most pairs are too far apart to matter
            x, y, z = a[0] + b[0] - c[0] - d[0], a[1] + b[1] - c[1] - d[1], a[2] + b[2] - c[2] - d[2]
            near = 2.0 * (rule["reach"][i] + rule["other_reach"][j] + closest)
            if x * x + y * y + z * z < near * near:
                closest = min(closest, segment_distance(a, b, c, d) - rule["radius"][i] - rule["other_radius"][j])
    return closest
