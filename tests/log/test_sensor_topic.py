"""A topic of another package: it is in the log, its reader, the review's curves and table, and the log's page."""

import json
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from hal.topic import Message, Topic
from rtstack.topics import TOPICS, topic_table

DECLARED = """
from hal.base.record import WRENCH, Field
from hal.topic import Message, Topic

SAMPLE = Message(
    "rtstack.WrenchSample",
    "What a force and torque sensor at the wrist measures.",
    (
        Field("wrench_measured", "Wrench in the sensor's frame: force N, torque Nm.", "N, Nm", WRENCH, "sensor"),
        Field("temperature", "Temperature of the sensor, {unit}.", "degC"),
        Field("overload", "Channels that are beyond their range.", bits=WRENCH, plotted=False),
    ),
)
TOPIC = Topic("/left/wrench_sensor", SAMPLE, 500)
"""
RUN = """
import json, sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from console.review.columns import LogColumns
from console.review.conversion import convert
from console.review.series import Tabled, csv_lines
from rtstack.log.analysis.signals import signals
from docs.generate.log_topics import log_messages, topic_table
from rtstack.cells import default_cell_file, load_description
from rtstack.log.reader import read_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import RunSamples, open_log
from rtstack.trials.specification import DemonstrationSpecification
from sim_robot.cell import simulated_cell

folder = Path(sys.argv[1])


class Wrist:
    topic = "/left/wrench_sensor"

    def __init__(self, states):
        self.states, self.calls = states, 0

    def read(self, sample):
        self.calls += 1
        t_ns = int(self.states["t_ns"][0])
        if self.calls > 5 and t_ns % 2_000_000 == 0:  # it takes a while to start, and measures at 500 Hz
            sample["t_ns"] = t_ns
            sample["wrench_measured"] = self.states["O_F_ext_hat_K"][0]
            sample["temperature"] = 25.0 + self.calls
            sample["overload"] = 0b101 if t_ns == 100_000_000 else 0


class After:
    def __init__(self, ticks):
        self.left = ticks

    @property
    def stop_requested(self):
        self.left -= 1
        return self.left < 0


specification = DemonstrationSpecification("rice_box")
description, source = load_description(None)


def run(log):
    simulated = simulated_cell("rice_box", 0.0, 0)
    cell = replace(simulated.as_cell("direct"), sensors=(Wrist(simulated.states),))
    run_demonstration(specification, description, cell, RunContext(log, stop=After(300)))
    cell.close()


path = folder / "wrist.mcap"
run(open_log(path, specification, description, "direct", source))
kept = RunSamples(path)
run(kept)
log = read_log(path)
records = log.topic("/left/wrench_sensor")
arm = log.topic("/left/arm")
columns = folder / "columns"
columns.mkdir()
index = convert(log, columns)
wanted = [one for one in signals().values() if one.topic == "/left/wrench_sensor"]
print(json.dumps({
    "t_ns": records["t_ns"].tolist(), "ticks": len(arm), "temperature": records["temperature"].tolist(),
    "overload": records["overload"].tolist(),
    "kept": kept.history.batches()["/left/wrench_sensor"].tobytes() == records.tobytes(),
    "as the arm": bool(np.array_equal(
        records["wrench_measured"],
        arm["O_F_ext_hat_K"][np.searchsorted(arm["t_ns"], records["t_ns"])])),
    "tree": [[one.name, one.unit] for one in wanted],
    "csv": list(csv_lines([Tabled(LogColumns(columns, index))], wanted, 0.0, 1.0))[0].strip(),
    "rows": len(list(csv_lines([Tabled(LogColumns(columns, index))], wanted, 0.0, 1.0))[1].splitlines()),
    "page": topic_table() + log_messages(),
}))
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What a run with the package installed leaves behind, told by the process that made it."""
    folder = tmp_path_factory.mktemp("wrist")
    (folder / "wrist.py").write_text(DECLARED)
    metadata = folder / "wrist-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: wrist\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[rtstack.topics]\nwrist = wrist:TOPIC\n")
    root = Path(__file__).parents[2]
    ended = subprocess.run(
        [sys.executable, "-c", RUN, folder], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(root)])},
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    return {**json.loads(ended.stdout), "path": str(folder / "wrist.mcap")}


def test_each_sample_is_in_the_log_once_as_it_was_measured(found: dict) -> None:
    t_ns = found["t_ns"]
    assert len(t_ns) == len(set(t_ns))
    assert t_ns == sorted(t_ns)
    assert {later - earlier for earlier, later in pairwise(t_ns)} == {2_000_000}
    assert abs(2 * len(t_ns) - (found["ticks"] - 5)) <= 2
    assert found["as the arm"]
    assert found["overload"].count(0b101) == 1
    assert found["overload"][t_ns.index(100_000_000)] == 0b101
    assert found["overload"].count(5) == 1 or found["overload"].count(5) == 0
    assert found["kept"], "the history of a run without a log process has the same bytes"


def test_the_review_has_its_curves_and_its_table(found: dict) -> None:
    units = {"fx": "N", "fy": "N", "fz": "N", "mx": "Nm", "my": "Nm", "mz": "Nm"}
    wrench = [[f"left.wrench_measured.{axis}", unit] for axis, unit in units.items()]
    assert found["tree"] == [*wrench, ["left.temperature", "degC"]]
    assert found["csv"] == ",".join(["t_s", "utc", *(name for name, _ in found["tree"])])
    assert found["rows"] == len(found["t_ns"])


def test_the_logs_page_describes_it(found: dict) -> None:
    row = "| `/left/wrench_sensor` | [`rtstack.WrenchSample`](#rtstackwrenchsample) | 500 Hz |"
    assert row in found["page"]
    assert "| `wrench_measured` | double[6] | N, Nm | sensor | Wrench in the sensor's frame" in found["page"]
    assert "| `overload` | string[] |" in found["page"]


def test_a_reader_that_does_not_know_it_reads_the_rest(found: dict) -> None:
    from rtstack.log.reader import read_log

    log = read_log(Path(found["path"]))
    assert "/left/wrench_sensor" in log.topics
    assert len(log.topic("/left/arm")) == found["ticks"]


@pytest.mark.parametrize(
    ("name", "schema", "line"),
    [
        ("humid", "rtstack.HumiditySample", "topic 'humid': expected a name as /GROUP/NAME"),
        ("/lab/humid", "labkit.Humidity", "topic /lab/humid: schema 'labkit.Humidity': expected rtstack.NAME"),
        ("/lab/humid", "rtstack.ArmSample", "/lab/humid: schema rtstack.ArmSample is another topic's: rename one"),
        ("/lab/humid", "foxglove.Grid", "/lab/humid: schema foxglove.Grid: expected rtstack.NAME"),
    ],
)
def test_a_topic_that_the_log_has_no_place_for_is_refused_in_a_line(name, schema, line):
    with pytest.raises(ValueError, match=f"^{re.escape(line)}"):
        topic_table([*TOPICS.values(), Topic(name, Message(schema, "Humidity.", ()), 10)])
