"""The package of examples/plugin has no error in the strictest mode: what is Unknown there comes from our API."""

import json
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = ("hal", "sim_robot", "rtstack", "console", "deploy")


def strictly(folder: Path, *packages: Path) -> list[str]:
    """Return what basedpyright says of packages in its strict mode, as where rtstack is installed."""
    configuration = {
        "include": [str(package) for package in packages], "typeCheckingMode": "strict",
        "extraPaths": [str(ROOT), sysconfig.get_path("purelib")], "reportMissingModuleSource": False,
    }  # fmt: skip
    (folder / "pyrightconfig.json").write_text(json.dumps(configuration))
    command = [str(Path(sys.executable).with_name("basedpyright")), "-p", str(folder), "--outputjson"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    found = json.loads(done.stdout)
    assert found["summary"]["filesAnalyzed"] > 0
    said = found["generalDiagnostics"]
    return [f"{each['file']}:{each['range']['start']['line'] + 1}: {each['message']}" for each in said]


@pytest.mark.long
def test_a_package_from_outside_has_no_error_in_strict_mode(tmp_path: Path) -> None:
    assert strictly(tmp_path, ROOT / "examples/plugin") == []


@pytest.mark.long
def test_a_law_of_another_signature_is_found(tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(
        "from rtstack.control.controller import ArmLaw\n\n\n"
        "class Law:\n    def command(self) -> None: ...\n\n\nlaw: ArmLaw = Law()\n"
    )
    found = strictly(tmp_path, tmp_path / "wrong.py")
    assert any('"Law" is incompatible with protocol "ArmLaw"' in line for line in found), found


def test_every_package_says_that_it_is_typed() -> None:
    """That the wheel has the files is in tests/deploy."""
    assert [name for name in OURS if not (ROOT / name / "py.typed").exists()] == []
