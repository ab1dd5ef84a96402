"""The page on fault scripts has every kind, with the keys that the kind has, and its example is taken."""

import re
import tomllib
from dataclasses import fields
from pathlib import Path

from sim_robot.faults.file import faults_in
from sim_robot.faults.kinds import KINDS, OF_NO_ARM, OF_THE_LINK

PAGE = (Path(__file__).parents[2] / "docs" / "fault_scripts.md").read_text()


def test_every_kind_is_in_the_table_with_its_keys():
    rows = dict(re.findall(r"^\| `(\w+)`([^|]*\|[^|]*)\|", PAGE, re.MULTILINE))
    kinds = {name: row for name, row in rows.items() if name in KINDS}
    assert kinds.keys() == KINDS.keys()
    for name, row in kinds.items():
        effect = KINDS[name]
        assert set(re.findall(r"`(\w+)`", row)) == {field.name for field in fields(effect)}, name
        assert ("of no arm" in row) == (effect in OF_NO_ARM), name
        assert ("of the link" in row) == (effect in OF_THE_LINK), name


def test_the_example_is_taken():
    example = PAGE.split("```toml", 1)[1].split("\n", 1)[1].split("```", 1)[0]
    assert [fault.kind for fault in faults_in(tomllib.loads(example), "the page")] == ["push", "reflex"]
