"""The command line as its users meet it: a process, its exit status, one line on stderr, nothing written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from rtstack.cli.cells import default_cell_file, open_cell
from rtstack.log.reader import read_log
from rtstack.trials.record import open_log
from rtstack.trials.result import TrialResult
from rtstack.trials.run import run_demonstration
from rtstack.trials.specification import DemonstrationSpecification

COMMAND = Path(sys.executable).with_name("rtstack")


def run(*arguments: object, cwd: Path, **options) -> subprocess.CompletedProcess:
    """Run the command as a user would."""
    return subprocess.run(
        [str(COMMAND), *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120, **options
    )


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording by `rtstack teach`."""
    folder = tmp_path_factory.mktemp("cli")
    done = run("teach", "ref.mcap", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("recorded ref.mcap")
    return folder / "ref.mcap"


def _is_refused(done: subprocess.CompletedProcess, folder: Path, *words: str) -> None:
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert not list(folder.iterdir())


def test_a_trial_prints_one_json_object_with_the_fields_of_the_contract(recording, tmp_path):
    done = run("trial", "--reference", recording, "--displacement-mm", "15", "--json", "--log", "t.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == set(TrialResult.__dataclass_fields__)
    assert result["success"] is True
    assert result["log"] == "t.mcap"
    assert (tmp_path / "t.mcap").stat().st_size > 1e6
    review = run("review", "t.mcap", "--json", cwd=tmp_path)
    assert review.returncode == 0
    again = json.loads(review.stdout)["score"]
    assert again["average_force_norm"] == result["average_force_norm"]
    text = run("review", "t.mcap", cwd=tmp_path)
    assert "interim -> post_impact" in text.stdout
    assert "complete: nothing to recover" in run("recover", "t.mcap", cwd=tmp_path).stdout


BAD_TRIALS = [
    (["--object", "anvil"], ["anvil", "rice_box"]),
    (["--displacement-mm", "900"], ["900"]),
    (["--displacement-mm", "nan"], ["nan"]),
    (["--controller", "best"], ["proposed"]),
    (["--seed", "-1"], ["seed"]),
    (["--log", "missing/t.mcap"], ["missing"]),
    (["--log", "."], ["directory"]),
    (["--cell", "moon"], ["direct"]),
    (["--cell-file", "missing.toml"], ["missing.toml"]),
    (["--wrong"], ["--wrong"]),
]


@pytest.mark.parametrize(("arguments", "words"), BAD_TRIALS)
def test_bad_input_to_a_trial(recording, tmp_path, arguments, words):
    _is_refused(run("trial", "--reference", recording, *arguments, cwd=tmp_path), tmp_path, *words)


def test_a_log_that_exists_is_not_overwritten(recording, tmp_path):
    (tmp_path / "t.mcap").write_bytes(b"mine")
    done = run("trial", "--reference", recording, "--log", "t.mcap", cwd=tmp_path)
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
def test_a_reference_that_is_none(recording, tmp_path, name, words):
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    path = inputs / f"{name}.mcap"
    if name == "foreign":
        path.write_text("all work and no play")
    elif name == "truncated":
        path.write_bytes(recording.read_bytes()[:400_000])
    elif name == "folder":
        path.mkdir()
    folder = tmp_path / "work"
    folder.mkdir()
    _is_refused(run("trial", "--reference", path, "--log", "t.mcap", cwd=folder), folder, *words)


def test_a_foreign_mcap_as_reference(recording, tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    folder = tmp_path / "work"
    folder.mkdir()
    _is_refused(run("trial", "--reference", path, cwd=folder), folder, "not a log of ours")


class _StopAt:
    """Asks for a stop from the n-th tick on."""

    def __init__(self, tick: int) -> None:
        self._left = tick

    @property
    def stop_requested(self) -> bool:
        self._left -= 1
        return self._left < 0


def test_a_reference_without_an_impact(cell, tmp_path):
    """A demonstration that was broken off before the hands met the box."""
    path = tmp_path / "early.mcap"
    specification = DemonstrationSpecification()
    simulated = open_cell("direct", specification.object, 0.0, specification.seed)
    log = open_log(path, specification, cell, "direct", default_cell_file())
    result = run_demonstration(specification, cell, simulated, log=log, stop=_StopAt(700))
    simulated.close()
    assert "stop requested" in result.failure_reason
    folder = tmp_path / "work"
    folder.mkdir()
    _is_refused(run("trial", "--reference", path, cwd=folder), folder, "no impact")


def test_ctrl_c_brakes_finishes_the_log_and_ends_without_a_traceback(tmp_path):
    path = tmp_path / "early.mcap"
    process = subprocess.Popen(
        [str(COMMAND), "teach", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not path.exists():
        pass
    process.send_signal(2)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1, (out, err)
    assert "stop requested" in out
    assert err == ""
    assert read_log(path).complete


def test_teach_refuses_what_it_cannot_do(tmp_path):
    _is_refused(run("teach", "x.mcap", "--object", "anvil", cwd=tmp_path), tmp_path, "anvil")
    _is_refused(run("teach", "missing/x.mcap", cwd=tmp_path), tmp_path, "missing")
    _is_refused(run("review", "missing.mcap", cwd=tmp_path), tmp_path, "missing.mcap")
    _is_refused(run("recover", "missing.mcap", cwd=tmp_path), tmp_path, "missing.mcap")
    _is_refused(run("dance", cwd=tmp_path), tmp_path, "dance")


def test_a_read_only_folder(recording, tmp_path):
    if os.geteuid() == 0:
        target = "/proc/t.mcap"  # root may write anywhere but there
    else:
        (tmp_path / "locked").mkdir(mode=0o500)
        target = str(tmp_path / "locked" / "t.mcap")
    folder = tmp_path / "work"
    folder.mkdir()
    _is_refused(run("trial", "--reference", recording, "--log", target, cwd=folder), folder, "cannot write")


def test_help_answers(tmp_path):
    done = run("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in ("teach", "trial", "review", "recover", "up", "bench"):
        assert command in done.stdout
    assert run(cwd=tmp_path).stdout == done.stdout


def test_a_killed_log_process_fails_the_trial_and_the_rest_is_recovered(recording, tmp_path):
    """kill -9 in the middle: everything up to half a second before is there, and the trial says what to do."""
    path = tmp_path / "t.mcap"
    process = subprocess.Popen(
        [str(COMMAND), "trial", "--reference", str(recording), "--log", str(path), "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    attached = 1.1 * recording.stat().st_size  # the recording comes first in the file, then the samples
    while process.poll() is None and not (path.exists() and path.stat().st_size > attached):
        pass
    writers = [c for c in psutil.Process(process.pid).children() if "rtstack.log.process" in c.cmdline()]
    assert len(writers) == 1
    writers[0].kill()
    out, err = process.communicate(timeout=60)
    result = json.loads(out)
    assert process.returncode == 1
    assert result["success"] is False
    assert "rtstack recover" in result["failure_reason"]
    assert "Traceback" not in err
    before = read_log(path, truncated=True).topic("/left/arm")
    done = run("recover", path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    again = read_log(tmp_path / "t.recovered.mcap")
    samples = again.topic("/left/arm")
    assert again.metadata["trial"]["kind"] == "trial"
    assert len(samples) >= len(before) > 0
    assert set((np.diff(samples["t_ns"])).tolist()) == {1_000_000}
    # a chunk is at most a quarter of a second: what the file had grown to is what is given back
    assert len(again.topic("/right/control")) >= len(samples) - 500
