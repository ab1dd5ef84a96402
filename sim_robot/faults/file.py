"""A faults file: `[[fault]]` tables of TOML into `ScriptedFault` records. What each kind and key means: `kinds`."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError, from_document, one_line, place_of, read_toml
from sim_robot.faults.kinds import KINDS, Mode, ObjectTilted, Origin, Reflex, ScriptedFault
from sim_robot.scene import SIDES

LONGEST_S = 1e6


class FaultNeedsLink(ConfigurationError):
    """A fault of the link where no link is."""


def load_faults(path: Path, sides: Sequence[str] = SIDES) -> tuple[ScriptedFault, ...]:
    """Read a faults file for a cell with these arms. Raises ConfigurationError with one line: place, key, remedy."""
    document, text = read_toml(path)
    return faults_in(document, str(path), text, sides)


def faults_in(
    document: dict[str, Any], source: str, text: str = "", sides: Sequence[str] = SIDES
) -> tuple[ScriptedFault, ...]:
    """Check a parsed document for a cell with these arms; text: its TOML, to name lines. Raises ConfigurationError."""
    for key in document:
        if key != "fault":
            raise ConfigurationError(one_line(f"{source}: unknown key {key!r}; each fault is a [[fault]] table"))
    tables = document.get("fault", [])
    if not isinstance(tables, list):
        raise ConfigurationError(f"{source}: 'fault' must be a list of tables: write [[fault]]")
    faults = []
    for number, table in enumerate(tables, 1):
        try:
            faults.append(_fault(table, sides))
        except (_Wrong, ValueError) as error:  # ValueError: an integer that is too long to be shown
            place = place_of(source, text, ("fault", number - 1, *([error.key] if isinstance(error, _Wrong) else [])))
            raise ConfigurationError(one_line(f"{place}: fault {number}{_named(table)}: {error}")) from None
    return tuple(faults)


def refuse_link_faults(faults: tuple[ScriptedFault, ...]) -> None:
    """Raise FaultNeedsLink where a fault is the link's: a cell in one process has none."""
    kinds = sorted({fault.effect.kind for fault in faults if fault.effect.of_the_link})
    if kinds:
        raise FaultNeedsLink(
            f"faults of the link ({', '.join(kinds)}) need the robot behind its interface: use rtstack sim --faults, "
            "or leave them out"
        )


def tilt_of(faults: tuple[ScriptedFault, ...]) -> float:
    """Return by how much the object is tilted from the start, degrees about the world's x."""
    return sum(fault.effect.tilt_deg for fault in faults if isinstance(fault.effect, ObjectTilted))


class _Wrong(Exception):
    def __init__(self, key: str, message: str) -> None:
        super().__init__(message)
        self.key = key


def _fault(table: Any, arms: Sequence[str]) -> ScriptedFault:
    if not isinstance(table, dict):
        raise _Wrong("", f"expected a table, got {table!r}")
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        said = "missing key 'kind'" if kind is None else f"unknown kind {kind!r}"
        raise _Wrong("kind", f"{said}; choose one of {', '.join(KINDS)}")
    effect = KINDS[kind]
    own = [field.name for field in fields(effect)]
    common = ["kind"] if effect is ObjectTilted else ["kind", "at_s", "when", "delay_s"]
    common += ["arm"] if effect.of_an_arm else []
    common += ["duration_s"] if effect.lasts else []
    for key in table:
        if key not in common + own:
            raise _Wrong(key, f"unknown key {key!r}; its keys are {', '.join(common + own)}")
    sides = _sides(table, arms) if effect.of_an_arm else tuple(range(len(arms)))
    if effect is Mode and not {"at_s", "when", "delay_s"} & set(table):
        origin, delay_ms = Origin.START, 0
    else:
        origin, delay_ms = (Origin.MOTION, 0) if effect is ObjectTilted else _moment(table)
    duration_ms = _milliseconds(table, "duration_s", smallest_s=1e-3) if "duration_s" in table else None
    if effect is Reflex and duration_ms is None:
        duration_ms = 1
    try:
        what = from_document({key: table[key] for key in own if key in table}, effect, "its own keys")
    except ConfigurationError as error:
        raise _Wrong(own[0], str(error).removeprefix("its own keys: ")) from None
    return ScriptedFault(what, sides, origin, delay_ms, duration_ms)


def _sides(table: dict[str, Any], arms: Sequence[str]) -> tuple[int, ...]:
    arm = table.get("arm")
    if arm == "both" and len(arms) > 1:
        return tuple(range(len(arms)))
    if arm not in arms:
        said = "missing key 'arm'" if arm is None else f"arm cannot be {arm!r}"
        raise _Wrong("arm", f"{said}; say {', '.join(arms)}" + (" or both" if len(arms) > 1 else ", the one arm"))
    return (arms.index(arm),)


def _moment(table: dict[str, Any]) -> tuple[Origin, int]:
    if "at_s" in table:
        for key in ("when", "delay_s"):
            if key in table:
                raise _Wrong(key, f"at_s and {key} together: leave one of them out")
        return Origin.MOTION, _milliseconds(table, "at_s")
    if "when" not in table:
        raise _Wrong("delay_s", 'no moment: add at_s (seconds since the first motion) or when = "first_contact"')
    if table["when"] != Origin.FIRST_CONTACT.value:
        raise _Wrong("when", f'when cannot be {table["when"]!r}; say "first_contact", or use at_s')
    return Origin.FIRST_CONTACT, _milliseconds(table, "delay_s") if "delay_s" in table else 0


def _milliseconds(table: dict[str, Any], key: str, smallest_s: float = 0.0) -> int:
    value = table[key]
    if type(value) not in (int, float) or not smallest_s <= value <= LONGEST_S:
        raise _Wrong(key, f"{key} must be a number of seconds from {smallest_s:g} to {LONGEST_S:g}, got {value!r}")
    return round(1e3 * value)


def _named(table: Any) -> str:
    kind = table.get("kind") if isinstance(table, dict) else None
    return f" ({kind})" if isinstance(kind, str) and kind in KINDS else ""
