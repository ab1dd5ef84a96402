"""The folder of a campaign: results come back as they went in, and nobody else's folder is touched."""

import csv

import pytest

from rtstack.campaign.plan import load_plan, plan_file
from rtstack.campaign.store import COLUMNS, OF_THE_HOST, RESULTS, TIMES, Store, check_folder
from rtstack.trials.errors import TrialError


@pytest.fixture
def file():
    return plan_file("reference-spreading")


@pytest.fixture
def plan(file):
    return load_plan(file.path).sealed([b"cell"])


def some_row(plan):
    trial = plan.trials(plan.experiments[0])[0]
    values = dict.fromkeys(COLUMNS) | {name: getattr(trial, name) for name in trial.__slots__}
    return values | {"id": trial.id, "success": False, "average_force_norm": 0.1 + 0.2, "ticks": 5364, "wall_s": 1.5}


def test_a_result_comes_back_to_the_bit(tmp_path, plan):
    row = some_row(plan)
    with Store(tmp_path) as store:
        store.add(row)
        store.add(row)
        assert store.rows() == [row]
        store.write_csv(store.rows())
    (result,) = csv.DictReader((tmp_path / RESULTS).read_text().splitlines())
    assert float(result["average_force_norm"]) == 0.1 + 0.2
    assert not set(OF_THE_HOST) & result.keys()
    (times,) = csv.DictReader((tmp_path / TIMES).read_text().splitlines())
    assert times["id"] == result["id"]
    assert float(times["wall_s"]) == 1.5


def test_one_program_at_a_time(tmp_path):
    with Store(tmp_path), pytest.raises(TrialError, match="another campaign is running"):
        Store(tmp_path)
    Store(tmp_path).close()


def test_what_a_folder_may_be(tmp_path, plan, file):
    check_folder(tmp_path / "new", plan, resume=False)
    with pytest.raises(TrialError, match="nothing to resume"):
        check_folder(tmp_path / "new", plan, resume=True)
    with pytest.raises(TrialError, match="does not exist"):
        check_folder(tmp_path / "no" / "new", plan, resume=False)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(TrialError, match="is not a folder"):
        check_folder(tmp_path / "file", plan, resume=False)
    with pytest.raises(TrialError, match="is not empty"):
        check_folder(tmp_path, plan, resume=False)
    out = tmp_path / "out"
    out.mkdir()
    with Store(out) as store:
        store.claim(plan, file)
    check_folder(out, plan, resume=True)
    with pytest.raises(TrialError, match="go on with --resume"):
        check_folder(out, plan, resume=False)
    with pytest.raises(TrialError, match="has another campaign, reference-spreading:"):
        check_folder(out, plan.as_sample(), resume=True)
    with pytest.raises(TrialError, match="with other parameters"):
        check_folder(out, plan.sealed([b"another cell"]), resume=True)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "campaign.sqlite").write_bytes(b"no database at all" * 100)
    with pytest.raises(TrialError, match="cannot be read"):
        check_folder(tmp_path / "broken", plan, resume=True)
