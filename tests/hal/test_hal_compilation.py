"""Compiled code is kept by the state of its sources: an edit anywhere in them gives another folder."""

import contextlib
import os
import subprocess
import sys
import threading

from numba.core.caching import IndexDataCacheFile

import hal.compiled_cache  # noqa: F401  # the lock
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


def test_two_that_compile_at_once_keep_what_is_each_ones(tmp_path, monkeypatch):
    """Neither takes the other's number: each waits until the other one has written."""
    read, both_have_read = IndexDataCacheFile._load_index, threading.Barrier(2)

    def read_and_wait(cache):
        found = read(cache)
        with contextlib.suppress(threading.BrokenBarrierError):
            both_have_read.wait(0.5)
        return found

    def save(key):
        IndexDataCacheFile(str(tmp_path), "f", "stamp").save(key, f"code for {key}")

    monkeypatch.setattr(IndexDataCacheFile, "_load_index", read_and_wait)
    savers = [threading.Thread(target=save, args=(key,)) for key in ("int", "float")]
    for saver in savers:
        saver.start()
    for saver in savers:
        saver.join()
    monkeypatch.setattr(IndexDataCacheFile, "_load_index", read)
    for key in ("int", "float"):
        assert IndexDataCacheFile(str(tmp_path), "f", "stamp").load(key) == f"code for {key}"


def test_every_process_that_compiles_writes_under_the_lock():
    program = (
        "import rtstack.model.rotation; from numba.core.caching import IndexDataCacheFile as file;"
        "print(hasattr(file.save, '__wrapped__'))"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE_LOCATOR")}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]
