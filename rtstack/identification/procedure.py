"""The procedure: every joint of every arm, so many runs each, a log a run; and the file that is made of the logs."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rtstack.control.parameters import FrictionParameters
from rtstack.identification.fit import JointFriction, JointSamples, fit_joint, joint_samples
from rtstack.identification.sweep import Sweep, sweep
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.trials.assembly import Parameters, arm_controllers, default_parameters, with_law
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, FrictionFile
from rtstack.trials.move import PreparedMotion
from rtstack.trials.review import log_columns
from rtstack.trials.specification import SweepSpecification

JOINTS = 7


def sweep_log(asked: SweepSpecification) -> str:
    """Return the name of the log of a sweep."""
    return f"joint{asked.joint}-run{asked.run}.mcap"


def runs_of(object_name: str, runs: int, seed: int) -> Iterator[SweepSpecification]:
    """Yield all runs of an identification, in order: run by run, so that one which is broken off has all joints."""
    for run in range(runs):
        for joint in range(1, JOINTS + 1):
            yield SweepSpecification(object_name, joint, run, seed)


def uncompensated(description: CellDescription) -> Parameters:
    """Return the published numbers with the cell's law, and with friction compensation zero, as Appendix A asks for."""
    none = (FrictionParameters(scale=0.0),) * len(description.arms)
    return with_law(replace(default_parameters(), friction=none), description.gains.law_inertia)


class Identification:
    """The identification of a cell's arms. Knows the sweeps; takes runs; gives the file."""

    def __init__(self, description: CellDescription) -> None:
        self._description = description
        self._parameters = uncompensated(description)
        self._arms = arm_controllers(description, self._parameters)
        self._sweeps: dict[int, Sweep] = {}
        self._samples: tuple[dict[int, list[JointSamples]], ...] = tuple({} for _ in self._arms)

    def sweep(self, joint: int) -> Sweep:
        """Return the sweep of joint 1 to 7."""
        if joint not in self._sweeps:
            self._sweeps[joint] = sweep(self._description, self._arms, joint - 1)
        return self._sweeps[joint]

    def prepared(self, asked: SweepSpecification) -> PreparedMotion:
        """Return a run to be carried out, through noise of its own. It overwrites a log that was broken off."""
        noise = 1000 * asked.run + asked.joint
        return PreparedMotion(asked, self._description, self.sweep(asked.joint).plan, self._parameters, noise, True)

    def take_log(self, asked: SweepSpecification, path: Path) -> bool:
        """Take a run that was made before from its log; return whether there is a complete one. Raises TrialError where
        the log is of another identification."""
        if not path.exists():
            return False
        try:
            log = read_log(path)
        except LogError:
            return False
        if log.metadata.get("trial", {}).get("specification") != json.dumps(asked.as_dict()):
            raise TrialError(f"{path} is the log of something else: give the friction's file another name")
        if log.metadata.get("result", {}).get("success") != "true":
            return False
        self.take(asked.joint, log_columns(log))
        return True

    def take(self, joint: int, columns: Columns) -> None:
        """Take the samples of a run of joint 1 to 7 that succeeded."""
        for side, samples in enumerate(self._samples):
            samples.setdefault(joint, []).append(joint_samples(columns, side, self.sweep(joint), self._arms[side]))

    def friction(self, joint: int) -> tuple[JointFriction, ...]:
        """Return the friction of joint 1 to 7 of each arm. KeyError where there is no run."""
        published = FrictionParameters()
        return tuple(fit_joint(samples[joint], published, joint - 1) for samples in self._samples)

    def file(self, cell: str, seed: int) -> FrictionFile:
        """Return the file of all joints."""
        joints = [self.friction(joint) for joint in range(1, JOINTS + 1)]
        arms = {
            side: ArmFriction(
                **{name: tuple(getattr(one[k], name) for one in joints) for name in ArmFriction.__slots__}
            )
            for k, side in enumerate(self._description.sides)
        }
        runs = min(len(samples) for side in self._samples for samples in side.values())
        return FrictionFile(cell, seed, runs, **arms)


def lowest_object(description: CellDescription) -> str:
    """Return the object that is least in the way, for cells that always have one."""
    return min(description.objects, key=lambda name: description.objects[name].size[2])
