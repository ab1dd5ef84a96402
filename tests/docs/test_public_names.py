"""No public name changes unnoticed, and what the documentation and the examples import is public."""

import ast
import difflib
import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.docs.blocks import PAGES, ROOT, blocks_of

sys.path.insert(0, str(ROOT / "docs/generate"))

import public_names

OURS = {"rtstack", "hal", "sim_robot", "console", "deploy"}
PROGRAM = ".venv/bin/python docs/generate/public_names.py"


def _python() -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each Python block and example."""
    for page in PAGES:
        yield from ((block.place, block.text) for block in blocks_of(page) if block.language == "python")
    for path in sorted((ROOT / "examples").rglob("*.py")):
        yield str(path.relative_to(ROOT)), path.read_text()
    for path in sorted((ROOT / "examples").rglob("*.ipynb")):
        sources = (
            "".join(cell["source"]) for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"
        )
        yield from ((path.name, source) for source in sources if not source.startswith(("!", "%")))


def _imported(text: str) -> Iterator[str]:
    """Yield what a program imports of ours: MODULE.NAME, or a module."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in OURS:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] in OURS)


def test_what_the_documentation_and_the_examples_import_is_on_the_page():
    public = public_names.names() | {"rtstack"}
    places = dict(_python())
    assert len(places) > 40
    lacking = [f"{place}: {name}" for place, text in places.items() for name in _imported(text) if name not in public]
    assert lacking == [], "put these names on docs/reference/python.md, or import them from where they are listed there"


def test_a_name_that_is_not_public_is_found():
    text = "import numpy\nfrom rtstack.loop.session import Session\nimport hal.wire\n"
    assert list(_imported(text)) == ["rtstack.loop.session.Session", "hal.wire"]


def test_no_public_name_has_changed():
    committed, now = public_names.NAMES.read_text().splitlines(), public_names.lines()
    compared = difflib.unified_diff(committed, now, lineterm="", n=0)
    changed = [line for line in compared if not line.startswith(("+++", "---", "@@"))]
    assert changed == [], f"public names have changed: add an entry under Changed in CHANGELOG.md, then run {PROGRAM}"


def test_a_changed_signature_is_found(monkeypatch, tmp_path):
    place = tmp_path / "rtstack"
    place.mkdir()
    for signature in ("(path: Path) -> Log", "(path: Path, whole: bool=False) -> Log"):
        (place / "reader.py").write_text(f"def read{signature.replace('=', ' = ')}:\n    '''Read.'''\n")
        (tmp_path / "page.md").write_text("::: rtstack.reader\n    options: {members: [read]}\n")
        monkeypatch.setattr(public_names, "ROOT", tmp_path)
        monkeypatch.setattr(public_names, "PAGE", tmp_path / "page.md")
        public_names._tree.cache_clear()
        assert public_names.lines() == [f"rtstack.reader.read{signature}"]
    (tmp_path / "page.md").write_text("::: rtstack.reader\n    options: {members: [write]}\n")
    with pytest.raises(public_names.PageError, match=r"rtstack\.reader has no write"):
        public_names.lines()
    public_names._tree.cache_clear()


def test_every_public_name_can_be_imported():
    for module, members in public_names.listed():
        found = importlib.import_module(module)
        for name in members or ():
            assert hasattr(found, name), f"{module}.{name}"


def test_the_list_says_how_it_is_made():
    assert PROGRAM in (public_names.__doc__ or "")
    assert Path(public_names.NAMES).name == "public_names.txt"
