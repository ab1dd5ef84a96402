"""A network switch in user space: each packet goes to the namespace that has its destination.

switch.py ADDRESS=DESCRIPTOR ...      until stdin ends. Descriptors are of the devices' other ends.
"""

import contextlib
import os
import select
import socket
import sys

LARGEST_PACKET = 65536
_DESTINATION = slice(16, 20)  # of an IPv4 packet


def main() -> None:
    """Forward between the descriptors that are given."""
    ends = {socket.inet_aton(a): int(d) for a, d in (word.split("=") for word in sys.argv[1:])}
    told = sys.stdin.fileno()
    while True:
        ready = select.select([told, *ends.values()], (), ())[0]
        if told in ready:
            return
        for source in ready:
            with contextlib.suppress(OSError):  # a device that is down
                packet = os.read(source, LARGEST_PACKET)
                sink = ends.get(packet[_DESTINATION])
                if sink is not None:
                    os.write(sink, packet)


if __name__ == "__main__":
    main()
