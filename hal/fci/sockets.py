"""The sockets of this process. libfranka has no way to wait for two arms at once: their descriptors have."""

import contextlib
import os
import socket
import stat


def open_sockets(kind: socket.SocketKind) -> set[tuple[int, int]]:
    """Return descriptor and inode of each internet socket of this kind (SOCK_DGRAM, SOCK_STREAM) of this process.

    Other sockets open and close meanwhile: each client of the robot process has one.
    """
    found = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # the descriptor of the listing itself is closed by now
            status = os.fstat(int(name))
            if not stat.S_ISSOCK(status.st_mode):
                continue
            with socket.socket(fileno=os.dup(int(name))) as sock:
                if (sock.family, sock.type) == (socket.AF_INET, kind):
                    found.add((int(name), status.st_ino))
    return found


def give_up_after(descriptor: int, patience_s: float) -> None:
    """Let a connection end when sent data is not acknowledged for so long: libfranka waits for ever.

    Linux, tcp(7): TCP_USER_TIMEOUT. Never raises.
    """
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * patience_s))


def shut_down(descriptor: int) -> None:
    """End a connection under the feet of who waits for an answer on it. Never raises."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.shutdown(socket.SHUT_RDWR)
