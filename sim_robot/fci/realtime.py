"""The pace of the robot: 1 kHz by absolute deadlines, answered or not."""

import time
from collections.abc import Callable

from sim_robot.fci.server import Server

PERIOD_NS = 1_000_000
# while the server is behind its own clock, a client still gets this long to answer a state
SHORTEST_ANSWER_NS = 300_000
# further behind than this, the robot's time slips instead of being caught up
LARGEST_LAG_NS = 50_000_000


class Realtime:
    """Serves until `stopped` says so. overruns: ticks that began over a period late; slipped_ns: time given up."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self.ticks = self.overruns = 0
        self.slipped_ns = self.worst_lateness_ns = 0

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve both arms."""
        server, clock = self._server, time.monotonic_ns
        deadline = clock()
        while not stopped():
            deadline += PERIOD_NS
            self._wait(deadline)
            lateness = clock() - deadline
            if lateness > PERIOD_NS:
                self.overruns += 1
                self.worst_lateness_ns = max(self.worst_lateness_ns, lateness)
                if lateness > LARGEST_LAG_NS:
                    self.slipped_ns += lateness
                    deadline += lateness
            self.ticks += 1
            server.advance()
            for station in server.stations:
                station.show_new()
            if self.ticks % 100 == 0:
                server.show_grippers()

    def report(self) -> str:
        """One line on how well the pace was kept."""
        return (
            f"{self.ticks} ticks, {self.overruns} overruns (worst {1e-6 * self.worst_lateness_ns:.1f} ms late), "
            f"{1e-6 * self.slipped_ns:.1f} ms slipped"
        )

    def _wait(self, deadline_ns: int) -> None:
        """Take answers and requests until the deadline; when late, only until the moving arms have answered."""
        server, clock = self._server, time.monotonic_ns
        entered = clock()
        while True:
            now = clock()
            left = deadline_ns - now
            if left <= 0:
                left = entered + SHORTEST_ANSWER_NS - now
                if left <= 0 or not any(station.awaited for station in server.stations):
                    server.poller.serve(0.0)
                    return
            server.poller.serve(left * 1e-9)
