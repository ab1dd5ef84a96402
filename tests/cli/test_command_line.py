"""The command line as its users meet it: exit status, one line on stderr, nothing written.

A process of its own is started where the process matters, and once for what is refused: the others would say the same.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from typer.core import TyperGroup
from typer.main import get_command

from rtstack.cli.app import app, whole
from rtstack.log.reader import read_log
from rtstack.trials.result import TrialResult
from tests.support.runs import StopAfter, demonstrate

COMMAND = Path(sys.executable).with_name("rtstack")


def run(*arguments: object, cwd: Path, **options) -> subprocess.CompletedProcess:
    """Run the command as a user would."""
    return subprocess.run(
        [str(COMMAND), *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120, **options
    )


@pytest.fixture
def recording(demonstration) -> Path:
    """A recording."""
    return demonstration.path


@pytest.fixture
def folder(tmp_path) -> Path:
    """An empty one beside what a test makes."""
    (tmp_path / "work").mkdir()
    return tmp_path / "work"


def _is_refused(done: subprocess.CompletedProcess, folder: Path, *words: str) -> None:
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert not list(folder.iterdir())


def test_a_trial_prints_one_json_object_with_the_fields_of_the_contract(recording, tmp_path, command_line):
    done = run("trial", "--reference", recording, "--displacement-mm", "15", "--json", "--log", "t.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == set(TrialResult.__dataclass_fields__)
    assert result["success"] is True
    assert result["log"] == "t.mcap"
    assert (tmp_path / "t.mcap").stat().st_size > 1e6
    review = command_line("review", "t.mcap", "--json", cwd=tmp_path)
    assert review.returncode == 0
    again = json.loads(review.stdout)["score"]
    assert again["average_force_norm"] == result["average_force_norm"]
    text = command_line("review", "t.mcap", cwd=tmp_path)
    assert "interim -> post_impact" in text.stdout
    assert "complete: nothing to recover" in command_line("recover", "t.mcap", cwd=tmp_path).stdout


BAD_TRIALS = [
    (["--object", "anvil"], ["anvil", "rice_box"]),
    (["--displacement-mm", "900"], ["900"]),
    (["--displacement-mm", "nan"], ["displacement_mm", "finite"]),
    (["--displacement-x-mm", "500"], ["+500 mm", "along x: allowed are -100 to +100 mm"]),
    (["--yaw-deg", "60"], ["+60 deg", "-45 to +45 deg"]),
    (["--controller", "best"], ["proposed"]),
    (["--seed", "-1"], ["seed"]),
    (["--law-inertia", "X"], ["--law-inertia", "'X'", "'M', 'M+B_theta'"]),
    (["--log", "missing/t.mcap"], ["missing"]),
    (["--log", "."], ["directory"]),
    (["--cell", "moon"], ["direct"]),
    (["--cell-file", "missing.toml"], ["missing.toml"]),
    (["--wrong"], ["--wrong"]),
]


@pytest.mark.parametrize(("arguments", "words"), BAD_TRIALS)
def test_bad_input_to_a_trial(recording, tmp_path, command_line, arguments, words):
    _is_refused(command_line("trial", "--reference", recording, *arguments, cwd=tmp_path), tmp_path, *words)


def test_a_process_ends_as_it_is_said_here(recording, tmp_path, command_line):
    arguments = ("trial", "--reference", recording, *BAD_TRIALS[0][0])
    done, said = run(*arguments, cwd=tmp_path), command_line(*arguments, cwd=tmp_path)
    _is_refused(done, tmp_path, *BAD_TRIALS[0][1])
    assert (said.returncode, said.stdout, said.stderr) == (done.returncode, done.stdout, done.stderr)


WRONG = {
    "demo": ("--out none/demo", "cannot make the folder none/demo: No such file or directory; choose another one"),
    "teach": ("ref.mcap --object anvil", "unknown object 'anvil'"),
    "trial": ("--reference none.mcap", "cannot read none.mcap"),
    "play": ("none.mcap", "cannot read none.mcap"),
    "place": ("--object anvil", "unknown object 'anvil'"),
    "identify-friction": ("none/friction.toml", "the folder none does not exist"),
    "guide": ("--cell moon", "unknown cell 'moon'"),
    "wiggle": ("left --cell moon", "unknown cell 'moon'"),
    "calibrate": ("none.toml", "none.toml: cannot be read"),
    "commission": ("--cell-file none.toml", "none.toml: cannot be read"),
    "desk status": ("", "where is Desk of the boxes?"),
    "desk start": ("", "where is Desk of the boxes?"),
    "desk stop": ("", "where is Desk of the boxes?"),
    "desk shutdown": ("", "where is Desk of the boxes?"),
    "review": ("none.mcap", "cannot read none.mcap"),
    "excite": ("none/log.mcap", "the directory none does not exist"),
    "twin": ("none.mcap --out twin", "cannot read none.mcap"),
    "replay": ("none.mcap", "cannot read none.mcap"),
    "export": ("none.mcap data.h5 --to hdf5", "none.mcap: cannot be read"),
    "import": ("none out.mcap", "none: it is no LeRobot data set"),
    "recover": ("none.mcap", "cannot read none.mcap"),
    "recover-arms": ("--cell moon", "cell 'moon': the robots' addresses are given as fci:LEFT,RIGHT"),
    "up": ("--left 127.0.0.11 --right 127.0.0.11", "two arms have two addresses"),
    "robot": ("--left 127.0.0.11 --right 127.0.0.11", "two arms have two addresses"),
    "console": ("--run none", "start `rtstack robot`"),
    "teleoperate": ("moon --token x", "moon"),
    "policy": ("moon", "unknown policy 'moon'"),
    "sim": ("--cpu 9999", "--cpu 9999: choose one of"),
    "check": ("--left 127.0.0.11 --right 127.0.0.11", "two arms have two addresses"),
    "host-setup": ("--kernel odd", "is not one of 'rt', 'generic'"),
    "campaign compare": ("none none", "none is no campaign's folder"),
    "campaign pack": ("none", "none is no campaign's folder"),
    "campaign": ("aim-aware-grab --quick --out done --scheduler nonsense", "no scheduler at nonsense"),
    "tune-monitor": ("none.mcap --out monitor.toml", "give at least"),
    "impact-map": ("none.toml", "none.toml: cannot be read"),
    "home": ("none.toml", "none.toml: cannot be read"),
    "plan": ("plan.mcap --speed nan", "plan: speed"),
    "bench tick": ("--ticks 1", "--ticks"),
    "bench link": ("--cell moon", "unknown cell 'moon'"),
    "token create": ("--name robot --scope all", "is not one of 'view', 'operate'"),
    "token list": ("--logs none", "none: no such folder"),
    "token revoke": ("id --logs none", "none: no such folder"),
    "token sign-in": ("--logs none", "none: no such folder"),
    "plot": ("none.mcap", "cannot read none.mcap"),
    "completion": ("tcsh", "'bash', 'zsh', 'fish'"),
    "logs list": ("--logs none", "cannot read none"),
    "logs show": ("none.mcap", "cannot read none.mcap"),
    "logs compare": ("none.mcap none.mcap", "cannot read none.mcap"),
    "logs reviewed": ("none.mcap", "there is no such log"),
    "logs prune": ("--logs none --older-than 3", "cannot read none"),
}


def test_every_command_helps_and_refuses_what_is_wrong(tmp_path, command_line):
    for command in _commands(whole()):
        helped = command_line(*command.split(), "--help", cwd=tmp_path)
        assert (helped.returncode, helped.stderr) == (0, ""), command
        assert f"Usage: rtstack {command} " in helped.stdout
        arguments, word = WRONG[command]
        _is_refused(command_line(*command.split(), *arguments.split(), cwd=tmp_path), tmp_path, word)


def test_the_list_of_commands_says_how_their_help_begins():
    listed, loaded = get_command(app).commands, whole().commands
    for width in (45, 50, 55, 60):  # completions, and lists in terminals of different widths
        lines = [{name: each.get_short_help_str(width) for name, each in all_.items()} for all_ in (listed, loaded)]
        assert lines[0] == lines[1]


def test_the_list_of_commands_loads_none_of_them(tmp_path):
    listing = "import sys; from rtstack.cli.app import app; app(['--help'], standalone_mode=False); print(sys.modules)"
    done = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert "rtstack.cli.app" in done.stdout
    for heavy in ("numpy", "pinocchio", "mujoco", "numba", "pydantic", "rtstack.cli.trials"):
        assert f"'{heavy}'" not in done.stdout


def _commands(command: object, name: str = "") -> list[str]:
    """All commands below one, by name."""
    if not isinstance(command, TyperGroup):
        return [name]
    return [each for key, below in command.commands.items() for each in _commands(below, f"{name} {key}".strip())]


def test_an_unknown_campaign_names_all_of_them(tmp_path, command_line):
    done = command_line("campaign", "nope", "--out", "done", cwd=tmp_path)
    _is_refused(done, tmp_path, "unknown campaign 'nope'", "aim-aware-grab", "reference-spreading")


def test_a_log_that_exists_is_not_overwritten(recording, tmp_path, command_line):
    (tmp_path / "t.mcap").write_bytes(b"mine")
    done = command_line("trial", "--reference", recording, "--log", "t.mcap", cwd=tmp_path)
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert (tmp_path / "t.mcap").read_bytes() == b"mine"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing", ["No such file"]),
        ("foreign", ["not an MCAP file"]),
        ("truncated", ["rtstack recover"]),
        ("folder", ["folder"]),
    ],
)
def test_a_reference_that_is_none(recording, tmp_path, folder, command_line, name, words):
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    path = inputs / f"{name}.mcap"
    if name == "foreign":
        path.write_text("all work and no play")
    elif name == "truncated":
        path.write_bytes(recording.read_bytes()[:400_000])
    elif name == "folder":
        path.mkdir()
    _is_refused(command_line("trial", "--reference", path, "--log", "t.mcap", cwd=folder), folder, *words)


def test_a_foreign_mcap_as_reference(tmp_path, folder, command_line):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    _is_refused(command_line("trial", "--reference", path, cwd=folder), folder, "not a log of ours")


def test_without_an_object_a_trial_has_the_one_of_its_reference(tmp_path, command_line):
    made = command_line("teach", "ref.mcap", "--object", "parcel", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    done = command_line("trial", "--reference", "ref.mcap", "--json", cwd=tmp_path)
    assert (json.loads(done.stdout)["object"], done.stderr) == ("parcel", "")
    asked = command_line("trial", "--reference", "ref.mcap", "--object", "anvil", cwd=tmp_path)
    assert "unknown object 'anvil'" in asked.stderr  # what is given counts


def test_a_reference_without_an_impact(cell, tmp_path, folder, command_line):
    """A demonstration that was broken off before the hands met the box."""
    path = tmp_path / "early.mcap"
    result = demonstrate(path, cell, stop=StopAfter(700))
    assert "stop requested" in (result.failure_reason or "")
    _is_refused(command_line("trial", "--reference", path, cwd=folder), folder, "no impact")


def test_ctrl_c_brakes_finishes_the_log_and_ends_without_a_traceback(tmp_path):
    path = tmp_path / "early.mcap"
    process = subprocess.Popen(
        [str(COMMAND), "teach", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not path.exists():
        time.sleep(1e-3)
    process.send_signal(2)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1, (out, err)
    assert "stop requested" in out
    assert err == ""
    assert read_log(path).complete


def test_the_demo_goes_the_whole_way_and_opens_its_page_where_there_is_a_display(tmp_path, command_line, monkeypatch):
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {tmp_path}/opened\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")  # how a user names one
    monkeypatch.setattr("webbrowser._tryorder", None)  # which would be read once a process
    monkeypatch.setenv("DISPLAY", ":0")
    done = command_line("demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "success | proposed, rice_box, -30 mm" in done.stdout
    assert sorted(path.name for path in (tmp_path / "demo").iterdir()) == [
        "demonstration.mcap", "impact.html", "trial.mcap",
    ]  # fmt: skip
    page = (tmp_path / "demo" / "impact.html").as_uri()
    assert (tmp_path / "opened").read_text().strip() == page
    assert page not in done.stdout
    again = command_line("demo", cwd=tmp_path)
    assert (again.returncode, again.stdout) == (2, "")
    assert "cannot make the folder demo: File exists; choose another one with --out" in again.stderr


def test_teach_refuses_what_it_cannot_do(tmp_path, command_line):
    _is_refused(command_line("teach", "x.mcap", "--law-inertia", "m", cwd=tmp_path), tmp_path, "'M', 'M+B_theta'")
    _is_refused(command_line("teach", "missing/x.mcap", cwd=tmp_path), tmp_path, "missing")
    _is_refused(command_line("dance", cwd=tmp_path), tmp_path, "dance")


def test_a_read_only_folder(recording, tmp_path, folder, command_line):
    if os.geteuid() == 0:
        target = "/proc/t.mcap"  # root may write anywhere but there
    else:
        (tmp_path / "locked").mkdir(mode=0o500)
        target = str(tmp_path / "locked" / "t.mcap")
    _is_refused(command_line("trial", "--reference", recording, "--log", target, cwd=folder), folder, "cannot write")


def test_help_answers(tmp_path, command_line):
    done = command_line("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in ("teach", "trial", "review", "recover", "up", "bench"):
        assert command in done.stdout
    assert run(cwd=tmp_path).stdout == done.stdout


@pytest.mark.long
def test_a_killed_log_process_fails_the_trial_and_the_rest_is_recovered(recording, tmp_path, command_line):
    """kill -9 in the middle: everything up to half a second before is there, and the trial says what to do."""
    path = tmp_path / "t.mcap"
    process = subprocess.Popen(
        [str(COMMAND), "trial", "--reference", str(recording), "--log", str(path), "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    early = 0.1 * recording.stat().st_size  # the trial is about as long
    while process.poll() is None and not (path.exists() and path.stat().st_size > early):
        time.sleep(1e-3)
    writers = [c for c in psutil.Process(process.pid).children() if "rtstack.log.writing.process" in c.cmdline()]
    assert len(writers) == 1
    writers[0].kill()
    out, err = process.communicate(timeout=60)
    result = json.loads(out)
    assert process.returncode == 1
    assert result["success"] is False
    assert "rtstack recover" in result["failure_reason"]
    assert "Traceback" not in err
    before = read_log(path, truncated=True).topic("/left/arm")
    done = command_line("recover", path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    again = read_log(tmp_path / "t.recovered.mcap")
    samples = again.topic("/left/arm")
    assert again.metadata["trial"]["kind"] == "trial"
    assert len(samples) >= len(before) > 0
    assert set((np.diff(samples["t_ns"])).tolist()) == {1_000_000}
    # a chunk is at most a quarter of a second: what the file had grown to is what is given back
    assert len(again.topic("/right/control")) >= len(samples) - 500
