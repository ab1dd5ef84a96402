"""A campaign's plan: which trials it has, under which names and seeds, and what is refused."""

import re
from collections import Counter
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.displacement import Displacement
from rtstack.experiments.plan_file import digest_of
from rtstack.experiments.registry import plan_file
from rtstack.experiments.seeds import seed_of
from rtstack.papers.conditions import Hand, Reference
from rtstack.papers.reference_spreading.controllers import NAMES
from rtstack.papers.reference_spreading.plan import load_plan, select
from rtstack.references.demonstration import grab
from rtstack.references.quintic import ViaPoint, quintic_path


@pytest.fixture
def plan():
    return load_plan(plan_file("reference-spreading").path)


def test_it_is_what_the_paper_ran_on_more_references_and_with_two_variants(plan):
    table2, figure11 = plan.experiments
    chosen = [Reference("rice_box", n) for n in range(3)]
    trials = plan.trials(table2)
    assert Counter(t.conditions for t in trials) == dict.fromkeys(("nominal", "with_B_theta", "honest"), 4 * 80)
    assert {t.controller for t in trials} == set(map(str, NAMES))
    repeated = plan.trials(figure11, chosen)
    assert sum(t.controller in NAMES for t in repeated) == 600
    assert plan.size() == 3 * 320 + 5 * 600 / 4  # the fifth controller is no part of the paper's
    assert len({t.reference for t in repeated}) == 6
    assert len({t.object for t in repeated}) == 4
    cells = Counter((t.displacement_mm, t.controller) for t in repeated)
    assert set(cells.values()) == {30}


def test_the_papers_law_is_what_runs_and_ours_is_a_variant(plan):
    assert next(iter(plan.conditions)) == "nominal"
    assert plan.conditions["nominal"].law_inertia == "M"
    assert plan.conditions["with_B_theta"] == replace(plan.conditions["nominal"], law_inertia="M+B_theta")
    assert plan.conditions["honest"] == replace(plan.conditions["nominal"], profile="honest")


def test_a_trial_has_one_name_and_one_seed_for_ever(plan):
    table2, figure11 = plan.experiments
    trials = [*plan.trials(table2), *plan.trials(figure11, [Reference("rice_box", n) for n in range(3)])]
    assert len({trial.id for trial in trials}) == len(trials)
    first = trials[0]
    assert first.id == "table2.nominal.rice_box-100.-30mm.0.no_reference_spreading"
    assert first.seed == seed_of(20341, "table2", "rice_box/100", -30.0, 0) == 2507771781
    repetitions = {(t.experiment, t.seed): t.seed for t in trials}
    assert len(set(repetitions.values())) == len(repetitions)
    by = {(t.experiment, t.reference.partition("@")[0], t.displacement_mm, t.repetition): t.seed for t in trials}
    assert len(set(by.values())) == len(by)  # another repetition has another seed
    # the same one under all conditions and with all controllers: they meet the same arms
    assert all(
        t.seed == by[t.experiment, t.reference.partition("@")[0], t.displacement_mm, t.repetition] for t in trials
    )


def test_places_along_x_and_about_z_have_names_and_seeds_of_their_own(plan):
    plain = plan.experiments[0]
    turned = replace(plain, displacements_x_mm=(0.0, 10.0), yaws_deg=(0.0, -5.0))
    trials = {trial.id: trial for trial in plan.trials(turned)}
    assert len(trials) == 4 * len(plan.trials(plain)) == replace(plan, experiments=(turned,)).size()
    assert {trial.id: trial for trial in plan.trials(plain)}.items() <= trials.items()
    assert len({trial.seed for trial in trials.values()}) == len(trials) / (4 * 3)  # controllers, conditions
    one = trials["table2.nominal.rice_box-100.-30mm+10mmx-5deg.0.no_reference_spreading"]
    place = Displacement.given(one.displacement_mm, one.displacement_x_mm, one.yaw_deg)
    assert place == Displacement(0.01, -0.03, radians(-5.0))


def test_quick_is_a_part_of_it(plan):
    quick = plan.as_sample()
    assert 0 < quick.size() < plan.size() / 5
    assert quick.references() != plan.references()
    assert set(quick.references()) < set(plan.references())
    assert digest_of(quick) != digest_of(plan)


def test_the_digest_sees_every_file(plan, tmp_path):
    one, other, both = (tmp_path / name for name in ("one", "other", "both"))
    for path, content in ((one, b"a"), (other, b"b"), (both, b"ab")):
        path.write_bytes(content)
    files = ([], [one], [other], [one, other], [other, one], [both])
    assert len({digest_of(plan, some) for some in files} | {digest_of(plan, [], also="a")}) == 7
    assert digest_of(plan, [one]) == digest_of(plan, [one])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("pad_friction = 0.9", "pad_friction = -0.9", "key conditions.nominal.pad_friction: Input should be greater"),
        ("slip_m = 0.04\n", "", "key success.slip_m: "),
        ('"no_interim"', '"no_such"', r"key controllers.2: "),
        ("repetitions = 5", "repetitions = 0", "key experiments.1.repetitions: "),
        ('experiment = "table2", count', 'experiment = "table9", count', "selects from an experiment that is not"),
        ('"parcel/100"', '"parcel"', "key experiments.1.references.0: "),
        ("seed = 20341", "seeds = 20341", "key seed"),
        ("grip = 2.0", "grip = 2.0\ndepth_m = 0.04", "give either grip or depth_m"),
        ('law_inertia = "M"', 'law_inertia = "B"', "key conditions.nominal.law_inertia: "),
        ('judge = "swing"', 'judge = "swings"', "key claims.21.judge: unknown 'swings': choose one of "),
        ('title = "Reference', 'cell_file = "none.toml"\ntitel = "Reference', "key t"),
    ],
)
def test_a_plan_that_cannot_be_is_one_line(tmp_path, old, new, said):
    text = plan_file("reference-spreading").path.read_text()
    assert old in text
    path = tmp_path / "plan.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=said) as refused:
        load_plan(path)
    assert re.match(rf"{re.escape(str(path))}:(\d+:)? ", str(refused.value))
    assert "\n" not in str(refused.value)


def test_references_are_chosen_by_their_success():
    failed = {(0, 0), (1, 0), (1, 1), (1, 2), (1, 3)}
    rows = [{"reference": f"rice_box/{n}", "success": (n, k) not in failed} for n in range(5) for k in range(4)]
    assert [reference.variation for reference in select(rows, 3)] == [2, 3, 4]
    assert [reference.variation for reference in select(rows, 4)] == [0, 2, 3, 4]


@pytest.mark.parametrize(("name", "conditions"), [("rice_box/3", ""), ("bottles/0@M+B_theta_60kNm", "M+B_theta_60kNm")])
def test_a_reference_is_its_name(name, conditions):
    reference = Reference.named(name)
    assert reference.name == name
    assert reference.conditions == conditions
    assert reference.file == f"{name.replace('/', '-')}.mcap"


def test_each_conditions_have_references_of_their_own_and_the_same_arms():
    plan = load_plan(plan_file("reference-spreading-sensitivity").path)
    (experiment,) = plan.experiments
    trials = {(t.conditions, t.reference.partition("@")[0], t.displacement_mm): t for t in plan.trials(experiment)}
    fast, nominal = (trials[conditions, "rice_box/130", -30.0] for conditions in ("fast", "nominal"))
    assert (fast.reference, nominal.reference) == ("rice_box/130@fast", "rice_box/130")
    assert plan.conditions_of(Reference.named(fast.reference)) == plan.conditions["fast"]
    assert fast.seed == nominal.seed
    assert len(plan.references()) == 3 * len(plan.conditions)
    assert {t.reference for t in trials.values()} == {reference.name for reference in plan.references()}


def test_a_map_has_conditions_for_each_hand_law_and_pad():
    plan = load_plan(plan_file("reference-spreading-hands").path)
    assert plan.hands is not None
    made = plan.conditions["M+B_theta_60kNm_120mm_120ms"]
    assert (made.law_inertia, made.pad_stiffness) == ("M+B_theta", 6e4)
    assert made.hand == Hand(depth_m=0.12, stop_s=0.12)
    assert plan.conditions["M_200kNm_30mm_even"].hand == Hand(depth_m=0.03)
    assert plan.size() == 32 * 3 * 4


def test_a_grip_gives_a_depth_and_an_even_stop():
    """Twice m g / (2 mu) through K_r; to rest in twice the time that the speed of the approach would take."""
    plain = grab(0)
    script = Hand(grip=2.0).script(plain, mass_kg=1.25, pad_friction=0.9, stiffness_n_m=300.0)
    assert script.squeeze == pytest.approx(2.0 * 1.25 * 9.81 / (2 * 0.9) / 300.0)
    assert script.squeeze_s == pytest.approx(2.0 * script.squeeze / plain.speed_y)
    t = np.linspace(0.0, script.squeeze_s, 50)
    _, speed = quintic_path([ViaPoint(0.0, 0.0, plain.speed_y), ViaPoint(script.squeeze_s, script.squeeze)], t)
    assert speed.max() <= plain.speed_y * (1 + 1e-9)  # a hand that stops does not speed up first
    assert replace(script, squeeze=plain.squeeze, squeeze_s=plain.squeeze_s) == plain


def test_a_variation_keeps_its_share_of_the_depth():
    deep = [Hand(depth_m=0.04).script(grab(n), 1.0, 1.0, 300.0).squeeze for n in range(1, 30)]
    assert 0.034 < min(deep) < 0.037
    assert 0.041 < max(deep) < 0.044
