"""The hazard table names tests that there are."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_every_test_that_a_hazard_names_is_there():
    text = (ROOT / "docs/reference/hazards.md").read_text()
    named = re.findall(r"`(tests/[\w/.]+)`", text)
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).is_file()] == []
