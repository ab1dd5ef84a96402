"""The vendor's recovery of one arm, in a process of its own: it lasts up to 12 s, and libfranka keeps its process.

    python -m hal.fci.recovery ADDRESS

Exit status 0: recovered; 1: the robot refused, with its words on stdout; 2: it could not be asked.
"""

import subprocess
import sys

import pylibfranka as franka

from hal.fci.faults import VENDOR

DONE, REFUSED, LOST = 0, 1, 2
LONGEST_S = 25.0  # twice the longest that is published (GitHub, franka_ros issue 308)


def begin(address: str) -> "subprocess.Popen[str]":
    """Ask the arm at an address, to which no other client is connected."""
    return subprocess.Popen(
        [sys.executable, "-m", "hal.fci.recovery", address],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip


def end(process: "subprocess.Popen[str]") -> tuple[int, str]:
    """Wait for the end, without Python's lock; return the exit status and what the robot said."""
    try:
        said, _ = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return LOST, f"no answer within {LONGEST_S:g} s"
    return process.returncode, said.strip()


def main() -> int:
    try:
        franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore).automatic_error_recovery()
    except VENDOR as error:
        print(" ".join(str(error).removeprefix("libfranka: ").split()))
        return REFUSED if isinstance(error, franka.CommandException) else LOST
    return DONE


if __name__ == "__main__":
    sys.exit(main())
