"""A lab's own arms and objects: what the plant takes of the cell's file, where the controller finds its own values.

A file with `model` or `pad` in [left] or [right] gives the simulated arm both, and its `home`; one with `model` places
its base and the table, too. A file with one of the two tables describes a cell with this arm alone. [objects.NAME] and
[objects.NAME.plant]: docs/howto/cell.md.
"""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError, from_document, read_toml
from hal.robots import reference_in
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import NO_OBJECT, SIDES, ArmPlacement, GraspObject, Scene, Table

# cardboard that is backed by its filling: those of the grabbing scene's rice_box
WALLS = {"stiffness": 1e5, "damping_ratio": 0.6}
_BASE = {"base_position": "T_world_base_position", "base_orientation_wxyz": "T_world_base_wxyz"}
_UNITS = {"mass": " kg", "size": " m", "pad_friction": "", "table_friction": ""}  # what both sides may know


def with_lab_objects(scene: Scene, cell_file: Path) -> Scene:
    """Return the scene with arms and objects of a cell's file. Raises ConfigurationError, naming the key."""
    described = read_toml(cell_file)[0]
    own = [side for side in SIDES if side in described]
    if len(own) == 1:
        scene = scene.only(own)
    objects = dict(scene.objects)
    for name, thing in _described(cell_file).items():
        if name == NO_OBJECT:
            continue
        scenes = objects.get(name)
        plants = thing.get("plant", {})
        if not isinstance(plants, dict):
            raise ConfigurationError(f"{cell_file}: objects.{name}.plant: expected a table, got {plants!r}")
        measured = WALLS | {key: thing[key] for key in _UNITS if key in thing}
        known = measured if scenes is None else {k: v for k, v in asdict(scenes).items() if v is not None}
        objects[name] = from_document({**known, **plants}, GraspObject, f"{cell_file}: objects.{name}.plant")
    arms = {
        side: _as_described(arm, described.get(side, {}), cell_file, side)
        for side, arm in zip(scene.sides, scene.arms, strict=True)
    }
    table, tables = described.get("table"), [described.get(side) for side in arms]
    if isinstance(table, dict) and any(isinstance(each, dict) and "model" in each for each in tables):
        scene = replace(scene, table=from_document(asdict(scene.table) | table, Table, f"{cell_file}: table"))
    return replace(scene, objects=objects, **arms)


def _as_described(arm: ArmPlacement, described: Any, cell_file: Path, side: str) -> ArmPlacement:
    if not isinstance(described, dict) or not {"model", "pad"} & set(described):
        return arm
    where = f"{cell_file}: {side}"
    own = {key: described[key] for key in ("model", "pad", "home") if key in described}
    if not isinstance(own.get("model", ""), str):
        raise ConfigurationError(f"{where}: model: expected a name or the path of a TOML, got {own['model']!r}")
    if "model" in own:
        own["model"] = reference_in(cell_file, own["model"])
        own |= {_BASE[key]: described[key] for key in _BASE if key in described}
    known = {field.name: getattr(arm, field.name) for field in fields(arm) if field.name not in ("hand", "pad")}
    placed = replace(from_document(known | own, ArmPlacement, where), hand=arm.hand)
    load_plant_parameters().of(placed.robot)  # a bad key of its table [plant] is found before anything is opened
    return placed


def difference(scene: Scene, cell_file: Path, name: str) -> str | None:
    """Return in one line in what the plant's object differs from the cell's file. scene: with the file's objects."""
    described = _described(cell_file).get(name)
    if described is None or name not in scene.objects:
        return None
    counted = read_toml(cell_file)[0].get("contact_friction", {})
    described = {f"{what}_friction": counted[what] for what in ("pad", "table") if what in counted} | described
    plants: dict[str, Any] = asdict(scene.objects[name])
    plants["pad_friction"], plants["table_friction"] = scene.frictions(name)
    other = [
        f"{key} {_text(plants[key])}{unit} (the controller: {_text(described[key])}{unit})"
        for key, unit in _UNITS.items()
        if key in described and _text(plants[key]) != _text(described[key])
    ]
    return f"the plant's {name} is not what the cell's file describes: {', '.join(other)}" if other else None


def _described(cell_file: Path) -> dict[str, dict[str, Any]]:
    table = read_toml(cell_file)[0].get("objects", {})
    if not isinstance(table, dict) or not all(isinstance(value, dict) for value in table.values()):
        raise ConfigurationError(f"{cell_file}: objects: expected a table for each object")
    return table


def _text(value: Any) -> str:
    return " x ".join(f"{float(part):g}" for part in value) if isinstance(value, list | tuple) else f"{float(value):g}"
