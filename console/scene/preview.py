"""A trial before it runs: simulated in a process of its own, on a plant of its own. No arm moves."""

import json
import subprocess
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

from console.child_process import end, stand_back, start
from console.orders import TrialOrder
from console.scene.ghost import GhostPlayer, Shown, motion_of
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.trials.specification import TrialSpecification, like

_LONGEST_S = 300.0
_END_S = 5.0


@dataclass(frozen=True, slots=True)
class PreviewView:
    """running: it is being simulated; success, line: what came out, None before."""

    running: bool
    success: bool | None = None
    line: str = ""


class Preview:
    """One at a time. May be used from any thread."""

    def __init__(self, cell_file: Path, ghost: GhostPlayer, profile: str = "") -> None:
        """profile: of the simulated robot that previews; ideal, where the cell's is not known."""
        self._cell_file, self._ghost, self._profile = cell_file, ghost, profile or "ideal"
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self.view = PreviewView(False)

    def begin(self, order: TrialOrder, reference: Path) -> PreviewView:
        """Simulate a trial, then show it. One that is being simulated is given up for it."""
        self.close()
        asked = like(TrialSpecification, order, reference=str(reference)).as_dict()
        del asked["shadow"]  # what would be sent is simulated, too
        options = (f"--{name.replace('_', '-')}={value}" for name, value in asked.items() if value not in (None, {}))
        command = ["trial", "--json", "--profile", self._profile, "--cell-file", str(self._cell_file), *options]
        self.view = PreviewView(True, line="is being simulated")
        threading.Thread(target=self._run, args=(command,), daemon=True, name="preview").start()
        return self.view

    def close(self) -> None:
        """End what is being simulated."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            end(process, _END_S)

    def _run(self, command: list[str]) -> None:
        with tempfile.TemporaryDirectory(prefix="rtstack-preview-") as folder:
            log = Path(folder) / "preview.mcap"
            process = start(
                "rtstack", *command, "--log", str(log),
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=stand_back,
            )  # fmt: skip
            with self._lock:
                self._process = process
            try:
                said, errors = process.communicate(timeout=_LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                said, errors = process.communicate()
            with self._lock:
                if self._process is not process:
                    return  # another one was asked for
                self._process = None
            try:
                result = json.loads(said)
                motion = motion_of(read_log(log))
            except (ValueError, LogError):
                last = errors.decode(errors="replace").strip().splitlines()[-1:]
                self.view = PreviewView(False, False, last[0] if last else "the simulation ended early")
                return
        self._ghost.play(motion, Shown.PREVIEW, impact_s=result["detected_impact_time_s"])
        force, verdict = result["average_force_norm"], result["impact_verdict"]
        words = "" if force is None else f"force norm {force:.1f}", "" if verdict is None else f"impact {verdict}"
        line = ", ".join(filter(None, ("would succeed", *words)))
        success = bool(result["success"])
        self.view = PreviewView(False, success, line if success else f"would fail: {result['failure_reason']}")
