"""The hour on one arm (tests/programs/one_hour.py): its figures, what it refuses, and all of it against a simulated arm
that is served as metal, with a person at a pseudo-terminal."""

import json
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from hal.state import ARM_STATE, RobotMode
from rtstack.cells import load_description
from rtstack.cells.simulator import Simulator
from rtstack.safety.limits import ForcePhase
from rtstack.trials.tightening import limits_of_arms
from tests.programs.one_hour import STEPS
from tests.support.hour import figures
from tests.support.hour.person import Person
from tests.support.hour.recorder import RecordedArm, Rows
from tests.support.hour.runs import capped, constant_speed, steps, sweeps
from tests.support.real_cell import write_cell_file

ROOT = Path(__file__).resolve().parents[2]
SLOWER = 6  # than real time: a pause of this machine costs fewer packets
# the program, without its watchdogs of the time of day, which this machine cannot keep
_PATIENT = """
import runpy, sys
import hal.fci.pair, rtstack.loop.watchdogs
rtstack.loop.watchdogs.CLUTCH_S = 3.0
hal.fci.pair.STALE_S = hal.fci.pair.STALE_IN_LOCKSTEP_S
rtstack.loop.watchdogs.OVERRUN_TICKS = 10_000
sys.argv[0] = "one_hour"
runpy.run_module("tests.programs.one_hour", run_name="__main__", alter_sys=True)
"""
PASSES = 4  # a step that a pause of this machine has ended is run again, as the program does in the same folder


def rows(n: int, **values: np.ndarray) -> Rows:
    """Rows of n states in motion, a millisecond apart."""
    state = np.zeros(n, ARM_STATE)
    state["t_ns"] = np.arange(n) * 1_000_000
    state["robot_mode"], state["control_command_success_rate"] = RobotMode.MOVE, 1.0
    for name, value in values.items():
        if name != "tau":
            state[name] = value
    times = np.arange(n) * 1_000_000 + 1
    return Rows(state, values.get("tau", np.zeros((n, 7))), np.ones(n, bool), times, times + 100_000)


# figures


@pytest.mark.parametrize("ticks", [1, 3])
def test_an_echo_is_found_after_its_ticks(ticks: int):
    sent = np.random.default_rng(1).normal(size=(400, 7)).cumsum(axis=0)
    shown = np.concatenate([np.zeros((ticks, 7)), sent[:-ticks]])
    found = figures.echo(rows(400, tau_J_d=shown, tau=sent))
    assert found["ticks"] == ticks
    assert found["largest_off_nm"] == 0.0
    assert found["told_apart"]


def test_an_echo_that_is_filtered_is_not_exact():
    sent = np.random.default_rng(1).normal(size=(400, 7)).cumsum(axis=0)
    shown = np.zeros_like(sent)
    for k in range(1, 400):
        shown[k] = 0.5 * (shown[k - 1] + sent[k - 1])
    assert figures.echo(rows(400, tau_J_d=shown, tau=sent))["largest_off_nm"] > 0.1


def test_a_gap_says_whether_the_last_torque_was_repeated():
    torque = np.arange(600.0)[:, None] * np.ones(7) * 1e-3
    shown = np.concatenate([np.zeros((1, 7)), torque[:-1]])
    kept = rows(600, tau_J_d=shown.copy(), tau=torque)
    kept.sent[300:305] = False
    assert not figures.gap(kept, 5).repeated
    kept.state["tau_J_d"][300:306] = torque[299]
    found = figures.gap(kept, 5)
    assert (found.repeated, found.went_on) == (True, True)
    kept.state["robot_mode"][400:] = RobotMode.REFLEX
    assert not figures.gap(kept, 5).went_on


def test_a_stop_is_measured_from_the_tick_in_which_it_was_asked_for():
    lab = capped(load_description(None)[0].only(["left"]))
    from rtstack.model.arm_model import ArmModel

    speed = np.concatenate([np.full(200, 0.3), np.linspace(0.3, 0.0, 150), np.zeros(50)])
    q = np.tile(np.array(lab.arms[0].home), (400, 1))
    q[:, 0] += np.cumsum(speed) * 1e-3
    dq = np.zeros((400, 7))
    dq[:, 0] = speed
    found = figures.stop(rows(400, q=q, dq=dq), 200, ArmModel(lab.arms[0], lab.pad))
    lever_m = np.hypot(0.4, 0.15)  # from the base's axis to the pad at home
    assert found["at_rest"]
    assert found["ms"] == pytest.approx(140.0, abs=2.0)  # below 0.02 rad/s
    assert found["pad_m_s"] == pytest.approx(0.3 * lever_m, rel=1e-2)
    assert found["mm"] == pytest.approx(1e3 * lever_m * 0.15 * 0.3 / 2, rel=0.05)


def test_a_swing_is_found_at_its_frequency():
    t = np.arange(3000) * 1e-3
    torque = np.zeros((3000, 7))
    torque[:, 2] = 0.3 * np.sin(2 * np.pi * 41.0 * t) + np.random.default_rng(1).normal(scale=0.05, size=3000)
    found = figures.resonance(rows(3000, tau_J=torque), 2)
    assert found["hz"] == pytest.approx(41.0, abs=1.0)
    assert found["times_the_median"] > 100.0


def test_the_box_s_clock_is_compared_with_this_one():
    kept = rows(20_000)
    kept.read_ns[:] = kept.state["t_ns"] * (1.0 - 50e-6) + np.random.default_rng(1).exponential(2e4, 20_000)
    assert figures.link(kept)["clock_ppm"] == pytest.approx(50.0, abs=2.0)


# motions


def test_the_caps_are_below_what_a_cell_that_is_not_commissioned_may_do():
    description = capped(load_description(None)[0])
    for limits in limits_of_arms(description):
        assert limits.ee_speed_max == 0.25
        for phase in ForcePhase:
            assert limits.force_by_phase[phase] <= 50.0
            assert max(limits.collisions(phase).collision_forces[:3]) <= 65.0
    assert description.start_motion.speed_rad_s <= 0.15


@pytest.mark.parametrize(
    ("path", "fastest"),
    [(constant_speed(0.4), 0.4), (sweeps(0, (0.05, 0.1, 0.25), 1.5), 0.25), (steps(3, 0.01, 0.5), 0.0)],
)
def test_a_path_begins_where_the_arm_is_and_is_as_fast_as_said(path, fastest: float):
    q = np.array([0.1, 0.2, 0.3, -2.0, 0.5, 1.6, 0.7])
    way, speed = path(q)
    assert np.allclose(way[0], q, atol=1e-3)
    assert np.abs(speed).max() == pytest.approx(fastest, rel=0.02)


class _Arm:
    """An arm of which only its answers count."""

    def __init__(self) -> None:
        from hal.state import ArmState

        self.state, self.written = ArmState.empty(), 0

    def read(self):
        return self.state

    def write(self, tau: np.ndarray) -> None:
        self.written += 1

    def stop(self) -> None: ...

    def recover(self) -> None: ...

    def close(self) -> None: ...


def test_only_the_answers_that_are_named_are_left_out():
    arm = _Arm()
    kept = RecordedArm(arm)
    kept.lose = frozenset({2, 3})
    for _ in range(6):
        kept.read()
        kept.write(np.ones(7))
    assert arm.written == 4
    assert kept.rows.sent.tolist() == [True, True, False, False, True, True]


# the command


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--left", "127.0.0.11", "--only", "99"], "no step '99'"), (["--left", "192.0.2.9"], "simulated = true"),
        *(pytest.param(*each, marks=pytest.mark.long) for each in (
            ([], "one arm"), (["--left", "127.0.0.11", "--right", "127.0.0.12"], "one arm"),
            (["--left", "127.0.0.11"], "in a terminal"),
        )),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path: Path, options: list[str], said: str):
    cell = tmp_path / "cell.toml"
    cell.write_text((ROOT / "deploy/cells/grab.toml").read_text())
    command = [sys.executable, "-m", "tests.programs.one_hour", tmp_path / "out", "--cell-file", cell, *options]
    done = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_each_step_says_what_happens_and_what_the_person_does():
    assert [step.number for step in STEPS] == list(range(1, len(STEPS) + 1))
    assert sum(step.minutes for step in STEPS) <= 60
    for step in STEPS:
        assert step.does.endswith(".")
        assert step.you.endswith(".")
    words = {step.key for step in STEPS if step.word}
    assert words == {"steps", "losses", "thresholds", "user-stop"}
    page = (ROOT / "docs/runbook/unproven.md").read_text()
    for step in STEPS:
        assert f"| {step.number} |" in page or f"| {step.number}, " in page or f", {step.number} |" in page, step.number


def hour(folder: Path, faults: str = "", only: str = "", answers: Mapping[str, str] | None = None) -> str:
    """Run the program at a terminal against a simulated arm that is served as metal; return what it has said."""
    script = None
    if faults:
        script = folder / "faults.toml"
        script.write_text(faults)
    simulator = Simulator(
        "", 0.0, 3, lockstep=False, profile="honest", faults=script, more=["--slower", str(SLOWER)]
    )  # fmt: skip
    try:
        host, port = simulator.tracker.address
        cell = folder / "cell.toml"
        write_cell_file(cell, str(simulator.left), str(simulator.right), f"{host}:{port}")
        simulator.tracker.close()
        person = Person()
        ends = person.theirs
        command = [sys.executable, "-c", _PATIENT, str(folder / "results"), "--cell-file", str(cell), "--short"]
        command += ["--left", str(simulator.left), *(["--only", only] if only else [])]
        process = subprocess.Popen(command, cwd=ROOT, stdin=ends, stdout=ends, stderr=ends)
        person.attend(answers)
        process.wait()
        return person.said
    finally:
        simulator.close()


def result(folder: Path, number: int) -> dict:
    """Return the record of a step; of one that was not reached, as of one that has failed."""
    for path in (folder / "results").glob(f"{number:02d}-*.json"):
        return json.loads(path.read_text())
    return {"failed": "not run", "skipped": "", "claims": [], "figures": {}}


def until(folder: Path, complete: Callable[[], bool], faults: str = "", only: str = "") -> str:
    """Give the command until its steps are complete: this machine may end one by a pause."""
    said = ""
    for _ in range(PASSES):
        said = hour(folder, faults, only)
        if complete():
            break
    return said


@pytest.mark.alone
@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_whole_hour_is_run_on_a_simulated_arm_that_is_served_as_metal(tmp_path: Path):
    done = [step.number for step in STEPS]
    said = until(tmp_path, lambda: not any(result(tmp_path, number)["failed"] for number in done))
    records = {number: result(tmp_path, number) for number in done}
    assert {number: record["failed"] for number, record in records.items() if record["failed"]} == {}, said
    assert {number for number, record in records.items() if record["skipped"]} == {3, 6}  # no Desk, no hand
    verdicts = {
        claim["what"]: claim["as_claimed"] for record in records.values() for claim in record["claims"]
    }  # fmt: skip
    for what in (
        "load, end effector and K are read back", "the hold stays", "the box holds the arm after a stop",
        "tau_J_d echoes the torque", "25 lost answers stop the arm", "torques step by 1 Nm a tick at most",
        "the joints follow the way", "and arrive", "limits of the box's URDF",
    ):  # fmt: skip
        assert verdicts[what], (what, said)
    assert verdicts["the estimate of the weight"] is False  # no weight hangs at a simulated arm
    assert verdicts["the box's own reflex at 15 N"] is None  # and no hand pushes it
    stops = records[18]["figures"]["stops"]
    assert [stop["at_rest"] for stop in stops] == [True] * 3
    for stop in stops:
        assert stop["pad_m_s"] == pytest.approx(stop["asked_m_s"], rel=0.1)
    assert stops[0]["mm"] < stops[1]["mm"] < stops[2]["mm"]
    (archive,) = (tmp_path / "results").glob("one_hour-left-*.zip")
    with zipfile.ZipFile(archive) as opened:
        names = opened.namelist()
        text = "".join(opened.read(name).decode() for name in names if not name.endswith(".npz"))
        with opened.open("13-losses.npz") as file:
            lost = np.load(file)
            assert (~lost["lost10.sent"] & (lost["lost10.answered_ns"] > 0)).sum() == 10
    assert {"table.md", "README.md", "18-stops.json", "18-stops.npz"} <= set(names)
    address = load_description(tmp_path / "cell.toml")[0].mountings["left"].address
    for hidden in (str(tmp_path), address):
        assert hidden not in text
    again = hour(tmp_path)  # what is there is not run again
    assert again.count(": done") == len(STEPS) - 2


PUSH = '[[fault]]\nkind = "push"\narm = "left"\nforce_N = [0.0, 25.0, 0.0]\nat_s = 0.5\nduration_s = 0.4\n'
STOP = '[[fault]]\nkind = "user_stop"\narm = "left"\nat_s = 0.6\nduration_s = 1.0\n'


@pytest.mark.alone
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_push_and_a_user_stop_are_seen(tmp_path: Path):
    until(tmp_path, lambda: bool(result(tmp_path, 14)["figures"].get("errors")), PUSH, "14")
    pushed = result(tmp_path, 14)
    assert pushed["figures"]["errors"] == ["cartesian_reflex"]
    assert 10.0 < pushed["figures"]["largest_component_n"] < 25.0
    until(tmp_path, lambda: "USER_STOPPED" in str(result(tmp_path, 15)["figures"]), STOP, "15")
    stopped = result(tmp_path, 15)
    assert "User Stop pressed" in stopped["figures"]["ended"]
    assert [mode for _, mode, _ in stopped["figures"]["modes"]][-2:] == ["USER_STOPPED", "IDLE"]
    assert all(claim["as_claimed"] for claim in stopped["claims"])
