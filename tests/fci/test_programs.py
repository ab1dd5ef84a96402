"""Unmodified client programs, as their authors' examples go; why franky-control at full dynamics ends in reflexes."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

from hal.robots import FR3
from tests.support.fci.client import program_path
from tests.support.fci.server import Served


@pytest.mark.parametrize(
    "program", [pytest.param("aiofranka", marks=pytest.mark.long), "franka_rs", "franky_motions", "pylibfranka"]
)
def test_a_program_runs_through(lockstep: Served, program: str) -> None:
    path = program_path(program)
    finished = subprocess.run(
        [sys.executable, str(path), lockstep.left], capture_output=True, text=True, timeout=120, check=False
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr


PROGRAM = program_path("franky_limits")
# libfranka, rate_limiting.h, for the FR3
FR3_TRANSLATION, FR3_ROTATION = 9.0, 17.0


def franky(address: str, *arguments: str) -> str:
    command = [sys.executable, str(PROGRAM), address, *arguments]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout.strip()


def smallest_joint_acceleration(q: np.ndarray, direction: np.ndarray) -> float:
    """Smallest largest joint acceleration, rad/s^2, for 1 m/s^2 from rest along a direction (3,) of the flange's."""
    model = pin.buildModelFromXML(FR3.urdf)
    data = model.createData()
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId("link8"), pin.LOCAL)
    bound = np.ones((7, 1))
    solved = linprog(
        np.r_[np.zeros(7), 1.0],
        A_eq=np.c_[J, np.zeros(6)],
        b_eq=np.r_[direction, np.zeros(3)],
        A_ub=np.block([[np.eye(7), -bound], [-np.eye(7), -bound]]),
        b_ub=np.zeros(14),
        bounds=[(None, None)] * 7 + [(0.0, None)],
    )
    assert solved.success
    return solved.fun


def test_frankys_limits_are_not_the_fr3s(lockstep: Served) -> None:
    translation, rotation, *joints = (float(word) for word in franky(lockstep.left, "limits").split())
    assert translation > FR3_TRANSLATION
    assert rotation > FR3_ROTATION
    assert (np.array(joints) > FR3.limits.ddq_max).sum() >= 4


@pytest.mark.parametrize(("share", "said"), [(0.2, "arrived"), (0.5, "discontinuity"), (1.0, "discontinuity")])
def test_a_pose_that_needs_more_of_the_joints_than_they_may(lockstep: Served, share: float, said: str) -> None:
    """5 cm along the flange's x axis; the simulated robot stops at twice what is published."""
    outcome = franky(lockstep.left, "pose", str(share))
    assert said in outcome
    q = np.array([float(word) for word in outcome.split("|")[1].split()])
    needed = share * float(outcome.split("|")[2]) * smallest_joint_acceleration(q, np.array([1.0, 0.0, 0.0]))
    assert (needed < FR3.limits.ddq_max[0]) == (said == "arrived")
