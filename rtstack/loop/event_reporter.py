"""The events of a session: its mode, impacts, contact, classifications, end and connection."""

from collections.abc import Sequence

from rtstack.control.controller import Controller
from rtstack.loop.fault import FaultNotes
from rtstack.loop.publisher import Publisher
from rtstack.loop.timeline import Timeline
from rtstack.loop.watchdogs import slow_tick
from rtstack.samples import SIDES, Level, Mode

MOST_PAUSES = 20
_STOPPING = Mode.STOPPING  # looked up once: an enumeration's member costs 0.1 us


class EventReporter:
    """Publishes each change once, after the torques were sent. Text is formatted only for an event. Times in texts are
    s since the start of the reference; events carry the robot's time."""

    def __init__(
        self, publisher: Publisher, controller: Controller, time: Timeline, notes: FaultNotes,
        sides: Sequence[str] = SIDES,
    ) -> None:  # fmt: skip
        self._publisher, self._controller, self._machine = publisher, controller, controller.machine
        self._time, self._notes = time, notes
        self._mode, self._waiting = Mode.IDLE, False  # as they were told
        self._sides = sides
        self._unsaid = tuple(range(len(sides)))  # arms whose first impact has not been told yet
        self._pauses = 0
        self._speaker = ""  # who has something to say about the end

    def tick(self) -> None:
        """Say what this tick has brought. Called every tick."""
        machine, monitor = self._machine, self._controller.monitor
        if self._time.pause_ns:
            self._pause()
        if self._unsaid and machine.impact_s >= 0.0 and machine.mode is not _STOPPING:
            self._impacts()
        if machine.mode is not self._mode or machine.waiting is not self._waiting:
            self.mode()
        if monitor is not None and monitor.news():
            self._say(Level.WARNING if monitor.unexpected else Level.INFO, "verdict", monitor.text)

    def mode(self) -> None:
        """Say which mode it is now, and what waiting for contact has come to."""
        machine = self._machine
        if self._waiting and not machine.waiting:
            self._contact()
        self._waiting = machine.waiting
        if machine.mode is not self._mode:
            self._say(Level.INFO, "mode", f"{self._mode.name.lower()} -> {machine.mode.name.lower()}")
            self._mode = machine.mode

    def rest(self) -> None:
        """Say that the arms have stopped, and whether the run's ticks took too long. Not for the tick."""
        self.mode()
        if slow := slow_tick(self._publisher.median_compute_us):
            self._say(Level.WARNING, "loop", slow)

    def let_speak(self, speaker: str) -> None:
        """Have the end told that was just noted, in this name; "" where the plan has come to its own end."""
        self._speaker = speaker

    def end(self) -> None:
        """Say once why the session ends before its own end. Called every tick."""
        if self._speaker:
            trip, speaker, self._speaker = self._notes.trip, self._speaker, ""
            self._publisher.event(self._notes.t_ns, trip.level, speaker, trip.text)

    def robot(self, error: Exception) -> None:
        """Say what the robot itself ended the session with."""
        self._say(Level.ERROR, "robot", str(error))

    def link(self, lost: int) -> None:
        """Say how many answers to arms with clocks of their own came too late, and how far their states were apart."""
        text = f"{lost} answers came too late, {self._time.missed} states missed"
        if len(self._sides) > 1:
            text += f", the arms' states were {self._time.skew_ns * 1e-6:g} ms apart at most"
        self._say(Level.INFO, "link", text)

    def _pause(self) -> None:
        """Report a pause that the robot has bridged, MOST_PAUSES of them at most."""
        pause_ns, self._time.pause_ns = self._time.pause_ns, 0
        self._pauses += 1
        if self._pauses <= MOST_PAUSES:
            text = f"no answer for {pause_ns * 1e-6:.0f} ms: the robot went on with the last torque"
            self._say(
                Level.WARNING, "link", text + ", and further pauses are not reported" * (self._pauses == MOST_PAUSES)
            )

    def _impacts(self) -> None:
        """Each arm's first impact, where impacts are waited for: the second one tells how far apart they were."""
        for side in self._unsaid:
            impact_s = self._controller.impact_s[side]
            if impact_s >= 0.0:
                self._unsaid = tuple(k for k in self._unsaid if k != side)
                self._say(Level.INFO, "impact", f"detected at {impact_s:.3f} s, {self._sides[side]}")

    def _contact(self) -> None:
        machine = self._machine
        if machine.completion_s >= 0.0:
            self._say(Level.INFO, "contact", f"complete at {machine.completion_s:.3f} s")
        else:
            patience_s = machine.parameters.completion_patience_s
            text = f"not complete within {patience_s} s of the impact: going on without"
            self._say(Level.WARNING, "contact", text)

    def _say(self, level: Level, name: str, text: str) -> None:
        self._publisher.event(self._time.t_ns, level, name, text)
