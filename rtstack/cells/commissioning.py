"""The commissioning of a cell of real arms: which steps were signed, which are open, and what is capped until then.

The record is a file beside the cell's, CELL.commissioning.toml, with one table for each signed step. A step counts as
long as its facts are those of today: another pad, base, box, firmware, version or limit opens it again.
"""

import datetime
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, load_toml, toml_text
from rtstack.cells.kinds import kind_of
from rtstack.model.cell_description import CellDescription
from rtstack.safety.guided import SPEED_M_S
from rtstack.safety.limits import CONTACT_FORCE_N, FORCES_BY_PHASE
from rtstack.samples import SIDES

_PHASES = ("", "_contact", "_approach")
# Until the foam was pressed: a person's reduced speed, and in all phases what may be felt where nothing is to be met:
# 50 N for the judge, at which the robot's own threshold is 65 N (rtstack.safety.limits)
CAP: dict[str, Any] = {"ee_speed_max": SPEED_M_S} | {
    f"{what}{phase}_max": FORCES_BY_PHASE[f"{what}_approach_max"] for what in ("force", "tau_ext") for phase in _PHASES
}
# then, until a first grab: a demonstration opens its hands at 0.57 m/s
DEMONSTRATION_CAP: dict[str, Any] = {"ee_speed_max": 0.6, "force_max": CONTACT_FORCE_N}
_START_RAD_S = 0.2
# kinds of run that wait, each with what it does
_AFTER_A_GRAB = {
    "trial": "a trial hits its object", "hit": "the pad hits the platform",
    "identification": "its joints turn at up to 1 rad/s",
}  # fmt: skip
_GRABS = {"demonstration": "a demonstration hits its object", "place": "the pads take an object"}


@dataclass(frozen=True, slots=True)
class Step:
    """One step of commissioning. needs: the facts that it depends on; command: what carries it out and signs it."""

    name: str
    what: str
    needs: tuple[str, ...]
    command: str


@checked(frozen=True, slots=True, config=STRICT)
class Signature:
    """A signed step: its name, the signer (by), the time (at, UTC), what was measured, and the facts that it was signed
    for, each as a digest. log: file name of the run that shows it."""

    name: str
    by: str
    at: datetime.datetime
    log: str = ""
    values: dict[str, float | str] = field(default_factory=dict)
    facts: dict[str, str] = field(default_factory=dict)


@checked(frozen=True, slots=True, config=STRICT)
class _Record:
    step: tuple[Signature, ...] = ()


@dataclass(frozen=True, slots=True)
class StepState:
    """A step and its last signature, None where there is none. changed: the facts that are others since."""

    step: Step
    signature: Signature | None
    changed: tuple[str, ...]

    @property
    def done(self) -> bool:
        return self.signature is not None and not self.changed


def record_file(cell_file: Path) -> Path:
    return cell_file.with_name(f"{cell_file.stem}.commissioning.toml")


def steps(description: CellDescription) -> tuple[Step, ...]:
    arms = description.mountings
    kind = "fci:" + ",".join(arms[side].address if side in arms else "" for side in SIDES).rstrip(",")
    box, pad, base, firmware = ([f"{side} {fact}" for side in arms] for fact in ("box", "pad", "base", "firmware"))
    every = (*box, *pad, *firmware, "software")
    whole = (*every, *base, "limits")
    by_log = "rtstack commission {0} --log LOG.mcap".format
    return (
        *(
            Step(f"hold {side}", "payload, force estimate, link", tuple(facts), f"rtstack check --{side} {arm.address}")
            for (side, arm), *facts in zip(arms.items(), box, pad, firmware, ["software"] * len(arms), strict=True)
        ),
        *(
            Step(f"wiggle {side}", "it is this arm", (fact,), f"rtstack wiggle {side} --cell {kind}")
            for side, fact in zip(arms, box, strict=True)
        ),
        Step("guide", "led by hand", (*box, *firmware, "software"), f"rtstack guide --cell {kind}"),
        Step("calibrate", "measured", (*pad, *base), f"rtstack calibrate POINTS.toml --cell {kind} --write"),
        Step("motion", "each pad moves by 50 mm, and meets nothing", whole, by_log("motion")),
        Step("foam", "each pad presses on foam with 10 to 65 N", whole, by_log("foam")),
        Step("object", "a first grab, of the lightest object", whole, by_log("object")),
    )


def facts(description: CellDescription, firmware: Mapping[str, str]) -> dict[str, str]:
    """Return the facts of a cell by name, each as a digest. firmware: system version by side, as Desk reports it."""
    found: dict[str, Any] = {"software": version("rtstack"), "limits": description.safety}
    for (side, arm), pad in zip(description.mountings.items(), description.pads, strict=True):
        found[f"{side} box"] = arm.address, arm.serial, Path(arm.model).name
        found[f"{side} pad"] = asdict(pad)
        found[f"{side} base"] = arm.base_position, arm.base_orientation_wxyz
        found[f"{side} firmware"] = firmware.get(side, "")
    return {name: digest(value) for name, value in found.items()}


def digest(value: Any) -> str:
    """Return a fact's value as the record has it."""
    return hashlib.sha256(json.dumps(value, default=str).encode()).hexdigest()[:12]


def signatures(cell_file: Path) -> tuple[Signature, ...]:
    """Return what was signed for a cell's file, oldest first. Raises ConfigurationError."""
    file = record_file(cell_file)
    return load_toml(file, _Record).step if file.exists() else ()


def known_firmware(signed: Sequence[Signature]) -> dict[str, str]:
    """Return the digest of the firmware of each arm, by side, when it was held last."""
    return {
        name.split()[0]: digest
        for each in signed if each.name.startswith("hold ")
        for name, digest in each.facts.items() if name.endswith(" firmware")
    }  # fmt: skip


def states(description: CellDescription, cell_file: Path) -> tuple[StepState, ...]:
    """Return each step of a cell, as its file describes it, with its last signature. Raises ConfigurationError."""
    signed = signatures(cell_file)
    now = facts(description, {}) | {f"{side} firmware": of for side, of in known_firmware(signed).items()}
    last = {each.name: each for each in signed}
    found = []
    for step in steps(description):
        one = last.get(step.name)
        changed = () if one is None else tuple(fact for fact in step.needs if one.facts.get(fact) != now[fact])
        found.append(StepState(step, one, changed))
    return tuple(found)


def sign(
    step: str, by: str, values: Mapping[str, float | str], description: CellDescription, cell_file: Path | None,
    firmware: Mapping[str, str] | None = None, log: str = "",
) -> None:  # fmt: skip
    """Append a signed step to the record. firmware: by side; None: as it was when the arms were held last.

    Raises ConfigurationError for an unknown step, an empty name and a file that cannot be written.
    """
    if cell_file is None or description.simulated:
        raise ConfigurationError("only a cell of real arms is commissioned: name its file with --cell-file")
    names = [each.name for each in steps(description)]
    if step not in names:
        raise ConfigurationError(f"there is no step {step!r}: there are {', '.join(names)}")
    if not by.strip():
        raise ConfigurationError("a step is signed with a name: --sign NAME")
    now = facts(description, firmware or {})
    if firmware is None:
        now |= {f"{side} firmware": of for side, of in known_firmware(signatures(cell_file)).items()}
    at = datetime.datetime.now(datetime.UTC).replace(microsecond=0).isoformat()
    written = {"name": step, "by": by.strip(), "at": at, "log": log, "values": dict(values), "facts": now}
    text = toml_text({"step": written}).replace("[step", "[[step", 1).replace("]", "]]", 1)
    try:
        with record_file(cell_file).open("a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise ConfigurationError(f"{record_file(cell_file)}: cannot be written: {error.strerror}") from None


@dataclass(frozen=True, slots=True)
class Commissioning:
    states: tuple[StepState, ...]

    @property
    def next(self) -> StepState | None:
        """The first open step, None where all are done."""
        return next((state for state in self.states if not state.done), None)

    @property
    def line(self) -> str:
        """What is capped, and what is next, in one line; "" where commissioning is complete."""
        state = self.next
        if state is None:
            return ""
        cap = "0.6 m/s, 140 N, demonstrations" if state.step.name == "object" else "0.25 m/s, 65 N, no impact"
        why = f", open again because these have changed: {', '.join(state.changed)}" * bool(state.changed)
        return f"being commissioned, capped to {cap}; next: {state.step.name} ({state.step.command}){why}"

    def capped(self, description: CellDescription) -> CellDescription:
        """Return the description with what the open steps allow."""
        state = self.next
        if state is None:
            return description
        line, refused = self.line, dict(description.refused)
        unsafe = [each.step.name for each in self.states if each.step.name[:4] in ("hold", "wigg") and not _sound(each)]
        if unsafe:
            refused["guide"] = f"no hand on an arm before {unsafe[0]} is signed: the cell is {line}"
        last = state.step.name == "object"
        cap = DEMONSTRATION_CAP if last else CAP
        for verb, why in (_AFTER_A_GRAB if last else _AFTER_A_GRAB | _GRABS).items():
            refused[verb] = f"not yet: {why}: the cell is {line}"
        own = FORCES_BY_PHASE | description.safety
        tighter = {key: np.minimum(own.get(key, most), most).tolist() for key, most in cap.items()}
        slow = replace(description.start_motion, speed_rad_s=min(_START_RAD_S, description.start_motion.speed_rad_s))
        safety = description.safety | tighter
        return replace(description, safety=safety, start_motion=slow, refused=refused, commissioning=line)


def _sound(state: StepState) -> bool:
    """Whether a step was signed for this box and this pad: another version does not keep a hand from an arm."""
    return state.signature is not None and not any(fact.endswith((" box", " pad")) for fact in state.changed)


def commissioned(kind: str, description: CellDescription, cell_file: Path) -> CellDescription:
    """Return the description of a cell, capped where its arms are real and its commissioning is not complete.

    kind: as the command line spells it. Raises TrialError, ConfigurationError.
    """
    found, argument = kind_of(kind)
    if description.simulated or found.simulated(argument, description):  # a file of a simulated cell is refused later
        return description
    return Commissioning(states(description, cell_file)).capped(description)
