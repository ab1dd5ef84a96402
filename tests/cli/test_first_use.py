"""What motions need is compiled once, before a stack starts."""

import os
import subprocess
import sys

import pytest

from rtstack.cli import first_use

COMPILE = "from rtstack.cli.first_use import compile_once; compile_once(2)"
SAID = "rtstack: compiling, once for this machine: about 50 s\n"


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
    first_use.compile_once(2)
    assert capsys.readouterr() == ("", SAID)
    child("raise SystemExit('a second time')")
    first_use.compile_once(2)
    assert capsys.readouterr() == ("", "")


def test_what_is_not_compiled_is_one_line_and_comes_once(child, capsys):
    child("import sys; sys.exit('no room')")
    first_use.compile_once(2)
    first_use.compile_once(2)
    line = "rtstack: not everything is compiled, the first motion waits for the rest: no room\n"
    assert capsys.readouterr() == ("", SAID + line)


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
