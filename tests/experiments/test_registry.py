"""Kinds of experiments by entry points: ours come by the same door, and a broken one is a line."""

import sys

import pytest

from hal import extensions
from rtstack.experiments.experiment import Experiment
from rtstack.experiments.registry import KINDS, installed_plans, kind_named, kind_of, plan_file, plan_paths
from rtstack.trials.errors import TrialError
from tests.support.counting import PLAN

OURS = {"reference-spreading", "impact-map-validation", "aim-aware-planar", "aim-aware-arm", "aim-aware-grab"}


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """Install a package of three kinds: one that works and brings a plan, and three that do not."""
    (tmp_path / "counting_plugin.py").write_text(
        "from pathlib import Path\nfrom tests.support.counting import CountingExperiment\n"
        "class Counting(CountingExperiment):\n    @classmethod\n    def plans(cls):\n"
        f"        return {{'counting': Path({str(tmp_path / 'counting.toml')!r})}}\n"
    )
    information = tmp_path / "counting_plugin-1.2.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: counting-plugin\nVersion: 1.2\n")
    (information / "entry_points.txt").write_text(
        "[rtstack.experiments]\ncounting = counting_plugin:Counting\nbroken = counting_plugin:Missing\n"
        "strange = pathlib:Path\nunfinished = rtstack.experiments.experiment:Experiment\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "counting.toml").write_text(PLAN)
    caches = (installed_plans, extensions._offered)
    for cached in caches:
        cached.cache_clear()
    yield tmp_path
    for cached in caches:
        cached.cache_clear()
    sys.modules.pop("counting_plugin", None)


def test_every_plan_of_ours_is_read_by_its_kind_and_has_a_sample():
    assert set(KINDS.names()) >= OURS
    for name, path in plan_paths().items():
        kind = kind_named(kind_of(path))
        assert issubclass(kind, Experiment)
        whole, sample = kind.read(path, False), kind.read(path, True)
        assert (whole.name, whole.quick, sample.quick) == (name, False, True)
        assert 0 < sample.size() < whole.size()
        assert whole.title


def test_an_unknown_campaign_names_the_known_ones():
    with pytest.raises(TrialError, match=r"unknown campaign 'nope': there are .*reference-spreading"):
        plan_file("nope")


def test_a_kind_that_lacks_a_method_is_refused_before_anything_runs(plugin):
    with pytest.raises(
        TrialError,
        match="'unfinished': Experiment does not define cases, on_cell and row_of_log, or tasks, read, report",
    ):
        kind_named("unfinished")


def test_an_unknown_kind_names_the_known_ones(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text('kind = "nope"\n')
    with pytest.raises(TrialError, match=r"unknown kind of experiment 'nope': choose one of .*aim-aware-arm"):
        kind_named(kind_of(path))


def test_a_plug_in_brings_its_kind_and_its_plan_and_a_broken_one_is_a_line(plugin, capsys):
    file = plan_file("counting")
    assert file.path == plugin / "counting.toml"
    kind = kind_named(kind_of(file.path))
    assert (kind.__name__, kind.read(file.path, False).size()) == ("Counting", 3)
    broken, strange, _unfinished = capsys.readouterr().err.splitlines()
    assert broken.startswith("rtstack: warning: kind of experiment 'broken': counting_plugin:Missing of ")
    assert "cannot be loaded: AttributeError" in broken
    assert strange.startswith("rtstack: warning: kind of experiment 'strange': Path is no subclass of")
    assert "reference-spreading" in plan_paths()
