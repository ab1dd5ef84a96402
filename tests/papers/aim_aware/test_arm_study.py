"""The arm study: the platform in the plant, the hit in the loop, and what is concluded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from rtstack.experiments.claims import ClaimStatus
from rtstack.model.arm_model import ArmModel
from rtstack.papers.aim_aware.arm.study import ArmRun, load_arm_run
from rtstack.papers.aim_aware.arm.tuning import separated
from rtstack.papers.aim_aware.arm.worker import hit_case, judged_case, learned_at, plan_case, prepare_hit, run_cases
from rtstack.papers.aim_aware.claims import LETTERS, evaluated
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.platform.plan import AXES, face_jacobian
from rtstack.papers.aim_aware.tuning import Need

FILE = Path(__file__).resolve().parents[3] / "deploy/campaigns/aim-aware-arm.toml"
EXACT = {"inclination_deg": 0.0, "height_mm": 0.0}


@pytest.fixture(scope="module")
def run() -> ArmRun:
    return load_arm_run(FILE, True)


def test_the_grid_is_the_papers_and_the_tuning_has_seen_none_of_it(run):
    study = run.study
    assert len(study.grid.plans()) * len(study.grid.inclination_deg.values()) == 84
    assert study.grid.approach_deg.values() == (100.0, 110.0, 120.0, 130.0)
    coarse = study.coarse.approach_deg.values()
    assert not set(study.grid.approach_deg.values()) & set(coarse)
    assert coarse[0] < 100.0  # what is judged lies inside the range that was tuned on
    assert coarse[-1] > 130.0
    assert study.coarse.inclination_deg == study.grid.inclination_deg
    assert [column.always_deg for column in study.tunings.values()] == [(0.0, 0.0), (0.0, 8.0)]
    table2 = [(c.window, c.delay, c.configuration_rad, c.velocity_rad_s) for c in study.tunings.values()]
    assert table2 == [(13, 5, 0.12, 0.18), (13, 5, 0.15, 0.2)]


def test_a_plan_goes_where_it_says_at_the_speed_that_it_says(run):
    study, case = run.study, Case(110.0, 0.51, 0.0)
    twist = run.tuned.learned["110"]
    plan = plan_case(study, case, twist)
    k = round(plan.t_d_s * 1e3)
    model = ArmModel(study.mounting, study.pad)
    J = face_jacobian(model, plan.q_d)
    face = model.p7 + model.R7 @ model.face
    np.testing.assert_allclose(face, [0.51, 0.0, 0.15], atol=1e-8)
    np.testing.assert_allclose((model.R7 @ model.R_joint_ee)[:, 2], [0.0, 0.0, -1.0], atol=1e-8)
    angle, speed = np.radians(110.0), study.task.speed_m_s
    np.testing.assert_allclose(plan.ante["twist"][k][AXES], [-speed * np.cos(angle), -speed * np.sin(angle), 0.0])
    np.testing.assert_allclose((J @ plan.dq_post[k])[AXES], twist, atol=1e-6)
    # the joints' velocities are those of a motion: they sum up to where the reference goes
    moved = plan.q_d + 1e-3 * plan.dq_post[k : k + 100].sum(axis=0)
    face_jacobian(model, moved)
    gone = model.p7 + model.R7 @ model.face - [0.51, 0.0, 0.15]
    assert gone[0] == pytest.approx(plan.post["position"][k + 100, 0] - 0.51, abs=2e-4)


def test_the_platform_stands_where_it_is_said_to_and_leans_to_the_side_that_it_is_said_to(run):
    """The pad's near edge meets a platform whose near edge is the higher one, and the pad turns accordingly."""
    study = replace(run.study, setup=replace(run.study.setup, **EXACT))
    plan = plan_case(study, Case(110.0, 0.51, 0.0), run.tuned.learned["110"])
    first_ms, turned = {}, {}
    for deg in (-6.0, 0.0, 6.0):
        case = Case(110.0, 0.51, deg)
        done = hit_case(study, case, prepare_hit(study, case, plan, run.monitors()["a"], 5))
        assert not done.stopped
        first_ms[deg] = int(np.argmax(done.ticks["post"])) - 1e3 * plan.t_d_s
        turned[deg] = np.degrees(1e-3 * done.ticks["twist"][:, 4].sum())
    assert abs(first_ms[0.0]) <= 5
    # half the plate's width sin(beta), at the vertical speed
    early = 1e3 * 0.1 * np.sin(np.radians(6.0)) / (study.task.speed_m_s * np.sin(np.radians(110.0)))
    for deg in (-6.0, 6.0):
        assert -first_ms[deg] == pytest.approx(early, abs=8)
        assert turned[deg] == pytest.approx(-deg, abs=1.0)  # in the end the pad lies on the platform


def test_a_hit_is_the_same_again_and_another_one_with_another_seed(run):
    case = Case(100.0, 0.51, 0.0)
    (impact, _), (again, _) = (judged_case(run, case) for _ in range(2))
    assert (impact.ticks == again.ticks).all()
    other, _ = judged_case(run, replace(case, repetition=1))
    assert (other.ticks["residual"] != impact.ticks["residual"]).any()
    row = run_cases(run, [case])[0]
    assert row["verdict_b"] == "expected" == row["verdict_a"]
    assert row["stopped"] == ""
    far = run_cases(run, [replace(case, inclination_deg=16.0)])[0]
    assert far["verdict_a"] == far["verdict_b"] == "unexpected"


def test_a_hit_that_the_robot_refuses_says_so_and_counts_as_not_expected(run):
    study = replace(run.study, gains=replace(run.study.gains, stiffness=(2e5,) * 3 + (20.0,) * 3))
    case = Case(100.0, 0.51, 0.0)
    plan = plan_case(study, case, run.tuned.learned["100"])
    done = hit_case(study, case, prepare_hit(study, case, plan, run.monitors()["a"], 1))
    assert done.stopped
    assert len(done.ticks) < len(plan.dq_post)


def _rows(edges: dict[str, tuple[float, float]], some: dict[str, tuple[float, float]] | None = None):
    """Twenty hits an inclination: all expected within the edges, half of them within `some`; letters: none."""
    rows = []
    for deg in np.arange(-20.0, 21.0, 2.0):
        for case in range(20):
            row: dict[str, float | str] = {"inclination_deg": float(deg), "approach_deg": 100.0 + 10.0 * (case % 4)}
            for name, (low, high) in edges.items():
                wide = some[name] if some and case % 2 else (low, high)
                inside = wide[0] <= deg <= wide[1]
                row |= {
                    f"verdict_{name}": "expected" if inside else "unexpected",
                    f"verdict_{LETTERS}{name}": "unexpected",
                }
                row |= {f"reason_{name}": "none" if inside else "envelope", f"reason_{LETTERS}{name}": "configuration"}
            rows.append(row)
    return rows


def _verdicts(run, rows, part: int = 1) -> dict[str, ClaimStatus]:
    claims = evaluated(run, rows, rows)[part].claims
    return {
        f"{plan.judge} {plan.at or ''}".strip(): each.verdict for plan, each in zip(run.claims, claims, strict=True)
    }


PLAIN = {"mirrored band b"}  # with a band on the plain side the mirrored reading fails


@pytest.mark.parametrize(
    ("edges", "some", "differing"),
    [
        ({"a": (0.0, 0.0), "b": (0.0, 8.0)}, {"a": (-2.0, 0.0), "b": (-2.0, 10.0)}, PLAIN),
        ({"a": (-4.0, 0.0), "b": (0.0, 8.0)}, {"a": (-6.0, 0.0), "b": (0.0, 8.0)}, PLAIN | {"band a"}),
        ({"a": (0.0, 2.0), "b": (-8.0, 8.0)}, None, PLAIN | {"band b", "off centre b"}),
        ({"a": (0.0, 2.0), "b": (0.0, 8.0)}, {"a": (0.0, 2.0), "b": (0.0, 16.0)}, PLAIN | {"ambiguity b"}),
        ({"a": (0.0, 2.0), "b": (0.0, 8.0)}, {"a": (0.0, 2.0), "b": (0.0, 20.0)}, PLAIN | {"ambiguity b", "ends b"}),
        ({"a": (0.0, 0.0), "b": (-8.0, 0.0)}, None, {"band b"}),  # the plain reading
    ],
)
def test_a_claim_holds_or_differs(run, edges, some, differing):
    verdicts = _verdicts(run, _rows(edges, some))
    assert {name for name, verdict in verdicts.items() if verdict is ClaimStatus.DIFFERS} == differing
    assert len(verdicts) == 11
    # twenty hits of twenty do not prove "always"
    assert verdicts["ends a"] is ClaimStatus.WITHIN


def test_what_has_no_interval_or_no_band_cannot_be_told(run):
    rows = _rows({"a": (0.0, 0.0), "b": (0.0, 8.0)})
    assert _verdicts(run, rows)["asymmetric a"] is ClaimStatus.UNDECIDED  # as sharp on both sides
    wide = _rows({"a": (0.0, 0.0), "b": (0.0, 8.0)}, {"a": (-6.0, 0.0), "b": (0.0, 8.0)})
    assert _verdicts(run, wide)["asymmetric a"] is ClaimStatus.HOLDS
    letters = _verdicts(run, rows, part=0)
    assert letters["band a"] is ClaimStatus.DIFFERS
    assert letters["ambiguity a"] is letters["off centre b"] is letters["growing"] is ClaimStatus.UNDECIDED


def test_the_papers_column_has_the_papers_band_in_both_readings(run):
    readings = {claim.where: claim.says for claim in run.claims if claim.where.startswith("Figure 8(b), ")}
    assert readings == dict.fromkeys(
        ("Figure 8(b), plain reading", "Figure 8(b), mirrored reading"), "{0, ..., 8} deg always expected"
    )
    assert all(claim.mark for claim in run.claims)


def test_a_contact_of_the_map_learns_its_own_velocity_and_is_another_plant(run):
    whole = replace(run, quick=False)
    first = next(case for case in whole.cases() if case.contact == 1 and case.inclination_deg == 0.0)
    row = run_cases(whole, [first])[0]
    assert row["contact"] == 1
    assert row["id"].endswith("-contact1")
    at, failed = learned_at(whole, first)
    assert failed == ""
    assert at.study.setup.stiffness == whole.contacts[0]["stiffness"]
    assert at.tuned.learned["100"] != whole.tuned.learned["100"]


def test_a_one_sided_band_is_found_on_its_side(run):
    study = run.study
    needs = {
        Case(105.0, 0.51, float(deg)): Need(0.01 + 0.02 * abs(deg), 0.1 + (0.3 * abs(deg) if deg > 0 else 0.0))
        for deg in range(-14, 15, 2)
    }
    needs_of = dict.fromkeys(study.tunings, needs)
    found, left_out = separated(study, needs_of, mirrored=True)
    assert left_out == 0
    assert found["a"].configuration_rad < 0.05 < 0.17 < found["b"].configuration_rad
    plain, _ = separated(study, needs_of, mirrored=False)
    assert min(f.separation for f in plain.values()) < min(f.separation for f in found.values())
    lost = dict.fromkeys(study.tunings, needs | {Case(105.0, 0.51, -8.0): Need(np.inf, np.inf)})
    assert separated(study, lost, mirrored=True)[1] == 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("speed_m_s = 0.25", "speed_m_s = 0.0", "key task.speed_m_s: "),
        ("first = 95.0, last = 135.0", "first = 90.0, last = 130.0", "key coarse: 100 deg is an approach that"),
        ("push_n = 70.0", "push_n = 71.0", "was found for another"),
        ("always_deg = [0.0, 8.0]", "always_deg = 8.0", "key tunings.b.always_deg: "),
    ],
)
def test_a_study_that_cannot_be_run_is_one_line(tmp_path, old, new, said):
    text = FILE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=said) as error:
        load_arm_run(path, False)
    assert "\n" not in str(error.value)
