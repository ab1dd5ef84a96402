"""The procedure: every joint of both arms, so many runs each, a log a run; and the file that is made of the logs."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hal.cell import Cell
from rtstack.control.parameters import FrictionParameters
from rtstack.identification.fit import JointFriction, JointSamples, fit_joint, joint_samples
from rtstack.identification.sweep import Sweep, sweep
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import Parameters, arm_controllers, default_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, FrictionFile
from rtstack.trials.motion import run_motion
from rtstack.trials.review import log_columns
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.specification import SweepSpecification
from rtstack.trials.start_motion import StartMotion

JOINTS = 7


@dataclass(frozen=True, slots=True)
class SweepRun:
    """One sweep that has to be made, or was: its log's name follows from it."""

    specification: SweepSpecification

    @property
    def file(self) -> str:
        """Name of its log."""
        return f"joint{self.specification.joint}-run{self.specification.run}.mcap"


def runs_of(object_name: str, runs: int, seed: int, joints: Sequence[int] = range(1, JOINTS + 1)) -> Iterator[SweepRun]:
    """Yield all runs of an identification, in order: run by run, so that one which is broken off has all joints."""
    for run in range(runs):
        for joint in joints:
            yield SweepRun(SweepSpecification(object_name, joint, run, seed))


def uncompensated() -> Parameters:
    """Return a controller's numbers with friction compensation set to zero, as Appendix A asks for."""
    none = FrictionParameters(scale=0.0)
    return replace(default_parameters(), friction=(none, none))


class Identification:
    """The identification of a cell's arms. Knows the sweeps; takes runs; gives the file."""

    def __init__(self, description: CellDescription) -> None:
        self._description = description
        self._parameters = uncompensated()
        self._arms = arm_controllers(description, self._parameters)
        self._sweeps: dict[int, Sweep] = {}
        self._samples: tuple[dict[int, list[JointSamples]], ...] = ({}, {})

    def sweep(self, joint: int) -> Sweep:
        """Return the sweep of joint 1 to 7."""
        if joint not in self._sweeps:
            self._sweeps[joint] = sweep(self._description, self._arms, joint - 1)
        return self._sweeps[joint]

    def run(
        self, run: SweepRun, cell: Cell, context: RunContext = NO_CONTEXT, way: StartMotion | None = None
    ) -> str | None:
        """Make a run on an open cell and take it. Returns why it failed, None for a success. Closes the log."""
        joint = run.specification.joint
        reason, columns = run_motion(
            self.sweep(joint).plan, self._description, self._parameters, cell, context, way=way
        )
        if reason is None:
            self._take(joint, columns)
        return reason

    def take_log(self, run: SweepRun, path: Path) -> bool:
        """Take a run that was made before from its log. Returns whether there is a complete one.

        Raises TrialError where the log is of another identification.
        """
        if not path.exists():
            return False
        try:
            log = read_log(path)
        except LogError:
            return False
        about = log.metadata.get("trial", {})
        if about.get("specification") != json.dumps(run.specification.as_dict()):
            raise TrialError(f"{path} is the log of something else: give the friction's file another name")
        if log.metadata.get("result", {}).get("success") != "true":
            return False
        self._take(run.specification.joint, log_columns(log))
        return True

    def _take(self, joint: int, columns: Columns) -> None:
        for side, samples in enumerate(self._samples):
            taken = joint_samples(columns, side, self.sweep(joint), self._arms[side])
            samples.setdefault(joint, []).append(taken)

    def friction(self, joint: int) -> tuple[JointFriction, JointFriction]:
        """Return the friction of joint 1 to 7 of the left and of the right arm. KeyError where there is no run."""
        published = FrictionParameters()
        left, right = (fit_joint(samples[joint], published, joint - 1) for samples in self._samples)
        return left, right

    def file(self, cell: str, seed: int) -> FrictionFile:
        """Return the file of all joints."""
        both = [self.friction(joint) for joint in range(1, JOINTS + 1)]
        left, right = (
            ArmFriction(**{name: tuple(getattr(arm[side], name) for arm in both) for name in ArmFriction.__slots__})
            for side in (0, 1)
        )
        runs = min(len(samples) for side in self._samples for samples in side.values())
        return FrictionFile(cell, seed, runs, left, right)


def lowest_object(description: CellDescription) -> str:
    """Return the object that is least in the way, for cells that always have one."""
    return min(description.objects, key=lambda name: description.objects[name].size[2])
