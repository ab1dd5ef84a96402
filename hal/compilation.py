"""Where compiled code is kept: a folder that is named after the sources that it was compiled from.

numba keeps one cache a source file and does not see that a function which it inlined from another file has changed:
after an edit, old machine code would go on running. A folder a state of the sources cannot be stale.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

_TYPES: dict[Any, Any] = {}  # of arrays that were bound
_PREFIX = "rtstack-"
_LOCATOR = "hal.compiled_cache.SharedCacheLocator"
_ROOT = Path(__file__).resolve().parents[1]
# the packages in which something is compiled, and what they take constants from
_COMPILED = (
    "hal", "rtstack/control", "rtstack/log", "rtstack/loop", "rtstack/model", "rtstack/monitor", "rtstack/safety",
    "rtstack/studies/planar", "rtstack/teleoperation", "sim_robot",
)  # fmt: skip


def keep_compiled_code_by_its_sources() -> None:
    """Point numba's cache to the folder of the present sources. Call before anything is compiled."""
    folder = str(_base() / f"{_PREFIX}{_digest()}")
    # read by numba when it is imported, here and in child processes
    os.environ["NUMBA_CACHE_DIR"], os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = folder, _LOCATOR
    if "numba" in sys.modules:
        config = sys.modules["numba"].config
        config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = folder, _LOCATOR


def bound(function: Callable[..., Any], *arguments: Any, later: tuple[Any, ...] = ()) -> Callable[..., Any]:
    """Return a compiled function with its first arguments bound, compiled now: a call asks nobody for their types.

    later: what the arguments that are still to come look like; those that are arrays have to be contiguous. Such a call
    costs half of one through numba's dispatcher, which looks at each argument's type. Bind arrays, whose contents may
    change, and numbers that do not.
    """
    compile_for = getattr(function, "compile", None)
    if compile_for is None:  # NUMBA_DISABLE_JIT
        return partial(function, *arguments)
    import numba

    types = []
    for value in (*arguments, *later):
        if not isinstance(value, np.ndarray):
            types.append(numba.typeof(value))
            continue
        key = value.dtype, value.ndim, value.flags.num
        if key not in _TYPES:  # to find the type of a record takes a millisecond
            _TYPES[key] = numba.typeof(value)
        types.append(_TYPES[key])
    return partial(compile_for(tuple(types)), *arguments)


def _base() -> Path:
    """The user's choice, else the user's cache folder, else one for temporary files."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        path = Path(chosen)
        return path.parent if path.name.startswith(_PREFIX) else path
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    try:
        (cache / "rtstack").mkdir(parents=True, exist_ok=True)
    except OSError:
        cache = Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"
    return cache / "rtstack"


def _digest() -> str:
    digest = hashlib.sha256()
    for package in _COMPILED:
        for source in sorted((_ROOT / package).rglob("*.py")):
            digest.update(source.name.encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]
