"""Where a campaign's results are kept, and which folder may be whose."""

import csv
import re
from types import SimpleNamespace

import pytest

from rtstack.experiments import store as store_module
from rtstack.experiments import version
from rtstack.experiments.experiment import Request
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.report import registered
from rtstack.experiments.store import OF_THE_HOST, RESULTS, TIMES, Store, check_folder
from rtstack.trials.errors import TrialError
from tests.support.counting import PLAN, CountingExperiment

COLUMNS = {"value": float, "fine": bool, "ticks": int | None}


@pytest.fixture
def counting(tmp_path):
    """Give the counting experiment of a plan's text, in a folder."""

    def opened(out, text=PLAN, logs=None):
        path = tmp_path / "counting-plan.toml"
        path.write_text(text)
        request = Request(PlanFile(path, "c"), out, logs)
        return CountingExperiment(CountingExperiment.read(path, False), request)

    return opened


def test_a_result_comes_back_to_the_bit(tmp_path):
    row = {"id": "a", "value": 0.1 + 0.2, "fine": False, "ticks": None}
    row |= {"git_commit": "c", "digest": "d", "wall_s": 1.5, "worker": "w"}
    with Store(tmp_path, COLUMNS) as store:
        store.add(row)
        store.add(row)
        assert store.rows() == [row]
        store.write_csv(store.rows())
    (result,) = csv.DictReader((tmp_path / RESULTS).read_text().splitlines())
    assert float(result["value"]) == 0.1 + 0.2
    assert not set(OF_THE_HOST) & result.keys()
    (times,) = csv.DictReader((tmp_path / TIMES).read_text().splitlines())
    assert times["id"] == result["id"]
    assert float(times["wall_s"]) == 1.5


def test_one_program_at_a_time(tmp_path):
    with Store(tmp_path, COLUMNS), pytest.raises(TrialError, match="another campaign is running"):
        Store(tmp_path, COLUMNS)
    with Store(tmp_path, COLUMNS):
        pass


def test_what_a_folder_may_be(tmp_path, counting):
    check_folder(counting(tmp_path / "new"), resume=False)
    with pytest.raises(TrialError, match="nothing to resume"):
        check_folder(counting(tmp_path / "new"), resume=True)
    with pytest.raises(TrialError, match="does not exist"):
        check_folder(counting(tmp_path / "no" / "new"), resume=False)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(TrialError, match="is not a folder"):
        check_folder(counting(tmp_path / "file"), resume=False)
    with pytest.raises(TrialError, match="is not empty"):
        check_folder(counting(tmp_path), resume=False)
    out = tmp_path / "out"
    out.mkdir()
    begun = counting(out)
    with Store(out, begun.columns) as store:
        store.claim(begun)
    check_folder(begun, resume=True)
    with pytest.raises(TrialError, match="go on with --resume"):
        check_folder(begun, resume=False)
    with pytest.raises(TrialError, match="keeps its logs in"):
        check_folder(counting(out, logs="s3://elsewhere/x"), resume=True)
    other = PLAN.replace('name = "counting"', 'name = "other"')
    with pytest.raises(TrialError, match="has another campaign, counting:"):
        check_folder(counting(out, other), resume=True)
    with pytest.raises(TrialError, match="with other parameters"):
        check_folder(counting(out, PLAN.replace("3]", "4]")), resume=True)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "campaign.sqlite").write_bytes(b"no database at all" * 100)
    with pytest.raises(TrialError, match="cannot be read"):
        check_folder(counting(tmp_path / "broken"), resume=True)


def test_a_resume_with_another_version_or_another_plug_in_is_marked(tmp_path, counting, monkeypatch, capsys):
    begun = counting(tmp_path / "out")
    (tmp_path / "out").mkdir()
    plug_in = tmp_path / "site" / "some_lab"
    plug_in.mkdir(parents=True)
    (plug_in / "__init__.py").write_text("GAIN = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path / "site")
    offered_in(monkeypatch, {"rtstack.trackers": "some_lab.law"})
    monkeypatch.setattr(store_module, "present", version.present.__wrapped__)
    for k, said in enumerate(["", "", "another version", "another version"]):
        if k == 2:
            (plug_in / "__init__.py").write_text("GAIN = 2.0\n")
        with Store(tmp_path / "out", begun.columns) as store:
            store.claim(begun)
            found = registered(begun, store)["versions"]
        assert said in capsys.readouterr().err
        assert len(found) == (k >= 2)
    assert re.match(r"some-lab 1\.0 \(code \w{16}\) instead of 1\.0 \(code \w{16}\)", found[0])


def offered_in(monkeypatch: pytest.MonkeyPatch, modules: dict[str, str]) -> None:
    dist = SimpleNamespace(name="some-lab", version="1.0")
    offered = {group: [SimpleNamespace(group=group, module=name, dist=dist)] for group, name in modules.items()}
    monkeypatch.setattr(
        version, "entry_points", lambda group=None: SimpleNamespace(groups=offered) if group is None else offered[group]
    )


@pytest.mark.parametrize("group", ["trackers", "cameras", "policies", "robots", "cells", "controllers", "experiments"])
@pytest.mark.parametrize("file", ["some_law.py", "some_law/__init__.py", "some_law/gains.toml"])
def test_the_results_of_other_code_of_a_plug_in_are_not_resumed(tmp_path, counting, monkeypatch, group, file):
    begun, site = counting(tmp_path / "out"), tmp_path / "site"
    (tmp_path / "out").mkdir()
    (site / file).parent.mkdir(parents=True, exist_ok=True)
    (site / file).with_name("__init__.py" if "/" in file else "some_law.py").write_text("")
    (site / file).write_text("gain = 1.0\n")
    monkeypatch.syspath_prepend(site)
    offered_in(monkeypatch, {f"rtstack.{group}": "some_law"})
    monkeypatch.setattr(store_module, "present", version.present.__wrapped__)
    with Store(tmp_path / "out", begun.columns) as store:
        store.claim(begun)
    check_folder(begun, resume=True)
    (site / file).write_text("gain = 2.0\n")
    told = r"was begun with the plug-in some-lab 1\.0 \(code \w+\) instead of 1\.0 \(code \w+\): .* begin anew"
    with pytest.raises(TrialError, match=told):
        check_folder(begun, resume=True)
    offered_in(monkeypatch, {})
    with pytest.raises(TrialError, match=r"some-lab 1\.0 \(code \w+\) instead of none: "):
        check_folder(begun, resume=True)
