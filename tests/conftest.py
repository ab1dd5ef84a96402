"""What tests of several packages share: the cell, one recorded demonstration, and a runner of trials on it."""

import gc
import os
import runpy
import signal
import subprocess
import sys
import tomllib
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
from hypothesis import settings
from packaging.markers import Marker

from hal import extensions
from hal.base.extras import published_for
from rtstack.cells import default_cell_file
from rtstack.cli.app import main
from rtstack.experiments.registry import installed_plans
from rtstack.live.first_use import FirstUse
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.trials.controllers import DEFAULT
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.specification import TrialSpecification

pytest_plugins = ["rtstack.testing"]  # as in the tests of another package


class _NoClient(MetaPathFinder):
    """A Python for which the vendor publishes no client (pyproject.toml): what imports it is skipped, and says why."""

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:
        """Skip the module or the test that asks for it."""
        pythons = published_for(fullname) if fullname == "pylibfranka" else None
        if pythons and not Marker(pythons).evaluate():  # where there is one and it lacks, that is a failure
            pytest.skip("pylibfranka is not published for this Python", allow_module_level=True)


sys.meta_path.append(_NoClient())  # the last one: asked for what is not installed
# helpers assert too, and say what was compared
pytest.register_assert_rewrite("tests.support")
# the first example may compile code, and shared machines stall: correctness is never a matter of wall-clock here
settings.register_profile("shared", deadline=None)
settings.load_profile("shared")


def pytest_sessionstart() -> None:
    """Compile once for all workers and all processes of tests, whose stacks then have nothing to say about it."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        FirstUse(1).wait()
        FirstUse(2).wait()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown() -> None:
    """Let go of what a failed test held: its traceback would keep clients connected to a robot that then ends."""
    failed = getattr(sys, "last_traceback", None)
    if failed is not None:
        traceback.clear_frames(failed)
        sys.last_value = sys.last_traceback = None
        gc.collect()


@pytest.fixture(scope="session")
def cell() -> CellDescription:
    """The description of the simulated grabbing cell."""
    return load_cell_description(default_cell_file())


@dataclass(frozen=True, slots=True)
class Demonstration:
    """A recording and what came out of it."""

    path: Path
    result: DemonstrationResult


@pytest.fixture(scope="session")
def demonstration(cell: CellDescription, tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """The plain demonstration with the rice box, seed 0."""

    from tests.support.made_once import made_once  # not before its asserts are rewritten, above
    from tests.support.runs import demonstrate

    def record(folder: Path) -> Demonstration:
        path = folder / "ref.mcap"
        return Demonstration(path, demonstrate(path, cell))

    return made_once(tmp_path_factory, "recordings", record)


@dataclass(frozen=True, slots=True)
class Runner:
    """Runs trials on the shared recording."""

    cell: CellDescription
    reference: Path

    def run(
        self,
        controller: str = DEFAULT,
        displacement_mm: float = 0.0,
        seed: int = 1,
        log: Path | None = None,
        **around: Any,
    ) -> TrialResult:
        """Run one trial in the direct cell, in the context of what `around` names."""
        from tests.support.runs import attempt

        specification = TrialSpecification(str(self.reference), controller, "rice_box", displacement_mm, seed)
        return attempt(specification, self.cell, log, **around)


@pytest.fixture(scope="session")
def runner(cell: CellDescription, demonstration: Demonstration) -> Runner:
    """Trials on the shared demonstration."""
    return Runner(cell, demonstration.path)


@pytest.fixture(scope="module")
def boxes() -> Iterator[Any]:
    """A lockstep server of both arms with the Desk of their boxes."""
    from tests.support.fci.server import serve

    with serve("--lockstep", "--desk") as served:
        yield served


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Install a package as pip would: a module's source, and what it offers to a group, as NAME=ATTRIBUTE."""
    installed: list[str] = []

    def put(package: str, source: str, group: str, **offers: str) -> None:
        place = tmp_path / "installed" / package
        offered = {name: f"{package}:{attribute}" for name, attribute in offers.items()}
        _describe(place, package, package, "1.2", {group: offered})
        (place / f"{package}.py").write_text(source)
        monkeypatch.syspath_prepend(str(place))
        extensions._offered.cache_clear()
        installed.append(package)

    yield put
    extensions._offered.cache_clear()
    for package in installed:
        sys.modules.pop(package, None)


def _describe(place: Path, package: str, name: str, version: str, offers: dict[str, dict[str, str]]) -> None:
    """Write what pip leaves of a package: its name and version, and what it offers to each group."""
    metadata = place / f"{package}-{version}.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    groups = [(f"[{group}]", *(f"{name} = {target}" for name, target in of.items())) for group, of in offers.items()]
    (metadata / "entry_points.txt").write_text("".join(f"{line}\n" for group in groups for line in group))


@pytest.fixture
def learned_grab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install the package of examples/learned_grab."""
    yield from _installed("learned_grab", tmp_path, monkeypatch)


@pytest.fixture
def reality(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install the package of examples/reality."""
    yield from _installed("reality", tmp_path, monkeypatch)


def _installed(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install a package of the examples as pip would, for this process and those that it starts."""
    source = Path(__file__).parents[1] / "examples" / name
    project = tomllib.loads((source / "pyproject.toml").read_text())["project"]
    place = tmp_path / f"installed_{name}"
    _describe(place, name, project["name"], project["version"], project["entry-points"])
    monkeypatch.syspath_prepend(str(place))
    paths = (str(place), str(source), os.environ.get("PYTHONPATH"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    caches = (installed_plans, extensions._offered)
    for cached in caches:
        cached.cache_clear()
    yield
    for cached in caches:
        cached.cache_clear()


@pytest.fixture
def command_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """The command `rtstack` in this process: how it ended and what it said, without an interpreter's start.

    What depends on a process (signals, children, rights) is asked of a real one.
    """

    def run(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        capsys.readouterr()
        words = ["rtstack", *map(str, arguments)]
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", words)
            if cwd is not None:
                patch.chdir(cwd)
            with pytest.raises(SystemExit) as ended:
                main()
        said = capsys.readouterr()
        status = ended.value.code
        assert isinstance(status, int)
        return subprocess.CompletedProcess(words, status, said.out, said.err)

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def lerobot_policy(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What `examples/13_lerobot_policy.py` defines, where neither torch nor lerobot is: `tests/foreign` runs it beside
    both."""
    for name in ("", ".configs", ".configs.policies", ".policies", ".policies.factory", ".policies.utils"):
        monkeypatch.setitem(sys.modules, f"lerobot{name}", MagicMock())
    monkeypatch.setitem(sys.modules, "torch", MagicMock())
    return runpy.run_path(str(Path(__file__).parents[1] / "examples" / "13_lerobot_policy.py"))
