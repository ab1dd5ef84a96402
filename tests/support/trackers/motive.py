"""What Motive sends over NatNet, written from the published description of its bit stream, not from hal.natnet.

A frame has all that a frame may have: marker sets, markers without a name, bodies, a skeleton, labeled markers, a force
plate, a device, and since 4.1 assets.
"""

import socket
import struct
import threading
import time
from collections.abc import Iterable

Body = tuple[int, tuple[float, float, float], tuple[float, float, float, float], bool]  # id, position, xyzw, tracked


def _list(version: tuple[int, int], entries: Iterable[bytes]) -> bytes:
    entries = list(entries)
    content = b"".join(entries)
    size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
    return struct.pack("<i", len(entries)) + size + content


def _rigid(body: Body) -> bytes:
    number, position, xyzw, tracked = body
    return struct.pack("<i", number) + struct.pack("<7f", *position, *xyzw) + struct.pack("<fH", 3e-4, int(tracked))


def _channels(number: int) -> bytes:
    channels = [struct.pack("<i3f", 3, 0.1, 0.2, 0.3), struct.pack("<i1f", 1, 0.5)]
    return struct.pack("<ii", number, len(channels)) + b"".join(channels)


def _labeled(number: int) -> bytes:
    return struct.pack("<i3ffhf", number, 0.1, 0.2, 0.3, 0.014, 2, 1e-4)


def frame(version: tuple[int, int], number: int, stamp_s: float, bodies: list[Body]) -> bytes:
    """Return the message of a frame of data."""
    markers = [b"box\0" + struct.pack("<i6f", 2, *[0.25] * 6), b"all\0" + struct.pack("<i3f", 1, *[0.5] * 3)]
    parts = [
        struct.pack("<i", number),
        _list(version, markers),
        _list(version, [struct.pack("<3f", 1.0, 2.0, 3.0)] * 3),
        _list(version, map(_rigid, bodies)),
        _list(version, [struct.pack("<ii", 7, 2) + 2 * _rigid((1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), True))]),
    ]
    if version >= (4, 1):
        asset_body = struct.pack("<i7ffh", 2, *[8.0] * 3, 0.0, 0.0, 0.0, 1.0, 1e-4, 1)
        asset_marker = struct.pack("<i3ffhf", 5, *[8.0] * 3, 0.01, 2, 1e-4)
        parts.append(_list(version, [struct.pack("<ii", 3, 1) + asset_body + struct.pack("<i", 2) + 2 * asset_marker]))
    parts += [
        _list(version, map(_labeled, range(4))),
        _list(version, [_channels(1)]),
        _list(version, [_channels(2)]),
        struct.pack("<IId", 0, 0, stamp_s),
        struct.pack("<3Q", 10, 20, 30),
        struct.pack("<II", 1, 2) if version >= (4, 1) else b"",
        struct.pack("<hi", 0, 0),
    ]
    content = b"".join(parts)
    return struct.pack("<HH", 7, len(content)) + content


def server_info(version: tuple[int, int]) -> bytes:
    """Return the answer to a client that connects: the application's name and version, NatNet's, clock and port."""
    content = b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((*version, 0, 0))
    content += struct.pack("<QBHB4B", 10_000_000, 1, 1511, 0, 239, 255, 42, 99)
    return struct.pack("<HH", 1, len(content)) + content


class Motive:
    """A server that sends frames to who has connected and says regularly that he is still there."""

    def __init__(self, version: tuple[int, int], host: str = "127.0.0.1") -> None:
        self.version, self.frames = version, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self._socket.settimeout(0.1)
        self.address = self._socket.getsockname()
        self.client: tuple[str, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._over.is_set():
            try:
                message, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                continue
            (kind,) = struct.unpack_from("<H", message)
            if kind == 0:
                self._socket.sendto(server_info(self.version), sender)
                self.client = sender

    def wait_for_client(self, longest_s: float = 30.0) -> None:
        """Wait until a client has connected."""
        end_s = time.monotonic() + longest_s
        while self.client is None:
            assert time.monotonic() < end_s, "no client has connected"
            time.sleep(0.01)

    def send(self, stamp_s: float, bodies: list[Body]) -> None:
        """Send a frame to the client, if there is one."""
        self.frames += 1
        self.send_raw(frame(self.version, self.frames, stamp_s, bodies))

    def send_raw(self, message: bytes) -> None:
        """Send any bytes to the client."""
        if self.client is not None:
            self._socket.sendto(message, self.client)

    def start_again(self, version: tuple[int, int]) -> None:
        """Be another Motive at the same address, which knows no client."""
        self.version, self.client = version, None

    def send_to_all(self, group: str) -> None:
        """Send to a group, through the interface of the server's address."""
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.address[0]))
        self.client = (group, 1511)

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()
        self._socket.close()
