"""A box of another FCI version: one line that names both versions and says what to do; nothing is left connected."""

import socket
import struct
import subprocess
import sys
from collections.abc import Iterator

import pytest

from hal.errors import HardwareError
from hal.fci import FciArm
from hal.wire import PORT, VERSION
from rtstack.cells.simulator import _free_pairs

# answers Connect as a box of another version does, and keeps the connection; libfranka keeps Python's lock meanwhile
_BOX = """
import socket, sys
from hal.wire import HEADER
kept, box = [], socket.create_server((sys.argv[1], int(sys.argv[2])))
print("serving", flush=True)
while True:
    client = box.accept()[0]
    kept.append(client)
    command, number, size = HEADER.unpack(client.recv(HEADER.size, socket.MSG_WAITALL))
    client.recv(size - HEADER.size, socket.MSG_WAITALL)
    client.sendall(HEADER.pack(command, number, HEADER.size + 3) + bytes((1, int(sys.argv[3]), 0)))
"""


@pytest.fixture(params=[9, 5], ids=["FR3 before 5.9", "Panda"])
def box(request: pytest.FixtureRequest) -> Iterator[tuple[str, int]]:
    """The address of such a box, and the version that it speaks."""
    address = next(_free_pairs())[0]
    command = [sys.executable, "-c", _BOX, address, str(PORT), str(request.param)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "serving\n"
        yield address, request.param
        process.terminate()


def test_another_protocol_is_one_line_that_says_what_to_do(box: tuple[str, int]):
    address, version = box
    with pytest.raises(HardwareError) as refused:
        FciArm(address, name="left arm")
    said = str(refused.value)
    assert "\n" not in said
    assert said.startswith(f"the left arm at {address}: Incompatible library version (server version: {version}, ")
    assert f"rtstack needs {VERSION}" in said
    assert "5.9 or newer" in said
    assert "docs/howto/protocol.md" in said
    assert "http" not in said


def test_the_simulated_box_answers_another_version_as_a_box_does(served_arms):
    """What is refused above is refused by the simulated robot, too: a client of version 9 gets status 1 and 10."""
    with socket.create_connection((served_arms.left, PORT)) as client:
        client.sendall(struct.pack("<IIIHH", 0, 1, 16, 9, 40_000))
        assert struct.unpack("<IIIBH", client.recv(15, socket.MSG_WAITALL))[3:] == (1, VERSION)
