"""`python -m rtstack.selftest`: it finds an installation that works, and one that does not."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psutil
import pytest

from hal.compilation import cache_folder
from rtstack import cells, selftest
from rtstack.log import reader
from rtstack.samples import LawInertia
from rtstack.trials import assembly


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder whose path is short: a socket of the stack's has a place in it (unix(7): 108 bytes)."""
    with TemporaryDirectory() as made:
        yield Path(made)


def _started(folder: Path, *options: str) -> subprocess.Popen[str]:
    """Start it in an empty folder, which is also home and holds temporary files, with this user's compiled code."""
    own = {"HOME": str(folder), "TMPDIR": str(folder), "NUMBA_CACHE_DIR": str(cache_folder())}
    command = [sys.executable, *options, "-m", "rtstack.selftest"]
    return subprocess.Popen(
        command, cwd=folder, env=os.environ | own, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_each_part_of_this_installation_is_ok_and_nothing_is_left(folder: Path) -> None:
    out, errors = (run := _started(folder, "-W", "error")).communicate(timeout=250)
    assert (run.returncode, errors) == (0, ""), out
    assert [line.split(maxsplit=2)[:2] for line in out.splitlines()] == [[name, "ok,"] for name in selftest.PARTS]
    assert list(folder.iterdir()) == []


def test_ctrl_c_ends_it_and_what_it_has_started(folder: Path) -> None:
    run = _started(folder)
    assert run.stdout is not None
    while run.stdout.read(1) != "\n":  # the first part is over
        assert run.poll() is None
    children = psutil.Process(run.pid).children(recursive=True)
    run.send_signal(signal.SIGINT)
    out, errors = run.communicate(timeout=100)
    assert (run.returncode, errors, out.splitlines()[-1].endswith("interrupted")) == (130, "", True)
    assert psutil.wait_procs(children, timeout=10.0)[1] == []
    assert list(folder.iterdir()) == []


def _run(monkeypatch: pytest.MonkeyPatch, *names: str) -> int:
    monkeypatch.setattr(selftest, "PARTS", {name: selftest.PARTS[name] for name in names})
    return selftest.main()


def test_a_law_without_the_motors_inertia_fails_the_tick(monkeypatch, capsys) -> None:
    papers = assembly.default_parameters()
    without = replace(papers, inertia=replace(papers.inertia, law_inertia=LawInertia.LINKS))
    monkeypatch.setattr(assembly, "default_parameters", lambda: without)
    assert _run(monkeypatch, "plant", "tick") == 1
    plant, tick = capsys.readouterr().out.splitlines()
    assert plant.startswith("plant ok, ")
    assert tick.startswith("tick  FAILED, the commanded acceleration is ")
    assert "`rtstack check`" in tick


def test_a_pad_of_another_mass_fails_the_plant(monkeypatch, capsys) -> None:
    cell, file = cells.load_description(None)
    heavier = replace(cell, pad=replace(cell.pad, mass=cell.pad.mass + 0.2))
    monkeypatch.setattr(cells, "load_description", lambda asked: (heavier, file))
    assert _run(monkeypatch, "plant") == 1
    assert "FAILED, held arms moved by 0.000" in (said := capsys.readouterr().out)
    assert "(limit 0.5)" in said


def test_a_log_that_lacks_a_message_fails_the_log(monkeypatch, capsys) -> None:
    whole = reader.Log.topic
    monkeypatch.setattr(reader.Log, "topic", lambda self, name: whole(self, name)[: -1 if "right" in name else None])
    assert _run(monkeypatch, "log") == 1
    assert "'/right/arm': (5364, 5363)" in capsys.readouterr().out


def test_what_is_raised_is_one_line(monkeypatch, capsys) -> None:
    def broken(_folder: Path) -> str:
        return str(np.zeros(2)[2])

    monkeypatch.setitem(selftest.PARTS, "tick", (broken, (), "do this"))
    assert _run(monkeypatch, "tick") == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("tick  FAILED, IndexError: ")
    assert "; do this, " in line


def test_a_part_whose_extra_is_missing_is_skipped(monkeypatch, capsys) -> None:
    monkeypatch.setattr("hal.base.extras.find_spec", lambda name: None)
    assert _run(monkeypatch, "plant", "tick", "page") == 0
    plant, tick, page = capsys.readouterr().out.splitlines()
    assert plant == "plant skipped, cryptography is not installed: pip install 'rtstack[sim]'"
    assert tick.startswith("tick  ok, ")
    assert page == "page  skipped, fastapi is not installed: pip install 'rtstack[console]'"
