"""The sockets of this process. libfranka has no way to wait for two arms at once: their descriptors have."""

import contextlib
import os
import select
import socket
import stat
import struct
import time

_MOST_BYTES = 1 << 20  # of an answer: an FR3's model has some 20,000


def exchange(
    line: socket.socket, header: struct.Struct, command: int, body: bytes, due_s: float, least: int = 1
) -> bytes:
    """Ask a box, and return its answer's body, of at least so many bytes.

    header: of a command, its id, and the size with the header. due_s: of time.monotonic. Raises OSError.
    """
    line.sendall(header.pack(command, command + 1, header.size + len(body)) + body)
    *echo, size = header.unpack(_receive(line, header.size, due_s))
    if echo != [command, command + 1] or not header.size + least <= size < _MOST_BYTES:
        raise ConnectionError("what answers there is no robot")
    return _receive(line, size - header.size, due_s)


def _receive(line: socket.socket, size: int, due_s: float) -> bytes:
    data = b""
    while len(data) < size:
        line.settimeout(max(1e-3, due_s - time.monotonic()))
        chunk = line.recv(size - len(data))
        if not chunk:
            raise ConnectionResetError("it hung up")
        data += chunk
    return data


def open_sockets(kind: socket.SocketKind, peer: str = "") -> set[tuple[int, int]]:
    """Return descriptor and inode of each internet socket of this process of a kind (SOCK_DGRAM, SOCK_STREAM).

    peer: an address, to which a stream has to lead; a datagram socket then has to be bound and have no peer, as
    libfranka's. Other threads open and close sockets meanwhile.
    """
    found = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # the descriptor of the listing itself is closed by now
            status = os.fstat(int(name))
            if not stat.S_ISSOCK(status.st_mode):
                continue
            with socket.socket(fileno=os.dup(int(name))) as sock:
                if (sock.family, sock.type) != (socket.AF_INET, kind):
                    continue
                bound = sock.getsockname()[1] != 0  # asked first: a socket that connects now is bound before
                if not peer or (bound and _peer(sock) == (peer if kind is socket.SOCK_STREAM else "")):
                    found.add((int(name), status.st_ino))
    return found


def numeric(address: str) -> str:
    """Return a host's numeric address, "" where it has none."""
    try:
        return socket.gethostbyname(address)
    except OSError:
        return ""


def _peer(sock: socket.socket) -> str:
    try:
        return sock.getpeername()[0]
    except OSError:
        return ""


def give_up_after(descriptor: int, patience_s: float) -> None:
    """Let a connection end when sent data is not acknowledged for so long, as libfranka waits for ever
    (TCP_USER_TIMEOUT of tcp(7)).

    Never raises.
    """
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * patience_s))


def receive_from(descriptor: int, host: str, size: int, patience_s: float) -> None:
    """Have the kernel drop what others send to a datagram socket: only the port counts from which `host` sends
    datagrams of `size` bytes; what waits there is forgotten.

    Where none comes within patience_s, all senders go on to count: a box may have several addresses. Leaves the flags,
    which are libfranka's too. Never raises.
    """
    due_s, found = time.monotonic() + patience_s, False
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        while not found and select.select([sock], [], [], max(0.0, due_s - time.monotonic()))[0]:
            data, sender = sock.recvfrom(size + 1, socket.MSG_DONTWAIT)
            found = sender[0] == host and len(data) == size
            if found:
                sock.connect(sender)
        while True:
            sock.recv(1, socket.MSG_DONTWAIT)


def shut_down(descriptor: int) -> None:
    """End a connection under the feet of who waits for an answer on it. Never raises."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.shutdown(socket.SHUT_RDWR)
