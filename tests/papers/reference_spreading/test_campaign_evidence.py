"""What a campaign leaves: logs like any trial's, from which its numbers follow without our code, and one page."""

import csv
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from rtstack.campaign.plan import load_plan, plan_file
from rtstack.campaign.trial_log import WholeRunLog
from rtstack.cli.campaign_cell import open_conditioned_cell
from rtstack.cli.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.samples import Mode
from rtstack.topics import TOPICS
from rtstack.trials.company import Company
from rtstack.trials.record import frames, open_log
from rtstack.trials.specification import Controller, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial


@pytest.fixture
def rows(finished):
    with (finished.out / "results.csv").open() as file:
        return list(csv.DictReader(file))


def test_every_row_names_its_log_seed_commit_and_parameters(finished, rows):
    assert len(rows) == 5
    for row in rows:
        log = read_log(finished.out / row["log"])
        assert log.metadata["campaign"]["id"] == row["id"]
        assert log.metadata["campaign"]["digest"] == row["digest"]
        assert log.metadata["trial"]["git_commit"] == row["git_commit"]
        assert json.loads(log.metadata["trial"]["specification"])["seed"] == int(row["seed"])
        assert log.metadata["result"]["success"] == row["success"].lower()


def test_the_force_norm_and_the_lift_follow_from_the_log_without_our_code(finished, rows):
    for row in rows:
        wrench, height = {}, []
        with (finished.out / row["log"]).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            about = {record.name: record.metadata for record in reader.iter_metadata()}
            for _, channel, message, decoded in reader.iter_decoded_messages():
                if channel.topic.endswith("/control"):
                    wrench.setdefault(message.log_time, []).append((decoded.mode, list(decoded.wrench_desired)))
                elif channel.topic == "/object/pose":
                    height.append(decoded.pose.position.z)
        times = sorted(wrench)
        from_impact_s = (np.array(times) - times[0]) * 1e-9 - float(about["trial"]["nominal_impact_s"])
        norms = [
            np.linalg.norm([w for _, both in wrench[t] for w in [both]])
            for t, near in zip(times, np.abs(from_impact_s) <= 0.1 + 1e-9, strict=True)
            if near and wrench[t][0][0] != Mode.STOPPING
        ]
        assert np.mean(norms) == pytest.approx(float(row["average_force_norm"]), rel=1e-12)
        lift_mm = 1e3 * (max(height) - np.median(height[:20]))
        assert lift_mm == pytest.approx(float(row["max_lift_mm"]), rel=1e-12)


def test_the_log_is_the_one_that_the_log_process_writes(finished, command, cell, rows, tmp_path):
    row = next(row for row in rows if row["controller"] == "proposed")
    plan = load_plan(command.plan)
    reference = finished.out / "references" / "rice_box-0.mcap"
    specification = TrialSpecification(
        str(reference), Controller.PROPOSED, row["object"], float(row["displacement_mm"]), int(row["seed"])
    )
    prepared = prepare_trial(specification, cell)
    path = tmp_path / "trial.mcap"
    log = open_log(path, specification, cell, "direct", default_cell_file(), reference=prepared.reference)
    opened = open_conditioned_cell(
        row["object"], 1e-3 * specification.displacement_mm, specification.seed, plan.conditions["nominal"]
    )
    assert run_trial(prepared, opened, Company(log), criterion=plan.criterion).success
    opened.close()
    theirs, ours = read_log(path), read_log(finished.out / row["log"])
    assert ours.topics == theirs.topics
    for topic in TOPICS:
        if topic != "/timing":
            assert ours.topic(topic).tobytes() == theirs.topic(topic).tobytes(), topic
    assert ours.messages("/tf") == theirs.messages("/tf")
    assert {a.name for a in ours.attachments} == {a.name for a in theirs.attachments}
    assert ours.metadata.keys() == theirs.metadata.keys() | {"campaign"}
    assert ours.metadata["log"] == theirs.metadata["log"]


def test_a_trial_that_the_judge_ends_leaves_its_evidence_in_the_log(finished, cell, tmp_path):
    reference = finished.out / "references" / "rice_box-0.mcap"
    specification = TrialSpecification(str(reference), safety=(("dq_max", (0.2,) * 7),))
    prepared = prepare_trial(specification, cell)
    log = WholeRunLog(tmp_path / "faulted.mcap", {}, [], frames(cell, specification.object))
    opened = open_conditioned_cell(
        specification.object, 0.0, 1, load_plan(plan_file("reference-spreading").path).conditions["nominal"]
    )
    try:
        assert not run_trial(prepared, opened, Company(log)).success
    finally:
        opened.close()
    left = read_log(log.path)
    assert left.metadata["fault"]["end"] == End.SAFETY
    assert "faster than its position allows" in left.metadata["fault"]["detail"]
    assert "last_second.npz" in {attachment.name for attachment in left.attachments}


class _Sources(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources = []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href", "action")]


def test_the_page_needs_nothing_else(finished):
    text = (finished.out / "report.html").read_text()
    page = _Sources()
    page.feed(text)
    assert len(page.sources) == 4  # figures 5, 8 and 10, and ours: there is no figure 11 in it
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert "url(" not in text
    assert "<script" not in text
    assert {path.name for path in (finished.out / "figures").iterdir()} == {
        "beyond.png",
        *(f"figure{n}.png" for n in (5, 8, 10)),
    }
    assert re.search(r"no velocity feedback has the fewest successful grabs", text)
    assert "cannot be told" in text or "holds" in text
    assert "mean force norm: cannot be told with the object displaced." in text
