"""Simulated arms at loopback addresses for the tests of any client: a pytest plug-in and a context manager.

    pytest_plugins = ["rtstack.testing"]  # in conftest.py; needs pytest and `pip install 'rtstack[sim]'`

The arms are those of `rtstack sim`, a server process that speaks the Franka Control Interface. A test that names the
fixture `served_arms` gets a server of its own, whose plant has not moved. PYTEST_DONT_REWRITE: this module asserts
nothing, and a conftest.py may import it before it names it as a plug-in.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from hal.base.configuration import ConfigurationError
from hal.base.extras import require
from hal.errors import HardwareError

if TYPE_CHECKING:  # it takes seconds to import, which only a test with arms has to spend
    from rtstack.model.cell_description import CellDescription


@dataclass(frozen=True, slots=True)
class ServedArms:
    """A running server.

    left, right: the arms' addresses, "" where there is no such arm. tracker: HOST:PORT to which the object's poses are
    sent. pid: of the server, for a test that ends or freezes it.
    """

    left: str
    right: str
    tracker: str
    pid: int
    cell_file: Path | None = None

    @property
    def cell(self) -> str:
        """The kind for `open_cell` and `--cell`: fci:LEFT,RIGHT."""
        return f"fci:{self.left},{self.right}".rstrip(",")

    @property
    def description(self) -> "CellDescription":
        """The cell's description for `open_cell`, with the tracker at this server's port."""
        from rtstack.cells import load_description

        described = load_description(self.cell_file, self.cell)[0]
        return replace(described, tracker=replace(described.tracker, address=self.tracker))


@contextmanager
def serve_arms(
    object_name: str = "rice_box", *, lockstep: bool = True, seed: int = 0, displacement_m: float = 0.0,
    profile: str = "ideal", faults: Path | None = None, cell_file: Path | None = None,
    sides: Sequence[str] = ("left", "right"), options: Sequence[str] = (),
) -> Iterator[ServedArms]:  # fmt: skip
    """Serve the simulated arms until the end of the `with` block.

    Starting takes some two seconds; the first start of an installation compiles for up to a minute.

    Args:
        object_name: An object of the cell; "" for none.
        lockstep: True: the robot waits for each moving arm's answer, so that a slow machine changes nothing. False:
            1 kHz by the host's clock, with the communication errors that a late answer has.
        seed: Of the placement and of the sensors' noise.
        displacement_m: Of the object from its place, along y, m.
        profile: Of the simulated robot: ideal, honest or a TOML, see `rtstack sim --profile`.
        faults: A script of faults, see `rtstack sim --faults`.
        cell_file: A lab's cell; None for the simulated grabbing cell.
        sides: The arms that there are.
        options: Further options of `rtstack sim`, as they are written there.

    Yields:
        The addresses, once both arms accept clients.

    Raises:
        ConfigurationError: The package's extra `sim` is not installed.
        HardwareError: The server does not start; with its message.

    """
    require("sim")
    from rtstack.cells.simulator import Simulator

    simulator = Simulator(
        object_name, displacement_m, seed, lockstep=lockstep, faults=faults, cell_file=cell_file, profile=profile,
        more=options, sides=sides,
    )  # fmt: skip
    try:
        simulator.tracker.close()  # the client that is tested listens there
        host, port = simulator.tracker.address
        yield ServedArms(simulator.left or "", simulator.right or "", f"{host}:{port}", simulator.pid, cell_file)
    finally:
        simulator.close()
        if simulator.report:
            print(f"simulated robot: {simulator.report}", file=sys.stderr)


def _fixture(lockstep: bool) -> Iterator[ServedArms]:
    with ExitStack() as stack:
        try:
            arms = stack.enter_context(serve_arms(lockstep=lockstep))
        except (ConfigurationError, HardwareError) as error:
            pytest.fail(str(error), pytrace=False)
        yield arms


@pytest.fixture
def served_arms() -> Iterator[ServedArms]:
    """Both arms and the rice box, in lockstep."""
    yield from _fixture(lockstep=True)


@pytest.fixture
def realtime_arms() -> Iterator[ServedArms]:
    """Both arms and the rice box, at 1 kHz of the host's clock."""
    yield from _fixture(lockstep=False)
