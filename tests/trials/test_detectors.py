"""Impact detectors by name: Appendix B's, and those of another package, which change the mode in its place."""

import json

import pytest
from joint_tracking.jump import ResidualJump

from rtstack.log.reader import read_log
from rtstack.samples import Mode
from rtstack.trials.controllers import DEFAULT_DETECTOR, detector_names
from rtstack.trials.specification import TrialSpecification
from tests.support.runs import attempt

PLUG_IN = """
class At:
    def __init__(self, arm):
        self.ticks = 0

    def update(self, arm):
        self.ticks += 1
        return self.ticks == 1001

class Never(At):
    def update(self, arm):
        return False

class Wrong(At):
    def update(self, arm):
        return "yes"

class Raises(At):
    def update(self, arm):
        raise ValueError("my own bug")

class Nothing:
    def __init__(self, arm):
        pass
"""


@pytest.fixture
def detectors(install) -> None:
    names = {"at": "At", "never": "Never", "wrong": "Wrong", "raises": "Raises", "nothing": "Nothing"}
    install("lab_detectors", PLUG_IN, "rtstack.detectors", **{f"lab_{name}": each for name, each in names.items()})


def test_appendix_b_is_the_default_and_offered_by_name():
    assert detector_names()[0] == DEFAULT_DETECTOR == TrialSpecification("a").detector


def test_the_mode_follows_the_detector_that_is_named(detectors, command_line, demonstration, tmp_path):
    """Interim mode begins in the tick that the plug-in says, long before the impact, and the log says whose it was."""
    log = tmp_path / "at.mcap"
    command_line("trial", "--reference", demonstration.path, "--detector", "lab_at", "--log", log)
    read = read_log(log)
    control = read.topic("/left/control")
    assert list(control["mode"]).index(Mode.INTERIM) == 1000
    record = read.metadata["trial"]
    assert json.loads(record["specification"])["detector"] == "lab_at"
    assert json.loads(record["versions"])["lab_detectors"] == "1.2"
    assert float(read.metadata["result"]["detected_impact_time_s"]) == pytest.approx(1.0, abs=1e-9)


def test_one_that_detects_nothing_leaves_the_mode(detectors, command_line, demonstration, tmp_path):
    log = tmp_path / "never.mcap"
    ended = command_line("trial", "--reference", demonstration.path, "--detector", "lab_never", "--log", log)
    assert ended.returncode == 1
    read = read_log(log)
    assert Mode.INTERIM not in read.topic("/left/control")["mode"]
    assert "detected_impact_time_s" not in read.metadata["result"] or not read.metadata["result"][
        "detected_impact_time_s"
    ].startswith("1.")


def test_the_example_detects_the_impact_where_appendix_b_does(cell, demonstration):
    """Within the time that one's filter is faster; and the grab is a success."""
    own, paper = (
        attempt(TrialSpecification(str(demonstration.path), seed=1, **more), cell)
        for more in ({"detector": ResidualJump}, {})
    )
    assert own.success
    assert paper.success
    assert own.detected_impact_time_s == pytest.approx(paper.detected_impact_time_s, abs=0.01)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lab_wrong", "TypeError: update of the impact detector returned 'yes', not True or False"),
        ("lab_raises", "ValueError: my own bug"),
        ("lab_nothing", "the impact detector cannot be made: TypeError: Nothing has no update"),
        ("lab_lost", "unknown impact detector 'lab_lost': choose one of appendix_b, lab_at"),
    ],
)
def test_one_that_cannot_work_is_refused_before_an_arm_moves(
    detectors, command_line, demonstration, tmp_path, name, message
):
    log = tmp_path / "refused.mcap"
    ended = command_line("trial", "--reference", demonstration.path, "--detector", name, "--log", log)
    assert ended.returncode == 2
    assert message in ended.stderr
    assert not log.exists()
