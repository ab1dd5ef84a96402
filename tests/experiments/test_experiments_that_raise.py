"""What is wrong with an experiment of another author, and which version of it a campaign's rows are of."""

import re

import pytest

from rtstack.experiments.experiment import Request
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.registry import KINDS, kind_named
from rtstack.experiments.store import Store
from tests.support.counting import PLAN

PLUG_IN = """
from dataclasses import dataclass

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, load_toml
from rtstack.experiments.experiment import Experiment, Task
from rtstack.experiments.report import Report, Section


@checked(frozen=True, slots=True, config=STRICT)
class Plan:
    kind: str
    name: str
    title: str
    numbers: tuple[int, ...]
    controllers: tuple[str, ...] = ()
    quick: bool = False

    def size(self):
        return len(self.numbers)


@dataclass(frozen=True, slots=True)
class Case:
    id: str


def without(case):  # here: without
    return [{"id": case.id}]


def fails(case):
    return [{"id": case.id, "number": 1 / 0}]  # here: fails


def none(case):  # here: none
    return None


def text(case):  # here: text
    return [{"id": case.id, "number": object()}]


class Good(Experiment[Plan, Case]):
    function = staticmethod(lambda case: [{"id": case.id, "number": 1}])

    def __init__(self, specification, request):
        super().__init__(specification, request, {"number": int})

    @classmethod
    def read(cls, path, quick):
        return load_toml(path, Plan)

    def cases(self, rows):
        return [Case("a")]

    def tasks(self, cases):
        return [Task(case.id, self.function, (case,), (case,)) for case in cases]

    def report(self, results):
        return Report([Section("all")])


class Without(Good):
    function = staticmethod(without)


class Fails(Good):
    function = staticmethod(fails)


class ReturnsNone(Good):
    function = staticmethod(none)


class Text(Good):
    function = staticmethod(text)


class FailsToRead(Good):
    @classmethod
    def read(cls, path, quick):
        raise ValueError("my own bug")  # here: read


class FailsToReport(Good):
    def report(self, results):
        return {}["rows"]  # here: report
"""
WRONG = {
    "Without": ("a could not be run: a row cannot be kept: TypeError: there is no number", "without", 1),
    "Fails": ("a could not be run: ZeroDivisionError: division by zero", "fails", 1),
    "ReturnsNone": ("a could not be run: TypeError: a task returned a NoneType, not a list of rows", "none", 1),
    "Text": ("a could not be run: a row cannot be kept: TypeError: Error binding parameter", "text", 1),
    "FailsToRead": ("cannot be run: ValueError: my own bug", "read", 2),
    "FailsToReport": ("KeyError: 'rows'", "report", 1),
}


@pytest.fixture
def installed(install, monkeypatch, tmp_path):
    """Install the plug-in, for workers, too."""
    install("wrong_kinds", PLUG_IN, KINDS.group, wrong_Good="Good", **{f"wrong_{name}": name for name in WRONG})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "installed" / "wrong_kinds"))


def plan(tmp_path, name, more=""):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.replace('kind = "counting"', f'kind = "wrong_{name}"') + more)
    return path


@pytest.mark.parametrize("name", WRONG)
def test_a_kind_names_its_package_file_and_line(installed, tmp_path, command_line, name) -> None:
    line, at, status = WRONG[name]
    number = next(k for k, text in enumerate(PLUG_IN.splitlines(), 1) if text.endswith(f"# here: {at}"))
    done = command_line("campaign", plan(tmp_path, name), "--out", tmp_path / "out", "--workers", 1)
    found = rf"{re.escape(line)}.* \(wrong_kinds 1\.2, wrong_kinds\.py:{number}\); mend it there, or uninstall"
    assert re.search(found, done.stderr), done.stderr
    assert done.returncode == status
    assert "internal error" not in done.stderr
    assert (tmp_path / "out").exists() == (status != 2)


def test_a_kind_without_a_time_of_the_robot_says_none(installed, tmp_path, command_line) -> None:
    done = command_line("campaign", plan(tmp_path, "Good"), "--out", tmp_path / "out", "--workers", 1)
    assert done.returncode == 0
    assert re.search(r"^1 trials in \d+ s with 1 workers$", done.stdout, re.M), done.stdout


def opened(tmp_path, more=""):
    path = plan(tmp_path, "Good", more)
    kind = kind_named("wrong_Good")
    return kind(kind.read(path, False), Request(PlanFile(path, "c"), tmp_path / "out"))


def test_the_digest_has_the_versions_of_the_kinds_and_the_controllers_packages(install, installed, tmp_path) -> None:
    alone, with_law = opened(tmp_path), 'controllers = ["proposed", "other_law"]\n'
    install("other_package", "law = print", "rtstack.controllers", other_law="law")
    assert opened(tmp_path).digest == alone.digest  # a plan that does not name it
    named = opened(tmp_path, with_law).digest
    metadata = tmp_path / "installed" / "other_package" / "other_package-1.2.dist-info" / "METADATA"
    metadata.write_text(metadata.read_text().replace("1.2", "1.3"))
    install("third", "", "rtstack.controllers", third="law")  # which has the metadata read anew
    assert opened(tmp_path, with_law).digest != named
    assert opened(tmp_path).digest == alone.digest


def test_a_row_of_ours_without_a_column_is_no_plug_ins_mistake(tmp_path) -> None:
    with Store(tmp_path, {"number": int}) as store, pytest.raises(TypeError, match="there is no number"):
        store.add({"id": "a", "git_commit": "c", "digest": "d", "wall_s": 1.5, "worker": "w"})
