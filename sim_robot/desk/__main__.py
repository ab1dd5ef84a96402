"""Desk of the boxes, started by the process that serves their FCI (sim_robot.desk.process), and ended with it.

python -m sim_robot.desk FLAGS_DESCRIPTOR PORT SELF_TEST_DUE_S SIDE=ADDRESS...    in the order of the flags
"""

import sys
import threading

from sim_robot.desk.box import DeskBox
from sim_robot.desk.process import flags_at
from sim_robot.desk.server import DeskServer


def main() -> int:
    """Serve until standard input ends. Returns 2 where it cannot listen."""
    descriptor, port, self_test_due_s, *boxes = sys.argv[1:]
    flags = flags_at(int(descriptor))
    for number, named in enumerate(boxes):
        side, _, address = named.partition("=")
        box = DeskBox(flags[number], f"simulated-{side}", float(self_test_due_s))
        try:
            server = DeskServer(address, int(port), box)
        except OSError as error:
            print(f"Desk cannot listen at {address}:{port}: {error.strerror}", flush=True)
            return 2
        threading.Thread(target=server.serve_forever, daemon=True).start()
    print("serving", flush=True)
    sys.stdin.read()
    return 0


if __name__ == "__main__":
    sys.exit(main())
