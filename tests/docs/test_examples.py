"""The examples run, in the order of their numbers, in one folder, with warnings as errors."""

import base64
import io
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rtstack.datasets.episode import read_episode
from rtstack.datasets.frames import frames_of
from rtstack.log.reader import read_log
from rtstack.log.time_of_day import time_of_day
from rtstack.samples import SIDES
from rtstack.teleoperation.policy import Chunk
from tests.support.docs.run import BIN, PATIENCE_S, environment

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the examples run."""
    return tmp_path_factory.mktemp("examples")


def _as_program(folder: Path, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments]
    return subprocess.run(command, cwd=folder, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S)


def _run_here(folder: Path, monkeypatch, capsys, *numbers: str) -> dict[str, str]:
    """Run examples in this process, as programs in a folder. Returns what each has printed."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", environment()["PATH"])
    said = {}
    for number in numbers:
        (path,) = EXAMPLES.glob(f"{number}_*.py")
        monkeypatch.setattr(sys, "argv", [str(path)])
        capsys.readouterr()
        runpy.run_path(str(path), run_name="__main__")
        said[number] = capsys.readouterr().out
    return said


@pytest.mark.long
def test_one_to_seven_run_without_a_robot(folder, monkeypatch, capsys):
    said = _run_here(folder, monkeypatch, capsys, *(f"0{n}" for n in range(1, 8)))
    assert "success" in said["01"]
    assert "ante_impact -> interim" in said["02"]
    assert (folder / "trial.png").stat().st_size > 10_000
    assert said["04"].count("success") == 3
    assert "solved" in said["05"]
    verdict = read_log(folder / "trial.mcap").metadata["result"]["impact_verdict"]
    assert verdict == "expected"
    assert said["06"].count(f": {verdict}") == 2  # the monitor over the log agrees with the one in the tick
    assert "success" in said["07"]
    assert "refused: squeeze" in said["07"]


@pytest.mark.long
def test_fifteen_to_thirty_one_read_repeat_and_refuse(folder, monkeypatch, capsys):
    """Those without a client of the robot's; ref.mcap and trial.mcap are of the examples before."""
    if not (folder / "trial.mcap").exists():
        _as_program(folder, "01_run_a_trial.py").check_returncode()
    said = _run_here(folder, monkeypatch, capsys, "15", "19", "22", "24", "25", "26", "29", "30", "31")
    assert f"of {len(read_log(folder / 'trial.mcap').topic('/timing'))} ticks within 300 us" in said["15"]
    expected, unexpected = said["19"].splitlines()
    assert expected.endswith("expected: as planned; success")
    assert "60 mm, hold: unexpected: wrong place; " in unexpected
    beside_mm = [float(line.split()[-5]) for line in said["22"].splitlines()[1:]]
    assert beside_mm[0] < 0.1 < beside_mm[1]
    assert said["24"].startswith("no fault after 4.")
    assert "nearest to its limit: joint 4, by 0.02" in said["24"]
    assert "largest step 1 ms" in said["25"]
    assert "cut off: complete False" in said["25"]
    assert said["26"].startswith("both arms in step: True")
    first, last, between = (float(line.split()[-2]) for line in said["26"].splitlines()[1:])
    assert max(first, last) < 0.1 * between
    assert said["29"].count(": success, 0 ticks missed") == 3
    for line, part in zip(
        said["30"].splitlines(), ("objects.rice_box.mass", "'rice_bocks'", "cable", "2"), strict=True
    ):
        assert part in line
    assert "findings; the timer is" in said["31"]


@pytest.mark.long
def test_fourteen_to_twenty_three_drive_a_served_arm(folder, monkeypatch, capsys):
    """In lockstep, where the outcome does not depend on the machine; but for 16, which also looks at an arm at rest."""
    if not (folder / "ref.mcap").exists():
        _as_program(folder, "01_run_a_trial.py").check_returncode()
    said = _run_here(folder, monkeypatch, capsys, "14", "16", "17", "18", "20", "21", "23")
    assert "communication_constraints_violation" in said["14"]
    assert "20 states later 0.81 of 100 did" in said["14"]
    assert "joint 4 moved by 0.100 rad" in said["16"]
    assert [line.split(",")[0] for line in said["17"].splitlines()] == [
        "arm 1: 500 states answered", "arm 2: 500 states answered",
    ]  # fmt: skip
    assert "errors: controller_torque_discontinuity\nafter recovery: IDLE\nin motion again: MOVE\n" in said["18"]
    assert "at 10 N: stopped after" in said["20"]
    assert "cartesian_reflex" in said["20"]
    assert "at 65 N: pushed the box, and went on" in said["20"]
    since_ms, for_ms = (int(word) for word in said["21"].splitlines()[0].split() if word.isdecimal())
    assert since_ms > 500
    assert for_ms > 0
    rose_mm = [int(line.split("by ")[1].split()[0]) for line in said["23"].splitlines()]
    assert abs(rose_mm[0]) < 5 < rose_mm[1]


@pytest.mark.long
def test_eight_runs_four_trials_on_a_scheduler(folder):
    done = _as_program(folder, "08_campaign_on_a_scheduler.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("success True") == 4
    assert len(list((folder / "campaign/logs").glob("*.mcap"))) == 4


def _token(folder: Path) -> str:
    (folder / "logs").mkdir()
    create = [str(BIN / "rtstack"), "token", "create", "--name", "example", "--scope", "operate"]
    done = subprocess.run(create, cwd=folder, env=environment(), capture_output=True, text=True, check=True)
    return done.stdout.strip()


def _with_a_stack(folder: Path, token: str, *names: str) -> list[subprocess.CompletedProcess[str]]:
    stack = subprocess.Popen(
        [str(BIN / "rtstack"), "up", "--port", "0"],
        cwd=folder, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert stack.stdout is not None
        address = stack.stdout.readline().removeprefix("rtstack is up: ").strip()
        done = [_as_program(folder, name, address.split("?")[0], token) for name in names]
        stack.send_signal(signal.SIGINT)
        _, errors = stack.communicate(timeout=PATIENCE_S)
        assert (stack.returncode, errors) == (0, "")
        return done
    finally:
        stack.terminate()
        stack.communicate()


@pytest.mark.alone
@pytest.mark.long
def test_twenty_seven_and_twenty_eight_look_at_a_console_and_leave_it(tmp_path):
    looked, left = _with_a_stack(tmp_path, _token(tmp_path), "27_what_a_page_knows.py", "28_operator_goes.py")
    assert looked.stdout.splitlines()[1] == "in control: no operator; arms: simulated", looked.stderr
    gone, recovered = left.stdout.splitlines()
    assert gone.startswith("fault: the operator has gone: "), left.stderr
    assert recovered == "recovered: disarmed"


def _was_held_up(done: subprocess.CompletedProcess[str]) -> bool:
    """Whether a machine that stalled for two seconds took control away from the program, as it should."""
    said = done.stdout + done.stderr
    return any(line in said for line in ("take control first", "operator has gone", "no longer has"))


@pytest.mark.alone
@pytest.mark.long
def test_nine_and_ten_talk_to_a_console(folder):
    token = _token(folder)
    for _ in range(4):
        done, queued = _with_a_stack(folder, token, "09_talk_to_the_console.py", "10_queue_of_trials.py")
        if not (_was_held_up(done) or _was_held_up(queued)):
            break
    assert done.stdout.splitlines()[:2] == ["demonstration: done ", "trial: done "], done.stdout + done.stderr
    assert read_log(folder / "console.mcap").metadata["trial"]["kind"] == "trial"
    lines = queued.stdout.splitlines()
    assert (queued.returncode, lines[1:3]) == (
        0, ["problem of the recording: none", "queue: all of it is done"],
    ), queued.stdout + queued.stderr  # fmt: skip
    for seed, line in enumerate(lines[3:5]):
        assert line.startswith(f"seed {seed} succeeded"), line
        assert read_log(folder / f"queued-{seed}.mcap").metadata["trial"]["seed"] == str(seed)


def test_eleven_makes_a_bag_that_a_reader_of_ros_2_reads_bit_for_bit(demonstration, tmp_path):
    from rosbags.highlevel import AnyReader

    bag = runpy.run_path(str(EXAMPLES / "11_to_a_ros_2_bag.py"))
    bag["convert"](demonstration.path, tmp_path / "bag", 100)
    log = read_log(demonstration.path)
    samples, time = log.topic("/left/arm")[::100], time_of_day(log)
    with AnyReader([tmp_path / "bag"]) as reader:
        read = {}
        for connection, t_ns, data in reader.messages():
            read.setdefault(connection.topic, []).append((t_ns, reader.deserialize(data, connection.msgtype)))
    assert sorted(read) == ["/left/joint_states", "/left/wrench", "/right/joint_states", "/right/wrench", "/tf"]
    for sample, (t_ns, joints) in zip(samples, read["/left/joint_states"], strict=True):
        assert t_ns == time.unix_ns(int(sample["t_ns"]))
        for name, values in (("q", joints.position), ("dq", joints.velocity), ("tau_J", joints.effort)):
            assert (sample[name] == values).all()
    assert len(read["/tf"]) == 2 * len(samples)


@pytest.mark.long
def test_twelve_finds_the_box_in_a_picture_and_grabs_it(folder, learned_grab):
    done = _as_program(folder, "12_policy_that_looks.py")
    assert done.returncode == 0, done.stdout + done.stderr
    saw, came = done.stdout.splitlines()
    x_mm, y_mm = (float(word) for word in saw.split() if word.lstrip("-").isdecimal())
    assert np.hypot(x_mm + 20.0, y_mm - 40.0) < 10.0, saw
    assert came.startswith("success: lifted by 2"), came


def test_thirteen_makes_of_an_observation_the_frame_that_the_data_set_has(demonstration, lerobot_policy):
    frames = frames_of(read_episode(demonstration.path, ""), 50)
    log, k = read_log(demonstration.path), 70
    samples = [{name: log.topic(f"/{side}/{name}")[20 * (k + 1) - 1] for name in ("arm", "control")} for side in SIDES]
    poses = log.topic("/object/pose")
    seen = poses[poses["t_ns"] <= samples[0]["arm"]["t_ns"]][-1]
    picture = io.BytesIO()
    Image.effect_noise((40, 30), 50).convert("RGB").save(picture, "jpeg")
    shown = {
        "number": 7, "t_ns": int(samples[0]["arm"]["t_ns"]), "t_s": 0.0, "force": np.zeros((2, 3)).tolist(),
        **{name: [side["arm"][name].tolist() for side in samples] for name in ("q", "dq")},
        **{name: [side["control"]["pose_ref"].tolist() for side in samples] for name in ("pose", "pose_ref")},
        "object_pose": [*seen["position"].tolist(), *seen["orientation_wxyz"].tolist()],
        "pictures": {"front": {"t_ns": 0, "jpeg": base64.b64encode(picture.getvalue()).decode()}},
    }  # fmt: skip
    names = ("observation.state", "observation.environment_state")
    made = lerobot_policy["frame_of"](shown, (*names, "observation.images.front"))
    for name in names:
        assert made[name].tobytes() == frames[name].values[k].astype(np.float32).tobytes()
    assert (made["observation.images.front"] == np.asarray(Image.open(picture))).all()
    unseen = lerobot_policy["frame_of"](shown | {"object_pose": None}, names[1:])
    assert unseen[names[1]].tolist() == [0.0] * 8

    actions = frames["action"].values[k : k + 3]
    longer = actions.reshape(3, 2, 7) * [1, 1, 1, 1.2, 1.2, 1.2, 1.2]
    answer = lerobot_policy["answer_to"](shown, longer.reshape(3, 14))
    assert (answer["to"], answer["step_s"]) == (7, 0.02)
    np.testing.assert_allclose(np.reshape(answer["poses"], (3, 14)), actions, atol=1e-12)
    assert Chunk(answer["step_s"], np.array(answer["poses"])).problem(2) is None


def test_every_example_is_run_here():
    numbers = sorted(path.name[:2] for path in EXAMPLES.glob("*.py"))
    assert numbers == [f"{n:02d}" for n in range(1, 32)]
