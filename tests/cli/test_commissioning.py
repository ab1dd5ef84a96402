"""The record of commissioning: what is capped while steps are open, what opens them again, and what signs them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cells import load_description
from rtstack.cells.commissioning import Commissioning, commissioned, record_file, sign, states
from rtstack.live.source import live_source
from rtstack.safety.limits import ForcePhase
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.move import PreparedGuide
from rtstack.trials.specification import DemonstrationSpecification, GuideSpecification
from rtstack.trials.tightening import limits_of_arms
from tests.support.real_cell import commission, write_cell_file
from tests.support.runs import demonstrate

LEFT, RIGHT = "127.0.99.97", "127.0.99.98"
HELD = ("hold left", "hold right", "wiggle left", "wiggle right")
KIND = f"fci:{LEFT},{RIGHT}"


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    write_cell_file(path, LEFT, RIGHT)
    return path


def capped(path: Path):
    return commissioned(KIND, load_description(path)[0], path)


def open_steps(path: Path) -> list[str]:
    return [each.step.name for each in states(load_description(path)[0], path) if not each.done]


def test_without_a_record_a_cell_is_slow_soft_and_meets_nothing(cell):
    record_file(cell).unlink()
    found = capped(cell)
    for limits in limits_of_arms(found):
        assert limits.ee_speed_max == 0.25
        assert np.all(limits.force_by_phase == 50.0)
        assert limits.collisions(ForcePhase.IMPACT).collision_forces[0] == 65.0
    assert found.start_motion.speed_rad_s == 0.2
    assert set(found.refused) == {"guide", "trial", "demonstration", "place", "hit", "identification"}
    assert "hold left (rtstack check --left 127.0.99.97)" in found.refused["trial"]
    demonstration = prepare_demonstration(DemonstrationSpecification(), found)
    assert "no impact; next: hold left" in demonstration.refusal
    assert "no hand on an arm before hold left" in PreparedGuide(GuideSpecification(), found).refusal


def test_a_limit_that_is_tighter_already_stays(cell):
    cell.write_text(cell.read_text().replace("ee_speed_max = 1.0", "ee_speed_max = 0.1\nforce_approach_max = 30.0"))
    commission(cell, until="motion")
    found = limits_of_arms(capped(cell))[0]
    assert found.ee_speed_max == 0.1
    assert np.all(found.force_by_phase == (50.0, 50.0, 30.0))


def test_a_hand_is_allowed_once_each_arm_was_held_and_recognised(cell):
    commission(cell, until="wiggle right")
    assert "before wiggle right" in capped(cell).refused["guide"]
    commission(cell, until="guide")
    assert "guide" not in capped(cell).refused


def test_after_the_foam_a_demonstration_is_allowed_and_no_trial(cell):
    commission(cell, until="object")
    found = capped(cell)
    assert set(found.refused) == {"trial", "hit", "identification"}
    limits = limits_of_arms(found)[0]
    assert limits.ee_speed_max == 0.6
    assert limits.force_by_phase[ForcePhase.IMPACT] == 140.0


def test_a_complete_record_caps_nothing(cell):
    assert capped(cell) == load_description(cell)[0]
    assert live_source(cell, KIND).description.refused == {}
    assert commissioned("direct", load_description(cell)[0], cell.with_name("none.toml")).refused == {}


@pytest.mark.parametrize(
    ("change", "stay"),
    [
        (("left", {"base_position": (0.0, 0.61, 0.0)}), {*HELD, "guide"}),
        (("left", {"address": "127.0.99.96"}), {"hold right", "wiggle right", "calibrate"}),
        (("safety", {"ee_speed_max": 0.9}), {*HELD, "guide", "calibrate"}),
    ],
)  # fmt: skip
def test_a_change_opens_the_steps_that_it_concerns(cell, change, stay):
    part, values = change
    description = load_description(cell)[0]
    if part == "left":
        assert description.left is not None
        description = replace(description, left=replace(description.left, **values))
    else:
        description = replace(description, safety=description.safety | values)
    assert {each.step.name for each in states(description, cell) if each.done} == stay


def test_another_pad_opens_all_that_it_takes_part_in(cell):
    description = load_description(cell)[0]
    other = replace(description, pad=replace(description.pad, mass=description.pad.mass + 0.1))
    found = {each.step.name: each for each in states(other, cell)}
    assert [name for name, each in found.items() if each.done] == ["wiggle left", "wiggle right", "guide"]
    line = Commissioning(tuple(found.values())).line
    assert "next: hold left" in line
    assert "left pad" in line


def test_another_version_keeps_no_hand_from_an_arm(cell, monkeypatch):
    monkeypatch.setattr("rtstack.cells.commissioning.version", lambda _: "9.9.9")
    assert open_steps(cell) == ["hold left", "hold right", "guide", "motion", "foam", "object"]
    assert "guide" not in capped(cell).refused


def test_another_firmware_opens_what_was_signed_with_the_one_before(cell):
    description = load_description(cell)[0]
    sign("hold left", "Anna", {}, description, cell, {"left": "5.10.0"})
    assert open_steps(cell) == ["guide", "motion", "foam", "object"]


def test_a_signature_has_name_date_and_values_and_one_arm_alone_may_be_signed(cell):
    record_file(cell).unlink()
    description = load_description(cell)[0]
    sign("hold left", " Anna ", {"hold": "pass: 0.001 rad"}, description.only(["left"]), cell, {"left": "5.9.0"})
    one = states(description, cell)[0]
    assert one.done
    assert one.signature is not None
    assert (one.signature.by, one.signature.values) == ("Anna", {"hold": "pass: 0.001 rad"})
    assert one.signature.at.tzinfo is not None


@pytest.mark.parametrize(("step", "by", "word"), [("jump", "Anna", "no step 'jump'"), ("guide", " ", "--sign NAME")])
def test_what_cannot_be_signed_is_refused(cell, step, by, word):
    before = record_file(cell).read_bytes()
    with pytest.raises(ConfigurationError, match=word):
        sign(step, by, {}, load_description(cell)[0], cell)
    assert record_file(cell).read_bytes() == before


def test_the_command_shows_the_steps_and_refuses_what_a_log_does_not_show(cell, tmp_path, command_line):
    commission(cell, until="motion")
    done = command_line("commission", "--cell-file", str(cell), cwd=tmp_path)
    assert done.returncode == 0
    assert "next: motion (rtstack commission motion --log LOG.mcap)" in done.stdout
    listed = json.loads(command_line("commission", "--cell-file", str(cell), "--json", cwd=tmp_path).stdout)
    assert [row["step"] for row in listed["steps"] if not row["done"]] == ["motion", "foam", "object"]
    demonstrate(tmp_path / "ref.mcap", load_description(None)[0])
    for words, said in (
        (("motion",), "--sign NAME"),
        (("foam", "--log", "ref.mcap", "--sign", "Anna"), "step foam comes after motion"),
        (("motion", "--log", "ref.mcap", "--sign", "Anna"), "it was made in simulation, on direct"),
    ):
        refused = command_line("commission", *words, "--cell-file", str(cell), cwd=tmp_path)
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
        assert said in refused.stderr
    simulated = command_line("commission", cwd=tmp_path)
    assert simulated.returncode == 2
    assert "simulated = true" in simulated.stderr
