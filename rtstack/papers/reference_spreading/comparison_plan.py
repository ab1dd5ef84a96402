"""A plan that a person makes on the page Campaigns, from another plan's conditions and its criterion of success."""

import tomllib
from collections.abc import Sequence

from hal.base.configuration import toml_text
from rtstack.experiments.registry import plan_file

PATTERN = "reference-spreading"  # the plan
_MADE = "made on the page Campaigns; the conditions and what a success is are those of the plan"


def comparison_plan(
    name: str, title: str, controllers: Sequence[str], objects: Sequence[str], demonstrations: int,
    displacements_mm: Sequence[float], repetitions: int, seed: int,
) -> str:  # fmt: skip
    """Return the plan's file: controllers x demonstrations of each object x displacements along y x repetitions.

    Raises OSError.
    """
    taken = tomllib.loads(plan_file(PATTERN).path.read_text(encoding="utf-8"))
    first = next(iter(taken["conditions"].items()))
    head = {
        "name": name, "title": title, "seed": seed, "controllers": list(controllers), "success": taken["success"],
        "conditions": dict([first]),
    }  # fmt: skip
    references = [f"{thing}/{number}" for thing in objects for number in range(demonstrations)]
    experiment = {
        "name": "comparison", "references": references, "displacements_mm": list(displacements_mm),
        "repetitions": repetitions, "conditions": [first[0]],
    }  # fmt: skip
    sample = {"references": 1, "displacements_mm": list(displacements_mm[:2]), "repetitions": 1}
    parts = [toml_text(head, f"{_MADE} {taken['name']}"), "[[experiments]]", toml_text(experiment)]
    return "\n".join([*parts, "[experiments.quick]", toml_text(sample)])
