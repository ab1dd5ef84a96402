"""`import` of our packages leaves the caller's process as it is: a notebook's settings are its own."""

import json
import subprocess
import sys

import pytest

from tests.support.sampling import sampled

PACKAGES = ("hal", "sim_robot", "rtstack", "console", "deploy")
# all modules but those that are programs; the libraries beforehand, since what they do is theirs
PROGRAM = """
import gc, importlib, json, os, pkgutil, signal, sys, threading, warnings
import numba, numba.core.caching, numpy, scipy, mujoco, matplotlib, matplotlib.pyplot, pinocchio, distributed, fastapi
import typer, viser, uvicorn, trimesh
from numba.core.caching import CacheImpl, IndexDataCacheFile

def state():
    return {
        "environment": dict(os.environ),
        "signals": {str(number): repr(signal.getsignal(number)) for number in signal.valid_signals()},
        "wake-up descriptor": signal.set_wakeup_fd(-1),
        "numba": {name: repr(value) for name, value in vars(numba.config).items() if name.isupper()},
        "numba's cache": [repr(CacheImpl._locator_classes), repr(IndexDataCacheFile.save)],
        "numba's threads": numba.get_num_threads(),
        "threads": threading.active_count(),
        "warnings": [repr(entry) for entry in warnings.filters],
        "error handling": repr(numpy.geterr()),
        "printing": repr(numpy.get_printoptions()),
        "backend": matplotlib.get_backend(),
        "plots": {name: repr(value) for name, value in matplotlib.rcParams.items()},
        "folder": os.getcwd(),
        "mask": os.umask(0o22),
        "collection": [gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()],
        "interpreter": [sys.getswitchinterval(), sys.getrecursionlimit(), repr(sys.excepthook), sys.path],
        "processors": sorted(os.sched_getaffinity(0)),
        "scheduling": os.sched_getscheduler(0),
        "random": repr(numpy.random.get_state()[1][:4]),
    }

os.umask(0o22)
before = state()
for package in sys.argv[1:]:
    importlib.import_module(package)
    if MODULES:
        for found in pkgutil.walk_packages(sys.modules[package].__path__, f"{package}."):
            if not found.name.endswith("__main__"):
                try:
                    importlib.import_module(found.name)
                except ModuleNotFoundError as error:  # the vendor's client is not published for every Python
                    if error.name != "pylibfranka" or sys.version_info < (3, 13):
                        raise
after = state()
print(json.dumps({name: [str(before[name]), str(after[name])] for name in before if before[name] != after[name]}))
"""


@pytest.mark.parametrize("modules", sampled((False, True), bool), ids=["packages", "their modules"])
def test_an_import_changes_nothing_in_the_callers_process(modules: bool) -> None:
    program = f"MODULES = {modules}\n{PROGRAM}"
    done = subprocess.run([sys.executable, "-c", program, *PACKAGES], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {}
