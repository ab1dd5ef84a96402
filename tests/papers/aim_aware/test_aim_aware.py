"""What is concluded from the verdicts, and that the committed tuning is what the coarse grid gives."""

import pytest

from hal.configuration import ConfigurationError
from rtstack.cli.app import main
from rtstack.experiments.claims import ClaimStatus
from rtstack.papers.aim_aware.bands import Bands, bands
from rtstack.papers.aim_aware.claims import judge
from rtstack.papers.aim_aware.classification import plan_case, simulate_case
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.study import load_run
from rtstack.papers.aim_aware.tuning import Need, find, separate
from rtstack.papers.aim_aware.worker import run_plan

DEGREES = [float(deg) for deg in range(-10, 11)]


def _rows(expected: dict[str, float], some: dict[str, float] | None = None, impulse_ns: float = 0.2):
    """Two cases an inclination: both expected up to `expected` degrees, one of them up to `some`."""
    rows = []
    for deg in DEGREES:
        for case in range(2):
            verdicts = {
                f"verdict_{name}": "expected"
                if abs(deg) <= (edge if case or not some else max(edge, some[name]))
                else "unexpected"
                for name, edge in expected.items()
            }
            rows.append({"inclination_deg": deg, "impulse_ns": impulse_ns} | verdicts)
    return rows


def test_bands_say_what_is_expected_always_sometimes_and_never():
    found = bands(_rows({"a": 2.0}, {"a": 4.0}), "a")
    assert found.always == (-2.0, 2.0)
    assert found.sometimes == ([-4.0, -3.0], [3.0, 4.0])
    assert found.never == (-5.0, 5.0)
    assert found.ambiguity_deg == (3.0, 3.0)
    assert found.shares[3.0] == 0.5
    assert Bands({-1.0: 1.0, 0.0: 0.9, 1.0: 1.0}, 3).always is None
    assert Bands({-1.0: 0.5, 0.0: 1.0, 1.0: 1.0}, 3).always == (0.0, 1.0)
    assert Bands({-1.0: 0.5, 0.0: 1.0, 1.0: 1.0}, 3).never == (None, None)


AS_THE_PAPER = {"a": 0.0, "b": 2.0, "c": 4.0}


@pytest.mark.parametrize(
    ("expected", "some", "differing"),
    [
        (AS_THE_PAPER, {"a": 1.0, "b": 3.0, "c": 5.0}, set()),
        (AS_THE_PAPER, None, set()),
        ({"a": 1.0, "b": 2.0, "c": 4.0}, None, set()),  # within a degree
        ({"a": 2.0, "b": 3.0, "c": 4.0}, None, {"0 deg is always"}),
        ({"a": 0.0, "b": 2.0, "c": 2.0}, None, {"-4 .. +4 deg are", "the sensitivity", "beyond, from 6"}),
        (AS_THE_PAPER, {"a": 2.0, "b": 5.0, "c": 6.0}, {"an area of", "beyond, from 4"}),
        (AS_THE_PAPER, {"a": 0.0, "b": 4.0, "c": 6.0}, {"the ambiguous area"}),
        (AS_THE_PAPER, {"a": 1.0, "b": 3.0, "c": 10.0}, {"an area of", "beyond, from 6", "the ambiguous area"}),
        ({"a": -1.0, "b": 2.0, "c": 4.0}, None, {"0 deg is always", "beyond, from 2"}),
    ],
)
def test_a_claim_holds_or_differs(study_run, expected, some, differing):
    claims = judge(study_run, _rows(expected, some))
    said = {claim.says for claim in claims if claim.verdict is ClaimStatus.DIFFERS}
    assert len(said) == len(differing)
    assert all(any(text.startswith(start) for start in differing) for text in said)
    assert len(claims) == 12


@pytest.mark.long
def test_the_committed_tuning_is_what_the_coarse_grid_gives(study_run):
    tuned = study_run.tuned
    assert find(study_run.study, tuned.residual_rate_nm_s) == tuned.tunings
    # and r_b is the candidate whose worst separation is the largest
    worst = {rate: min(values) for rate, values in tuned.separations.items() if values}
    assert max(worst, key=worst.__getitem__) == f"{tuned.residual_rate_nm_s:g}"
    assert set(tuned.separations) == {f"{rate:g}" for rate in study_run.study.tuning.residual_rate_nm_s}


def test_a_tuning_lies_between_what_wanted_and_unwanted_cases_need(study_run):
    search = study_run.study.tuning
    needs = {Case(90.0, 0.3, 0.0): Need(0.01, 0.05), Case(90.0, 0.3, 1.0): Need(9.0, 9.0)}
    needs |= {Case(90.0, 0.3, 2.0): Need(0.04, 0.01), Case(90.0, 0.3, -2.0): Need(0.005, 0.8)}
    found = separate(needs, (0.0, 0.0), search.ambiguity_deg)
    assert found is not None
    assert (found.configuration_rad, found.velocity_rad_s, found.separation) == (0.02, 0.1, 4.0)
    needs[Case(90.0, 0.3, 2.0)] = Need(0.009, 0.04)  # needs less than a wanted one
    assert separate(needs, (0.0, 0.0), search.ambiguity_deg) is None


def test_a_case_is_the_same_again_and_unseen_by_the_tuning_where_it_says_so(study_run):
    first = run_plan(study_run, 76.0, 0.3, (-4.0, 0.0, 3.0))
    assert [row["tuned_on"] for row in first] == [False] * 3
    assert run_plan(study_run, 90.0, 0.3, (2.0,))[0]["tuned_on"]
    ours = ("cpu_s", "worker")
    again = run_plan(study_run, 76.0, 0.3, (3.0,))[0]
    assert {k: v for k, v in again.items() if k not in ours} == {k: v for k, v in first[2].items() if k not in ours}


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
        ('kind = "aim-aware-planar"', 'kind = "other"', "key kind: there is 'aim-aware-planar', not 'other'"),
        ("gravity_m_s2 = 9.81", "gravity_m_s2 = 9.81\nwind = 1", "key arm.wind: "),
        ("last = 120.0, step = 10.0", "last = 121.0, step = 10.1666", "key coarse: .* is no point of the grid"),
        ("push_n = 60.0", "push_n = 61.0", "was found for another"),
        ('name = "aim-aware-planar"', 'name = "mine"', "there is no tuning for mine: find it with `python -m"),
        ('name = "aim-aware-planar"', 'name = "../mine"', "key name: "),
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
