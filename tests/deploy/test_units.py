"""The systemd units: systemd accepts and trusts them, and what they start runs without any privilege."""

import configparser
import contextlib
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from hal.compilation import cache_folder
from rtstack.cli.host_setup import unit_texts
from rtstack.live import notify
from rtstack.live.client import RobotClient

PATIENCE_S = 120.0
WORST_EXPOSURE = 4.0  # of systemd-analyze security, from 0 (safe) to 10
SERVICES = sorted(name for name in unit_texts() if name.endswith(".service"))
analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze: apt install systemd")


def unit(name: str) -> configparser.ConfigParser:
    """Return a unit's sections; of an option that is given twice the last counts, as for systemd."""
    parser = configparser.ConfigParser(interpolation=None, strict=False, comment_prefixes="#", delimiters="=")
    parser.optionxform = str  # type: ignore[assignment]
    parser.read_string(unit_texts()[name])
    return parser


@pytest.fixture
def installed(tmp_path: Path) -> list[Path]:
    """The units, starting this installation, in a folder."""
    paths = [tmp_path / name for name in unit_texts()]
    for path in paths:
        path.write_text(unit_texts()[path.name])
    return paths


@analyze
def test_systemd_accepts_the_units(installed):
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", *installed], capture_output=True, text=True)
    about_us = [line for line in done.stderr.splitlines() if "rtstack" in line]
    assert (done.returncode, about_us) == (0, []), done.stderr


@analyze
@pytest.mark.parametrize("name", SERVICES)
def test_a_unit_is_not_exposed(installed, name):
    path = next(path for path in installed if path.name == name)
    command = ["systemd-analyze", "security", "--offline=yes", f"--threshold={WORST_EXPOSURE * 10:.0f}", path]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-300:]
    found = re.search(r"Overall exposure level for \S+: ([\d.]+)", done.stdout)
    assert found is not None
    assert float(found[1]) <= WORST_EXPOSURE


@pytest.mark.parametrize("name", SERVICES)
def test_a_unit_names_no_capability_and_no_root(name):
    service = unit(name)["Service"]
    assert service["User"] == "rtstack"
    assert service["CapabilityBoundingSet"] == service["AmbientCapabilities"] == ""
    assert service["NoNewPrivileges"] == "yes"


def test_signs_of_life_are_those_of_the_thread_that_turns(monkeypatch, tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setattr(notify, "EVERY_S", 0.0)
        notifier = notify.Notifier()
        pulse = notify.Pulse(notifier)

        def said() -> bytes:
            pulse.look()
            try:
                return manager.recv(64)
            except BlockingIOError:
                return b""

        assert said() == b""
        pulse.beat()
        assert said() == b"READY=1"
        assert said() == b""  # it hangs
        assert pulse.trip() is None
        assert said() == b"WATCHDOG=1"
        notifier.close()


class Manager:
    """Starts a unit's command as systemd would: as nobody, with the unit's limits and nothing more, and listens."""

    def __init__(self, folder: Path, unprivileged: list[str]) -> None:
        self.folder = folder
        self._before = unprivileged
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / "notify"))
        (folder / "notify").chmod(0o777)
        self._socket.settimeout(1.0)

    def start(self, name: str) -> subprocess.Popen:
        """Start ExecStart of a unit, with its folders below ours, and wait until it says that it is ready."""
        service = unit(name)["Service"]
        words = service["ExecStart"].replace("${RTSTACK_PORT}", "0").replace("$RTSTACK_CELL", "").split()
        words = [word.replace("/run/rtstack", str(self.folder / "run")) for word in words]
        words = [word.replace("/var/lib/rtstack", str(self.folder / "state")) for word in words]

        def limit() -> None:
            """Not beyond what this machine lets root raise: a container may not."""
            for which, name, default in (("RTPRIO", "LimitRTPRIO", "0"), ("MEMLOCK", "LimitMEMLOCK", "65536")):
                number, text = getattr(resource, f"RLIMIT_{which}"), service.get(name, default)
                wanted = resource.RLIM_INFINITY if text == "infinity" else int(text)
                with contextlib.suppress(ValueError, OSError):
                    resource.setrlimit(number, (wanted, wanted))

        environment = os.environ | {
            "NOTIFY_SOCKET": str(self.folder / "notify"), "NUMBA_CACHE_DIR": str(self.folder / "cache"),
            "HOME": str(self.folder), "PYTHONPATH": os.pathsep.join(sys.path),
        }  # fmt: skip
        with (self.folder / f"{name}.out").open("w") as out:
            process = subprocess.Popen(
                [*self._before, *words], env=environment, preexec_fn=limit, stdin=subprocess.DEVNULL, stdout=out,
                stderr=out, cwd=self.folder,
            )  # fmt: skip
        deadline = time.monotonic() + PATIENCE_S
        while self.hears() != b"READY=1":
            if process.poll() is not None or time.monotonic() > deadline:
                process.kill()
                process.wait()
                pytest.fail(self.said(name))
        return process

    def said(self, name: str) -> str:
        """Return what a unit's process has printed."""
        return (self.folder / f"{name}.out").read_text()

    def hears(self) -> bytes:
        """Wait a second for the next sign of life; empty without one."""
        with contextlib.suppress(TimeoutError):
            return self._socket.recv(64)
        return b""

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(unprivileged):
    with tempfile.TemporaryDirectory(prefix="units-") as name:  # that others may enter, unlike pytest's
        yield from _managing(Path(name), unprivileged)


def _managing(folder: Path, unprivileged: list[str]) -> Iterator[Manager]:
    if cache_folder().is_dir():  # what was compiled already
        shutil.copytree(cache_folder(), folder / "cache")
    for name in ("run", "state"):
        (folder / name).mkdir()
    folder.chmod(0o755)
    if unprivileged:
        for path in (folder, *folder.rglob("*")):
            os.chown(path, 65534, 65534)
    running = Manager(folder, unprivileged)
    try:
        yield running
    finally:
        running.close()


@pytest.mark.alone
@pytest.mark.long
def test_the_units_commands_run_without_privileges_and_never_restart_into_motion(manager):
    robot = manager.start("rtstack-robot.service")
    client = RobotClient(manager.folder / "run/robot.sock")
    try:
        status = Path(f"/proc/{robot.pid}/status").read_text()
        assert re.search(r"^NoNewPrivs:\s*1", status, re.MULTILINE) or os.getuid() != 0
        deadline = time.monotonic() + PATIENCE_S
        while manager.hears() != b"WATCHDOG=1":
            assert time.monotonic() < deadline, manager.said("rtstack-robot.service")
        client.take("anna")
        assert client.arm("anna").phase == "armed"
        robot.kill()
        robot.wait()
        client.close()
        robot = manager.start("rtstack-robot.service")
        status = client.status()
        assert (status.phase, status.holder, status.job) == ("disarmed", None, None)

        console = manager.start("rtstack-console.service")
        try:
            address = None
            while address is None:
                assert console.poll() is None, manager.said("rtstack-console.service")
                manager.hears()
                address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", manager.said("rtstack-console.service"))
            with httpx.Client(trust_env=False, timeout=60.0, follow_redirects=True) as browser:
                assert "grab - operate" in browser.get(address[0]).text
        finally:
            console.terminate()
            assert console.wait(PATIENCE_S) in (0, -signal.SIGTERM)  # systemd calls both a success
    finally:
        client.close()
        robot.send_signal(signal.SIGTERM)
        assert robot.wait(PATIENCE_S) == 0, manager.said("rtstack-robot.service")
    assert [path.name for path in (manager.folder / "run").glob("*")] == []
