"""A stack whose arms are Pandas: a demonstration and a trial by the page's own orders, at the pace of a real robot."""

from contextlib import closing
from pathlib import Path

import pytest

from hal.robots import FER
from rtstack.log.reader import read_log
from rtstack.trials.review import review_log
from tests.support.console.stack import Stack, Viewer
from tests.support.robot_files import cell_of

pytestmark = pytest.mark.alone


@pytest.mark.parametrize(
    "kind", [pytest.param("direct", marks=pytest.mark.long), pytest.param("realtime", marks=pytest.mark.realtime)]
)
def test_pandas_are_demonstrated_and_tried_from_the_page(kind: str, tmp_path: Path) -> None:
    stack = Stack(tmp_path / "logs", ["--cell-kind", kind, "--cell-file", str(cell_of(tmp_path))])
    try:
        with closing(Viewer(stack, answers=True)):
            stack.post("take", operator="anna")
            stack.post("arm")
            recording = stack.run("jobs/demonstration", object="rice_box")
            reference = stack.log_id(recording)
            trial = stack.run("jobs/trial", reference=reference, object="rice_box", displacement_mm=-20)
    finally:
        left_behind = stack.end()
    assert left_behind == []
    for name in (recording, trial):
        log = read_log(stack.logs / name)
        assert log.metadata["result"]["success"] == "true", log.metadata["result"]["failure_reason"]
        assert log.metadata["result"]["safety_interventions"] == "0"
        assert [a.name for a in log.attachments if a.name.endswith(".urdf")] == [f"{FER.name}.urdf"]
    score = review_log(stack.logs / trial).score
    assert score is not None
    assert score.held
