"""The monitor of a plan: what it expects is planned, what it allows is seen in runs of the plan; it tells faults."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.cells import default_cell_file
from rtstack.cli.plan_monitor import FIRST_SEED, SHIFTED_MM, plan_monitor
from rtstack.planning import PlanError
from rtstack.planning.file import write_plan
from rtstack.references.planned import planned_reference
from rtstack.samples import Reaction
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import tuning_in
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.support.runs import attempt

GRAVITY = 9.81


@pytest.fixture(scope="module")
def watched(cell, grabbed, tmp_path_factory):
    """Return the file of a plan that has a monitor."""
    path = tmp_path_factory.mktemp("watched") / "grab.mcap"
    tuning, found = plan_monitor(grabbed, "grab", cell, 9, False)
    assert (found.runs, found.false_alarms) == (3, ())
    write_plan(path, grabbed, cell, default_cell_file(), tuning)
    return path


@pytest.mark.long
def test_what_is_expected_is_what_was_planned(cell, grabbed, watched):
    k, recording = grabbed.recording.impact, grabbed.recording
    impact = grabbed.reference.impact
    for arm in range(2):
        J, J_before = grabbed.joints[arm].J[k], grabbed.joints[arm].J[k - 1]
        after = J @ impact.dq_post[arm, k]
        np.testing.assert_allclose(after[:3], grabbed.velocities[arm], atol=1e-5)  # the map's, scaled
        np.testing.assert_array_equal(impact.dq_post[arm, :k], np.broadcast_to(impact.dq_post[arm, k], (k, 7)))
        before = J_before @ impact.dq_ante[arm]
        np.testing.assert_allclose(before[:3], recording.points[arm, k - 1]["twist"][:3], atol=1e-4)
        np.testing.assert_allclose(impact.q_d[arm], grabbed.joints[arm].q[k])
    held = round((impact.t_d_s + 1.5) / recording.period_s)  # at rest in z between lift and lowering
    np.testing.assert_allclose(impact.net_force[held, 1:], (0.0, 1.25 * GRAVITY), atol=0.05)
    assert not impact.net_force[:k].any()
    height = grabbed.object_position[:, 2] - grabbed.object_position[0, 2]
    down = round(impact.set_down_s / recording.period_s)
    assert 0.01 < height[down] < 0.05
    assert impact.set_down_s < impact.release_s
    # and the file says the same
    loaded = prepare_trial(TrialSpecification(str(watched)), cell).reference.impact
    for field in ("q_d", "dq_ante", "dq_post", "net_force"):
        np.testing.assert_allclose(getattr(loaded, field), getattr(impact, field), atol=1e-8)
    assert loaded is not None
    assert (loaded.t_d_s, loaded.set_down_s, loaded.release_s) == (impact.t_d_s, impact.set_down_s, impact.release_s)


@pytest.mark.parametrize(
    ("script", "shift_mm", "verdict", "kind"),
    [
        ("", 12.0, "expected", None),
        pytest.param('kind = "object_lost"', 0.0, "unexpected", "object missing", marks=pytest.mark.long),
        ("", 60.0, "unexpected", "wrong place"),  # met early by one arm alone: the squeeze begins at its own time
        pytest.param('kind = "object_mass"\nmass_factor = 3.0', 0.0, "unexpected", "too heavy", marks=pytest.mark.long),
    ],
)
def test_good_runs_are_expected_and_faults_are_told(cell, watched, tmp_path, script, shift_mm, verdict, kind):
    faults = tmp_path / "faults.toml"
    faults.write_text(f"[[fault]]\n{script}\nat_s = 0.0\n" if script else "")
    prepared = prepare_trial(TrialSpecification(str(watched), displacement_mm=shift_mm, seed=3), cell)
    assert prepared.unwatched is None
    result = attempt(prepared, cell, faults=faults)
    assert (result.impact_verdict, result.impact_kind) == (verdict, kind)


def test_a_tuning_says_from_which_runs_it_is(watched):
    tuning = tuning_in(watched)
    assert tuning is not None
    said = {key: np.array(tuning.provenance[key]) for key in ("displacements_mm", "seeds", "held_out_seeds")}
    shifts = said["displacements_mm"]
    assert (shifts.min(), shifts.max()) == (-SHIFTED_MM, SHIFTED_MM)
    assert sorted([*said["seeds"], *said["held_out_seeds"]]) == list(range(FIRST_SEED, FIRST_SEED + 9))


def test_what_is_not_watched_says_why_and_what_to_do(cell, grabbed, pushed, tmp_path):
    def unwatched(planned, thing: str) -> str:
        path = tmp_path / "plan.mcap"
        write_plan(path, planned, cell, default_cell_file())
        specification = TrialSpecification(str(path), object=thing)
        with pytest.raises(TrialError, match="nothing would start the reaction hold: "):
            prepare_trial(replace(specification, reaction=Reaction.HOLD), cell)
        return prepare_trial(specification, cell).unwatched or ""

    # the object's own tuning is of demonstrations: it is no plan's
    assert unwatched(grabbed, "rice_box") == "its plan has no monitor: make one with it, by rtstack plan --watch RUNS"
    assert unwatched(pushed, "box_130").startswith("it follows a hit-and-push")
    older = replace(grabbed, force=np.zeros_like(grabbed.force))  # its file does not say what the pads exert
    assert unwatched(older, "rice_box").startswith("its plan does not say what the pads are to exert: plan it again")
    with pytest.raises(PlanError, match="a hit-and-push is not watched"):
        plan_monitor(pushed, "push", cell, 9, False)
    assert planned_reference(pushed.recording).impact is None
