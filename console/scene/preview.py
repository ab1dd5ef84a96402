"""A trial before it runs, and a grab that is planned: made by processes of their own. No arm moves."""

import json
import subprocess
import tempfile
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from console.child_process import end, stand_back, start
from console.orders import PlanOrder, TrialOrder
from console.refused import Refused
from console.scene.ghost import GhostPlayer, Shown, motion_of
from hal.base.files import replacing
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.trials.specification import TrialSpecification, like

_LONGEST_S = 300.0
_END_S = 5.0


@dataclass(frozen=True, slots=True)
class PreviewView:
    """running: it is being made; success, line: what came out, None before."""

    running: bool
    success: bool | None = None
    line: str = ""


class Preview:
    """One at a time. May be used from any thread."""

    doing = "is being simulated"

    def __init__(self, cell_file: Path, ghost: GhostPlayer, profile: str = "") -> None:
        """profile: of the simulated robot that previews; ideal, where the cell's is not known."""
        self._cell_file, self._ghost, self._profile = cell_file, ghost, profile or "ideal"
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._asked = 0  # how often: what an older one comes to is not shown
        self.view = PreviewView(False)

    def begin(self, order: TrialOrder, reference: Path) -> PreviewView:
        """Simulate a trial, then show it. One that is being simulated is given up for it."""
        asked = like(TrialSpecification, order, reference=str(reference)).as_dict()
        del asked["shadow"]  # what would be sent is simulated, too
        return self._begin(["trial", "--profile", self._profile, *_options(asked)], "--log")

    def close(self) -> None:
        """End what is being made."""
        with self._lock:
            process, self._process, self._asked = self._process, None, self._asked + 1
        if process is not None:
            end(process, _END_S)
        if self.view.running:
            self.view = PreviewView(False, line="was cancelled")

    def _begin(self, command: list[str], *last: str) -> PreviewView:
        """Run a command of rtstack that writes a log. last: what comes before the log's path."""
        self.close()
        self.view = PreviewView(True, line=self.doing)
        command = [*command, "--json", "--cell-file", str(self._cell_file), *last]
        threading.Thread(target=self._run, args=(command, self._asked), daemon=True, name="preview").start()
        return self.view

    def _run(self, command: list[str], asked: int) -> None:
        with tempfile.TemporaryDirectory(prefix="rtstack-preview-") as folder:
            log = Path(folder) / "preview.mcap"
            with self._lock:
                if self._asked != asked:
                    return  # it was cancelled
                self._process = process = start(
                    "rtstack", *command, str(log),
                    stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=stand_back,
                )  # fmt: skip
            try:
                said, errors = process.communicate(timeout=_LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                said, errors = process.communicate()
            with self._lock:
                if self._asked != asked:
                    return
                self._process = None
            try:
                result, motion = json.loads(said), motion_of(read_log(log))
            except (ValueError, LogError):
                last = errors.decode(errors="replace").strip().splitlines()[-1:]
                self.view = PreviewView(False, False, last[0] if last else "the simulation ended early")
                return
            self._ghost.play(motion, Shown.PREVIEW, impact_s=self._ended(result, log))

    def _ended(self, result: dict[str, Any], log: Path) -> float | None:
        """Say what came out; return the time of the impact, s."""
        force, verdict = result["average_force_norm"], result["impact_verdict"]
        words = "" if force is None else f"force norm {force:.1f}", "" if verdict is None else f"impact {verdict}"
        line = ", ".join(filter(None, ("would succeed", *words)))
        success = bool(result["success"])
        self.view = PreviewView(False, success, line if success else f"would fail: {result['failure_reason']}")
        return result["detected_impact_time_s"]


class Planner(Preview):
    """Plans a grab, as `rtstack plan` does, and keeps the newest plan until it is put among the logs."""

    doing = "is being planned"

    def __init__(self, cell_file: Path, ghost: GhostPlayer, logs: Path) -> None:
        super().__init__(cell_file, ghost)
        self._logs, self._plan = logs, b""

    def plan(self, order: PlanOrder) -> PreviewView:
        """Plan a grab, then show it. One that is being planned is given up for it."""
        self._plan = b""
        return self._begin(["plan", *_options(asdict(order))])

    def keep(self) -> Path:
        """Put the newest plan among the logs; return its path. Raises Refused, OSError."""
        with self._lock:
            plan, self._plan = self._plan, b""
        self.view = PreviewView(False)
        if not plan:
            raise Refused(409, "no plan is left to be used: preview one first")
        path = self._logs / f"{time.strftime('%Y%m%d-%H%M%S')}-plan.mcap"
        with replacing(path) as partial:
            partial.write_bytes(plan)
        return path

    def _ended(self, result: dict[str, Any], log: Path) -> float | None:
        self._plan = log.read_bytes()
        impact_s, speed = result["nominal_impact_s"], result["parameters"]["speed"]
        self.view = PreviewView(False, True, f"is possible: impact at {impact_s:.2f} s with {speed:g} m/s")
        return impact_s


def _options(asked: dict[str, Any]) -> list[str]:
    return [f"--{name.replace('_', '-')}={value}" for name, value in asked.items() if value not in (None, {})]
