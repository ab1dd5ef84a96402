"""Compiled code is kept by the state of its sources: an edit anywhere in them gives another folder."""

import os
import subprocess
import sys

from hal import compilation


def test_the_folder_follows_the_sources(tmp_path, monkeypatch):
    for name, text in (
        ("hal/limits.py", "A = 1\n"),
        ("rtstack/control/law.py", "B = 1\n"),
        ("console/page.py", "C = 1\n"),
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(compilation, "_ROOT", tmp_path)
    first = compilation._digest()
    (tmp_path / "console/page.py").write_text("C = 2\n")
    assert compilation._digest() == first
    (tmp_path / "rtstack/control/law.py").write_text("B = 2\n")
    assert compilation._digest() != first


def test_a_program_and_its_children_share_one_folder(tmp_path):
    program = "import os, rtstack, sim_robot, numba; print(os.environ['NUMBA_CACHE_DIR'], numba.config.CACHE_DIR)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    seen = set()
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        seen.update(done.stdout.split())
        environment["NUMBA_CACHE_DIR"] = done.stdout.split()[0]
    assert len(seen) == 1
    assert seen.pop().startswith(str(tmp_path / "rtstack-"))
