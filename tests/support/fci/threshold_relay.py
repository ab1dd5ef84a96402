"""Stands between a client and an arm's requests (TCP), and writes the thresholds that pass to a file: 52 doubles each.

    threshold_relay.py ARM ADDRESS FILE

Prints a line once it listens, and ends with its standard input. States and commands (UDP) go past it. It is a process
of its own, because pylibfranka keeps Python's lock while it connects.
"""

import socket
import struct
import sys
import threading
from pathlib import Path

COMMAND, HEADER, SIZE = 3, struct.Struct("<III"), 52 * 8  # SetCollisionBehavior
PORT = 1337


def received(source: socket.socket) -> bytes:
    """Return what has come, empty at the end."""
    try:
        return source.recv(4096)
    except OSError:
        return b""


def pass_on(source: socket.socket, sink: socket.socket, file: Path | None) -> None:
    """Pass everything on; with a file look for thresholds."""
    seen = b""
    while data := received(source):
        sink.sendall(data)
        seen += data if file is not None else b""
        while file is not None and len(seen) >= HEADER.size:
            command, _, size = HEADER.unpack_from(seen)
            if len(seen) < size:
                break
            if command == COMMAND:
                with file.open("ab") as out:
                    out.write(seen[HEADER.size : HEADER.size + SIZE])
            seen = seen[size:]
    for end in (source, sink):
        try:
            end.shutdown(socket.SHUT_RDWR)
        except OSError:
            end.close()


def serve(server: socket.socket, arm: str, file: Path) -> None:
    """Take one client after the other."""
    while True:
        client, _ = server.accept()
        robot = socket.create_connection((arm, PORT), source_address=(client.getpeername()[0], 0))
        threading.Thread(target=pass_on, args=(client, robot, file), daemon=True).start()
        threading.Thread(target=pass_on, args=(robot, client, None), daemon=True).start()


def main() -> None:
    """Relay until standard input ends."""
    arm, address, file = sys.argv[1:]
    server = socket.create_server((address, PORT))
    threading.Thread(target=serve, args=(server, arm, Path(file)), daemon=True).start()
    print("listening", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
