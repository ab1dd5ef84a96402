"""A cable that is as bad as it is told to be: packets between two network devices, by way of this process.

    relay.py LEFT RIGHT SEED < SETTINGS

LEFT and RIGHT are descriptors of the devices' other ends. Each line on stdin is a Cable as JSON, which counts from then
on. At the end of stdin it prints what it did, as JSON. Times in ms; what is lost, twice or overtaken are shares of the
packets.
"""

import contextlib
import heapq
import json
import os
import random
import select
import socket
import sys
import time
from dataclasses import asdict, dataclass, field

LARGEST_PACKET = 65536
OVERTAKEN_MS = 1.2  # how long a packet is held back that the next one, a control period later, is to overtake
ROUND = 64  # packets read at a time
_PROTOCOL, _UDP = 9, socket.IPPROTO_UDP  # of an IPv4 packet


@dataclass(frozen=True, slots=True)
class Cable:
    """delay_ms: one way; jitter_ms: more of it, at most, and without reordering nobody overtakes.

    After `after` packets to the left (0: never) `cut` is lost: the datagrams to the left, all to the left, or all.
    cut: datagrams, left, all.
    """

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    after: int = 0
    cut: str = "datagrams"


@dataclass(slots=True)
class Counts:
    """What became of the packets of one direction."""

    packets: int = 0
    lost: int = 0
    duplicated: int = 0
    reordered: int = 0


@dataclass(slots=True)
class Direction:
    """One direction of the cable."""

    source: int
    sink: int
    waiting: list[tuple[int, int, bytes]] = field(default_factory=list)
    counts: Counts = field(default_factory=Counts)
    newest_ns: int = 0

    def take(self, cable: Cable, cut: bool, chance: random.Random, now_ns: int) -> None:
        """Read what has come, and decide what becomes of it."""
        datagrams = cable.cut == "datagrams"
        for _ in range(ROUND):
            try:
                packet = os.read(self.source, LARGEST_PACKET)
            except BlockingIOError:
                return
            except OSError:  # the device is down
                return
            counts = self.counts
            counts.packets += 1
            if (cut and (not datagrams or packet[_PROTOCOL] == _UDP)) or chance.random() < cable.loss:
                counts.lost += 1
                continue
            late_ms = cable.delay_ms + chance.uniform(0.0, cable.jitter_ms)
            if chance.random() < cable.reordering:
                counts.reordered += 1
                self._hold(now_ns + round(1e6 * (late_ms + OVERTAKEN_MS)), packet)
                continue
            self.newest_ns = max(self.newest_ns, now_ns + round(1e6 * late_ms))
            self._hold(self.newest_ns, packet)
            if chance.random() < cable.duplication:
                counts.duplicated += 1
                self._hold(self.newest_ns, packet)

    def _hold(self, due_ns: int, packet: bytes) -> None:
        heapq.heappush(self.waiting, (due_ns, self.counts.packets + self.counts.duplicated, packet))

    def give(self, now_ns: int) -> None:
        """Write what is due."""
        while self.waiting and self.waiting[0][0] <= now_ns:
            packet = heapq.heappop(self.waiting)[2]
            with contextlib.suppress(OSError):  # a device that is down, or a full queue, loses it
                os.write(self.sink, packet)


class Relay:
    """Both directions, and the cable as it is now."""

    def __init__(self, left: int, right: int, seed: int) -> None:
        self.cable = Cable()
        self.to_left, self.to_right = Direction(right, left), Direction(left, right)
        self._chance = random.Random(seed)

    def run(self) -> None:
        """Relay until stdin ends."""
        settings, pending = sys.stdin.fileno(), b""
        both = (self.to_left, self.to_right)
        counted = 0  # packets to the left when the cable became what it is
        while True:
            now_ns = time.monotonic_ns()
            due = [one.waiting[0][0] for one in both if one.waiting]
            wait_s = max(0.0, 1e-9 * (min(due) - now_ns)) if due else 1.0
            ready = select.select([settings, *(one.source for one in both)], (), (), wait_s)[0]
            if settings in ready:
                said = os.read(settings, 4096)
                if not said:
                    return
                *lines, pending = (pending + said).split(b"\n")
                for line in lines:
                    self.cable = Cable(**json.loads(line))
                    counted = self.to_left.counts.packets
                    print("ready", flush=True)
            now_ns = time.monotonic_ns()
            cut = 0 < self.cable.after <= self.to_left.counts.packets - counted
            self.to_left.take(self.cable, cut, self._chance, now_ns)
            self.to_right.take(self.cable, cut and self.cable.cut == "all", self._chance, now_ns)
            for one in both:
                one.give(time.monotonic_ns())


def main() -> None:
    """Relay between the descriptors that are given."""
    left, right, seed = map(int, sys.argv[1:])
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(75))  # below the robot, over everybody else
    relay = Relay(left, right, seed)
    with contextlib.suppress(KeyboardInterrupt):
        relay.run()
    print(json.dumps({"left": asdict(relay.to_left.counts), "right": asdict(relay.to_right.counts)}), flush=True)


if __name__ == "__main__":
    main()
