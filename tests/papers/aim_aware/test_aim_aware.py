"""What is concluded from the verdicts, and that the committed tuning is what the coarse grid gives."""

from dataclasses import replace

import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cli.app import main
from rtstack.experiments.claims import ClaimStatus
from rtstack.papers.aim_aware.claims import LETTERS, SHARED, Bands, at_contact, bands, evaluated
from rtstack.papers.aim_aware.classification import plan_case, simulate_case
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.study import load_run
from rtstack.papers.aim_aware.tuning import Need, find, separate
from rtstack.papers.aim_aware.worker import run_cases

DEGREES = [float(deg) for deg in range(-10, 11)]


def _rows(expected: dict[str, float], some: dict[str, float] | None = None, impulse_ns: float = 0.2, count: int = 40):
    """Cases of each inclination: all expected up to `expected` degrees, half of them up to `some`; letters: 0 alone."""
    rows = []
    for deg in DEGREES:
        for case in range(count):
            row = {"inclination_deg": deg, "impulse_ns": impulse_ns, "second_ms": 1.0, "approach_deg": 90.0}
            for name, edge in expected.items():
                far = edge if case % 2 or not some else max(edge, some[name])
                for prefix, reach in (("", far), (LETTERS, 0.0)):
                    row[f"verdict_{prefix}{name}"] = "expected" if abs(deg) <= reach else "unexpected"
                    row[f"reason_{prefix}{name}"] = "none" if abs(deg) <= reach else "envelope"
            rows.append(row)
    return rows


def _verdicts(run, rows, part: str = "with our tuning") -> dict[str, ClaimStatus]:
    """Verdicts of one group of claims, by where and judge."""
    claims = next(section for section in evaluated(run, rows, rows) if section.name == part).claims
    planned = [claim for claim in run.claims if (claim.judge in SHARED) is (part == "whatever the tuning")]
    return {f"{plan.judge} {plan.at or ''}".strip(): claim.verdict for plan, claim in zip(planned, claims, strict=True)}


def test_bands_say_what_is_expected_always_sometimes_and_never():
    found = bands(_rows({"a": 2.0}, {"a": 4.0}), "a")
    assert found.always == (-2.0, 2.0)
    assert found.sometimes == [-4.0, -3.0, 3.0, 4.0]
    assert found.never == (-5.0, 5.0)
    assert found.ambiguity_deg == (3.0, 3.0)
    assert found.shares[3.0] == 0.5
    split = Bands({-1.0: 1.0, 0.0: 0.9, 1.0: 1.0}, 3)
    assert split.always is None
    assert split.words() == "not 0 deg (90 %), but -1, +1 deg"
    assert Bands({-1.0: 0.5, 0.0: 1.0, 1.0: 1.0}, 3).always == (0.0, 1.0)
    assert Bands({-1.0: 0.5, 0.0: 1.0, 1.0: 1.0}, 3).never == (None, None)


AS_THE_PAPER = {"a": 0.0, "b": 2.0, "c": 4.0}


@pytest.mark.parametrize(
    ("expected", "some", "differing"),
    [
        (AS_THE_PAPER, {"a": 1.0, "b": 3.0, "c": 5.0}, set()),
        (AS_THE_PAPER, None, set()),
        ({"a": 1.0, "b": 2.0, "c": 4.0}, None, set()),  # within a degree
        ({"a": 2.0, "b": 3.0, "c": 4.0}, None, {"band a"}),
        ({"a": 0.0, "b": 1.0, "c": 4.0}, {"a": 1.0, "b": 2.0, "c": 5.0}, {"band b"}),  # 2 deg is not always expected
        ({"a": 0.0, "b": 2.0, "c": 2.0}, None, {"band c", "beyond c"}),
        (AS_THE_PAPER, {"a": 2.0, "b": 5.0, "c": 6.0}, {"ambiguity b", "beyond b"}),
        (AS_THE_PAPER, {"a": 0.0, "b": 4.0, "c": 6.0}, {"alike"}),
        (AS_THE_PAPER, {"a": 1.0, "b": 3.0, "c": 10.0}, {"ambiguity c", "beyond c", "alike"}),
        ({"a": -1.0, "b": 2.0, "c": 4.0}, None, {"band a", "beyond a"}),
    ],
)
def test_a_claim_holds_or_differs(study_run, expected, some, differing):
    verdicts = _verdicts(study_run, _rows(expected, some))
    assert {name for name, verdict in verdicts.items() if verdict is ClaimStatus.DIFFERS} == differing
    assert len(verdicts) == 12
    letters = _verdicts(study_run, _rows(expected, some), "with the paper's letters")
    assert {name for name, verdict in letters.items() if verdict is ClaimStatus.DIFFERS} == {
        "band b", "band c", "beyond b", "beyond c"
    }  # fmt: skip


def test_no_verdict_comes_from_one_case_and_an_order_needs_intervals(study_run):
    one = _verdicts(study_run, _rows(AS_THE_PAPER, count=1))
    assert one["band a"] is one["ambiguity b"] is one["beyond c"] is one["alike"] is ClaimStatus.UNDECIDED
    few = _verdicts(study_run, _rows(AS_THE_PAPER, count=2))
    assert few["growing"] is ClaimStatus.WITHIN
    assert _verdicts(study_run, _rows(AS_THE_PAPER))["growing"] is ClaimStatus.HOLDS
    assert evaluated(study_run, [], []) == []


def test_what_no_tuning_changes_is_judged_once(study_run):
    rows = _rows(AS_THE_PAPER)
    both = "whatever the tuning"
    assert set(_verdicts(study_run, rows, both).values()) == {ClaimStatus.HOLDS}
    wrong = [*rows, rows[0] | {"second_ms": None, "impulse_ns": -0.1}]
    assert set(_verdicts(study_run, wrong, both).values()) == {ClaimStatus.DIFFERS}


def test_a_claims_columns_are_the_papers_and_ours(study_run):
    for claim in study_run.claims:
        assert "within" not in claim.says
    says = {claim.where: claim.says for claim in study_run.claims if claim.judge == "band"}
    assert says["Figure 7(c)"] == "-4 .. +4 deg always expected"
    assert any("coarse grid" in line for line in study_run.registration.chosen_on)


def test_a_changed_claim_asks_for_neither_a_new_tuning_nor_new_rows(tmp_path, study_text):
    from rtstack.experiments.plan_file import digest_of

    path = tmp_path / "study.toml"
    path.write_text(study_text.replace("at most 1 deg beyond", "at most 2 deg beyond"))
    changed = load_run(path, quick=True)
    path.write_text(study_text)
    as_it_is = load_run(path, quick=True)
    assert changed.claims != as_it_is.claims
    assert digest_of(changed) == digest_of(as_it_is)


def test_a_contact_that_is_run_at_all_points_is_judged_where_the_map_has_none(study_run):
    whole = replace(study_run, quick=False)
    number = whole.study.contacts.whole[0]
    rows = [
        {"contact": case.contact, "approach_deg": case.approach_deg, "location_m": case.location_m}
        | {"inclination_deg": case.inclination_deg}
        for case in whole.cases()
    ]
    mapped, others = (at_contact(whole, rows, number, each) for each in (True, False))
    assert len(mapped) == whole.study.contacts.grid.size()
    assert len(mapped) + len(others) == whole.grid.size()


@pytest.mark.long
def test_a_contact_of_the_map_has_cases_and_a_plant_of_its_own(study_run):
    whole = replace(study_run, quick=False)
    cases = list(whole.cases())
    assert len(cases) == len({case.id for case in cases}) == whole.size()
    assert study_run.size() == study_run.grid.size()  # a sample has no map
    values = whole.contacts[-1]
    at = whole.at(len(whole.contacts))
    assert at.study.contact.stiffness == values["stiffness"]
    assert at.monitors()["paper_a"].residual_rate_nm_s == (values["residual_rate_nm_s"],) * 3
    row = run_cases(whole, [case for case in cases if case.contact == 1][:1])[0]
    assert (row["contact"], row["tuned_on"]) == (1, False)


@pytest.mark.long
def test_the_committed_tuning_is_what_the_coarse_grid_gives(study_run):
    tuned = study_run.tuned
    assert find(study_run.study, tuned.residual_rate_nm_s) == tuned.tunings
    # and r_b is the candidate whose worst separation is the largest
    worst = {rate: min(values) for rate, values in tuned.separations.items() if values}
    assert max(worst, key=worst.__getitem__) == f"{tuned.residual_rate_nm_s:g}"
    assert set(tuned.separations) == {f"{rate:g}" for rate in study_run.study.tuning.residual_rate_nm_s}


def test_a_tuning_lies_between_what_wanted_and_unwanted_cases_need():
    needs = {Case(90.0, 0.3, 0.0): Need(0.01, 0.05), Case(90.0, 0.3, 1.0): Need(9.0, 9.0)}
    needs |= {Case(90.0, 0.3, 2.0): Need(0.04, 0.01), Case(90.0, 0.3, -2.0): Need(0.005, 0.8)}
    found = separate(needs, (0.0, 0.0), 2.0)
    assert found is not None
    assert (found.configuration_rad, found.velocity_rad_s, found.separation) == (0.02, 0.1, 4.0)
    needs[Case(90.0, 0.3, 2.0)] = Need(0.009, 0.04)  # needs less than a wanted one
    assert separate(needs, (0.0, 0.0), 2.0) is None


@pytest.mark.long
def test_a_case_is_the_same_again_and_unseen_by_the_tuning_where_it_says_so(study_run):
    cases = [Case(76.0, 0.3, deg) for deg in (-4.0, 0.0, 3.0)]
    first = run_cases(study_run, cases)
    assert [row["tuned_on"] for row in first] == [False] * 3
    assert run_cases(study_run, [Case(90.0, 0.3, 2.0)])[0]["tuned_on"]
    ours = ("cpu_s", "worker")
    again = run_cases(study_run, cases[2:])[0]
    assert {k: v for k, v in again.items() if k not in ours} == {k: v for k, v in first[2].items() if k not in ours}


@pytest.mark.long
def test_a_surface_that_is_inclined_is_hit_by_one_corner_first_and_by_both_in_the_end(study_run):
    study = study_run.study
    plan = plan_case(study, 90.0, 0.3)
    for deg, corner in ((-4.0, 0), (4.0, 1)):
        forces = simulate_case(study, plan, Case(90.0, 0.3, deg), 1000.0).ticks["forces"]
        first = (forces > 0.0).argmax(axis=0)
        assert first[corner] + 20 < first[1 - corner]
        # in the end the push presses; the orientation's stiffness shares it unevenly
        assert forces[-1].sum() == pytest.approx(study.task.push_n, rel=0.05)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("speed_m_s = 0.25", "speed_m_s = 0", "key task.speed_m_s: "),
        ('kind = "aim-aware-planar"', 'kind = "other"', "key kind: expected 'aim-aware-planar', found 'other'"),
        ("gravity_m_s2 = 9.81", "gravity_m_s2 = 9.81\nwind = 1", "key arm.wind: "),
        ("last = 120.0, step = 10.0", "last = 121.0, step = 10.1666", "key coarse: .* is not a point of the grid"),
        ("push_n = 60.0", "push_n = 61.0", "was found for another"),
        ('name = "aim-aware-planar"', 'name = "mine"', "no tuning for mine exists: find it with `python -m"),
        ('name = "aim-aware-planar"', 'name = "../mine"', "key name: "),
        ("whole = [25, 33]", "whole = [0]", "key contacts.whole: give numbers from 1 to 36"),
        ('judge = "alike"', 'judge = "nobody"', r"key claims.10.judge: unknown 'nobody': choose one of alike, "),
        ('at = "c"', 'at = "d"', r"key claims.6.at: unknown 'd': choose one of a, b, c"),
    ],
)
def test_a_study_that_cannot_be_run_is_one_line(tmp_path, study_text, old, new, said):
    assert old in study_text
    path = tmp_path / "mine.toml"
    path.write_text(study_text.replace(old, new))
    with pytest.raises(ConfigurationError, match=said) as error:
        load_run(path, quick=False)
    assert "\n" not in str(error.value)


def test_bad_input_writes_nothing(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["rtstack", "campaign", "aim-aware-planar", "--out", str(out), "--resume"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "nothing to resume" in capsys.readouterr().err
    assert not out.exists()


def test_the_grid_is_the_papers(study):
    assert study.grid.size() == 7161
    assert study.coarse.size() == 231


def test_a_comment_asks_for_no_new_tuning(tmp_path, study_text):
    path = tmp_path / "study.toml"
    path.write_text(f"# said in other words\n{study_text}")
    assert load_run(path, quick=True).size() > 0
