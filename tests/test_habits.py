"""The habits of the code base, as tests: lint, format, types, and who may import whom."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent


@pytest.mark.timeout(600)  # types: a minute and a half alone, and several beside other tests
@pytest.mark.parametrize(
    "command",
    [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["basedpyright"], ["lint-imports"]],
    ids=" ".join,
)
def test_tool_is_content(command):
    environment = os.environ | {"NODE_OPTIONS": "--max-semi-space-size=128"}  # less of its time for collections
    done = subprocess.run(
        [str(BIN / command[0]), *command[1:]], cwd=ROOT, capture_output=True, text=True, timeout=580, env=environment
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]


def test_the_repository_holds_no_vendored_or_built_files():
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    foreign = [f for f in listed if f.endswith((".stl", ".dae", ".obj", ".so", ".whl", ".min.js", ".mcap", ".lock"))]
    assert foreign == []


def test_constraints_pin_and_name_no_address():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert lines
    for line in lines:
        name, _, version = line.partition("==")
        assert name
        assert version, line
        assert "/" not in line, line


def test_tests_share_what_is_in_support_only():
    """No module of the tests imports a test file or changes where modules are looked for, but for docs/generate."""
    wrong = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            if any(part.startswith("test_") for name in names for part in name.split(".")[:3]):
                wrong.append(f"{path.name}:{node.lineno}: imports a test file")
            called = ast.unparse(node) if isinstance(node, ast.Call | ast.Assign) else ""
            if called.startswith(("sys.path.", "sys.path[")) and "docs/generate" not in called:
                wrong.append(f"{path.name}:{node.lineno}: {called}")
    assert wrong == []
