"""What a compiled function is made from: its code, the constants that it takes from modules, and what it calls.

Found from the functions themselves, as numba finds them when it compiles, so that no list of files has to be kept and
functions of any package are covered. What was read from a file since then does not count: the code in memory does.
"""

import hashlib
from collections.abc import Iterator
from enum import EnumMeta
from functools import cache
from types import CodeType, ModuleType
from typing import Any

import numpy as np


def digest_of(function: Any) -> str:
    """Return a digest that changes with anything that the machine code of a numba dispatcher is made from."""
    digest, waiting, seen = hashlib.sha256(), [function], set()
    while waiting:
        next_one = waiting.pop()
        if id(next_one) in seen:
            continue
        seen.add(id(next_one))
        own, called = _parts(next_one)
        digest.update(own)
        waiting.extend(called)
    return digest.hexdigest()


@cache  # numba takes globals as they are at the first compilation, too
def _parts(function: Any) -> tuple[bytes, tuple[Any, ...]]:
    """Return the digest of a compiled function (or numba intrinsic) alone, and those that its code names."""
    source = _source(function)
    words, called = [source.__qualname__, repr(source.__defaults__), repr(getattr(function, "targetoptions", None))], []
    cells = dict(zip(source.__code__.co_freevars, source.__closure__ or (), strict=True))
    for code in _nested(source.__code__):
        constants = [value for value in code.co_consts if not isinstance(value, CodeType)]
        words.append(repr((code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars)))
        for name in (*code.co_names, *code.co_freevars):
            found = cells[name].cell_contents if name in cells else source.__globals__.get(name)
            of_module = (
                [getattr(found, other, None) for other in code.co_names] if isinstance(found, ModuleType) else []
            )
            for value in (found, *of_module):
                if _source(value) is None:
                    words.append(f"{name} = {_told(value)}")
                else:
                    called.append(value)
    return hashlib.sha256("\n".join(words).encode()).digest(), tuple(called)


def _source(value: Any) -> Any:
    """The Python function of what numba compiles, None of anything else."""
    for name in ("py_func", "_defn"):  # of a dispatcher, of an intrinsic
        if hasattr(getattr(value, name, None), "__code__"):
            return getattr(value, name)
    return None


def _nested(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def _told(value: Any) -> str:
    """Return a text that is the same in each process, and another one for another value."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype!r} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__}({', '.join(map(_told, value))})"
    if isinstance(value, EnumMeta):
        return repr(list(value))
    if hasattr(value, "__qualname__"):  # a class or function
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, ModuleType):  # its path is none of the code
        return value.__name__
    return repr(value)
