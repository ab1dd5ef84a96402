"""Plans of the user's own: TOML files in a folder of theirs, found by name like those of the package."""

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.configuration import ConfigurationError, toml_text
from hal.files import PARTIAL, replacing

_MADE = "made on the page Campaigns; the conditions and what a success is are those of the plan"


def plan_folder() -> Path:
    """Return the folder of the user's own plans, a NAME.toml each."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "rtstack" / "campaigns"


def own_plans() -> dict[str, Path]:
    """Return the user's own plans by name; what they are worth is said when they are read."""
    return {path.stem: path for path in sorted(plan_folder().glob("*.toml"))}


@dataclass(frozen=True, slots=True)
class Comparison:
    """Controllers x demonstrations of objects x displacements along y x repetitions. demonstrations: of each object."""

    name: str
    title: str
    controllers: tuple[str, ...]
    objects: tuple[str, ...]
    demonstrations: int
    displacements_mm: tuple[float, ...]
    repetitions: int
    seed: int

    def text(self, pattern: Path) -> str:
        """Return the plan's file; pattern: a plan whose conditions and success it takes. Raises OSError."""
        taken = tomllib.loads(pattern.read_text(encoding="utf-8"))
        first = next(iter(taken["conditions"].items()))
        head = {
            "name": self.name, "title": self.title, "seed": self.seed, "controllers": list(self.controllers),
            "success": taken["success"], "conditions": dict([first]),
        }  # fmt: skip
        references = [f"{thing}/{number}" for thing in self.objects for number in range(self.demonstrations)]
        experiment = {
            "name": "comparison", "references": references, "displacements_mm": list(self.displacements_mm),
            "repetitions": self.repetitions, "conditions": [first[0]],
        }  # fmt: skip
        sample = {"references": 1, "displacements_mm": list(self.displacements_mm[:2]), "repetitions": 1}
        return "\n".join(
            [
                toml_text(head, f"{_MADE} {taken['name']}"),
                "[[experiments]]", toml_text(experiment),
                "[experiments.quick]", toml_text(sample),
            ]
        )  # fmt: skip


def keep_plan(comparison: Comparison, pattern: Path, read: Any) -> Path:
    """Write a plan into the user's folder, never over another one. read: reads and checks a plan's file.

    Raises ConfigurationError with one line; then nothing is written.
    """
    path = plan_folder() / f"{comparison.name}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise ConfigurationError(f"name: there is a plan {comparison.name} already, {path}; take another name")
        with replacing(path) as new:
            new.write_text(comparison.text(pattern), encoding="utf-8")
            try:
                read(new)
            except ConfigurationError as error:
                line = str(error).partition(PARTIAL)[2].lstrip(":0123456789 ") or str(error)
                raise ConfigurationError(line) from None
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
    return path
