"""A soak of the whole stack: an operator at work for half an hour, watched by others, and what that costs the host.

Starts `rtstack up` with the simulated cell. A client signs in, takes control, arms, and then over and over records a
demonstration, runs trials on it, downloads and reviews a log, while viewers read the live socket. After each round the
memory (RSS) and the descriptors of each process of the stack are noted. Exit status 1 where memory has grown by 5 % or
more since the warm-up (5 minutes, or a third of a shorter run), descriptors have, a run failed, or somebody was left
behind. Ctrl-C gives what there is so far.

Takes half an hour, or --minutes.
"""

import itertools
import json
import statistics
import subprocess
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import httpx
import typer
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from tests.programs import program
from tests.support.console.stack import COMMAND, SoakFailed, Stack, Viewer

WARM_UP_S = 300.0
MOST_GROWTH = 0.05
LATE_US = 2000.0  # between two ticks: a robot that does not wait would have missed one
KEPT_LOGS = 12  # older ones are deleted, as an operator would
DISPLACEMENTS_MM = (0.0, -30.0, 30.0)
CONTROLLERS = ("proposed", "no_reference_spreading", "no_velocity_feedback", "no_interim", "contact_completion")
SETTLE_S = 1.0  # after a round, before the processes are looked at

OPERATOR = "soak"


@dataclass(slots=True)
class Samples:
    """What was seen of one process after each round."""

    times_s: list[float] = field(default_factory=list)
    rss_mb: list[float] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)

    def after(self, begin_s: float) -> tuple[list[float], list[int]]:
        """Return memory and descriptors since a time."""
        kept = [k for k, t_s in enumerate(self.times_s) if t_s >= begin_s]
        return [self.rss_mb[k] for k in kept], [self.descriptors[k] for k in kept]


class Soak:
    """The operator's rounds, and what was noted after each."""

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        self.samples: dict[str, Samples] = defaultdict(Samples)
        self.rounds = self.runs = self.successes = self.ticks = self.missed = self.late = 0
        self._began_s = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        """How long it has been running."""
        return time.monotonic() - self._began_s

    def round(self, number: int) -> None:
        """Record, try, read, review; then note what everybody uses. Raises SoakFailed."""
        stack = self._stack
        stack.post("take", operator=OPERATOR)
        stack.post("arm")
        recording = stack.run("jobs/demonstration", object="rice_box", variation=number % 5, seed=number)
        self._count(recording)
        reference = stack.log_id(recording)
        for trial in range(2):
            k = 2 * number + trial
            controller, displacement_mm = CONTROLLERS[k % len(CONTROLLERS)], DISPLACEMENTS_MM[k % len(DISPLACEMENTS_MM)]
            name = stack.run(
                "jobs/trial", reference=reference, object="rice_box", seed=k, controller=controller,
                displacement_mm=displacement_mm,
            )  # fmt: skip
            self._count(name)
        self._read(name)
        stack.post("disarm")
        stack.post("release")
        self._tidy()
        time.sleep(SETTLE_S)
        self.rounds += 1
        self._note()

    def _count(self, name: str) -> None:
        with (self._stack.logs / name).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            result = next(record.metadata for record in reader.iter_metadata() if record.name == "result")
            timing = [message.period_us for *_, message in reader.iter_decoded_messages(["/timing"])]
        self.runs += 1
        self.successes += result["success"] == "true"
        self.ticks += int(result["ticks"])
        self.missed += int(result["missed_deadlines"])
        self.late += sum(period_us > LATE_US for period_us in timing)

    def _read(self, name: str) -> None:
        """Download a log as the page does, and review it as `rtstack review` does."""
        size = len(self._stack.client.get(f"/api/logs/{self._stack.log_id(name)}/download").raise_for_status().content)
        if size != (self._stack.logs / name).stat().st_size:
            raise SoakFailed(f"{name}: {size} bytes were downloaded")
        command = [str(COMMAND), "review", str(self._stack.logs / name), "--json"]
        review = subprocess.run(command, capture_output=True, text=True)
        if review.returncode:
            raise SoakFailed(f"review of {name}: {review.stderr.strip()}")

    def _tidy(self) -> None:
        logs = sorted(self._stack.logs.glob("*.mcap"), key=lambda path: path.stat().st_mtime)
        for path in logs[:-KEPT_LOGS]:
            path.unlink()

    def _note(self) -> None:
        for name, process in self._stack.members.items():
            samples = self.samples[name]
            samples.times_s.append(self.elapsed_s)
            samples.rss_mb.append(process.memory_info().rss / 1e6)
            samples.descriptors.append(process.num_fds())

    def _per_million(self, count: int) -> float | None:
        return round(1e6 * count / self.ticks, 1) if self.ticks else None

    def report(self, warm_up_s: float, trouble: list[str]) -> dict:
        """Return what was found, JSON-ready. trouble: what else went wrong."""
        found = list(trouble)
        processes = {}
        for name, samples in self.samples.items():
            rss, descriptors = samples.after(warm_up_s)
            if len(rss) < 2:
                found.append(f"{name}: too few rounds after the warm-up to say anything")
                continue
            part = max(1, len(rss) // 4)
            first, last = statistics.median(rss[:part]), statistics.median(rss[-part:])
            growth = last / first - 1.0
            processes[name] = {
                "rss_mb": [round(first, 1), round(last, 1)], "growth_percent": round(100.0 * growth, 2),
                "descriptors": [max(descriptors[:part]), max(descriptors[-part:])],
            }  # fmt: skip
            if growth >= MOST_GROWTH:
                found.append(f"{name}: memory grew by {100.0 * growth:.1f} %")
            if max(descriptors[-part:]) > max(descriptors[:part]):
                found.append(f"{name}: descriptors from {max(descriptors[:part])} to {max(descriptors[-part:])}")
        return {
            "minutes": round(self.elapsed_s / 60.0, 2), "rounds": self.rounds, "runs": self.runs,
            "successes": self.successes, "ticks": self.ticks, "missed_deadlines": self.missed,
            "missed_per_million_ticks": self._per_million(self.missed),
            "periods_over_2_ms_per_million_ticks": self._per_million(self.late),
            "processes": processes, "trouble": found,
        }  # fmt: skip


def main(
    minutes: float = 30.0,
    watchers: Annotated[int, typer.Option("--viewers", help="pages that only look")] = 2,
    json_file: Annotated[Path | None, typer.Option("--json", help="write the report here, too")] = None,
) -> int:
    """Soak. Returns 0 where all stayed flat, else 1."""
    whole_s = 60.0 * minutes
    warm_up_s = min(WARM_UP_S, whole_s / 3.0)
    trouble: list[str] = []
    with TemporaryDirectory() as folder:
        stack = Stack(Path(folder) / "logs")
        soak, viewers = Soak(stack), []
        try:
            viewers += [Viewer(stack, answers=k == 0) for k in range(1 + watchers)]
            for number in itertools.count():
                soak.round(number)
                left_min = max(0.0, whole_s - soak.elapsed_s) / 60.0
                print(f"round {soak.rounds}, {soak.runs} runs, about {left_min:.1f} min left", flush=True)
                if soak.elapsed_s >= whole_s:
                    break
        except KeyboardInterrupt:
            print("ended early: what there is so far")
        except (SoakFailed, httpx.HTTPError) as error:
            trouble.append(str(error))
        finally:
            for viewer in viewers:
                viewer.close()
            trouble += stack.end()
    if not all(viewer.views for viewer in viewers):
        trouble.append("a viewer was shown nothing")
    report = soak.report(warm_up_s, trouble)
    print(json.dumps(report, indent=2))
    if json_file is not None:
        json_file.write_text(json.dumps(report) + "\n")
    return 1 if report["trouble"] else 0


if __name__ == "__main__":
    program(main)
