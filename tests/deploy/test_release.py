"""What a release says of itself is the same everywhere, and two builds of it are the same file."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_every_file_names_the_same_version() -> None:
    (cited,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited == PROJECT["version"]
    assert json.loads((ROOT / "codemeta.json").read_text())["version"] == PROJECT["version"]


def test_every_dependency_is_in_the_table_and_no_other() -> None:
    extras = {
        name: lines for name, lines in PROJECT["optional-dependencies"].items() if name not in ("all", "dev", "docs")
    }
    wanted = {re.split(r"[=<>\[;]", each)[0] for lines in (PROJECT["dependencies"], *extras.values()) for each in lines}
    page = (ROOT / "docs/reference/dependencies.md").read_text()
    assert set(re.findall(r"^\| ([\w-]+) \|", page, re.MULTILINE)) - {"package", "extra"} == wanted


@pytest.mark.long
def test_two_builds_in_two_folders_are_the_same_file(tmp_path: Path) -> None:
    built = []
    for k in range(2):
        source = tmp_path / f"clone{k}"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(source)], check=True)
        for path in sorted(source.rglob("*")):
            os.utime(path, (1e9 + k * 1e7, 1e9 + k * 1e7))
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "wheel",
                "--quiet",
                "--no-deps",
                "--wheel-dir",
                str(tmp_path / str(k)),
                str(source),
            ],
            check=True,
        )
        built += (tmp_path / str(k)).glob("*.whl")
    assert built[0].read_bytes() == built[1].read_bytes()
