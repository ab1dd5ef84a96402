"""A cell whose file has the boxes' serial numbers is opened with these boxes only, and once they let FCI in."""

import contextlib
from pathlib import Path

import pytest

from hal.base.configuration import ConfigurationError
from hal.desk import NotTrusted, Trust
from hal.desk.power import start
from rtstack.cells import load_description, open_cell
from rtstack.trials.errors import TrialError
from tests.support.desk import desk_address, desk_cell_file, desk_of
from tests.support.fci.server import Served


@pytest.fixture
def trust(tmp_path, monkeypatch) -> Trust:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return Trust()


def opened(boxes: Served, path: Path) -> None:
    kind = f"fci:{boxes.left},{boxes.right}"
    open_cell(kind, "rice_box", 0.0, 0, load_description(path)[0], cell_file=path).close()


def test_the_boxes_are_asked_who_they_are_and_whether_they_are_ready(boxes, trust, tmp_path):
    path, desks = tmp_path / "cell.toml", (desk_address(boxes.left), desk_address(boxes.right))
    own = ("simulated-left", "simulated-right")
    with pytest.raises(NotTrusted, match="run `rtstack desk status` once as this user"):
        opened(boxes, desk_cell_file(path, desks, own))
    for address in desks:
        trust.remember(address)
    with pytest.raises(TrialError, match=r"left box lets no program move its arm: brakes locked, .*rtstack desk start"):
        opened(boxes, desk_cell_file(path, desks, own))
    for address in (boxes.left, boxes.right):
        with contextlib.closing(desk_of(address, trust)) as desk:
            list(start(desk, trust, desk_address(address)))
    opened(boxes, desk_cell_file(path, desks, own))
    with pytest.raises(TrialError, match=r"says that it is simulated-right.*the right one: they are exchanged"):
        opened(boxes, desk_cell_file(path, desks[::-1], own))
    with pytest.raises(TrialError, match=r"the right box at .* the cell's file has 295341-1: another box stands there"):
        opened(boxes, desk_cell_file(path, desks, ("simulated-left", "295341-1")))


def test_a_serial_number_without_desk_is_refused_with_its_line(tmp_path):
    path = desk_cell_file(tmp_path / "cell.toml", ("", ""), ("a", ""))
    with pytest.raises(ConfigurationError, match=r"cell.toml:\d+: key left.serial: a is compared with what Desk says"):
        load_description(path)
