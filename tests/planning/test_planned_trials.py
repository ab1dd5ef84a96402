"""A plan as a file, and trials that follow it without knowing that nobody has shown it to them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cells import default_cell_file
from rtstack.cli.app import app
from rtstack.log.reader import read_log
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.planning import GrabPlan, PushPlan
from rtstack.planning.file import write_plan
from rtstack.references.motion import Motion
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.trials.assembly import arm_controllers, default_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.review import log_columns, review_log
from rtstack.trials.scoring import SuccessCriterion, score
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.support.runs import attempt


@pytest.fixture(scope="session")
def files(cell, grabbed, pushed, tmp_path_factory):
    """Return the files of both plans."""
    folder = tmp_path_factory.mktemp("plans")
    for name, planned in (("grab", grabbed), ("push", pushed)):
        write_plan(folder / f"{name}.mcap", planned, cell, default_cell_file())
    return folder


def test_a_file_gives_back_the_references(cell, grabbed, pushed, files):
    parameters = default_parameters()
    for name, planned in (("grab", grabbed), ("push", pushed)):
        loaded = load_reference(files / f"{name}.mcap", arm_controllers(cell, parameters), parameters.detector)
        reference = planned.reference
        for field in ("period_s", "nominal_impact_s", "release_s", "object", "motion"):
            assert getattr(loaded, field) == getattr(reference, field)
        for piece in ("ante", "post"):
            for field in reference.ante.dtype.names:
                a, b = getattr(loaded, piece)[field], getattr(reference, piece)[field]
                np.testing.assert_allclose(a, b, atol=1e-8)
    assert sorted(path.name for path in files.iterdir()) == ["grab.mcap", "push.mcap"]


def test_a_plan_is_a_log_that_says_what_was_planned(grabbed, files):
    log = read_log(files / "grab.mcap")
    plan = log.metadata["plan"]
    assert plan["motion"] == "grab"
    assert json.loads(plan["parameters"])["post_impact_scale"] == 0.9
    np.testing.assert_allclose(json.loads(plan["velocity_after"])["left"], grabbed.map.twist("left")[:3])
    assert {"nominal impact, planned", "release, planned"} == {event.text for event in log.events}
    height = log.topic("/object/pose")["position"][:, 2]
    assert height.max() - height[0] == pytest.approx(0.25, abs=1e-3)
    assert log.messages("/tf")


def test_a_plan_that_is_cut_short_is_no_reference(cell, grabbed, tmp_path):
    path = tmp_path / "late.mcap"
    late = replace(grabbed.recording, impact=0)
    write_plan(path, replace(grabbed, recording=late), cell, default_cell_file())
    parameters = default_parameters()
    with pytest.raises(ReferenceError, match="no motion before and after an impact"):
        load_reference(path, arm_controllers(cell, parameters), parameters.detector)


@pytest.mark.parametrize("controller", list(Controller))
def test_every_controller_grabs_as_planned(cell, files, controller):
    result = _run(cell, files / "grab.mcap", "rice_box", controller)
    assert result.success, result.failure_reason
    assert result.max_lift_mm == pytest.approx(250.0, abs=5.0)
    assert result.detected_impact_time_s == pytest.approx(result.nominal_impact_time_s, abs=0.01)


def test_a_push_succeeds_where_the_object_goes_with_the_pad(cell, files, tmp_path):
    path = tmp_path / "trial.mcap"
    result = _run(cell, files / "push.mcap", "box_130", log=path)
    assert result.success, result.failure_reason
    review = review_log(path)
    assert review.trial["motion"] == Motion.HIT_AND_PUSH
    assert review.score is not None
    assert review.score.held
    columns = log_columns(read_log(path))
    place = columns.object["position"]
    assert place[-1, 1] - place[0, 1] == pytest.approx(-0.25, abs=0.01)
    impact, release = float(review.trial["nominal_impact_s"]), float(review.trial["release_s"])
    for factor in (0.0, 0.5, 1.5):  # an object that stays behind, or runs ahead
        moved = columns.object.copy()
        moved["position"] = place[0] + factor * (place - place[0])
        wrong = score(
            replace(columns, object=moved), int(columns.arm[0]["t_ns"][0]), impact, release,
            result.detected_impact_time_s, SuccessCriterion(), Motion.HIT_AND_PUSH,
        )  # fmt: skip
        assert not wrong.held


def _run(cell, path, thing, controller=Controller.PROPOSED, log=None):
    return attempt(TrialSpecification(str(path), controller, thing, seed=3), cell, log)


def test_the_command_prints_one_object_and_writes_one_file(tmp_path, capsys):
    path = tmp_path / "plan.mcap"
    app(["plan", str(path), "--motion", "hit-and-push", "--object", "box_060", "--json"], standalone_mode=False)
    printed = json.loads(capsys.readouterr().out)
    assert printed["motion"] == "hit-and-push"
    assert printed["velocity_planned"]["left"][1] < -0.4
    assert printed["monitor"] is None
    assert list(tmp_path.iterdir()) == [path]


def test_the_help_says_what_an_option_is_by_default(capsys):
    app(["plan", "--help"], standalone_mode=False)
    options = " ".join(capsys.readouterr().out.split("Options:")[1].split()).split(" --")
    said = {option.split()[0]: option.rsplit(": ", 1)[-1].rstrip(".") for option in options}
    grab, push = GrabPlan(), PushPlan()
    for key in ("rise", "posture", "squeeze", "lift", "lift_s", "momentum_s", "carry", "post_impact_scale"):
        assert said[key.replace("_", "-")] == f"{getattr(grab, key):g}"
    assert said["travel"] == f"{push.travel:g}"
    for key in ("speed", "height"):
        assert said[key] == f"{getattr(grab, key):g}, of a push {getattr(push, key):g}"
    assert said["inertia"] == grab.inertia.value


def test_the_plan_of_another_object_is_not_followed(cell, files):
    with pytest.raises(TrialError, match="the plan is for box_130, not for rice_box"):
        prepare_trial(TrialSpecification(str(files / "push.mcap"), object="rice_box"), cell)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--speed", "3"], "speed"),
        (["--lift-s", "1", "--motion", "hit-and-push"], "--lift-s does not belong to a hit-and-push"),
        (["--momentum-s", "0", "--motion", "hit-and-push"], "--momentum-s does not belong to a hit-and-push"),
        (["--momentum-s", "0.3"], "momentum_s"),
        (["--travel", "0.1"], "--travel does not belong to a grab"),
        (["--object", "brick"], "unknown object 'brick'"),
        (["--cell-file", "nowhere.toml"], "nowhere.toml: cannot be read"),
    ],
)
def test_what_is_refused_writes_nothing(tmp_path, arguments, said):
    with pytest.raises(ConfigurationError, match=said):
        app(["plan", str(tmp_path / "plan.mcap"), *arguments], standalone_mode=False)
    assert not list(tmp_path.iterdir())
