"""Cells by their addresses: what is refused, in one line, and what a description says of them."""

import os
import re
import socket
from pathlib import Path

import pytest

from hal.errors import HardwareError
from rtstack.cells import default_cell_file, open_cell
from rtstack.cells.fci import fci_addresses
from rtstack.live.source import live_source
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.errors import TrialError
from tests.support.real_cell import CALIBRATED

NOWHERE = "fci:127.0.99.97,127.0.99.98"
TRACKER = f"127.206.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}", 1341  # where nobody else binds meanwhile


def edited(folder: Path, old: str, new: str) -> Path:
    """Return the path of the default description with a change."""
    text = default_cell_file().read_text()
    assert old in text
    path = folder / "cell.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_tracker_port_is_taken(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(TRACKER)
        description = load_cell_description(edited(tmp_path, "127.0.0.1:1341", "{}:{}".format(*TRACKER)))
        with pytest.raises(HardwareError, match=r"{}:{}: Address already in use; .*\[tracker\]".format(*TRACKER)):
            open_cell(NOWHERE, "rice_box", 0.0, 0, description)


def test_the_port_is_free_again_after_a_cell_that_did_not_open(tmp_path):
    description = load_cell_description(edited(tmp_path, "127.0.0.1:1341", "{}:{}".format(*TRACKER)))
    with pytest.raises(HardwareError, match="does not answer"):
        open_cell(NOWHERE, "rice_box", 0.0, 0, description)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(TRACKER)


def test_a_description_of_before_has_the_defaults(tmp_path):
    text = default_cell_file().read_text()
    begin, end = text.index("[tracker]"), text.index("# What the cell handles")
    (tmp_path / "old.toml").write_text(text[:begin] + text[end:])
    assert load_cell_description(tmp_path / "old.toml") == load_cell_description(default_cell_file())


@pytest.mark.parametrize("kind", ["fci:", "fci:,", "fci:a,b,c", "fci:a,a", "direct"])
def test_two_arms_have_two_addresses(kind):
    with pytest.raises(TrialError):
        fci_addresses(kind)


@pytest.mark.parametrize(
    ("kind", "simulated"), [("direct", True), ("fci:127.0.0.11,127.0.0.12", True), ("fci:127.0.0.11,127.0.0.12", False)]
)
def test_an_arm_that_may_be_real_is_not_called_simulated(tmp_path, kind, simulated):
    file = edited(tmp_path, "simulated = true", f"simulated = {str(simulated).lower()}")
    file.write_text(f"{file.read_text()}\n{CALIBRATED}")
    assert live_source(file, kind).description.simulated is simulated


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["up", "--left", "127.0.0.11", "--right", "127.0.0.11"], "two addresses"),
        (["recover-arms", "--cell", "direct"], "fci:LEFT,RIGHT"),
        (["recover-arms", "--cell", NOWHERE], "does not answer"),
    ],
)
def test_bad_input_is_one_line_and_status_two(tmp_path, command_line, arguments, word):
    done = command_line(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert word in done.stderr
    assert not list(tmp_path.iterdir())


BENCH = """
from dataclasses import replace

from rtstack.cells import CellKind, open_cell

def open_bench(request):
    assert request.argument == "table-2"
    return replace(open_cell("direct", request.object_name, request.displacement, request.seed), name=request.kind)

bench = CellKind(open_bench)
dry = CellKind(open_bench, simulated=lambda argument, description: True)
"""
STILL = """
from hal.tracker import ObjectPose

class Still:
    def __init__(self, request):
        self.listens_at = request.host, request.port

    def latest(self):
        return ObjectPose.empty()

    def close(self):
        pass
"""


def test_a_cell_of_another_package_runs_a_demonstration_and_is_taken_for_a_real_one(install, command_line, tmp_path):
    install("benches", BENCH, "rtstack.cells", bench="bench", dry="dry")
    done = command_line("teach", "ref.mcap", "--cell", "dry:table-2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_log(tmp_path / "ref.mcap").metadata["trial"]["cell"] == "dry:table-2"
    assert live_source(default_cell_file(), "dry:table-2").description.simulated
    assert not live_source(default_cell_file(), "bench:table-2").description.simulated
    refused = command_line("teach", "real.mcap", "--cell", "bench:table-2", cwd=tmp_path)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "space bar" in refused.stderr


def test_an_unknown_cell_is_refused_with_those_that_there_are(install, command_line, tmp_path):
    install("benches", BENCH, "rtstack.cells", bench="bench")
    for words in (("teach", "ref.mcap", "--cell", "bed"), ("up", "--cell-kind", "bed")):
        refused = command_line(*words, cwd=tmp_path)
        assert refused.returncode == 2
        assert "unknown cell 'bed': choose one of bench, direct, fci, lockstep, realtime" in refused.stderr
    assert not list(tmp_path.glob("*.mcap"))


def test_a_tracker_of_another_package_is_opened_by_the_cells_file(install, tmp_path):
    install("stills", STILL, "rtstack.trackers", still="Still")
    described = load_cell_description(edited(tmp_path, "[tracker]\n", '[tracker]\nkind = "still"\n'))
    assert described.tracker.kind == "still"
    with pytest.raises(HardwareError, match="does not answer"):
        open_cell(NOWHERE, "rice_box", 0.0, 0, described)


def test_an_unknown_tracker_is_refused_before_a_stack_starts(tmp_path):
    file = edited(tmp_path, "[tracker]\n", '[tracker]\nkind = "camera"\n')
    with pytest.raises(
        TrialError, match=r"unknown tracker 'camera': choose one of apriltag, natnet, none, udp; see \[tracker\] kind"
    ):
        live_source(file, "fci:127.0.0.11,127.0.0.12")


WRONG_CELLS = """
from hal.tracker import ObjectPose
from rtstack.cells import CellKind


class Tuple:  # here: Tuple
    def __init__(self, request):
        pass

    def latest(self):
        return 1, 2

    def close(self):
        pass


class Fails:
    def __init__(self, request):
        raise RuntimeError("camera not plugged in")  # here: Fails


def nothing(request):  # here: nothing
    return None


def fails(request):
    raise OSError("no bench here")  # here: fails


def simulated():  # here: simulated
    return True


kind_nothing, kind_fails = (CellKind(each, simulated=lambda argument, description: True) for each in (nothing, fails))
kind_simulated = CellKind(nothing, simulated=simulated)
"""


def place(name):
    line = next(k for k, text in enumerate(WRONG_CELLS.splitlines(), 1) if text.endswith(f"# here: {name}"))
    return rf"\(wrong_cells 1\.2, wrong_cells\.py:{line}\); mend it there, or uninstall the package"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nothing", "open: TypeError: it returned a NoneType, not a hal.cell.Cell"),
        ("fails", "open: OSError: no bench here"),
        ("simulated", r"simulated: TypeError: simulated\(\) takes 0 positional arguments but 2 were given"),
    ],
)
def test_a_wrong_kind_of_cell_names_its_package_file_and_line(install, command_line, tmp_path, name, said):
    install("wrong_cells", WRONG_CELLS, "rtstack.cells", wrong=f"kind_{name}")
    done = command_line("teach", "ref.mcap", "--cell", "wrong", cwd=tmp_path)
    assert done.returncode == 2
    assert re.search(f"^rtstack: the cell wrong cannot be used: {said} {place(name)}$", done.stderr, re.M), done.stderr
    assert not list(tmp_path.glob("*.mcap"))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nothing", "TypeError: NoneType has no latest, no close"),
        ("Fails", "RuntimeError: camera not plugged in"),
        ("Tuple", "TypeError: latest returned a tuple, not a hal.tracker.ObjectPose"),
    ],
)
def test_a_wrong_tracker_names_its_package_file_and_line(install, tmp_path, name, said):
    install("wrong_cells", WRONG_CELLS, "rtstack.trackers", wrong=name)
    described = load_cell_description(edited(tmp_path, "[tracker]\n", '[tracker]\nkind = "wrong"\n'))
    with pytest.raises(TrialError, match=f"^the tracker wrong cannot be opened: {said} {place(name)}$"):
        open_cell(NOWHERE, "rice_box", 0.0, 0, described)
