"""The plans of the validation campaigns, and what comes of their results."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from hal.configuration import ConfigurationError
from rtstack.experiments.claims import ClaimStatus
from rtstack.experiments.registry import kind_of, plan_file
from rtstack.impact_map import ReflectedInertia
from rtstack.impact_map.grab import grab_scene
from rtstack.impact_map.map import converged
from rtstack.impact_map.problem import problem_of
from rtstack.papers.impact_maps.claims import judge_claims
from rtstack.papers.impact_maps.evaluation import combined, tables
from rtstack.papers.impact_maps.plan import load_validation_plan
from rtstack.papers.impact_maps.prediction import with_inertia
from rtstack.references.motion import Motion


def plan_named(name, quick=False):
    path = plan_file(name).path
    assert kind_of(path) == "impact-map-validation"
    return load_validation_plan(path, quick)


def test_the_campaign_is_the_papers_450_trials():
    plan = plan_named("impact-map-validation")
    trials = list(plan.trials())
    assert len(trials) == plan.size() == 450
    assert len({trial.id for trial in trials}) == 450
    assert len({trial.seed for trial in trials}) == 450
    assert len(plan.references()) == 2 * 3 * 3 * 5


def test_conditions_share_seeds_and_references():
    plan = plan_named("impact-map-sensitivity")
    by_what: dict[object, set[int]] = {}
    for trial in plan.trials():
        values = asdict(trial)
        by_what.setdefault(tuple(values[k] for k in values if k not in ("conditions", "seed")), set()).add(trial.seed)
    assert all(len(seeds) == 1 for seeds in by_what.values())
    assert {reference.compensate for reference in plan.references()} == {True, False}


def test_a_value_out_of_range_is_one_line(tmp_path):
    text = plan_file("impact-map-validation").path.read_text()
    broken = tmp_path / "broken.toml"
    for old, new, key in (
        ("speed = 0.7", "speed = 7.0", "case 2: plan: speed"),
        ("repetitions = 5", "repetitions = 0", "key repetitions"),
        ("k_p = 100.0", "k_p = -1.0", "gains.k_p"),
    ):
        broken.write_text(text.replace(old, new, 1))
        with pytest.raises(ConfigurationError, match=key):
            load_validation_plan(broken)


def rows_of(error_percent, motion=Motion.HIT_AND_PUSH, slope=1.2, noise=0.0):
    """Results of two objects whose natural velocity is below the prediction by this share."""
    rng, rows = np.random.default_rng(0), []
    for thing, predicted in (("box_060", 0.45), ("box_220", 0.37)):
        truth = predicted / (1.0 + error_percent / 100.0)
        for scale in (0.8, 0.9, 1.0, 1.1, 1.2):
            for _ in range(5):
                net = slope * (scale * predicted - truth) + noise * rng.standard_normal()
                rows.append(
                    {
                        "conditions": "nominal", "motion": str(motion), "object": thing, "case_name": "1",
                        "success": True, "complete": True, "planned_m_s": scale * predicted, "net_feedback_m_s": net,
                        "net_over_swing_m_s": net - 0.01, "swing_m_s": 0.01,
                        "predicted_B_theta_m_s": predicted, "predicted_B_m_s": 1.05 * predicted,
                        "predicted_none_m_s": 0.95 * predicted,
                    }
                )  # fmt: skip
    return rows


def test_tables_of_results_whose_answer_is_known():
    push, grab = tables(rows_of(2.0) + rows_of(-3.0, Motion.GRAB))
    assert push.average(ReflectedInertia.B_THETA) == pytest.approx(2.0)
    assert push.absolute(ReflectedInertia.B) == pytest.approx(1.05 * 102.0 - 100.0)
    assert grab.average(ReflectedInertia.B_THETA) == pytest.approx(-3.0)
    assert push.cells[0].swing_percent == pytest.approx(100.0 * 0.01 / (1.2 * 0.45 / 1.02))  # by the fit's slope
    shifted = 0.45 / 1.02 + 0.01 / 1.2  # by what the mean over a swing is less
    error = push.cells[0].error_percent(ReflectedInertia.B_THETA, over_swing=True)
    assert error == pytest.approx(100.0 * (0.45 / shifted - 1.0))
    assert combined([push, grab], ReflectedInertia.B_THETA) == pytest.approx(2.5)
    verdicts = {(claim.where, claim.says.split(" (")[0]): claim.verdict for claim in judge_claims([push, grab])}
    assert verdicts["Table II", "absolute error with B_theta at most 4 %"] is ClaimStatus.HOLDS
    assert verdicts["Table II", "smaller than with B by 2.72 points or more"] is ClaimStatus.HOLDS
    assert verdicts["Table III", "smaller than with B by 2.22 points or more"] is ClaimStatus.DIFFERS
    (bad,) = tables(rows_of(6.0, noise=0.05))
    assert [claim.verdict for claim in judge_claims([bad])[::2]] == [ClaimStatus.DIFFERS] * 2 + [ClaimStatus.DIFFERS]


def test_trials_that_failed_or_ended_early_do_not_count():
    rows = rows_of(0.0)
    wild = [replace_row(row, success=False, net_feedback_m_s=9.0) for row in rows[:2]]
    wild += [replace_row(row, complete=False, net_feedback_m_s=9.0) for row in rows[:1]]
    (table,) = tables(rows + wild)
    assert table.cells[0].excluded == 3
    assert table.cells[0].error_percent(ReflectedInertia.B_THETA) == pytest.approx(0.0, abs=1e-9)


def replace_row(row, **values):
    return {**row, **values}


def test_another_inertia_of_the_motors_is_the_map_of_that_scene(cell):
    q = np.array([[-0.559731, 0.121163, 0.017681, -2.391737, -2.025175, 1.877568, 1.012942]] * 2)
    q[1] *= [-1, 1, -1, 1, -1, 1, -1]
    dq = 0.2 * np.random.default_rng(2).standard_normal((2, 7))
    scene = grab_scene(cell, "rice_box", q, dq, 0.9, 0.4)
    for kind in ReflectedInertia:
        direct = converged(problem_of(replace(scene, reflected=kind)))
        derived = converged(with_inertia(problem_of(scene), ReflectedInertia.B_THETA, kind))
        np.testing.assert_allclose(derived.velocity, direct.velocity, atol=1e-9)
