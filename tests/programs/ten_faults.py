"""The faults of a client and of contact, in real time, again and again: is each caught in time, by its vendor's name?

python -m tests.programs.ten_faults [--rounds 20] [--loops 0]

Each case is that of tests/fci/test_fault_delay.py, against a server that keeps the clock instead of lockstep: the
reflex within two cycles of its condition (20 lost packets and two cycles for a stall), the vendor's error name, a
recovery, and a motion home. --loops: busy loops beside it. A case that fails is shown with what the server says of its
host's stalls: a client that is late on such a host is judged by states that it has not seen. Exit status 1 with one.
The client is a real-time thread where the host permits it.
"""

import argparse
import functools
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from hal.realtime import realtime_thread
from tests.support.fci import fault_delay as delay
from tests.support.fci.server import Served, serve
from tests.support.log.same_log import busy_loops

Case = Callable[[Served], None]
CASES: dict[str, Case] = {
    "NaN": functools.partial(delay.bad_torque, joint=3, values=[np.nan]),
    "Inf": functools.partial(delay.bad_torque, joint=3, values=[np.inf]),
    "200 Nm": functools.partial(delay.bad_torque, joint=1, values=[200.0]),
    "alternating 40 Nm": functools.partial(delay.bad_torque, joint=2, values=[40.0, -40.0]),
    "stall of 25 ms": functools.partial(delay.stalling_client, stall_ms=25),
    "stall of 300 ms": functools.partial(delay.stalling_client, stall_ms=300),
    "overspeed, stepped": functools.partial(delay.joint_too_fast, nm_per_ms=0.9),
    "overspeed, ramped": functools.partial(delay.joint_too_fast, nm_per_ms=0.05),
    "joint limit, stepped": functools.partial(
        delay.push_into_joint_limit,
        rad_per_ms=2e-3,
        condition=delay.too_fast,
        name="joint_velocity_violation",
    ),
    "joint limit, ramped": functools.partial(
        delay.push_into_joint_limit,
        rad_per_ms=1e-5,
        condition=delay.beyond,
        name="joint_position_limits_violation",
    ),
    "contact": delay.contact_above_threshold,
    "self-collision": delay.self_collision,
}


def tried(case: Case) -> tuple[str, list[str]]:
    """What went wrong, empty if nothing, and what the server said at its end."""
    with ExitStack() as stack:
        served = stack.enter_context(serve())
        try:
            with realtime_thread():  # not around the server, which is to have a CPU of its own
                case(served)
            wrong = ""
        except Exception as error:  # each has a row of the table
            place = traceback.extract_tb(error.__traceback__)[-1]
            wrong = f"{type(error).__name__}: {error}".strip().splitlines()[0] + f" in `{place.line}`"
    return wrong, served.said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--loops", type=int, default=0)
    parser.add_argument("--only", default="", help="a part of the cases' names")
    options = parser.parse_args()
    failed = 0
    print("| fault | caught as it should be | else |\n|---|---|---|")
    with busy_loops(options.loops):
        for name, case in CASES.items():
            if options.only not in name:
                continue
            others = []
            for _ in range(options.rounds):
                wrong, said = tried(case)
                if wrong:
                    others.append((wrong, said))
            failed += len(others)
            said = "; ".join(f"{wrong} [{' / '.join(lines[:2] + lines[3:])}]" for wrong, lines in others)
            print(f"| {name} | {options.rounds - len(others)} of {options.rounds} | {said} |", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (KeyboardInterrupt, subprocess.SubprocessError):
        sys.exit(130)
