"""The numbered suite against two arms at their addresses: simulated ones of its own, or whatever is at --cell.

    pytest tests/hil                                            a simulated cell of its own, in lockstep
    pytest tests/hil --cell 172.16.0.2,172.16.1.2 --cell-file FILE --marks     metal: both are held, stopped, recovered
    pytest tests/hil --cell ... --cell-file FILE --reflexes                    metal: they are also let go and shaken
    pytest tests/hil --cell ... --cell-file FILE --motion                      metal: they also grab the box

On metal each arm is let in by the gate of every command (rtstack.cells.metal), with the thresholds of the approach.

--hil-report FILE.md keeps date, addresses, versions, figures and a verdict per number.
"""

import contextlib
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from hal.cell import Cell
from hal.tracker_link import TrackerLink
from rtstack.cells import default_cell_file, kind_of, open_cell
from rtstack.check.host import host_findings
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.model.tracker_description import TrackerDescription
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.provenance import git_commit, package_versions
from rtstack.trials.record import open_log
from rtstack.trials.result import DemonstrationResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.start_motion import start_motion
from tests.support.hil.robot import Robot

_VERDICTS = {"passed": "pass", "failed": "FAIL", "skipped": "not run"}


@dataclass(frozen=True, slots=True)
class Entry:
    """A number: file and test as pytest names them, verdict, figures by name, and why where it did not pass."""

    number: str
    name: str
    verdict: str
    figures: tuple[tuple[str, Any], ...]
    reason: str

    @classmethod
    def of(cls, report: pytest.TestReport) -> "Entry":
        """Return what a report says."""
        file, _, test = report.nodeid.rpartition("/")[2].partition("::")
        reason = ""
        if report.skipped and isinstance(report.longrepr, tuple):
            reason = report.longrepr[2].removeprefix("Skipped: ")
        elif report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            reason = str(crash.message if crash else report.longrepr).splitlines()[0]
        name = test.removeprefix("test_").replace("_", " ")
        return cls(file[5:7], name, _VERDICTS[report.outcome], tuple(report.user_properties), reason)


def write_report(path: Path, cell: str | None, entries: list[Entry]) -> None:
    """Write the report as Markdown. cell: the addresses, None for the simulated cell of the suite's own."""
    versions = ", ".join(f"{name} {version}" for name, version in package_versions().items())
    lines = [
        "# Hardware in the loop",
        "",
        f"- date: {datetime.now().astimezone().isoformat(timespec='seconds')}",
        f"- arms: {cell or 'simulated, in lockstep (no address was given)'}",
        f"- host: {platform.node()}, {platform.release()}; "
        + "; ".join(f"{finding.name} {finding.value} ({finding.verdict})" for finding in host_findings()),
        f"- versions: {versions}",
        f"- commit: {git_commit()}",
        "",
        "| number | what | verdict | figures |",
        "|---|---|---|---|",
    ]
    for entry in entries:
        figures = ", ".join(f"{name} {_shown(value)}" for name, value in entry.figures)
        said = "; ".join(text for text in (figures, entry.reason) if text).replace("|", "/")
        lines.append(f"| {entry.number} | {entry.name} | {entry.verdict} | {said or '-'} |")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


BIN = Path(sys.executable).parent
END_S = 30.0
_entries: list[Entry] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the arms are, and what may be done with them."""
    group = parser.getgroup("hardware in the loop")
    group.addoption("--cell", metavar="LEFT,RIGHT", help="addresses of the arms; without: a simulated cell")
    group.addoption("--cell-file", type=Path, metavar="FILE", help="of the arms at --cell; needed where they are real")
    group.addoption("--marks", action="store_true", help="assert the marks of timing too, not only its figures")
    group.addoption("--reflexes", action="store_true", help="arms may be left without torque, and run into a reflex")
    group.addoption("--motion", action="store_true", help="the arms may move: the box is on its marks, nobody is near")
    group.addoption("--hil-report", metavar="FILE.md", help="keep the figures and verdicts here")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse what is no pair of addresses."""
    at = config.getoption("cell", None)
    if at is not None and [bool(one) for one in at.split(",")] != [True, True]:
        raise pytest.UsageError(f"--cell {at}: give two addresses, LEFT,RIGHT")


def _addresses() -> tuple[str, str, str]:
    """Loopback addresses of this process."""
    prefix = f"127.{90 + os.getpid() // 250 % 9}.{1 + os.getpid() % 250}"
    return f"{prefix}.11", f"{prefix}.12", f"{prefix}.1:1341"


@pytest.fixture(scope="session")
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    """The arms at --cell, or simulated ones."""
    at, marks = request.config.getoption("cell", None), bool(request.config.getoption("marks", False))
    if at is not None:
        left, right = at.split(",")
        file = request.config.getoption("cell_file", None)
        description = load_cell_description(file or default_cell_file())
        kind, argument = kind_of(f"fci:{at}")
        kind.check(argument, description, file)
        kind.measured(argument, description, file)
        yield Robot(left, right, False, marks, TrackerDescription().address)
        return
    left, right, tracker = _addresses()
    command = [BIN / "rtstack", "sim", "--lockstep", "--left", left, "--right", right, "--tracker", tracker]
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said.startswith("serving"), said
        yield Robot(left, right, True, marks, tracker)
    finally:
        process.terminate()
        process.communicate(timeout=END_S)


@pytest.fixture(scope="session")
def cell_source(request: pytest.FixtureRequest) -> Path:
    """The file that describes the cell."""
    return request.config.getoption("cell_file", None) or default_cell_file()


@pytest.fixture(scope="session")
def cell(cell_source: Path) -> CellDescription:
    """The description of the cell."""
    return load_cell_description(cell_source)


@pytest.fixture
def let_go(request: pytest.FixtureRequest, robot: Robot) -> None:
    """What leaves the arms without a torque of ours, or asks for too much, needs a word, too."""
    if not robot.simulated and not request.config.getoption("reflexes", False):
        pytest.skip("metal: the arms would be let go and run into a reflex; with nobody near, add --reflexes")


@pytest.fixture
def in_motion(request: pytest.FixtureRequest, robot: Robot) -> None:
    """What moves the arms needs a word from whoever stands beside them."""
    if not robot.simulated and not request.config.getoption("motion", False):
        pytest.skip("metal: the arms would grab; with the box on its marks and nobody near, add --motion")


@pytest.fixture
def open_arms(
    robot: Robot, cell: CellDescription, cell_source: Path
) -> Callable[[str], contextlib.AbstractContextManager[Cell]]:
    """Open the cell with an object in its place, and close it."""

    @contextlib.contextmanager
    def opened(object_name: str) -> Iterator[Cell]:
        if not robot.simulated:
            arms = open_cell(robot.kind, object_name, 0.0, 0, cell, cell_file=cell_source)
        else:  # a robot that waits: a pause of this machine is no silence
            host, _, port = robot.tracker.rpartition(":")
            pad, tracker = cell.pad, TrackerLink(host, int(port))
            try:
                pair = robot.pair(pad)
            except BaseException:
                tracker.close()
                raise
            arms = Cell(robot.kind, pair.left, pair.right, tracker, pair)
        try:
            yield arms
        finally:
            arms.close()
            if robot.simulated:
                arms.tracker.close()  # pyright: ignore[reportAttributeAccessIssue]

    return opened


@pytest.fixture
def description(robot: Robot, cell: CellDescription) -> CellDescription:
    """The cell, with the tracker where this robot sends to."""
    return replace(cell, tracker=replace(cell.tracker, address=robot.tracker))


# the report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note the verdict of a number and the figures that it has recorded."""
    if "hil/test_0" not in report.nodeid or (report.when != "call" and not report.failed and not report.skipped):
        return
    _entries.append(Entry.of(report))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the report."""
    path = session.config.getoption("hil_report", None)
    if path:
        write_report(Path(path), session.config.getoption("cell", None), _entries)


@pytest.fixture
def demonstrate(
    open_arms: Callable[[str], contextlib.AbstractContextManager[Cell]], description: CellDescription, robot: Robot,
    cell_source: Path, hil_recording: Path,
) -> Callable[[], DemonstrationResult]:  # fmt: skip
    """Hit the box with both pads, and leave the recording."""

    def demonstrated() -> DemonstrationResult:
        specification = DemonstrationSpecification()
        with open_arms(specification.object) as arms:
            way = start_motion(arms, description, specification.object)
            log = open_log(hil_recording, specification, description, robot.kind, cell_source)
            return run_demonstration(specification, description, arms, RunContext(log), way=way)

    return demonstrated


@pytest.fixture(scope="session")
def hil_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where 05 leaves its recording for 06."""
    return tmp_path_factory.mktemp("hil") / "recording.mcap"
