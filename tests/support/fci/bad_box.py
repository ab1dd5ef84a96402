"""A box that takes connections and does not go on as a robot does: bad_box.py ADDRESS KIND.

Prints a line once it listens.
"""

import socket
import struct
import sys
import threading
import time

GOOD = struct.pack("<BH", 0, 10)
kept = []


def answer(tcp: socket.socket, kind: str) -> None:
    kept.append(tcp)
    command_id = struct.unpack_from("<I", tcp.recv(4096), 4)[0]
    said = {
        "silent": b"",
        "huge": struct.pack("<III", 0, command_id, 0xFFFFFFF0),
        "other": struct.pack("<III", 0, command_id + 77, 15) + GOOD,
        "garbage": bytes(range(255)) * 10,
        "slow": struct.pack("<III", 0, command_id, 15) + GOOD,
        "gone": b"",
        "stateless": struct.pack("<III", 0, command_id, 15) + GOOD,
    }[kind]
    if kind == "gone":
        tcp.close()
    for byte in said if kind == "slow" else ():
        tcp.sendall(bytes([byte]))
        time.sleep(1.0)
    if kind not in ("gone", "slow"):
        tcp.sendall(said)


address, kind = sys.argv[1:]
with socket.create_server((address, 1337)) as server:
    print("listening", flush=True)
    while True:
        threading.Thread(target=answer, args=(server.accept()[0], kind), daemon=True).start()
