"""A twin: what logs of a cell say about its arms, as a profile of the simulated robot and as files of the cell."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.configuration import toml_text
from rtstack.control.parameters import FrictionParameters
from rtstack.identification import arm as identification
from rtstack.identification.arm import ArmSamples, Joint, Links, arm_samples
from rtstack.identification.estimate import Estimate
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.samples import SIDES
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, FrictionFile

Array = NDArray[np.float64]

SHORTEST_S = 5.0  # of all logs together
# of a value, added to each interval: what sampling at 1 kHz and noise in the regressors shift, 0.1 to 0.2 % on a robot
# of known parameters
METHOD = 0.0025
FEWEST = 300  # samples without contact
# half the width of an interval, beyond which a parameter counts as not identified: a share of its value, or its unit
SURE = {
    "friction_p1": 0.1, "friction_p2": 0.5, "B_theta": 0.1, "K": 0.1, "D": 0.25, "payload_kg": 0.1,
}  # fmt: skip
SURE_ABSOLUTE = {"friction_p3": 0.05, "gravity_factor": 0.02, "payload_kg": 0.05, "payload_moment": 0.02}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an arm. joint: 1 to 7, 0 of none. identified: whether the interval is narrow enough."""

    name: str
    joint: int
    value: float
    half_width: float
    identified: bool


@dataclass(frozen=True, slots=True)
class ArmTwin:
    """What the logs say about an arm.

    rms_nm: of the torque through each joint on what was held out, (7,): from the motor's side with the published
    numbers and with the twin's, and from the links' side.
    """

    parameters: tuple[Parameter, ...]
    rms_nm: Mapping[str, Sequence[float]]

    def values(self, name: str) -> list[Parameter]:
        """Return the parameters of a name, by joint."""
        return [each for each in self.parameters if each.name == name]


def twin(
    paths: Sequence[Path], description: CellDescription, unloaded: Sequence[Path] = ()
) -> tuple[ArmTwin, ArmTwin]:  # fmt: skip
    """Identify both arms of a cell. unloaded: logs of the same arms without the payload: what of the links is not as
    described cannot pass for a payload then; without them no payload is told. Raises TrialError with one line.
    """
    models = [ArmModel(mounting, description.pad).pin_model for mounting in (description.left, description.right)]
    loaded, empty = _samples(paths, models), _samples(unloaded, models) if unloaded else (None, None)
    left, right = (
        _arm(samples, bare, mounting.robot.B_theta)
        for samples, bare, mounting in zip(loaded, empty, (description.left, description.right), strict=True)
    )
    return left, right


def _samples(paths: Sequence[Path], models: Sequence[Any]) -> list[ArmSamples]:
    try:
        logs = [read_log(path) for path in paths]
        arms = [[_whole_ticks(log, side) for log in logs] for side in SIDES]
    except LogError as error:
        raise TrialError(str(error)) from None
    seconds = sum(map(len, arms[0])) * identification.PERIOD_S
    if seconds < SHORTEST_S:
        raise TrialError(f"{seconds:.1f} s of logs identify nothing; make one of 22 s with rtstack excite OUT.mcap")
    found = [arm_samples(model, records) for model, records in zip(models, arms, strict=True)]
    if min(len(samples.q) for samples in found) < FEWEST:
        raise TrialError("something is touched nearly all the time: make logs in free space (rtstack excite)")
    return found


def _whole_ticks(log: Log, side: str) -> NDArray:
    records = log.topic(f"/{side}/arm")
    if len(records) < 4 * identification.WINDOW:
        raise TrialError(f"{log.path}: it has no samples of the {side} arm: it says nothing about it")
    if np.any(np.diff(records["t_ns"]) != round(1e9 * identification.PERIOD_S)):
        raise TrialError(f"{log.path}: samples of the {side} arm are missing: the twin needs each millisecond")
    return records


def _arm(samples: ArmSamples, bare: ArmSamples | None, B_theta: NDArray[np.floating]) -> ArmTwin:
    published = FrictionParameters()
    friction = np.array([published.p1, published.p2, published.p3]).T
    link = identification.links(samples, bare)
    joints = [identification.joint(link, j, friction[j], float(B_theta[j])) for j in range(7)]
    parameters = [*_named("payload_kg", 0, link.payload, 0), *(
        each for k, axis in enumerate("xyz") for each in _named(f"payload_moment_{axis}", 0, link.payload, 1 + k)
    )]  # fmt: skip
    for j, found in enumerate(joints):
        for k, name in enumerate(Joint.MOTOR):
            parameters += _named(name, 1 + j, found.motor, k)
        for k, name in enumerate(Joint.SPRING):
            parameters += _named(name, 1 + j, found.spring, k)
    offsets = identification.bias(samples)
    parameters += [each for j in range(7) for each in _named("torque_offset", 1 + j, offsets, j)]
    before = [
        _rms(link, j, np.array([*friction[j], B_theta[j], 1.0, *np.zeros(identification.SHAPES)])) for j in range(7)
    ]
    after = [_rms(link, j, found.motor.value) for j, found in enumerate(joints)]
    every = link.samples
    motion = np.sqrt(np.mean((link.torque - every.tau_J)[every.held_out] ** 2, axis=0)).tolist()
    return ArmTwin(tuple(parameters), {"motor, published": before, "motor, twin": after, "links, twin": motion})


def _named(name: str, joint: int, estimate: Estimate, k: int) -> Iterator[Parameter]:
    value = float(estimate.value[k])
    half = float(np.hypot(estimate.half_width[k], METHOD * value))
    bound = max(
        SURE.get(name, 0.0) * abs(value), SURE_ABSOLUTE.get(name.rstrip("xyz").rstrip("_"), 0.0),
        np.inf if name == "torque_offset" else 0.0,
    )  # fmt: skip
    yield Parameter(name, joint, value, half, half < bound)


def _rms(link: Links, j: int, x: Array) -> float:
    samples = link.samples
    error = (identification.predicted(link, j, x) - samples.tau_J[:, j])[samples.held_out]
    return float(np.sqrt(np.mean(error**2)))


def profile_toml(arms: tuple[ArmTwin, ArmTwin], base: Mapping[str, Any]) -> str:
    """Return the text of a profile of the simulated robot: `base`, a profile, with what was identified of each arm."""
    document = dict(base)
    for side, found in zip(SIDES, arms, strict=True):
        table: dict[str, Any] = {}
        for name in (*Joint.MOTOR, *Joint.SPRING):
            its = found.values(name)
            if all(each.identified for each in its):
                table[name] = [each.value for each in its]
        mass = found.values("payload_kg")[0]
        if mass.identified and abs(mass.value) > mass.half_width:
            moment = [found.values(f"payload_moment_{axis}")[0].value for axis in "xyz"]
            table |= {"payload_kg": mass.value, "payload_centre": [each / mass.value for each in moment]}
        document[side] = table
    return toml_text(document, "Identified by `rtstack twin`; what it could not identify is left as it was.")


def friction_file(arms: tuple[ArmTwin, ArmTwin], cell: str, runs: int) -> FrictionFile:
    """Return the friction that a controller compensates; the published one of joints whose own is not identified."""
    published = FrictionParameters()

    def own(found: ArmTwin) -> ArmFriction:
        p1, p2, p3 = (
            tuple(each.value if each.identified else float(getattr(published, name)[each.joint - 1])
                  for each in found.values(f"friction_{name}"))
            for name in ("p1", "p2", "p3")
        )  # fmt: skip
        share = tuple(1.0 - each.value if each.identified else 0.0 for each in found.values("gravity_factor"))
        return ArmFriction(p1, p2, p3, share, tuple(found.rms_nm["motor, twin"]))  # pyright: ignore[reportArgumentType]

    return FrictionFile(cell, 0, runs, own(arms[0]), own(arms[1]))
