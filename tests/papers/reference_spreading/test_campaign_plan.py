"""A campaign's plan: which trials it has, under which names and seeds, and what is refused."""

import re
from collections import Counter
from dataclasses import replace
from math import radians

import pytest

from hal.configuration import ConfigurationError
from hal.displacement import Displacement
from rtstack.experiments.plan_file import digest_of
from rtstack.experiments.registry import plan_file
from rtstack.experiments.seeds import seed_of
from rtstack.papers.reference import Reference
from rtstack.papers.reference_spreading.names import NAMES
from rtstack.papers.reference_spreading.plan import load_plan, select


@pytest.fixture
def plan():
    return load_plan(plan_file("reference-spreading").path)


def test_it_is_what_the_paper_ran(plan):
    table2, figure11 = plan.experiments
    chosen = [Reference("rice_box", n) for n in range(3)]
    papers = [trial for trial in plan.trials(table2) if trial.controller in NAMES]
    assert len(papers) == 80
    trials = plan.trials(figure11, chosen)
    assert sum(trial.controller in NAMES for trial in trials) == 600
    assert plan.size() == 5 * 680 / 4  # and ours, which is no part of the paper's
    assert len({trial.reference for trial in trials}) == 6
    assert len({trial.object for trial in trials}) == 4
    cells = Counter((trial.displacement_mm, trial.controller) for trial in trials)
    assert set(cells.values()) == {30}


def test_a_trial_has_one_name_and_one_seed_for_ever(plan):
    table2, figure11 = plan.experiments
    trials = [*plan.trials(table2), *plan.trials(figure11, [Reference("rice_box", n) for n in range(3)])]
    assert len({trial.id for trial in trials}) == len(trials)
    first = trials[0]
    assert first.id == "table2.nominal.rice_box-0.-30mm.0.no_reference_spreading"
    assert first.seed == seed_of(20260, "table2", "rice_box/0", -30.0, 0) == 1946671048
    repetitions = {(t.experiment, t.reference, t.displacement_mm, t.repetition): t.seed for t in trials}
    assert len(set(repetitions.values())) == len(repetitions)  # another repetition has another seed
    assert all(t.seed == repetitions[t.experiment, t.reference, t.displacement_mm, t.repetition] for t in trials)


def test_places_along_x_and_about_z_have_names_and_seeds_of_their_own(plan):
    plain = plan.experiments[0]
    turned = replace(plain, displacements_x_mm=(0.0, 10.0), yaws_deg=(0.0, -5.0))
    trials = {trial.id: trial for trial in plan.trials(turned)}
    assert len(trials) == 4 * len(plan.trials(plain)) == replace(plan, experiments=(turned,)).size()
    assert {trial.id: trial for trial in plan.trials(plain)}.items() <= trials.items()
    assert len({trial.seed for trial in trials.values()}) == len(trials) / len(plan.controllers)
    one = trials["table2.nominal.rice_box-0.-30mm+10mmx-5deg.0.no_reference_spreading"]
    assert one.displacement == Displacement(0.01, -0.03, radians(-5.0))


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
        (
            'experiment = "table2", count',
            'experiment = "table9", count',
            "selects from an experiment that is not",
        ),
        ('"parcel/0"', '"parcel"', "key experiments.1.references.0: "),
        ("seed = 20260", "seeds = 20260", "key seed"),
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


@pytest.mark.parametrize(("name", "speed"), [("rice_box/3", None), ("bottles/0@0.45", 0.45)])
def test_a_reference_is_its_name(name, speed):
    reference = Reference.named(name)
    assert reference.name == name
    assert reference.speed_m_s == speed
    assert reference.file == f"{name.replace('/', '-')}.mcap"


def test_conditions_with_a_speed_have_references_of_their_own_and_the_same_arms():
    plan = load_plan(plan_file("reference-spreading-sensitivity").path)
    (experiment,) = plan.experiments
    trials = {
        (t.conditions, t.reference.partition("@")[0], t.displacement_mm, t.repetition): t
        for t in plan.trials(experiment)
    }
    fast, nominal = (trials[conditions, "rice_box/0", -30.0, 1] for conditions in ("fast", "nominal"))
    assert fast.reference == "rice_box/0@0.45"
    assert nominal.reference == "rice_box/0"
    assert fast.seed == nominal.seed
    assert len(plan.references()) == 5 * 4
    assert {t.reference for t in trials.values()} == {reference.name for reference in plan.references()}
