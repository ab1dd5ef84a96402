"""A cell's calibration as the page leads a person through it: points that are taken from the live states, and the fit.

The points are in a file of `rtstack calibrate`, beside the logs; a process of its own makes the fit.
"""

import datetime
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from console.live.watch import Watch
from console.questions.questions import Question, Questions
from console.refused import Refused
from rtstack.calibration.points import Point, load_points, save_points, write
from rtstack.cells import default_cell_file
from rtstack.loop.standstill import REST_DQ
from rtstack.model.cell_description import load_cell_description

FILE_NAME = "calibration.toml"  # in the folder of logs
LOOKS = 50  # states that a point is the mean of
_SILENT_S, _PATIENCE_S = 1.0, 10.0  # no state for so long; and until there are enough
MOST = 200


@dataclass(frozen=True, slots=True)
class PointView:
    """A point: what a person has to do for it, whether it was measured, and how far it is off after the fit, mm."""

    name: str
    what: str
    side: str
    asked: str
    measured: bool
    off_mm: float | None = None
    wrong: bool = False


@dataclass(frozen=True, slots=True)
class CalibrationView:
    """file: the cell's; date, rms_mm, uncertainty_mm: what it says now. looking: the fit is being made; lines: what was
    found and how well; values: for the cell's file; why: nothing is found, or it is not to be written.
    """

    file: str
    date: str | None
    rms_mm: float | None
    uncertainty_mm: float | None
    points: tuple[PointView, ...]
    looking: bool
    lines: tuple[str, ...]
    values: dict[str, Any]
    why: str | None


class CellCalibration:
    """The points of one cell. May be used from any thread. Raises Refused, ConfigurationError."""

    def __init__(self, file: Path, folder: Path, questions: Questions, watch: Watch) -> None:
        """file: the cell's; folder: of the logs."""
        self._file, self._path, self._lock = file, folder / FILE_NAME, threading.Lock()
        self._questions, self._watch = questions, watch

    def view(self) -> CalibrationView:
        """Return how things are; asks for a fit where there is none of these points."""
        cell = load_cell_description(self._file)
        points, now, sides = self._points(), cell.calibration, self._watch.sides
        answer, why, question = {}, None, self._fit(points, sides)
        if question is not None and question.done():
            try:
                why = (answer := question.answer())["refusal"]
            except Refused as error:
                why = str(error)
        wrong = answer.get("wrong_mm", {})
        off = answer.get("residuals_mm", {}) | wrong
        written = (None, None, None) if now is None else (now.date.isoformat(), now.rms_mm, now.uncertainty_mm)
        return CalibrationView(
            str(self._file),
            *written,
            tuple(
                PointView(name, p.what, p.side, p.asked, p.measured(sides), off.get(name), name in wrong)
                for name, p in points.items()
            ),
            question is not None and not question.done(),
            tuple(answer.get("lines", ())),
            answer.get("values", {}),
            why,
        )

    def put(self, name: str, point: Point) -> None:
        """Add a point that is to be measured."""
        with self._lock:
            points = self._points()
            if name in points:
                raise Refused(409, f"there is a point {name} already: remove it first")
            if len(points) >= MOST:
                raise Refused(409, f"{MOST} points are enough: remove some")
            save_points(self._path, {**points, name: point})

    def remove(self, name: str) -> None:
        """Forget a point."""
        with self._lock:
            points = self._points_with(name)
            del points[name]
            if points:
                save_points(self._path, points)
            else:
                self._path.unlink()

    def take(self, name: str) -> None:
        """Measure a point as the arms stand now: the mean of some states."""
        self._points_with(name)
        q, tau = self._states()
        with self._lock:
            points = self._points_with(name)
            save_points(self._path, {**points, name: points[name].taken(q, tau, self._watch.sides)})

    def write(self) -> None:
        """Write what was found into the cell's file."""
        if self._file.resolve() == default_cell_file().resolve():
            what = "this is the example's cell, whose file is not changed"
            raise Refused(409, f"{what}: start the stack with --cell-file and one of your own")
        if (question := self._fit(self._points(), self._watch.sides)) is None:
            raise Refused(409, "no point was measured yet")
        if (answer := question.answer())["refusal"] is not None:
            raise Refused(409, answer["refusal"])
        values = {tuple(key.split(".")): value for key, value in answer["values"].items()}
        values["calibration", "date"] = datetime.date.fromisoformat(values["calibration", "date"])
        with self._lock:
            write(self._file, values)

    def _fit(self, points: dict[str, Point], sides: Sequence[str]) -> Question | None:
        measured = any(point.measured(sides) for point in points.values())
        return self._questions.ask("calibration", self._path, datetime.date.today().isoformat()) if measured else None

    def _points(self) -> dict[str, Point]:
        return load_points(self._path) if self._path.exists() else {}

    def _points_with(self, name: str) -> dict[str, Point]:
        points = self._points()
        if name not in points:
            raise Refused(404, "there is no point of this name")
        return points

    def _states(self) -> tuple[np.ndarray, np.ndarray]:
        """Return joints and external torques of the arms at rest, (arms, 7) each, rad and Nm."""
        if max(arm.age_s for arm in self._watch.view.arms) > _SILENT_S:
            raise Refused(409, "the arms say nothing: is the cell's state red?")
        readers = [self._watch.rings.reader(f"/{side}/arm") for side in self._watch.sides]
        seen: list[list[np.ndarray]] = [[] for _ in readers]
        due_s = time.monotonic() + _PATIENCE_S
        while min(sum(map(len, own)) for own in seen) < LOOKS:
            if time.monotonic() > due_s:
                raise Refused(409, "the arms have fallen silent: take the point again")
            time.sleep(0.01)
            for own, reader in zip(seen, readers, strict=True):
                own.append(reader.drain())
        states = [np.concatenate(own) for own in seen]
        if max(float(np.abs(own["dq"].mean(axis=0)).max()) for own in states) > REST_DQ:
            raise Refused(409, "the arms move: let them come to rest, then take the point")
        mean = [[own[name].mean(axis=0) for own in states] for name in ("q", "tau_ext_hat_filtered")]
        return np.array(mean[0]), np.array(mean[1])
