"""What motions need is compiled once, before arms may be moved."""

import os
import subprocess
import sys
import threading

import pytest

from hal.base.files import locked
from rtstack.live import first_use
from rtstack.live.first_use import FirstUse

COMPILE = "from rtstack.live.first_use import FirstUse; FirstUse(2).wait()"
SAID = "rtstack: compiling, once for this machine: about 30 s\n"


@pytest.fixture
def child(tmp_path, monkeypatch):
    """Have what compiles be a program; give what starts it, and an empty cache."""
    folder = tmp_path / "compiled"
    folder.mkdir()
    monkeypatch.setattr(first_use, "cache_folder", lambda: folder)

    def be(program):
        popen = subprocess.Popen
        monkeypatch.setattr(
            first_use.subprocess, "Popen", lambda _, **pipes: popen([sys.executable, "-c", program], **pipes)
        )

    return be


def test_it_is_done_once_and_says_so_before(child, capsys):
    child("")
    FirstUse(2).wait()
    assert capsys.readouterr() == ("", SAID)
    child("raise SystemExit('a second time')")
    FirstUse(2).wait()
    assert capsys.readouterr() == ("", "")


def test_what_is_not_compiled_is_one_line_and_comes_once(child, capsys):
    child("import sys; sys.exit('no room')")
    FirstUse(2).wait()
    FirstUse(2).wait()
    line = "rtstack: not all is compiled, a motion waits for the rest: no room\n"
    assert capsys.readouterr() == ("", SAID + line)


def test_meanwhile_a_robot_process_refuses_motions_and_says_how_far_it_is(child, capsys, tmp_path):
    child("")
    robots = FirstUse(2)
    assert robots.refusal() is None  # nobody is at it
    with locked(tmp_path / "compiled/complete.lock"):
        robots = FirstUse(2)
        assert robots.refusal() == "compiling, once for this machine: 0%"
    FirstUse(2).begin()
    for thread in threading.enumerate():
        if thread.name == "compiling":
            thread.join()
    assert robots.refusal() is None
    assert robots.done
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.long
@pytest.mark.timeout(1200)  # a busy machine compiles for minutes
def test_nothing_is_left_to_be_compiled_by_a_motion(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run([sys.executable, "-c", COMPILE], env=environment, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", SAID)
    compiled = sorted(tmp_path.rglob("*.nbc"))
    assert len(compiled) >= 0.9 * first_use._FILES[2]  # what the progress is counted against
    command = [sys.executable, "-m", "rtstack"]
    for words in (("teach", "ref.mcap"), ("trial", "--reference", "ref.mcap"), ("play", "ref.mcap")):
        subprocess.run([*command, *words], cwd=tmp_path, env=environment)
    assert sorted(tmp_path.rglob("*.nbc")) == compiled
