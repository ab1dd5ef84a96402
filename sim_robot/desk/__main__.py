"""`python -m sim_robot.desk`: Desk of the boxes, started by the process that serves their FCI, and ended with it."""

import argparse
import sys
import threading

from sim_robot.desk.box import SELF_TEST_EVERY_S, DeskBox
from sim_robot.desk.process import flags_at
from sim_robot.desk.server import DeskServer


def main() -> int:
    """Serve until standard input ends. Returns 2 where it cannot listen."""
    parser = argparse.ArgumentParser(prog="sim_robot.desk")
    parser.add_argument("--flags", type=int, required=True, help="descriptor of sim_robot.desk.process")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--self-test-due-s", type=float, default=SELF_TEST_EVERY_S)
    parser.add_argument("boxes", nargs="+", metavar="SIDE=ADDRESS", help="in the order of the flags")
    options = parser.parse_args()
    flags = flags_at(options.flags)
    for number, named in enumerate(options.boxes):
        side, _, address = named.partition("=")
        box = DeskBox(flags[number], f"simulated-{side}", options.self_test_due_s)
        try:
            server = DeskServer(address, options.port, box)
        except OSError as error:
            print(f"Desk cannot listen at {address}:{options.port}: {error.strerror}", flush=True)
            return 2
        threading.Thread(target=server.serve_forever, daemon=True).start()
    print("serving", flush=True)
    sys.stdin.read()
    return 0


if __name__ == "__main__":
    sys.exit(main())
