"""A campaign on arms at their addresses: the object is set in its place by them, and every row comes from its log."""

import csv
import json
import signal
import socket
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hal.displacement import Displacement
from hal.errors import ConnectionLost
from hal.tracker import ObjectPose
from rtstack.cells import default_cell_file
from rtstack.cli.terminal import Terminal
from rtstack.experiments import attempts
from rtstack.experiments.attempts import Attempt, Kind, aborted
from rtstack.experiments.case_log import row_of
from rtstack.experiments.cell.reset import Reset, instruction
from rtstack.experiments.cell.runner import CellRunner
from rtstack.experiments.cell.schedule import CellSchedule, control_case, ordered
from rtstack.experiments.experiment import CellRun, Experiment
from rtstack.experiments.registry import kind_named
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification
from sim_robot.cell import simulated_cell
from tests.support.campaigns import PATIENCE_S, Command, two_controllers
from tests.support.fci.server import serve


def free_port() -> int:
    """Return a UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        return udp.getsockname()[1]


def until(happened, process):
    """Wait until something has happened while a process runs."""
    end_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.05)


@pytest.mark.timeout(900)
@pytest.mark.long  # tests/papers/aim_aware/test_hits.py runs one on an arm, and the parts have tests below
def test_a_campaign_runs_on_served_arms_and_what_a_person_aborts_counts_for_nothing(tmp_path):
    out, cell_file, tracker = tmp_path / "out", tmp_path / "cell.toml", f"127.0.0.1:{free_port()}"
    cell_file.write_text(default_cell_file().read_text().replace("127.0.0.1:1341", tracker))
    command = Command(two_controllers(tmp_path / "small.toml", 20.0))
    with serve("--lockstep", "--tracker", tracker) as served:
        kind = f"fci:{served.left},{served.right}"
        words = ("--workers", "1", "--cell", kind, "--cell-file", str(cell_file))
        process = command.start(out, *words)
        until(lambda: any((out / "logs").glob("*")), process)  # the first trial is running: the object was placed
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2, said
        assert "was aborted, and is run again: stop requested by the operator" in said
        (aborted,) = (out / "logs").glob("*.mcap")
        assert aborted.name.endswith(".aborted-1.mcap")
        done = command.run(out, "--resume", *words)
    assert done.returncode in (0, 1), done.stderr  # 1: a claim of the paper is not reached by so few
    rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
    assert len(rows) == 2
    for row in rows:
        log = read_log(out / row["log"])
        assert log.metadata["trial"]["cell"] == kind
        assert log.metadata["campaign"]["id"] == row["id"]
        pose = log.topic("/object/pose")
        first = pose[pose["seen"] == 1][0]["position"]
        assert abs(1e3 * first[1] - float(row["displacement_mm"])) < 6.0
        assert row["success"].lower() == log.metadata["result"]["success"]
        assert abs(float(row["placed_y_mm"]) - float(row["displacement_mm"])) < 6.0
        assert abs(float(row["placed_yaw_deg"])) < 2.5
    tried = list(csv.DictReader((out / "attempts.csv").read_text().splitlines()))
    cases = [each for each in tried if each["kind"] == "case"]
    assert [each["counts"] for each in cases] == ["False", "True", "True"]
    assert cases[0]["failed"].startswith("stop requested by the operator")
    assert {each["kind"] for each in tried} > {"case", "placement"}
    _, times, placements, beside, claims = json.loads((out / "report.json").read_text())["tables"]
    assert {line[0] for line in times["lines"]} >= {"case", "placement"}
    assert float(placements["lines"][0][1]) < 5.0
    assert beside["note"].startswith("2 common rows; ")
    assert len(claims["lines"]) > 0
    assert "Rows of the simulation and the arms" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("reason", "counts"),
    [
        (None, True),
        ("safety stop: left: the end effector is too fast", True),
        ("the object was not held until release", True),
        ("stop requested by the operator: on the way to the start pose", False),
        ("the operator let go", False),
        ("the robot left torque control: the left arm has sent no state for 100 ms", False),
        ("the robot left torque control: left arm: communication_constraints_violation; recover it", False),
        ("the robot left torque control: left arm: cartesian_reflex; recover it", True),
        ("the robot left torque control: on the way to the start pose: left arm: cartesian_reflex", False),
        ("safety stop: on the way to the start pose: left: the external force is too large", False),
    ],
)
def test_an_abort_is_no_result_of_a_controller(reason, counts):
    assert aborted(reason) is not counts


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        ("aim-aware-grab", "aim-aware-grab runs in the simulator: direct, or lockstep"),
        ("reference-spreading", "reference-spreading compares conditions that arms cannot be given, such as friction"),
    ],
)
def test_what_cannot_run_on_arms_says_so_before_anything_is_made(plan, said, tmp_path, command_line):
    done = command_line("campaign", plan, "--out", str(tmp_path / "out"), "--cell", "fci:127.0.0.11,127.0.0.12")
    assert done.returncode == 2
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_stack_that_does_not_run_is_one_line(tmp_path, command_line):
    done = command_line(
        "campaign", "reference-spreading-cell", "--out", str(tmp_path / "out"), "--cell", "stack:/no/robot.sock"
    )
    assert done.returncode == 2
    assert done.stderr.startswith("rtstack: the robot process does not answer")
    assert not (tmp_path / "out").exists()


def test_a_kind_runs_on_arms_that_says_how_and_reads_its_rows_back():
    whole = kind_named("reference-spreading")
    half = type("Half", (whole,), {"row_of_log": Experiment.row_of_log})  # would move the arms, and then have no row
    found = [kind.runs_on_cell() for kind in (whole, half, kind_named("aim-aware-grab"))]
    assert found == [True, False, False]


@dataclass(frozen=True)
class OneCase:
    id: str
    repetition: int


def test_the_order_is_drawn_block_by_block_and_stays_the_same():
    cases = [OneCase(f"{name}{k}", k) for name in "abcdefgh" for k in range(3)]
    order = ordered(cases, CellSchedule(), "digest")
    assert sorted(order, key=cases.index) == cases
    assert [case.repetition for case in order] == [0] * 8 + [1] * 8 + [2] * 8
    assert order == ordered(cases[::-1][::-1], CellSchedule(), "digest")
    blocks = [[case.id[0] for case in order if case.repetition == k] for k in range(3)]
    assert len(set(map(tuple, blocks))) == 3
    assert order != ordered(cases, CellSchedule(seed=1), "digest")


def test_a_control_case_that_the_plan_does_not_have_is_named():
    with pytest.raises(TrialError, match=r"on_cell\.control: the plan has no case b"):
        control_case([OneCase("a", 0)], CellSchedule(control="b"))


def test_the_report_counts_attempts_and_fits_the_drift_of_control_cases(tmp_path):
    made = [Attempt("2026-11-26T00:00:00", Kind.CASE, "a", "the operator let go", False, 2.0)]
    for k in range(4):
        row = json.dumps({"lift_mm": 10.0 + 0.5 * k, "none": None})
        made.append(Attempt("", Kind.CONTROL, "c", None, False, 4.0, row=row))
        made += [Attempt("", Kind.CASE, f"{k}.{n}", None, True, 4.0) for n in range(10)]
        made.append(Attempt("", Kind.PLACEMENT, "a", None, False, 8.0, off_mm=float(k), off_deg=0.1, peak_force_n=30.0))
    outcomes, times, placements, drift = attempts.tables(made, ["lift_mm", "none"])
    assert ("case", "no", "the operator let go", "1") in outcomes.lines
    assert ("case", "yes", "-", "40") in outcomes.lines
    assert {line[0]: line[2] for line in times.lines} == {
        "case": "4.0", "control case": "4.0", "placement": "8.0"
    }  # fmt: skip
    assert placements.lines[0] == ("off, mm", "1.50", "2.85", "3.00")
    ((name, runs, mean, slope),) = drift.lines
    assert (name, runs, mean, slope) == ("lift_mm", "4", "10.75", "5 [5, 5]")  # 0.5 in 10 cases
    (figure,) = attempts.figures(made, ["lift_mm", "none"])
    figure.draw(tmp_path / "drift.png")
    assert (tmp_path / "drift.png").stat().st_size > 1000


def test_a_person_is_told_how_to_move_the_object():
    description = load_cell_description(default_cell_file())
    stands, wanted = Displacement(0.010, 0.0, 0.05), Displacement(0.0, 0.012, 0.0)
    assert instruction("parcel", stands, wanted, description) == (
        "parcel: move it 12 mm towards the left arm, 10 mm against x, turn it by 3 degrees clockwise, seen from above"
    )
    turned = Displacement(0.0, 0.0, -1.55)  # a box turned by half a turn is the same
    assert instruction("parcel", turned, Displacement(0.0, -0.02, 1.55), description) == (
        "parcel: move it 20 mm towards the right arm, turn it by 2 degrees clockwise, seen from above"
    )


class Seen:
    """A tracker whose poses a test writes: where the object stands, and when it was seen."""

    def __init__(self, description, name):
        self.pose = ObjectPose.empty()
        self.pose.record["seen"] = 1
        self._z = description.table.top_z + description.objects[name].size[2] / 2.0

    def put(self, x_mm, y_mm, t_ns, lean=0.0):
        self.pose.record["position"] = (1e-3 * x_mm, 1e-3 * y_mm, self._z)
        self.pose.record["orientation_wxyz"] = (np.cos(lean / 2.0), np.sin(lean / 2.0), 0.0, 0.0)
        self.pose.record["t_ns"] = t_ns

    def latest(self):
        return self.pose


@pytest.mark.parametrize("by_arms", [True, False])
def test_what_the_arms_cannot_mend_or_are_not_to_a_person_is_told_until_it_is_right(by_arms):
    """Fallen, then not seen for long, then beside its place, then there: the campaign goes on by itself."""
    description = load_cell_description(default_cell_file())
    tracker = Seen(description, "parcel")
    cell = replace(simulated_cell("parcel", 0.0, 0).as_cell("direct"), tracker=tracker)
    now_ns = int(cell.arms[0].read().record["t_ns"][0])
    states = [(0.0, 20.0, now_ns, 1.5), (0.0, 20.0, now_ns - 3_000_000_000, 0.0), (0.0, 8.0, now_ns, 0.0)]
    told, carried = [], []

    def carry(run, kind, case_id):
        carried.append(kind)
        return SimpleNamespace(success=False, failure_reason="the object slipped", carried=False)

    def wait(said, kind, case_id):
        assert (kind, case_id) == (Kind.PERSON, "a case")
        while text := said():
            told.append(text)
            if states:
                tracker.put(*states.pop(0))
            else:
                tracker.put(0.0, 19.0, now_ns)
                time.sleep(0.05)

    tracker.put(0.0, 0.0, now_ns)
    planned = CellRun(
        PreparedRun(TrialSpecification("reference.mcap", object="parcel"), description), Path("log.mcap"), {},
        Displacement(0.0, 0.020, 0.0),
    )  # fmt: skip
    began_s = time.monotonic()
    Reset(cell, carry, wait, by_arms).set_in_place(planned, "a case")
    assert time.monotonic() - began_s > 0.9  # it has stood there for a second
    assert carried == [Kind.PLACEMENT] * by_arms
    why = " (the arms could not: the object slipped)" * by_arms
    assert told[0] == f"parcel: move it 20 mm towards the left arm{why}"
    assert told[1].startswith("parcel does not stand upright on the table (it leans by 86 degrees")
    assert told[2].startswith("the tracker has not seen parcel for 3 s")
    assert told[3] == f"parcel: move it 12 mm towards the left arm{why}"
    assert told[4] == "parcel stands in its place"


def test_the_arms_try_again_once_what_has_fallen_stands_upright():
    description = load_cell_description(default_cell_file())
    tracker = Seen(description, "parcel")
    cell = replace(simulated_cell("parcel", 0.0, 0).as_cell("direct"), tracker=tracker)
    now_ns = int(cell.arms[0].read().record["t_ns"][0])
    told, carried = [], []

    def carry(run, kind, case_id):
        carried.append(kind)
        tracker.put(0.0, 20.0, now_ns)
        return SimpleNamespace(success=True, failure_reason=None, carried=True)

    def wait(said, kind, case_id):
        while text := said():
            told.append(text)
            tracker.put(30.0, -40.0, now_ns)  # set upright, anywhere

    tracker.put(0.0, 0.0, now_ns, 1.5)
    run = PreparedRun(TrialSpecification("reference.mcap", object="parcel"), description)
    planned = CellRun(run, Path("log.mcap"), {}, Displacement(0.0, 0.020, 0.0))
    Reset(cell, carry, wait).set_in_place(planned, "a case")
    assert carried == [Kind.PLACEMENT]
    assert len(told) == 1
    assert told[0].startswith("parcel does not stand upright on the table")


def test_nothing_runs_until_the_table_is_clear_where_it_has_to_be():
    description = load_cell_description(default_cell_file())
    tracker = Seen(description, "parcel")
    cell = replace(simulated_cell("parcel", 0.0, 0).as_cell("direct"), tracker=tracker)
    now_ns = int(cell.arms[0].read().record["t_ns"][0])
    told = []

    def wait(said, kind, case_id):
        while text := said():
            told.append(text)
            tracker.put(0.0, 0.0, now_ns - 3_000_000_000)  # it was taken away

    tracker.put(0.0, 0.0, now_ns)
    run = PreparedRun(TrialSpecification("reference.mcap", object="parcel"), description)
    Reset(cell, lambda *run: None, wait).set_in_place(CellRun(run, Path("log.mcap"), {}, None, clear=True), "a case")
    assert len(told) == 1
    assert told[0].startswith("take the object off the table")


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "kinds"),
    [
        (240.0, 0.0, [Kind.PLACEMENT, Kind.START]),
        (0.0, -260.0, [Kind.START]),  # where a push leaves it, and the right arm starts: no arm moves before
    ],
)
def test_a_simulated_robot_puts_back_what_the_arms_cannot_reach(x_mm, y_mm, kinds):
    description = load_cell_description(default_cell_file())
    trackers = [Seen(description, "parcel"), Seen(description, "parcel")]
    cells = [replace(simulated_cell("parcel", 0.0, 0).as_cell("direct"), tracker=each) for each in trackers]
    now_ns = int(cells[0].arms[0].read().record["t_ns"][0])
    trackers[0].put(x_mm, y_mm, now_ns)
    trackers[1].put(0.0, 0.0, now_ns)
    carried = []

    def carry(run, kind, case_id):
        carried.append(kind)
        if kind is Kind.PLACEMENT:
            raise TrialError("it is out of reach")
        return SimpleNamespace(failure_reason=None)

    run = PreparedRun(TrialSpecification("reference.mcap", object="parcel"), description)

    def wait(said, kind, case_id):
        assert not said()

    reset = Reset(cells[0], carry, wait, True, lambda: cells[1])
    reset.set_in_place(CellRun(run, Path("log.mcap"), {}, Displacement()), "a case")
    assert carried == kinds


def test_a_pause_comes_before_a_run_that_brings_the_object(tmp_path):
    """As after a fault of a placement: no arm moves again before the person has looked."""
    done, reasons = [], ["a fault: look at the cell", "a fault: look at the cell", ""]

    class Host:
        stopped = ""

        @property
        def paused(self):
            done.append("asked")
            return reasons.pop(0)

        def carry_out(self, run, log, record):
            done.append("carried out")
            return SimpleNamespace(failure_reason=None, as_dict=dict)

    runner = object.__new__(CellRunner)
    runner.host, runner._at_start = Host(), True
    runner._store = SimpleNamespace(out=tmp_path, note_attempt=lambda attempt: done.append(str(attempt.kind)))
    runner._progress = SimpleNamespace(tell=lambda text: None)
    runner._schedule = CellSchedule()
    runner._carry_out(None, Kind.PLACEMENT, "a case")
    assert done == ["asked"] * 3 + [Kind.PERSON, "carried out", Kind.PLACEMENT]


def test_arms_that_were_lost_are_connected_to_again(monkeypatch):
    """What they have latched meanwhile is cleared; arms that answer are not opened again."""
    recovered, opened = [], []

    class Arm:
        def __init__(self, name, lost=False):
            self.name, self.lost = name, lost

        def recover(self):
            if self.lost:
                raise ConnectionLost("the left arm was lost; open it again")
            recovered.append(self.name)

    def both(left, right):
        return SimpleNamespace(arms=[left, right], recover=lambda: (left.recover(), right.recover()))

    @contextmanager
    def cell(self, run):
        opened.append(run)
        yield both(Arm("new left"), Arm("new right"))

    monkeypatch.setattr(Terminal, "cell", cell)
    host = Terminal("fci:a,b", load_cell_description(default_cell_file()), default_cell_file(), "a campaign")
    with host.kept_cell("a run"):
        assert host.recover() is None
        host._cell = both(Arm("left"), Arm("right", lost=True))
        assert host.recover() is host._cell
    assert opened == ["a run", "a run"]
    assert recovered == ["new left", "new right", "left", "new left", "new right"]


def test_a_kind_that_raises_on_a_log_is_named_in_one_line(monkeypatch):
    class Broken:
        digest = "abc"

        def row_of_log(self, case, log):
            raise ValueError("cannot reshape")

    monkeypatch.setattr("rtstack.experiments.case_log.case_log", lambda *asked: SimpleNamespace(metadata={}))
    with pytest.raises(TrialError, match=r"test_on_cell\..*Broken: row_of_log of a case: ValueError: cannot reshape"):
        row_of(Broken(), OneCase("a case", 0), Path("log.mcap"))
