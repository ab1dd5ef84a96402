"""The steps in which nothing moves: this PC, the connection, Desk, what the box reads back, the arm at rest."""

import json
import os
import resource
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from contextlib import closing
from importlib.metadata import version
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pylibfranka as franka

from hal.desk import Desk, Trust
from hal.errors import HardwareError, NoGripper
from hal.fci import FciArm, ask_for_urdf, limits_in
from hal.fci.gripper import ask_for_gripper
from hal.fci.setup import configure, tell_collisions
from hal.wire import VERSION
from rtstack.cells.fci import approach_collisions, pad_tools
from rtstack.check.arm import RESTING_NM
from rtstack.check.host import host_findings
from rtstack.trials.provenance import git_commit, host_report, package_versions
from rtstack.trials.tightening import difference_of_limits
from tests.support.hour import figures
from tests.support.hour.lab import Found, Lab, Skipped, say

_COLD = """
import sys, time
from pathlib import Path
from rtstack.cells import load_description
from rtstack.control.modes import Strategy
from rtstack.trials.assembly import cell_controller, cell_parameters, following
description = load_description(Path(sys.argv[1]), sys.argv[2])[0]
began = time.perf_counter()
cell_controller(description, cell_parameters(description), following(Strategy.PROPOSED), 0.0)
print(time.perf_counter() - began)
"""
COMPILE_S = 60.0  # some thirty on two processors
CONNECTIONS = 3
READ_BACK_STATES = 200
ESTIMATE_N = 9.0  # rtstack.trials.estimate: above it a trial is refused


def host(lab: Lab) -> Found:
    """Versions, what this PC allows, and how long the first run compiles."""
    found = Found()
    found.figures["versions"] = package_versions() | {"libfranka": version("pylibfranka"), "commit": git_commit()}
    found.figures["host"] = host_report() | {
        "rtprio_limit": list(resource.getrlimit(resource.RLIMIT_RTPRIO)),
        "memlock_limit": list(resource.getrlimit(resource.RLIMIT_MEMLOCK)), "load": list(os.getloadavg()),
    }  # fmt: skip
    for finding in host_findings():
        found.claim(f"PC: {finding.name}", "pass", f"{finding.verdict}: {finding.value}", finding.verdict == "pass")
    say("compiling the controller into an empty folder, as on a new PC ...")
    times = []
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-c", _COLD, str(lab.cell_file), lab.kind]
        for _ in range(2):
            done = subprocess.run(
                command, env=os.environ | {"NUMBA_CACHE_DIR": folder}, capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise HardwareError(f"the controller was not compiled: {done.stderr.strip().splitlines()[-1]}")
            times.append(float(done.stdout))
    found.figures |= {"first_run_s": times[0], "second_run_s": times[1]}
    found.claim("first run compiles", f"{COMPILE_S:g} s at most", f"{times[0]:.1f} s, then {times[1]:.1f} s",
                times[0] <= COMPILE_S)  # fmt: skip
    return found


def connection(lab: Lab) -> Found:
    """Connections in a row, the limits that the box tells, and what libfranka asks of the scheduler."""
    found, times, mode = Found(), list[float](), ""
    urdf = ""
    for _ in range(CONNECTIONS):
        began = time.perf_counter()
        urdf = ask_for_urdf(lab.address)
        times.append(time.perf_counter() - began)
    for _ in range(CONNECTIONS):
        began = time.perf_counter()
        with closing(FciArm(lab.address, None, approach_collisions(lab.description))) as arm:
            times.append(time.perf_counter() - began)
            mode = arm.read().robot_mode.name
    found.figures |= {"connections_s": times, "mode": mode, "server_version": VERSION}
    found.claim("connections one right after the other", f"{2 * CONNECTIONS} of {2 * CONNECTIONS}",
                f"{len(times)}, {max(times):.2f} s at most", True)  # fmt: skip
    _scheduler(found, lab.address)
    own = limits_in(urdf, "the arm")
    told: dict[str, Any] = {name: getattr(own, name) for name in ("q_lower", "q_upper", "dq_max", "tau_max")}
    joints = [joint for joint in ElementTree.fromstring(urdf).iter("joint") if joint.find("limit") is not None][:7]
    laws = [dict(each.attrib) for joint in joints if (each := joint.find("position_based_velocity_limits")) is not None]
    told["position_based_velocity_limits"] = laws
    told["dynamics"] = [dict(each.attrib) for joint in joints if (each := joint.find("dynamics")) is not None]
    told["inertials"] = [
        [element.attrib for element in inertial]
        for link in ElementTree.fromstring(urdf).iter("link") if (inertial := link.find("inertial")) is not None
    ]  # fmt: skip
    found.figures["urdf"] = told
    differs = difference_of_limits(lab.description, (own,))
    found.claim("limits of the box's URDF", "those of hal/robots", differs or "the same", not differs)
    ours = lab.mounting.robot.limits
    ours_law = [*ours.velocity_offset, *ours.deceleration]
    its_law = [float(law.get(key, "nan")) for key in ("velocity_offset", "deceleration_limit") for law in laws]
    same = len(its_law) == len(ours_law) and bool(np.allclose(its_law, ours_law, atol=1e-4))
    found.claim("its velocity limits by position", f"{len(ours_law)} numbers, ours", "the same" if same else
                f"{its_law or 'none'}", same)  # fmt: skip
    return found


def _scheduler(found: Found, address: str) -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    after = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    del robot
    os.sched_setscheduler(0, *before)
    raised = after[0] == os.SCHED_FIFO
    found.figures["scheduler_after_connecting"] = [int(after[0]), int(after[1])]
    found.claim("libfranka raises its thread to FIFO 99", "yes, and rtstack takes it back",
                f"priority {after[1]}" if raised else "refused by this PC, connected all the same", raised)  # fmt: skip


def desk(lab: Lab) -> Found:
    """Read the box's state without user and password."""
    if not lab.mounting.desk:
        raise Skipped("the cell's file names no Desk: write desk = ADDRESS under the arm")
    found, began = Found(), time.perf_counter()
    with closing(Desk(lab.mounting.desk, Trust(), name="box")) as box:
        state = box.state()
    shown = {name: getattr(state, name) for name in ("status", "operating_mode", "brakes", "fci", "self_test",
                                                     "self_test_s", "recovery", "version")}  # fmt: skip
    found.figures |= {"seconds": time.perf_counter() - began, "state": shown, "has_serial": state.serial != "unknown"}
    found.claim("Desk is read without a password", "yes", f"{state.fci}, brakes {state.brakes}", True)
    found.claim("it says its serial number", "yes", "yes" if state.serial != "unknown" else "no",
                state.serial != "unknown")  # fmt: skip
    return found


def settings(lab: Lab) -> Found:
    """Set load, end effector, thresholds and joint impedance; see after how many states they are read back."""
    found, pad = Found(), next(pad for pad in pad_tools(lab.description) if pad is not None)
    robot = franka.Robot(lab.address, franka.RealtimeConfig.kIgnore)
    try:
        before = robot.read_once()
        began = time.perf_counter()
        tell_collisions(robot, approach_collisions(lab.description))
        one_s = time.perf_counter() - began
        began = time.perf_counter()
        configure(robot, pad, approach_collisions(lab.description), "the arm")
        all_s = time.perf_counter() - began
        state, looks = robot.read_once(), 1
        while abs(state.m_ee + state.m_load - pad.mass) >= 1e-3 and looks < READ_BACK_STATES:
            state, looks = robot.read_once(), looks + 1
        carried = state.m_ee + state.m_load
        face = np.reshape(state.F_T_EE, (4, 4)).T
        stiffness = np.reshape(state.EE_T_K, (4, 4)).T
        found.figures |= {
            "one_request_s": one_s, "all_requests_s": all_s, "states_until_read_back": looks,
            "m_ee_kg": state.m_ee, "m_load_kg": state.m_load, "F_x_Cload_m": list(state.F_x_Cload),
            "m_ee_before_kg": before.m_ee, "m_load_before_kg": before.m_load, "O_ddP_O_m_s2": list(before.O_ddP_O),
            "F_T_NE": list(state.F_T_NE), "F_T_EE": face.ravel(), "EE_T_K": stiffness.ravel(),
        }  # fmt: skip
    finally:
        del robot
    off_mm = 1e3 * float(np.abs(face[:3, 3] - pad.F_T_face[:3, 3]).max())
    right = abs(carried - pad.mass) < 1e-3 and off_mm < 0.1 and bool(np.abs(stiffness - np.eye(4)).max() < 1e-5)
    found.claim("load, end effector and K are read back", f"{pad.mass:.3f} kg, the pad's face, K there",
                f"{carried:.3f} kg, {off_mm:.2f} mm off, after {looks} states", right)  # fmt: skip
    tilt = float(np.degrees(np.arccos(np.clip(-before.O_ddP_O[2] / max(np.linalg.norm(before.O_ddP_O), 1e-9), -1, 1))))
    found.claim("gravity, as the box has it", "along -z of its base, 0 deg", f"{tilt:.2f} deg", tilt < 1.0)
    return found


def resting(lab: Lab) -> Found:
    """Read the arm at rest: estimate, noise, drift, states, clock."""
    found = Found()
    rows = lab.idle(lab.ms(20_000, 3000))
    found.figures = {"rest": figures.rest(rows, lab.model), "link": figures.link(rows)}
    found.keep("rest", rows)
    felt = found.figures["rest"]
    force, worst = felt["force_n"], float(np.abs(felt["tau_ext_mean_nm"]).max())
    found.claim("force at rest", f"{ESTIMATE_N:g} N at most", f"{force:.2f} N, drift {felt['force_drift_n']:.2f} N",
                force <= ESTIMATE_N)  # fmt: skip
    found.claim("external torques at rest", f"{RESTING_NM:g} Nm at most", f"{worst:.2f} Nm", worst <= RESTING_NM)
    found.claim("payload, as the estimate explains it", "0.10 kg off at most", f"{felt['payload_off_kg']:+.3f} kg",
                abs(felt["payload_off_kg"]) <= 0.1)  # fmt: skip
    missed = found.figures["link"]["missed"]
    found.claim("states arrive", "every millisecond", f"{missed} of {len(rows)} missed", missed == 0)
    ppm = found.figures["link"].get("clock_ppm")
    found.claim("the box's clock beside this PC's", "within 100 ppm", "-" if ppm is None else f"{ppm:+.0f} ppm",
                None if ppm is None else abs(ppm) <= 100.0)  # fmt: skip
    earlier = lab.folder / "05-rest.json"
    if earlier.exists() and (first := json.loads(earlier.read_text())["figures"].get("rest")):
        moved = float(np.linalg.norm(np.subtract(felt["O_F_ext_mean_n_nm"], first["O_F_ext_mean_n_nm"])[:3]))
        apart = float(np.abs(np.subtract(felt["q_rad"], first["q_rad"])).max())
        found.claim("force at rest, beside that of step 5", "2 N at most", f"{moved:.2f} N, {apart:.2f} rad apart",
                    moved <= 2.0)  # fmt: skip
    return found


def gripper(lab: Lab) -> Found:
    """Ask whether a hand is there, and which version it speaks. Nothing moves."""
    found, began = Found(), time.perf_counter()
    try:
        spoken = ask_for_gripper(lab.address)
    except NoGripper as error:
        raise Skipped(f"no hand: {error}") from None
    found.figures |= {"version": spoken, "seconds": time.perf_counter() - began}
    found.claim("the hand's protocol", "version 3", f"version {spoken}", spoken == 3)
    return found
