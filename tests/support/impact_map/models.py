"""Ten robots of other people as chains of rods, MJCF and URDF from the same published numbers; no file is copied.

Every link is a cylinder from its joint to the next one. Lengths and masses are of data sheets; where a sheet gives the
mass of the whole robot only, it is spread over the links by their length.
"""

from dataclasses import dataclass

import numpy as np

TIP = 0.01  # m: radius of the sphere at the end of the last link
DT = 1e-5  # s, of MuJoCo's step
IMPEDANCE = 0.9999  # the largest that MuJoCo takes
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Link:
    """A link: its joint's axis and armature kg m^2, where it ends (from its joint) m, mass kg, radius m."""

    axis: tuple[float, float, float]
    end: tuple[float, float, float]
    mass: float
    radius: float
    armature: float = 0.0

    @property
    def centre(self):
        return np.array(self.end) / 2.0

    @property
    def inertia(self):
        """Return the inertia (3, 3) of a solid cylinder about its centre."""
        length = np.linalg.norm(self.end)
        u = np.array(self.end) / length
        across = self.mass * (3.0 * self.radius**2 + length**2) / 12.0
        return across * np.eye(3) + (self.mass * self.radius**2 / 2.0 - across) * np.outer(u, u)


def spread(mass, radius, *links, armature=0.0):
    """Return links (axis, end) that share a mass by their length."""
    lengths = [np.linalg.norm(end) for _, end in links]
    return tuple(
        Link(axis, end, float(mass * length / sum(lengths)), radius, armature)
        for (axis, end), length in zip(links, lengths, strict=True)
    )


def up(length, side=0.0):
    return (side, 0.0, length)


# name: links, configuration in which they hit, rad
MODELS = {
    # Universal Robots, "DH parameters for calculations of kinematics and dynamics": UR5e
    "UR5e": (
        (Link(Z, up(0.1625), 3.761, 0.06, 0.1), Link(Y, up(0.425), 8.058, 0.06, 0.1),
         Link(Y, up(0.3922), 2.846, 0.05, 0.1), Link(Y, (0.0, 0.1333, 0.0), 1.37, 0.04), Link(Z, up(0.0997), 1.3, 0.04),
         Link(Y, (0.0, 0.0996, 0.0), 0.365, 0.04)),
        (0.3, 0.9, 1.1, -0.5, 0.4, 0.2),
    ),
    # KUKA, LBR iiwa 14 R820, technical data: 29.9 kg; 0.36, 0.42, 0.4, 0.126 m
    "LBR iiwa 14": (
        spread(29.9, 0.06, (Z, up(0.18)), (Y, up(0.18)), (Z, up(0.21)), (Y, up(0.21)), (Z, up(0.2)), (Y, up(0.2)),
               (Z, up(0.126)), armature=0.1),
        (0.2, 0.6, 0.1, -1.4, 0.3, 0.8, 0.5),
    ),
    # Franka Emika Panda: DH of the FCI documentation; masses of Gaz et al., RA-L 2019
    "Panda": (
        (Link(Z, up(0.333), 4.97, 0.06), Link(Y, up(0.158), 0.646, 0.06), Link(Z, up(0.158, 0.0825), 3.228, 0.06),
         Link(Y, up(0.192, -0.0825), 3.587, 0.05), Link(Z, up(0.192), 1.225, 0.05),
         Link(Y, up(0.088), 1.666, 0.05), Link(Z, up(0.107), 0.735, 0.04)),
        (-0.5, 0.1, 0.0, -2.3, 0.4, 1.8, 1.0),
    ),
    # Kinova Gen3, user guide: 8.2 kg; 0.2848, 0.4208, 0.3143, 0.1674 m
    "Gen3": (
        spread(8.2, 0.045, (Z, up(0.1564)), (Y, up(0.1284)), (Z, up(0.2104)), (Y, up(0.2104)), (Z, up(0.2084)),
               (Y, up(0.1059)), (Z, up(0.1674))),
        (0.1, 0.7, -0.2, 1.2, 0.3, -0.6, 0.4),
    ),
    # UFACTORY xArm 7, user manual: 13.7 kg; 0.267, 0.293, 0.0525, 0.3425, 0.0775, 0.076, 0.097 m
    "xArm7": (
        spread(13.7, 0.05, (Z, up(0.267)), (Y, up(0.1465)), (Z, up(0.1465, 0.0525)), (Y, up(0.17, 0.0775)),
               (Z, up(0.1725)), (Y, up(0.04, 0.076)), (Z, up(0.097))),
        (0.2, 0.5, 0.3, 1.3, -0.2, 0.9, 0.1),
    ),
    # Unitree Go1, published parameters: 0.08, 0.213, 0.213 m; 0.591, 0.92, 0.131 kg
    "Go1 leg": (
        (Link(X, (0.0, 0.08, 0.0), 0.591, 0.04), Link(Y, up(-0.213), 0.92, 0.02), Link(Y, up(-0.213), 0.131, 0.01)),
        (0.2, 0.7, -1.4),
    ),
    # Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, planar elbow arm with unit links
    "planar 2R": ((Link(Y, up(1.0), 1.0, 0.05), Link(Y, up(1.0), 1.0, 0.05)), (0.6, 0.9)),
    # the acrobot of Spong, "The swing up control problem for the acrobot", 1995: 1 and 2 m, 1 and 1 kg
    "double pendulum": ((Link(Y, up(-1.0), 1.0, 0.02), Link(Y, up(-2.0), 1.0, 0.02)), (0.4, -0.7)),
    # Epson LS6-B602S, data sheet: 0.325 and 0.275 m, 17 kg
    "SCARA": (
        (Link(Z, (0.325, 0.0, 0.0), 7.0, 0.06, 0.05), Link(Z, (0.275, 0.0, 0.0), 5.0, 0.05, 0.05),
         Link(Y, up(-0.2), 1.0, 0.01), Link(Z, up(-0.05), 0.3, 0.02)),
        (0.4, 0.8, 0.1, 0.0),
    ),
    # SoftBank NAO H25, documentation of its links: 0.105, 0.05595, 0.05775 m
    "NAO arm": (
        (Link(Y, (0.0, 0.015, 0.0), 0.0728, 0.02), Link(Z, (0.105, 0.015, 0.0), 0.1573, 0.02),
         Link(X, (0.02, 0.0, 0.0), 0.0648, 0.02), Link(Z, (0.03595, 0.0, 0.0), 0.0777, 0.02),
         Link(X, (0.05775, 0.0, 0.0), 0.1853, 0.02)),
        (0.4, 0.2, -0.5, -0.8, 0.3),
    ),
}  # fmt: skip


def mjcf(links, surroundings="", friction=0.5):
    """Return the robot with a sphere at its tip, and what is around it. A step of it is a plastic impact."""
    tree, closing, start = "", "", (0.0, 0.0, 0.0)
    for k, link in enumerate(links):
        tree += (
            f'<body name="link{k}" pos="{_text(start)}"><joint type="hinge" axis="{_text(link.axis)}" '
            f'armature="{link.armature!r}"/><inertial pos="{_text(link.centre)}" mass="{link.mass!r}" '
            f'fullinertia="{_text(_six(link))}"/>'
        )
        closing, start = closing + "</body>", link.end
    tree += f'<geom name="tip" type="sphere" size="{TIP}" pos="{_text(start)}" mass="0" contype="2" conaffinity="1"/>'
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{DT}" gravity="0 0 0" cone="elliptic" jacobian="dense" '
        f'tolerance="1e-15" iterations="300" ls_iterations="100"/><default><geom friction="{friction} 0 0" '
        f'solref="-1e-9 {-IMPEDANCE / DT}" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"/></default><worldbody>{tree}'
        f"{closing}{surroundings}</worldbody></mujoco>"
    )


def urdf(links):
    """Return the robot as a URDF, whose link "tip" is the end of the last one."""
    text, start = '<robot name="chain"><link name="base"/>', (0.0, 0.0, 0.0)
    for k, link in enumerate(links):
        names = dict(zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), _six(link), strict=True))
        inertia = " ".join(f'{name}="{float(value)!r}"' for name, value in names.items())
        parent = f"link{k - 1}" if k else "base"
        text += (
            f'<link name="link{k}"><inertial><origin xyz="{_text(link.centre)}" rpy="0 0 0"/>'
            f'<mass value="{link.mass!r}"/><inertia {inertia}/></inertial></link>'
            f'<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>'
            f'<origin xyz="{_text(start)}" rpy="0 0 0"/><axis xyz="{_text(link.axis)}"/>'
            f'<limit lower="-7" upper="7" effort="100" velocity="10"/></joint>'
        )
        start = link.end
    last = len(links) - 1
    return text + (
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="link{last}"/><child link="tip"/>'
        f'<origin xyz="{_text(start)}" rpy="0 0 0"/></joint></robot>'
    )


def _six(link):
    """Return xx, yy, zz, xy, xz, yz of a link's inertia."""
    return link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _text(values):
    return " ".join(repr(float(value)) for value in values)
