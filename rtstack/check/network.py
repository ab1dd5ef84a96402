"""Whether the arms answer at their addresses, and by which interface of this machine."""

import ipaddress
import socket
from pathlib import Path

import psutil

from hal.errors import HardwareError, NoGripper
from rtstack.check.finding import Finding, finding

FCI_PORT = 1337  # libfranka, research_interface/robot/service_types.h: kCommandPort
_PATIENCE_S = 3.0
_GIGABIT = 1000
_NET = Path("/sys/class/net")


def arm_finding(name: str, address: str) -> Finding:
    """Say whether something accepts a connection where the arm should."""
    try:
        with socket.create_connection((address, FCI_PORT), _PATIENCE_S):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        advice = "switch it on, unlock its joints, activate FCI (`rtstack desk start`); check cable and addresses"
        return Finding(name, f"{address}: {reason}", "fail", advice, "no arm, no motion")
    return Finding(name, f"{address} answers", "pass")


def gripper_finding(name: str, address: str) -> Finding:
    """Say whether a hand answers at an arm's address. None is as good: the stack needs no gripper."""
    from hal.fci.gripper import ask_for_gripper  # and with it pylibfranka, which a check of the host does without

    try:
        return Finding(name, f"a Franka Hand answers, version {ask_for_gripper(address)}", "pass")
    except NoGripper:
        return Finding(name, "none is mounted", "pass")
    except HardwareError as error:
        return Finding(name, str(error), "pass")


def interface_finding(name: str, address: str) -> Finding:
    """Say which interface leads to an address, and whether anything is wrong with it. The address may be a name."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((address, FCI_PORT))  # of a datagram's socket: asks for the way, and sends nothing
            here = probe.getsockname()[0]
    except OSError as error:
        return Finding(name, f"no way to {address}: {error.strerror or error}", "fail",
                       "sudo rtstack host-setup --nic NAME=ADDR/PREFIX", "no arm, no motion")  # fmt: skip
    nic = next((n for n, all_ in psutil.net_if_addrs().items() if any(a.address == here for a in all_)), "unknown")
    if ipaddress.ip_address(here).is_loopback:
        return Finding(name, f"{nic}: on this machine", "pass")
    complaints, state = [], psutil.net_if_stats().get(nic)
    if (_NET / nic / "wireless").exists():
        complaints.append("wireless")
    elif state is not None and 0 < state.speed < _GIGABIT:
        complaints.append(f"{state.speed} Mbit/s")
    routes = [line.split() for line in Path("/proc/net/route").read_text().splitlines()[1:]]
    if nic in {row[0] for row in routes if len(row) > 1 and row[1] == "00000000"}:
        complaints.append("shared with everything else (it has the default route)")
    return finding(name, f"{nic}, {here}" + "".join(f", {c}" for c in complaints), not complaints,
                   "packets come late or in bursts", "a cable of its own from this PC to the control box")  # fmt: skip
