"""What a trial ends in: its card against its log, and the means of the trials in the queue."""

import json
import shutil

import numpy as np
import pytest

from console.orders import TrialOrder
from console.queue.entry import Entry, EntryState
from console.routes.trials import Measure, means_of
from rtstack.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.log_folder.catalogue import Catalogue
from rtstack.log_folder.log_rows import Ending, LogRow
from rtstack.model.cell_description import base_frame, load_cell_description
from rtstack.samples import SIDES
from tests.support.console.review_log import write_log
from tests.support.console.served_console import serve_console


@pytest.fixture(scope="module")
def trials(tmp_path_factory, demonstration, runner):
    """A console with a real trial, and a log of one before that met the object elsewhere; and a client of it."""
    logs = tmp_path_factory.mktemp("trials")
    shutil.copy(demonstration.path, logs / demonstration.path.name)
    shifted = {"controller": "proposed", "object": "rice_box", "displacement_mm": "-40.0", "success": "true"}
    shifted |= {"impact_verdict": "unexpected", "impact_kind": "wrong place", "average_force_norm": "30.0"}
    write_log(logs / "trial0.mcap", {"kind": "trial"}, shifted)
    runner.run(seed=1, log=logs / "trial1.mcap")
    with serve_console(logs) as served, served.signed_in() as (client, _):
        yield client, {entry.path.stem: entry for entry in Catalogue(logs).entries()}, served


def test_a_card_has_the_verdict_three_numbers_of_the_log_and_the_order_that_it_was(trials):
    client, entries, _ = trials
    entry = entries["trial1"]
    card = client.get(f"/api/trials/{entry.id}/card").raise_for_status().json()
    assert (card["ending"], card["row"]["verdict"]) == ("success", "expected")
    assert card["sentence"].startswith("Held until release; the impact was the one that was meant.")
    assert (card["compared"], card["before"]) == (1, entries["trial0"].id)
    assert card["again"] == {
        "reference": entries["ref"].id, "object": "rice_box", "controller": "proposed", "displacement_mm": 0.0,
        "displacement_x_mm": 0.0, "yaw_deg": 0.0, "seed": 1, "reaction": "continue", "law_inertia": "M+B_theta",
        "shadow": False, "detector": "appendix_b",
    }  # fmt: skip

    log = read_log(entry.path)
    hit_s = float(log.metadata["result"]["detected_impact_time_s"])
    peaks, errors = [], []
    cell = load_cell_description(default_cell_file())
    for side, mounting in zip(SIDES, (cell.left, cell.right), strict=True):
        arm, control = log.topic(f"/{side}/arm"), log.topic(f"/{side}/control")
        since_s = (arm["t_ns"] - arm["t_ns"][0]) * 1e-9 - hit_s
        after = (since_s > -1e-6) & (since_s < 0.2 + 1e-6)
        peaks.append(
            np.linalg.norm(arm["O_F_ext_hat_K"][(since_s > -0.0201) & (since_s < 0.2 + 1e-6), :3], axis=1).max()
        )
        frame = base_frame(mounting)
        world = arm["O_T_EE"][:, :3, 3] @ frame.rotation.T + frame.translation
        errors.append(np.linalg.norm(world - control["pose_ref"][:, :3], axis=1)[after].max() * 1e3)
    peak, norm, error = card["numbers"]
    assert (peak["value"], error["value"]) == (
        pytest.approx(max(peaks), rel=1e-6),
        pytest.approx(max(errors), rel=1e-6),
    )
    assert norm["value"] == float(log.metadata["result"]["average_force_norm"])
    assert [number["before"] for number in card["numbers"]] == [[], [30.0], []]
    assert (norm["mean"], norm["spread"]) == (30.0, None)
    impact = card["impact"]
    assert len(impact["t_ms"]) == len(impact["left"]) == len(impact["right"]) <= 300
    assert max(max(impact["left"]), max(impact["right"])) == pytest.approx(max(peaks), abs=0.01)
    assert [mode for _, _, mode in impact["modes"]][:2] == ["ANTE_IMPACT", "INTERIM"]


def test_an_impact_that_was_not_meant_is_no_plain_success_anywhere(trials):
    client, entries, _ = trials
    entry = entries["trial0"]
    card = client.get(f"/api/trials/{entry.id}/card").raise_for_status().json()
    assert (card["row"]["success"], card["row"]["verdict"]) == (True, "unexpected")
    assert card["ending"] == card["row"]["ending"] == "unexpected impact"
    assert card["sentence"] == "The object was held, the impact was not as meant: probably wrong place."
    found = client.get("/api/logs", params={"outcome": "unexpected"}).json()
    assert [row["id"] for row in found] == [entry.id]


def test_only_a_trial_has_a_card_and_a_trial_whose_reference_has_gone_says_so(trials):
    client, entries, _ = trials
    for wrong in (entries["ref"].id, "0" * 32, "..%2Fetc"):
        answer = client.get(f"/api/trials/{wrong}/card")
        assert answer.status_code == 404
    write_log(
        entries["ref"].path.parent / "old.mcap",
        {"kind": "trial", "specification": json.dumps({"reference": "/gone/away.mcap", "controller": "proposed"})},
        {"success": "false", "failure_reason": "it slipped"},
    )
    old = next(row for row in client.get("/api/logs").json() if row["name"] == "old.mcap")
    card = client.get(f"/api/trials/{old['id']}/card").raise_for_status().json()
    assert (card["again"], card["refusal"]) == (None, "its reference away.mcap is not among the logs")
    assert (card["ending"], card["impact"]) == ("failure", None)
    entries["ref"].path.with_name("old.mcap").unlink()


def test_the_queues_means_are_those_of_its_trials_logs(trials):
    client, entries, served = trials
    rows = {row["name"]: row for row in client.get("/api/logs").json()}
    order = TrialOrder(entries["ref"].id, object="rice_box")
    served.parts.queue._entries = [
        Entry(str(number) * 16, order, "ref", state=EntryState.SUCCEEDED, log=entries[f"trial{number}"].id)
        for number in range(2)
    ]
    (line,) = client.get("/api/trials/means").raise_for_status().json()
    assert (line["trials"], line["successes"], line["unexpected"]) == (2, 2, 1)
    assert [point["displacement_mm"] for point in line["points"]] == [-40.0, 0.0]
    values = [rows[f"trial{number}.mcap"]["average_force_norm"] for number in range(2)]
    assert line["whole"]["mean"] == pytest.approx(np.mean(values))
    (line,) = client.get("/api/trials/means", params={"measure": "success"}).json()
    assert line["whole"]["mean"] == 1.0
    assert line["whole"]["low"] < 1.0


def _row(controller, shift, force, success: bool | None = True):
    return LogRow(
        id="", name="", kind="trial", controller=controller, object="rice_box", displacement_mm=shift, seed=0,
        success=success, outcome="", verdict=None, note=None, average_force_norm=force, max_lift_mm=None, when=0.0,
        size_bytes=0, recording=False, title="", decision=None, displacement_x_mm=0.0, yaw_deg=0.0,
        law_inertia=None, ending=Ending.SUCCESS if success else Ending.FAILURE, starred=False, tags=(),
    )  # fmt: skip


def test_means_are_by_controller_and_shift_with_students_interval():
    rows = [_row("a", 0.0, 10.0), _row("a", 0.0, 12.0), _row("b", 0.0, 20.0), _row("a", 10.0, 30.0, success=False)]
    first, second = means_of([*rows, _row("a", 0.0, None, success=None)], Measure.FORCE)
    assert (first.controller, first.trials, first.successes) == ("a", 3, 2)
    assert (first.points[0].mean, first.points[0].n) == (11.0, 2)
    # 12.706: the 97.5 % quantile of Student's t with one degree of freedom; sd 1.414, n 2
    assert first.points[0].high == pytest.approx(11.0 + 12.706, rel=1e-4)
    assert (first.points[1].mean, first.points[1].low) == (30.0, None)
    assert first.whole.mean == pytest.approx(20.5)  # each shift counts alike
    assert (second.controller, second.whole.mean, second.whole.low) == ("b", 20.0, None)


@pytest.mark.parametrize(
    ("reason", "aborted"),
    [
        ("stop requested by the operator: STOP of anna", True), ("the operator has gone: no sign for 4.88 s", True),
        ("the robot left torque control: right arm in reflex: joint_reflex", True),
        ("the tick takes longer than its period: 1.2 ms", True), ("the log is not being written", True),
        ("the object was not held until release", False), ("no impact was detected", False),
        ("safety stop: left arm: the end effector is too fast", False), ("the QP was not solved: left arm", False),
    ],
)  # fmt: skip
def test_what_an_operator_a_watchdog_or_a_robot_ended_counts_against_no_controller(trials, reason, aborted):
    client, entries, served = trials
    path = entries["ref"].path.with_name("ended.mcap")
    about = {"kind": "trial", "controller": "proposed", "object": "rice_box"}
    write_log(path, about, {"success": "false", "failure_reason": reason, "average_force_norm": "99.0"})
    row = next(row for row in client.get("/api/logs").json() if row["name"] == path.name)
    assert (row["ending"], row["outcome"]) == ("aborted" if aborted else "failure", f"failed: {reason}")
    card = client.get(f"/api/trials/{row['id']}/card").raise_for_status().json()
    assert card["sentence"].startswith(f"{'Aborted' if aborted else 'Failed'}: {reason}.")
    order = TrialOrder(entries["ref"].id, object="rice_box")
    logs = (entries["trial0"].id, entries["trial1"].id, row["id"])
    served.parts.queue._entries = [Entry(str(k) * 16, order, "ref", log=log) for k, log in enumerate(logs)]
    (line,) = client.get("/api/trials/means", params={"measure": "success"}).raise_for_status().json()
    assert (line["successes"], line["trials"], line["aborted"]) == (2, 2 if aborted else 3, int(aborted))
    path.unlink()
