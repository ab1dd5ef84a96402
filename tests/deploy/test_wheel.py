"""What is installed by pip alone, without a clone: the command, the pages, the models."""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import httpx
import pytest

from hal.compilation import cache_folder

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 120.0
PAGES = ("/", "/logs", "/trials", "/campaigns", "/api", "/api/openapi.json", "/static/css/frame.css")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a Python that has the wheel's packages, and nothing of the clone."""
    folder = tmp_path_factory.mktemp("wheel")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if name.startswith(("tests/", "docs/")) or not (ROOT / name).exists():
            continue
        (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / "source" / name, follow_symlinks=True)
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([*wheel, "-w", str(folder), str(folder / "source")], check=True, timeout=TIMEOUT_S)
    (made,) = folder.glob("*.whl")
    with zipfile.ZipFile(made) as archive:
        archive.extractall(folder / "installed")
    shutil.rmtree(folder / "source")
    cache = folder / "cache"
    take_compiled(folder / "installed", cache)
    own = {"PYTHONPATH": str(folder / "installed"), "PYTHONSAFEPATH": "1", "NUMBA_CACHE_DIR": str(cache)}
    return os.environ | own


def take_compiled(installed: Path, cache: Path) -> None:
    """Take what was compiled of the same sources in the clone, which is kept by the folder of a source.

    What cannot be taken is compiled anew: that costs time, and says nothing about what was packed.
    """
    for folder in {source.parent for source in installed.rglob("*.py")}:
        ours = ROOT / folder.relative_to(installed)
        before, now = (
            f"{place.name}_{hashlib.sha1(str(place).encode(), usedforsecurity=False).hexdigest()}"
            for place in (ours, folder)
        )
        compiled = cache_folder() / before
        if compiled.is_dir():
            shutil.copytree(compiled, cache / now)


def test_the_packages_are_the_wheels(installed: dict[str, str], tmp_path: Path) -> None:
    look = (
        "import console, deploy, hal, rtstack, sim_robot; print([m.__file__ for m in (console, deploy, hal, rtstack)])"
    )
    said = subprocess.run(
        [sys.executable, "-c", look], cwd=tmp_path, env=installed, capture_output=True, text=True, check=True
    ).stdout
    assert said.count(installed["PYTHONPATH"]) == 4


def test_the_stack_comes_up_with_its_pages_and_models(installed: dict[str, str], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rtstack", "up", "--port", "0", "--logs", str(tmp_path / "logs")]
    stack = subprocess.Popen(command, cwd=tmp_path, env=installed, stdout=subprocess.PIPE, text=True)
    try:
        assert stack.stdout is not None
        address, token = stack.stdout.readline().split()[-1].split("/?token=")
        with httpx.Client(base_url=address, trust_env=False, timeout=TIMEOUT_S) as client:
            assert client.get("/", params={"token": token}, follow_redirects=True).status_code == 200
            for page in PAGES:
                answer = client.get(page)
                assert (page, answer.status_code) == (page, 200)
                assert answer.content
            assert "rice_box" in client.get("/api/status").json()["objects"]
    finally:
        stack.send_signal(signal.SIGINT)
        stack.communicate(timeout=TIMEOUT_S)
    assert stack.returncode == 0


def test_a_demonstration_is_recorded_without_a_clone(installed: dict[str, str], tmp_path: Path) -> None:
    taught = subprocess.run(
        [sys.executable, "-m", "rtstack", "teach", "ref.mcap"], cwd=tmp_path, env=installed, timeout=TIMEOUT_S,
        capture_output=True, text=True,
    )  # fmt: skip
    assert taught.returncode == 0, taught.stderr
    assert (tmp_path / "ref.mcap").stat().st_size > 100_000
