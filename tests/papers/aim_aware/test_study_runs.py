"""The samples of both studies, run by the command line: the rows that this process computes, and a page."""

import csv
from pathlib import Path

import pytest

from rtstack.experiments.registry import plan_file
from rtstack.papers.aim_aware.arm.study import load_arm_run
from rtstack.papers.aim_aware.arm.worker import run_cases as hit
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.study import load_run
from rtstack.papers.aim_aware.worker import run_cases
from tests.support.campaigns import Command

COLUMNS = ("verdict_a", "reason_b", "margin_b")
PLANAR = (*COLUMNS, "margin_c", "impacts", "last_ms")
TABLE2 = ("Table 2", "0.12 rad", "Figure 8(b), plain reading", "Sign of the inclination")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "load", "compute", "columns", "pictures", "said"),
    [
        ("aim-aware-planar", load_run, run_cases, PLANAR, 4, ()),
        ("aim-aware-arm", load_arm_run, hit, COLUMNS, 2, TABLE2),
    ],
)
def test_the_sample_is_run_and_reported(tmp_path, name, load, compute, columns, pictures, said):
    study, out = load(plan_file(name).path, True), tmp_path / "out"
    done = Command(Path(name)).run(out, "--quick", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert f"{study.grid.size()} simulations" in done.stdout
    with open(out / "results.csv", encoding="utf-8") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    cases: list[Case] = list(study.grid.cases())
    assert set(rows) == {case.id for case in cases}
    for row in compute(study, cases[: len(study.grid.inclination_deg.values())]):
        for column in columns:
            assert rows[row["id"]][column] == ("" if row[column] is None else str(row[column])), column
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == pictures
    assert "http" not in page
    assert [words for words in said if words not in page] == []
    assert (out / "signals.npz").exists() or name != "aim-aware-planar"
