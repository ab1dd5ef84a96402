"""The scenes behind the page: the same cell with full and with light meshes, made when they are first looked at."""

import threading
from collections.abc import Callable
from enum import StrEnum
from typing import Any

from console.live.watch import Watch
from console.questions.questions import Questions
from console.scene.experiment import ExperimentFigures, TrialPlans
from console.scene.ghost import GhostPlayer
from console.scene.gizmos import Gizmos
from console.scene.scene import CellFigures, Ghost, add_stage
from console.scene.server import SceneServer
from console.teleoperation.teleop_input import TeleopInput
from rtstack.model.cell_description import CellDescription

_GHOST = Ghost("/ghost", (204, 214, 224))  # neither an arm's colour nor the other log's of the review


class Detail(StrEnum):
    """How much is drawn: everything, or what software rendering can bear."""

    FULL = "full"
    LIGHT = "light"


class _LiveScene:
    """One scene, its server, and the thread that keeps it up to date while it is shown."""

    def __init__(
        self, cell: CellDescription, watch: Watch, teleop: TeleopInput, plans: TrialPlans, ghost: GhostPlayer,
        detail: Detail,
    ) -> None:  # fmt: skip
        self.server, full = SceneServer(), detail is Detail.FULL
        scene = self.server.viser.scene
        add_stage(self.server.viser, cell, full)
        self._scene, self._gizmos = CellFigures(scene, cell, full), Gizmos(self.server.viser, cell, teleop)
        self._experiment = ExperimentFigures(scene, cell)
        self._watch, self._plans, self._player = watch, plans, ghost
        self._ghost = CellFigures(scene, cell, full=False, ghost=_GHOST)  # before it is needed
        self._ghost.set_visible(False)
        self._frame_s = 1.0 / 30.0 if full else 1.0 / 20.0  # how often it is brought up to date
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True, name=f"scene {detail}")
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self.server.close()

    def _follow(self) -> None:
        while not self._ending.wait(self._frame_s):
            if not self.server.viser.get_clients():
                continue  # no page shows it
            status = self._watch.view.status
            with self.server.viser.atomic():
                if (q := self._watch.q()) is not None:
                    self._scene.show_arms(q)
                if status is not None:
                    self._scene.show_object(status.object, self._watch.object_pose())
                self._experiment.show(*self._plans.current(status))
                self._experiment.show_hits(self._watch.hits())
                if (shown := self._player.pose()) is None:
                    self._ghost.set_visible(False)
                else:
                    self._ghost.show_arms(shown[0])
                    self._ghost.show_object(*shown[1:])
                self._gizmos.show(self._watch.measured(), self._watch.command(), self._watch.forces())


class SceneServers:
    """One scene of each detail, made when it is first looked at. May be used from any thread."""

    def __init__(self, make: Callable[[Detail], Any]) -> None:
        """make: returns a scene, which has `server` and `close`."""
        self._make, self._lock = make, threading.Lock()
        self._made: dict[Detail, Any] = {}

    def server(self, detail: Detail) -> SceneServer:
        """Return the server of a scene; the first call makes it, which takes a second or two for the full one."""
        with self._lock:
            if detail not in self._made:
                self._made[detail] = self._make(detail)
            return self._made[detail].server

    def close(self) -> None:
        """End all scenes."""
        with self._lock:
            for scene in self._made.values():
                scene.close()
            self._made.clear()


class Scenes(SceneServers):
    """The live scenes. plans: the trial that they show; ghost: what does not take place."""

    def __init__(
        self, cell: CellDescription, watch: Watch, teleop: TeleopInput, questions: Questions, ghost: GhostPlayer
    ) -> None:  # fmt: skip
        self.plans, self.ghost = TrialPlans(questions), ghost
        super().__init__(lambda detail: _LiveScene(cell, watch, teleop, self.plans, ghost, detail))
