"""A process that has imported and compiled what a server needs, and forks one for each request on a socket.

Run by fci_server with the socket's descriptor. A request: the arguments of `rtstack sim` as JSON, and the
descriptor that the server is to print to. The answer: the server's process id. When the socket closes, all end.
"""

import contextlib
import ctypes
import json
import os
import signal
import socket
import sys
import traceback

from rtstack.cli.app import app
from sim_robot.cell import simulated_cell
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.server import Server
from sim_robot.plant_parameters import load_plant_parameters

PR_SET_PDEATHSIG = 1  # linux/prctl.h
LARGEST_REQUEST = 1 << 16


def warm_up(left: str, right: str) -> None:
    """Load all compiled code."""
    cell = simulated_cell("rice_box", 0.0, 0, box_kind=DrivenBox)
    server = Server(cell, load_plant_parameters(), (left, right))
    server.advance()
    server.close()


def become_server(arguments: list[str], output: int) -> None:
    """In the fork: serve until SIGTERM. Never returns."""
    status = 1
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        with open(output, "w") as out, contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            try:
                status = app(["sim", *arguments], standalone_mode=False) or 0
            except Exception:
                traceback.print_exc()
    finally:
        os._exit(status)


def main(descriptor: int, left: str, right: str) -> None:
    """Fork until the other end closes."""
    warm_up(left, right)
    with socket.socket(fileno=descriptor) as requests:
        while True:
            request, outputs, *_ = socket.recv_fds(requests, LARGEST_REQUEST, 1)
            if not request:
                return
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    continue
            number = os.fork()
            if number == 0:
                requests.close()
                become_server(json.loads(request), outputs[0])
            os.close(outputs[0])
            requests.sendall(str(number).encode())


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
