"""Compiled code is kept for the next process, and never used after an edit of anything that it was made from."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = {
    "__init__.py": "",
    "numbers_.py": "FACTOR = 2.0\nOFFSETS = (0.0, 10.0)\n",
    "below.py": "from hal.compilation import compiled\nfrom outside import numbers_\n\n\n"
    "@compiled\ndef below(x):\n    return x + numbers_.OFFSETS[1]\n",
    "inner.py": "from hal.compilation import compiled\nfrom outside.below import below\n"
    "from outside.numbers_ import FACTOR\n\n\n@compiled\ndef inner(x):\n    return FACTOR * below(x)\n",
    "outer.py": "from hal.compilation import compiled\nfrom outside.inner import inner\n\n\n"
    "def made(step):\n    @compiled\n    def outer(x):\n        return inner(x) + step\n\n    return outer\n\n\n"
    "outer = made(0.5)\n",
}
CALL = "from outside.outer import outer; print(outer(1.0), sum(outer.stats.cache_misses.values()))"


class Outside:
    """A package of compiled functions that is none of ours, and a folder for its machine code."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.write(**{name.removesuffix(".py"): text for name, text in FILES.items()})

    def write(self, **files: str) -> None:
        (self._folder / "outside").mkdir(exist_ok=True)
        for name, text in files.items():
            (self._folder / "outside" / f"{name}.py").write_text(text)

    def start(self, program: str = CALL) -> "subprocess.Popen[str]":
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(self._folder / "cache"),
            "PYTHONPATH": f"{self._folder}:{ROOT}",
            "PYTHONDONTWRITEBYTECODE": "1",  # Python itself sees an edit by time and size only
        }
        return subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE, text=True)

    def run(self, program: str = CALL) -> list[str]:
        with self.start(program) as process:
            said, _ = process.communicate(timeout=60)
        assert process.returncode == 0
        return said.split()


@pytest.fixture
def outside(tmp_path: Path) -> Outside:
    return Outside(tmp_path)


@pytest.mark.parametrize(
    ("name", "before", "after", "result"),
    [
        pytest.param("numbers_", "2.0", "3.0", "33.5", marks=pytest.mark.long),
        pytest.param("numbers_", "10.0", "20.0", "42.5", marks=pytest.mark.long),
        ("below", "x +", "x -", "-17.5"),
        pytest.param("inner", "FACTOR *", "FACTOR +", "13.5", marks=pytest.mark.long),
        pytest.param("outer", "made(0.5)", "made(1.5)", "23.5", marks=pytest.mark.long),
    ],
)
def test_an_edit_is_never_answered_by_old_machine_code(
    outside: Outside, name: str, before: str, after: str, result: str
) -> None:
    assert outside.run() == ["22.5", "1"]
    assert outside.run() == ["22.5", "0"]
    outside.write(**{name: FILES[f"{name}.py"].replace(before, after)})
    assert outside.run() == [result, "1"]
    assert outside.run() == [result, "0"]


SLOW = """
import sys, time
from numba.core.caching import IndexDataCacheFile
read = IndexDataCacheFile._load_index
def read_slowly(cache):
    found = read(cache)
    time.sleep(1.0)
    return found
IndexDataCacheFile._load_index = read_slowly
from outside.below import below
print("ready", flush=True)
below({argument})
"""


def test_a_module_that_is_gone_is_not_looked_for(outside: Outside, tmp_path: Path) -> None:
    """Kept machine code names the modules of what it calls."""
    assert outside.run() == ["22.5", "1"]
    outside.write(under=FILES["below.py"], inner=FILES["inner.py"].replace("outside.below", "outside.under"))
    (tmp_path / "outside" / "below.py").unlink()
    assert outside.run() == ["22.5", "1"]
    assert outside.run() == ["22.5", "0"]


@pytest.mark.long
def test_two_processes_that_compile_at_once_keep_what_is_each_ones(outside: Outside) -> None:
    """Neither takes the other's number: each waits until the other one has written."""
    outside.write(below=FILES["below.py"].replace("numbers_.OFFSETS[1]", "x"))
    processes = [outside.start(SLOW.format(argument=argument)) for argument in ("1", "1.5")]
    for process in processes:
        with process:
            assert process.communicate(timeout=60)[0] == "ready\n"
        assert process.returncode == 0
    look = "from outside.below import below as f; print(f(1), f(1.5), sum(f.stats.cache_misses.values()))"
    assert outside.run(look) == ["2", "3.0", "0"]


BOUND = """
import gc
from typing import NamedTuple
import numpy as np
from hal.compilation import bound, compiled
from outside.below import below

class Pair(NamedTuple):
    matrix: np.ndarray
    vector: np.ndarray

@compiled
def work(counter, pair, k, factor, records, added, more):
    counter[0] += 1
    return counter[0] + k * pair.matrix[0, 1] + factor * pair.vector[1] + records[0].q[1] + below(added) + more[0]

records = np.zeros(3, [("q", "f8", 2)])
records["q"][1, 1] = 0.25
counter = np.zeros(1, np.int64)
pair = Pair(np.asfortranarray([[0.0, 3.0], [0.0, 0.0]]), np.array([0.0, 8.0, 16.0])[::2])
work = bound(work, counter, pair, 2, 0.5, records[1:2], later=(0.0, np.zeros(1)))
del records, pair
gc.collect()
others = [np.ones(2) for _ in range(1000)]  # where forgotten arrays would have been
print(work(1.0, np.array([100.0])), work(1.0, np.array([100.0])), counter[0])
"""


@pytest.mark.long
def test_arrays_that_are_bound_are_found_again_at_each_call(outside: Outside, tmp_path: Path) -> None:
    """A named tuple, two numbers, another order, a step, a slice of records: 1 + 2 * 3 + 0.5 * 16 + 0.25 + 11 + 100."""
    outside.write(bound_=BOUND)
    assert outside.run("import outside.bound_") == ["126.25", "127.25", "2"]
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.nbc")}
    assert outside.run("import outside.bound_") == ["126.25", "127.25", "2"]
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.nbc")} == kept
    outside.write(below=FILES["below.py"].replace("x +", "x -"))
    assert outside.run("import outside.bound_") == ["106.25", "107.25", "2"]


def test_all_that_is_compiled_is_kept_this_way() -> None:
    """No function of ours goes to numba directly, whose cache misses edits."""
    sources = [
        path for package in ("hal", "sim_robot", "rtstack", "console") for path in (ROOT / package).rglob("*.py")
    ]
    used = {path.name for path in sources if re.search(r"\b(njit|jit|cfunc|vectorize|guvectorize)\(", path.read_text())}
    assert used == {"compilation.py"}


def test_code_from_a_pipe_is_compiled_and_not_kept():
    """What is tried at a prompt has no file either."""
    text = """
import numpy as np
from hal.compilation import bound_in_turn, compiled

@compiled
def add(out, step):
    out[0] += step

out = np.zeros(1)
bound_in_turn([(add, (out, 1.0)), (add, (out, 2.0))])()
print(out[0])
"""
    ran = subprocess.run([sys.executable, "-"], input=text, capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("3.0\n", "")
