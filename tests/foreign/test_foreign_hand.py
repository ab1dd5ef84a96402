"""A robot of another author that was told a hand which it does not carry: rtstack check finds out before it falls."""

from dataclasses import replace

import pytest

from rtstack.cli.link import link_findings
from rtstack.model.cell_description import CellDescription
from tests.support.foreign_robot import addresses, served

TICKS = 1500

pytestmark = [pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(900)]


def test_a_robot_that_was_told_a_wrong_hand_fails_the_check(cell: CellDescription, tmp_path) -> None:
    """franky-sim's arms carry 0.73 kg; their gravity compensation is told of 2.5 kg, and so is the lab's cell file."""
    described = replace(cell, pad=replace(cell.pad, mass=2.5, centre=(-0.01, 0.0, 0.03)))
    with served("franky-sim", tmp_path, addresses(), "2.5") as robot:
        found = {finding.name: finding for finding in link_findings(robot.kind, described, TICKS)}
    # its own limits differ from the description's, which is said too, as its torques do from the described weight
    assert found.keys() - {"limits"} == {"hold", "left torques", "right torques"}
    assert found["hold"].verdict == "fail"
    assert "stopped by its judge: joint 2: the estimated external torque is too large" in found["hold"].value
