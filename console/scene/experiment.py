"""The form's trial in the scene, before and while it runs: object, way of both pads, what they met. World frame."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser

from console.questions.questions import Question, Questions
from console.questions.trial_path import TrialPath
from console.refused import Refused
from console.scene.scene import Force, add_edges, box_edges, grown
from hal.base.arrays import Array
from hal.displacement import Displacement
from rtstack.live.protocol import JobKind, Status
from rtstack.model.cell_description import CellDescription
from rtstack.palette import MODE_STYLES
from rtstack.samples import Mode

_NOMINAL_COLOUR = (139, 148, 158)  # the idle mode's grey
_PUT_COLOUR = (240, 180, 41)  # amber: it is not where it belongs
HIT_COLOUR = (240, 228, 66)  # #F0E442, Okabe-Ito: of neither arm
_ARROW_M, _ARROW_S = 0.05, 0.15  # of a velocity: at least so long, else the way of so much time
_M_PER_N = 0.002  # of what was met: 100 N are 0.2 m
_LEAST_N = 5.0  # the impact detector's force_high: below it nothing was met


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """What is put where, and the file that is followed; None: nothing yet."""

    object: str
    displacement: Displacement
    reference: Path | None


class TrialPlans:
    """The form's trial and the running one, each with the question for its path. May be used from any thread."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self._form: tuple[TrialPlan | None, Question | None] = None, None
        self._running: tuple[int, TrialPlan, Question | None] | None = None

    def set(self, plan: TrialPlan | None) -> None:
        """Take what a form says now; None: no form is shown."""
        self._form = plan, None if plan is None else self._asked(plan)

    def ordered(self, job: int, plan: TrialPlan) -> None:
        """Take what was ordered, as this job."""
        self._running = job, plan, self._asked(plan)

    def current(self, status: Status | None) -> tuple[TrialPlan | None, TrialPath | None]:
        """Return what is to be drawn, of a running trial its own plan; the path: None until the reference was read."""
        job = None if status is None else status.job
        plan, question = self._form
        if job is not None and job.active:
            own = job.kind is JobKind.TRIAL and self._running is not None and self._running[0] == job.number
            plan, question = self._running[1:] if own and self._running is not None else (None, None)
        if question is not None and question.done():
            with suppress(Refused):
                return plan, TrialPath(**question.answer())
        return plan, None

    def _asked(self, plan: TrialPlan) -> Question | None:
        with suppress(OSError):
            return None if plan.reference is None else self._questions.ask("path", plan.reference)
        return None


def in_words(put: Displacement) -> str:
    """Return where an object is put from its place, short; empty for its place."""
    shifts = [f"{axis} {round(1e3 * metres):+d} mm" for axis, metres in (("y", put.y_m), ("x", put.x_m)) if metres]
    turn = [f"{np.degrees(put.yaw_rad):+.0f}\N{DEGREE SIGN}"] if put.yaw_rad else []
    return ", ".join([*shifts, *turn])


def segments(way: list[list[float]], dashed: bool = False) -> Array:
    """Return the pieces (n, 2, 3) of a way; dashed: every other one."""
    points = np.array(way)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    return pieces[::2] if dashed else pieces


def _colour(mode: Mode) -> tuple[int, int, int]:
    text = MODE_STYLES[mode].colour
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


class ExperimentFigures:
    """What a scene draws of the trial that the form asks for, or that runs."""

    def __init__(self, scene: viser.SceneApi, cell: CellDescription) -> None:
        self._scene, self._cell = scene, cell
        self._drawn: tuple[TrialPlan | None, bool] = (None, False)
        self._nodes: list[viser.SceneNodeHandle] = []
        drawn = HIT_COLOUR, 0.014, _M_PER_N, _LEAST_N, "bottom-center", "at most {:.0f} N"
        self._hits = [Force(scene, f"/hit/{side}", *drawn) for side in cell.sides]

    def show(self, plan: TrialPlan | None, path: TrialPath | None) -> None:
        """Draw a plan, once for each; path: None where it is not known yet."""
        if self._drawn == (plan, path is not None):
            return
        self._drawn = plan, path is not None
        for node in self._nodes:
            node.remove()
        self._nodes.clear()
        if plan is not None:
            self._place(plan)
            if path is not None:
                self._way(path)

    def show_hits(self, hits: Sequence[tuple[Array, Array] | None]) -> None:
        """Show where each pad has felt the most, (3,) m, and what, (3,) N; None: nothing yet."""
        for arrow, hit in zip(self._hits, hits, strict=True):
            arrow.show(*(hit or np.zeros((2, 3))))

    def _place(self, plan: TrialPlan) -> None:
        description = self._cell.objects.get(plan.object)
        if description is None:
            return
        size, put = grown(description.size), plan.displacement  # around the box, where it stands there
        at = np.array([0.0, 0.0, self._cell.table.top_z + description.size[2] / 2.0])
        self._lines("nominal", box_edges(size, at, 0.0), _NOMINAL_COLOUR, 2.0)
        words = in_words(put)
        if not words:
            return
        there = at + (put.x_m, put.y_m, 0.0)
        self._lines("put", box_edges(size, there, put.yaw_rad), _PUT_COLOUR, 3.0)
        above = there + (0.0, 0.0, size[2] / 2.0 + 0.03)
        self._nodes.append(self._scene.add_label("/trial/shift", words, position=above, anchor="bottom-center"))

    def _way(self, path: TrialPath) -> None:
        ante, post = _colour(Mode.ANTE_IMPACT), _colour(Mode.POST_IMPACT)
        for side, name in enumerate(self._cell.sides):
            self._lines(f"{name}/ante", segments(path.ante[side]), ante, 3.0)
            self._lines(f"{name}/extended", segments(path.extended[side], dashed=True), ante, 3.0)
            self._lines(f"{name}/before", segments(path.before[side], dashed=True), post, 3.0)
            self._lines(f"{name}/post", segments(path.post[side]), post, 3.0)
            velocity = np.array(path.velocity[side])
            if (length := float(np.linalg.norm(velocity))) > 0.0:
                impact = np.array(path.impact[side])
                way = velocity / length * max(_ARROW_M, _ARROW_S * length)
                self._nodes.append(
                    self._scene.add_arrows(
                        f"/trial/{name}/impact", np.array([[impact - way, impact]], np.float32), ante,
                        shaft_radius=0.004, head_radius=0.011, head_length=0.022,
                    )
                )  # fmt: skip

    def _lines(self, name: str, pieces: Array, colour: tuple[int, int, int], thickness: float) -> None:
        if len(pieces):
            self._nodes.append(add_edges(self._scene, f"/trial/{name}", pieces, colour, thickness))
