"""A twin: what logs of a cell say about its arms, as a profile of the simulated robot and as files of the cell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.base.configuration import toml_text
from rtstack.control.parameters import FrictionParameters
from rtstack.identification import arm as identification
from rtstack.identification.arm import ArmSamples, Joint, Links, arm_samples
from rtstack.identification.contact import ContactLog, contact_stiffness, estimate_delay
from rtstack.identification.estimate import CONFIDENCE, Estimate
from rtstack.log.analysis.lateness import state_delays_us
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.model.arm_model import ArmModel, face_placement
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, FrictionFile

SHORTEST_S = 5.0  # of all logs together
# of a value, added to each interval: what sampling at 1 kHz and noise in the regressors shift, 0.1 to 0.2 % on a robot
# of known parameters
METHOD = 0.0025
FEWEST = 200  # samples without contact that are fitted
LINK = tuple(f"link_late_{each}_us" for each in ("50", "90", "99", "99.9"))
LINK_SHARES = (0.5, 0.9, 0.99, 0.999)  # of states that come no later
RESAMPLED, FEWEST_BLOCKS = 400, 20
# half the width of an interval, beyond which a parameter counts as not identified: a share of its value, or its unit
SURE = {
    "friction_p1": 0.1, "friction_p2": 0.5, "B_theta": 0.1, "K": 0.1, "D": 0.25, "payload_kg": 0.1,
    "contact_stiffness": 0.1, **dict.fromkeys(LINK, 0.5),
}  # fmt: skip
SURE_ABSOLUTE = {"friction_p3": 0.05, "gravity_factor": 0.02, "payload_kg": 0.05, "payload_moment": 0.02,
    "estimate_delay_ms": 0.5,  # a profile counts whole ms
    **dict.fromkeys(LINK, 20.0),
}  # fmt: skip
# added like METHOD: what samples of 1 ms and substeps of 0.25 ms leave open of a delay, ms
METHOD_ABSOLUTE = {"estimate_delay_ms": 0.125}
WHOLE = ("estimate_delay_ms",)
TOUCHING = ("estimate_delay_ms", "contact_stiffness")  # what free space does not show


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
    """What the logs say about an arm. rms_nm: of the torque through each joint on what was held out, (7,): from the
    motor's side with the published numbers and with the twin's, and from the links' side."""

    parameters: tuple[Parameter, ...]
    rms_nm: Mapping[str, Sequence[float]]

    def values(self, name: str) -> list[Parameter]:
        """Return the parameters of a name, by joint."""
        return [each for each in self.parameters if each.name == name]


def twin(
    paths: Sequence[Path], description: CellDescription, cutoff_hz: float, unloaded: Sequence[Path] = (),
    held_out: Sequence[Path] = (),
) -> dict[str, ArmTwin]:  # fmt: skip
    """Identify the arms of a cell, by side. Raises TrialError with one line.

    unloaded: logs of the same arms without the payload, which no error of the links can pass for then; without them no
    payload is told. held_out: logs that are judged on and not fitted, instead of the end of each log. cutoff_hz: of the
    low-pass of the simulated robot's estimate of external torques; what is identified is the delay beyond it.
    """
    mountings = description.arms
    models = [ArmModel(mounting, description.pad).pin_model for mounting in mountings]
    try:
        logs = {each: read_log(each) for each in (*paths, *unloaded, *held_out)}
        sides = description.sides
        loaded, bare, judged = (
            [tuple(_whole_ticks(logs[each], side) for side in sides) for each in some]
            for some in (paths, unloaded, held_out)
        )
        cycles = [[logs[each].topic(f"/{side}/cycle") for each in (*paths, *unloaded)] for side in sides]
    except LogError as error:
        raise TrialError(str(error)) from None
    samples = [_samples(model, loaded, side, judged) for side, model in enumerate(models)]
    empty = [_samples(model, bare, side) if bare else None for side, model in enumerate(models)]
    links = [identification.links(one, other) for one, other in zip(samples, empty, strict=True)]
    touched = [ContactLog(log, tuple(link.inertial[k] for link in links))
               for k, logs in enumerate((loaded, bare)) for log in logs]  # fmt: skip
    delays = [estimate_delay(model, touched, side, cutoff_hz) for side, model in enumerate(models)]
    late_ms = [float(delay.value[0]) for delay in delays]
    faces = [
        face_placement(mounting, description.pad, model) for mounting, model in zip(mountings, models, strict=True)
    ]
    offsets = [identification.bias(each).value for each in samples]
    pair = len(models) == 2  # a squeeze needs two pads
    stiffness = contact_stiffness(models, faces, touched, offsets, late_ms, cutoff_hz) if pair else None
    squeezed = () if stiffness is None else (_named(TOUCHING[1], 0, stiffness, 0),)
    late = [link_lateness(each) for each in cycles]
    inertias = [mounting.robot.B_theta for mounting in mountings]
    found = [_arm(*each) for each in zip(links, samples, inertias, strict=True)]
    return {
        side: replace(arm, parameters=(
            *arm.parameters, _named(TOUCHING[0], 0, delay, 0), *squeezed,
            *(_named(name, 0, network, k) for k, name in enumerate(LINK)),
        )) for side, arm, delay, network in zip(sides, found, delays, late, strict=True)
    }  # fmt: skip


def link_lateness(logs: Sequence[NDArray]) -> Estimate:
    """Return by how much states come later than the fastest do, us: quantiles at LINK_SHARES, of CYCLE records. The
    intervals are of blocks of BLOCK_S drawn anew: states that are late together count once."""
    late = [state_delays_us(log) for log in logs if len(log)]
    size = round(identification.BLOCK_S / identification.PERIOD_S)
    blocks = [part for each in late for part in np.array_split(each, max(1, len(each) // size))]
    if len(blocks) < FEWEST_BLOCKS:
        return Estimate(np.zeros(len(LINK)), np.full(len(LINK), np.inf))
    generator = np.random.default_rng(0)
    value = np.quantile(np.concatenate(blocks), LINK_SHARES)
    choices = generator.integers(0, len(blocks), (RESAMPLED, len(blocks)))
    drawn = [np.quantile(np.concatenate([blocks[k] for k in choice]), LINK_SHARES) for choice in choices]
    low, high = np.quantile(drawn, (0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)), axis=0)
    return Estimate(value, np.maximum(high - value, value - low))


def _samples(
    model: Any, logs: Sequence[tuple[NDArray, ...]], side: int, held_out: Sequence[tuple[NDArray, ...]] = ()
) -> ArmSamples:  # fmt: skip
    seconds = sum(len(log[side]) for log in logs) * identification.PERIOD_S
    if seconds < SHORTEST_S:
        raise TrialError(f"{seconds:.1f} s of logs identify nothing; make one of 22 s with rtstack excite OUT.mcap")
    found = arm_samples(model, [log[side] for log in logs], [log[side] for log in held_out])
    if np.sum(~found.held_out) < FEWEST:
        raise TrialError("something is touched nearly all the time: make logs in free space (rtstack excite)")
    return found


def _whole_ticks(log: Log, side: str) -> NDArray:
    records = log.topic(f"/{side}/arm")
    if len(records) < 4 * identification.WINDOW:
        raise TrialError(f"{log.path}: it has no samples of the {side} arm: it says nothing about it")
    if np.any(np.diff(records["t_ns"]) != round(1e9 * identification.PERIOD_S)):
        raise TrialError(f"{log.path}: samples of the {side} arm are missing: the twin needs each millisecond")
    return records


def _arm(link: Links, samples: ArmSamples, B_theta: NDArray[np.floating]) -> ArmTwin:
    published = FrictionParameters()
    friction = np.array([published.p1, published.p2, published.p3]).T
    joints = [identification.joint(link, j, friction[j], float(B_theta[j])) for j in range(7)]
    load = "payload_kg", *(f"payload_moment_{axis}" for axis in "xyz")
    parameters = [_named(name, 0, link.payload, k) for k, name in enumerate(load)]
    for j, found in enumerate(joints, 1):
        parameters += [_named(name, j, found.motor, k) for k, name in enumerate(Joint.MOTOR)]
        parameters += [_named(name, j, found.spring, k) for k, name in enumerate(Joint.SPRING)]
    offsets = identification.bias(samples)
    parameters += [_named("torque_offset", 1 + j, offsets, j) for j in range(7)]
    before = [
        _rms(link, j, np.array([*friction[j], B_theta[j], 1.0, *np.zeros(identification.SHAPES)])) for j in range(7)
    ]
    after = [_rms(link, j, found.motor.value) for j, found in enumerate(joints)]
    every = link.samples
    motion = np.sqrt(np.mean((link.torque - every.tau_J)[every.held_out] ** 2, axis=0)).tolist()
    return ArmTwin(tuple(parameters), {"motor, published": before, "motor, twin": after, "links, twin": motion})


def _named(name: str, joint: int, estimate: Estimate, k: int) -> Parameter:
    value = float(estimate.value[k])
    half = float(np.hypot(estimate.half_width[k], METHOD_ABSOLUTE.get(name, METHOD * value)))
    bound = max(
        SURE.get(name, 0.0) * abs(value), SURE_ABSOLUTE.get(name.rstrip("xyz").rstrip("_"), 0.0),
        np.inf if name == "torque_offset" else 0.0,
    )  # fmt: skip
    return Parameter(name, joint, value, half, half < bound)


def _rms(link: Links, j: int, x: Array) -> float:
    samples = link.samples
    error = (identification.predicted(link, j, x) - samples.tau_J[:, j])[samples.held_out]
    return float(np.sqrt(np.mean(error**2)))


def profile_toml(arms: Mapping[str, ArmTwin], base: Mapping[str, Any]) -> str:
    """Return the text of a profile of the simulated robot: `base`, a profile, with what was identified of each arm."""
    document = dict(base)
    for side, found in arms.items():
        table: dict[str, Any] = {}
        for name in (*Joint.MOTOR, *Joint.SPRING, "torque_offset"):
            its = found.values(name)
            if all(each.identified for each in its):
                table[name] = [each.value for each in its]
        for name in TOUCHING:
            for its in found.values(name):
                if its.identified:
                    table[name] = max(0, round(its.value)) if name in WHOLE else its.value
        late = [found.values(name)[0] for name in LINK]
        if all(each.identified for each in late):
            table["link_late_us"] = [each.value for each in late]
        mass = found.values("payload_kg")[0]
        if mass.identified and abs(mass.value) > mass.half_width:
            moment = [found.values(f"payload_moment_{axis}")[0].value for axis in "xyz"]
            table |= {"payload_kg": mass.value, "payload_centre": [each / mass.value for each in moment]}
        document[side] = table
    return toml_text(document, "Identified by `rtstack twin`; what it could not identify is left as it was.")


def friction_file(arms: Mapping[str, ArmTwin], cell: str, runs: int) -> FrictionFile:
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

    return FrictionFile(cell, 0, runs, **{side: own(found) for side, found in arms.items()})
