"""What is installed by pip alone, without a clone: command, pages, models, a package that extends it; and a release."""

import hashlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np
import pytest

from hal.compilation import cache_folder
from hal.robots import robot
from rtstack.log.reader import read_log
from rtstack.model.arm_model import flange_pose
from rtstack.trials.review import log_columns
from tests.support.wheel import build, copy_sources, install

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 120.0
PAGES = ("/", "/logs", "/trials", "/campaigns", "/api", "/api/openapi.json", "/static/css/frame.css")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a Python that has the wheel's packages, and nothing of the clone."""
    folder = tmp_path_factory.mktemp("wheel")
    copy_sources(folder / "source")
    install(folder / "source", folder / "installed")
    shutil.rmtree(folder / "source")
    cache = folder / "cache"
    take_compiled(folder / "installed", cache)
    own = {"PYTHONPATH": str(folder / "installed"), "PYTHONSAFEPATH": "1", "NUMBA_CACHE_DIR": str(cache)}
    return os.environ | own


@pytest.fixture(scope="module")
def extended(installed: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The same environment with the package of examples/plugin, too, which a folder of its own holds."""
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(ROOT / "examples" / "plugin", folder / "source")
    install(folder / "source", folder / "installed")
    return installed | {"PYTHONPATH": f"{folder / 'installed'}{os.pathsep}{installed['PYTHONPATH']}"}


@pytest.fixture(scope="module")
def reference(extended: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demonstration, recorded there."""
    path = tmp_path_factory.mktemp("reference") / "ref.mcap"
    assert rtstack(extended, path.parent, "teach", path.name).returncode == 0
    return path


def rtstack(environment: dict[str, str], folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    command = [sys.executable, "-m", "rtstack", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, env=environment, timeout=TIMEOUT_S, capture_output=True, text=True)


@contextmanager
def stack(environment: dict[str, str], folder: Path) -> Iterator[tuple[str, str]]:
    """Run `rtstack up` with its logs in the folder; give its address and its one-time token."""
    command = [sys.executable, "-m", "rtstack", "up", "--port", "0", "--logs", str(folder / "logs")]
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address, token = process.stdout.readline().split()[-1].split("/?token=")
        yield address, token
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 0


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
    with (
        stack(installed, tmp_path) as (address, token),
        httpx.Client(base_url=address, trust_env=False, timeout=TIMEOUT_S) as client,
    ):
        assert client.get("/", params={"token": token}, follow_redirects=True).status_code == 200
        for page in PAGES:
            answer = client.get(page)
            assert (page, answer.status_code) == (page, 200)
            assert answer.content
        assert "rice_box" in client.get("/api/status").json()["objects"]


def test_the_command_line_offers_a_packages_controller(
    installed: dict[str, str], extended: dict[str, str], tmp_path: Path
) -> None:
    assert "joint_tracking" in rtstack(extended, tmp_path, "trial", "--help").stdout
    for environment, offered in ((installed, False), (extended, True)):
        refused = rtstack(environment, tmp_path, "trial", "--reference", "x.mcap", "--controller", "nothing")
        assert refused.returncode == 2
        assert ("joint_tracking" in refused.stderr) is offered


@pytest.mark.long
def test_a_packages_controller_grabs_the_box(extended: dict[str, str], reference: Path, tmp_path: Path) -> None:
    """Through the same judge, log and result as ours; which package it was stands in the log."""
    asked = ("trial", "--reference", reference, "--controller", "joint_tracking", "--log", "trial.mcap", "--json")
    done = rtstack(extended, tmp_path, *asked)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(done.stdout)
    assert (result["controller"], result["safety_interventions"]) == ("joint_tracking", 0)
    assert result["success"]
    shown = rtstack(extended, tmp_path, "review", "trial.mcap", "--json")
    assert shown.returncode == 0, shown.stderr
    assert '"joint-tracking": "0.1.0"' in read_log(tmp_path / "trial.mcap").metadata["trial"]["versions"]


@pytest.mark.long
def test_the_page_offers_it_and_an_input_device_leads_the_arms(extended: dict[str, str], tmp_path: Path) -> None:
    with stack(extended, tmp_path) as (address, token):
        with httpx.Client(base_url=address, trust_env=False, timeout=TIMEOUT_S) as client:
            page = client.get("/", params={"token": token}, follow_redirects=True).text
        assert '<option value="joint_tracking">joint tracking</option>' in page
        made = rtstack(extended, tmp_path, "token", "create", "--name", "device", "--scope", "operate")
        told = {"RTSTACK_TOKEN": made.stdout.strip()}
        led = rtstack(extended | told, tmp_path, "teleoperate", "scripted:0.3", "--record", "--console", address)
        assert led.returncode == 0, led.stdout + led.stderr
    (log,) = (tmp_path / "logs").glob("*.mcap")
    position = log_columns(read_log(log)).arm["O_T_EE"][:, :, 1, 3]  # along y, m
    assert (np.ptp(position, axis=1) > 0.01).all()


@pytest.mark.long
def test_a_simulated_leader_leads_both_pads(extended: dict[str, str], tmp_path: Path) -> None:
    """Its shoulders swing there and back: both pads do as its hands do, and nothing else."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with stack(extended, tmp_path) as (address, _):
        made = rtstack(extended, tmp_path, "token", "create", "--name", "leader", "--scope", "operate")
        told = extended | {"RTSTACK_TOKEN": made.stdout.strip()}
        words = (f"leader:{port}", "--record", "--console", address)
        led = subprocess.Popen([sys.executable, "-m", "rtstack", "teleoperate", *words], cwd=tmp_path, env=told)
        until_s = time.monotonic() + TIMEOUT_S
        while f":{port:04X} " not in Path("/proc/net/udp").read_text() and led.poll() is None:
            assert time.monotonic() < until_s, "the device was not opened"
            time.sleep(0.02)
        subprocess.run([sys.executable, "-m", "joint_tracking.leader", str(port)], check=True, env=extended, timeout=60)
        assert led.wait(TIMEOUT_S) == 0
    (log,) = (tmp_path / "logs").glob("*.mcap")
    arm = log_columns(read_log(log)).arm
    home, swung = arm["q"][:, 0], arm["q"][:, 0].copy()
    swung[:, 1] -= 0.12  # rad, the leader's swing
    for side in range(2):
        wanted = flange_pose(robot("fr3"), swung[side])[:3, 3] - flange_pose(robot("fr3"), home[side])[:3, 3]
        position = arm["O_T_EE"][side, :, :3, 3]
        moved = np.linalg.norm(position - position[0], axis=1)
        assert moved.max() == pytest.approx(np.linalg.norm(wanted), rel=0.15)
        assert moved[-1] < 0.2 * moved.max()


@pytest.mark.long
def test_a_packages_experiment_has_its_own_table_and_figure(extended: dict[str, str], tmp_path: Path) -> None:
    plan = ROOT / "examples" / "plugin" / "tracking.toml"
    done = rtstack(extended, tmp_path, "campaign", plan, "--out", "tracking", "--quick", "--workers", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "tracking" / "figures" / "tracking.png").stat().st_size > 5_000
    page = (tmp_path / "tracking" / "report.html").read_text()
    assert "Error before the impact" in page
    assert "joint tracking" in page


def test_a_packages_robot_is_found_by_its_name(extended: dict[str, str], tmp_path: Path) -> None:
    look = "from hal.robots import ROBOTS, robot; print(ROBOTS.names(), robot('half_speed').limits.dq_max[0])"
    said = subprocess.run(
        [sys.executable, "-c", look], cwd=tmp_path, env=extended, capture_output=True, text=True, check=True
    ).stdout
    assert "half_speed" in said
    assert "1.31" in said


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
def test_two_builds_in_two_folders_are_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")  # as a release does: the commit's time
    built = []
    for k in range(2):
        source = tmp_path / f"clone{k}"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(source)], check=True)
        for path in sorted(source.rglob("*")):
            os.utime(path, (1e9 + k * 1e7, 1e9 + k * 1e7))
        built.append(build(source, tmp_path / str(k)))
    assert built[0].read_bytes() == built[1].read_bytes()
