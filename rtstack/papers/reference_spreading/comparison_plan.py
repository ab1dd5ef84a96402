"""A plan that a person makes on the page Campaigns, from another plan's conditions and its criterion of success."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from hal.base.configuration import toml_text

PATTERN = "reference-spreading"  # the plan
_MADE = "made on the page Campaigns; the conditions and what a success is are those of the plan"


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
