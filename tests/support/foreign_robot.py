"""Robots of other authors: installed by name from PyPI into environments of their own, and served from there."""

import fcntl
import itertools
import os
import subprocess
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pylibfranka as franka

ROOT = Path(__file__).parents[2]
ENVIRONMENTS = ROOT / ".venv-foreign"  # kept from run to run, as .venv is
VERSIONS = {"franka-sim": "1.1.7", "franky-sim": "1.0.4", "lerobot": "0.4.4"}
PROGRAMS = Path(__file__).parents[1] / "programs" / "robots"
START_S, END_S = 120.0, 20.0
# of a robot's millisecond: two Python servers, our loop and its log share two cores, and no run is about their pace
SLOWNESS = 2.0
_octet = itertools.count(11)


@dataclass(frozen=True, slots=True)
class ForeignRobot:
    """Two arms of one author's, each a server of its own. said: what the servers wrote."""

    name: str
    left: str
    right: str
    said: tuple[Path, Path]

    @property
    def kind(self) -> str:
        """As the command line spells the cell."""
        return f"fci:{self.left},{self.right}"


def environment(name: str) -> Path:
    """Return the folder of a package's environment, made where it is not there. Raises RuntimeError with one line."""
    folder = ENVIRONMENTS / f"{name}-{VERSIONS[name]}"
    ENVIRONMENTS.mkdir(exist_ok=True)
    with open(ENVIRONMENTS / f"{name}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two test runs may want it at once
        if not (folder / "installed").exists():
            venv.create(folder, with_pip=True, clear=True)
            pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
            done = subprocess.run([*pip, f"{name}=={VERSIONS[name]}"], stderr=subprocess.PIPE, text=True, check=False)
            if done.returncode:
                said = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
                raise RuntimeError(f"{name} {VERSIONS[name]} cannot be installed by pip: {said}")
            (folder / "installed").touch()
    return folder


def _assets() -> Path:
    """Where franky-sim keeps its arm's MJCF and meshes."""
    (folder,) = environment("franky-sim").glob("lib/python3*/site-packages/franky_sim/assets")
    return folder


def addresses() -> tuple[str, str]:
    """Two loopback addresses of this process."""
    left, right = (f"127.{60 + os.getpid() // 250 % 20}.{1 + os.getpid() % 250}.{next(_octet)}" for _ in range(2))
    return left, right


@contextmanager
def served(name: str, folder: Path, addresses: tuple[str, str], *more: str) -> Iterator[ForeignRobot]:
    """Serve two arms at these addresses, and end them. folder: for what is written; more: the program's arguments."""
    said = folder / "left.txt", folder / "right.txt"
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for address, path in zip(addresses, said, strict=True):
            own = folder / address
            own.mkdir()
            with open(path, "wb") as output:
                command = [*foreign_command(name, address, own, SLOWNESS), *more]
                processes.append(subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, cwd=own))
        for address, process, path in zip(addresses, processes, said, strict=True):
            wait_for(address, process, path)
        yield ForeignRobot(name, *addresses, said)
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait(END_S)


def foreign_command(name: str, address: str, folder: Path, slowness: float) -> list[str]:
    """Return the command of one arm's server. folder: of its own; slowness: ms for each of its robot's."""
    program = PROGRAMS / f"{name.replace('-', '_')}_program.py"
    told = [str(_assets()), str(folder)] if name == "franka-sim" else []
    return [str(environment(name) / "bin" / "python"), str(program), address, *told, str(slowness)]


def wait_for(address: str, process: subprocess.Popen[bytes], said: Path) -> None:
    """Return once the arm at this address answers. Raises RuntimeError where its server ends, or does not serve."""
    end_s = time.monotonic() + START_S
    while time.monotonic() < end_s:
        if process.poll() is not None:
            break
        try:
            franka.Robot(address, franka.RealtimeConfig.kIgnore).read_once()
        except franka.NetworkException:
            time.sleep(0.2)
        else:
            return
    raise RuntimeError(f"{said}: the server did not serve: {said.read_text()[-2000:]}")
