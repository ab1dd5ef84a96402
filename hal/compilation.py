"""Compiled functions, and where their machine code is kept from one process to the next.

numba's own cache (`cache=True`) looks at a function's own file only: after an edit of a function that was inlined from
another file, old machine code would go on running. Here machine code is kept under a digest of all that it is made
from, in a folder of the user's, and written under a lock. It is a property of each function: numba's settings, and
functions that others compile, stay as they are.
"""

import atexit
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from enum import EnumMeta
from functools import cache, partial
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, ParamSpec, cast, overload

import numba
import numpy as np
from numba.core import config, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from hal.base.files import locked
from hal.base.shared import private_folder, refuse_foreign

P = ParamSpec("P")
Step = tuple[Callable[..., Any], tuple[Any, ...]]  # a compiled function and its arguments
_TYPES: dict[Any, Any] = {}  # of arrays that were bound
_ending = ExitStack()  # of this process
atexit.register(_ending.close)


# the result is Any: to infer it, a checker would read the body of each compiled function at each call
@overload
def compiled(signature: Callable[P, Any]) -> Callable[P, Any]: ...
@overload
def compiled(signature: str | None = None, **options: Any) -> Callable[[Callable[P, Any]], Callable[P, Any]]: ...
def compiled(signature: Callable[..., Any] | str | None = None, **options: Any) -> Any:
    """Compile a function as numba.njit does, with the error model of numpy, and keep the machine code.

    Used as `@compiled`, or with a signature and numba's options, as `@compiled("void(int64)", nogil=True)`: then it is
    compiled at once, for this signature only. For functions of any package.
    """
    if callable(signature):
        return compiled()(signature)

    def compile_and_keep(function: Callable[..., Any]) -> Any:
        # nothing here is called by C code or passed as a value: a wrapper for that would be compiled for nothing
        with_defaults: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
        made: Any = numba.njit(**with_defaults)(function)
        if made is not function:  # NUMBA_DISABLE_JIT
            with suppress(RuntimeError):  # code from a prompt or a pipe has no file that kept machine code belongs to
                made._cache = cache = _Cache(made)
                made.compile = partial(cache.compile_alone, made.compile)
            if signature is not None:
                made.compile(signature)
                made.disable_compile()
        return made

    return compile_and_keep


def bound(function: Callable[..., Any], *arguments: Any, later: tuple[Any, ...] = ()) -> Callable[..., Any]:
    """Return a compiled function with its first arguments bound, compiled now: a call looks at none of them.

    later: what the arguments that are still to come look like; those that are arrays have to be contiguous. Bind
    arrays, whose contents may change, named tuples of arrays, int, bool (it becomes an int) and float. numba's own call
    makes and forgets an object for each array, 40 ns and more; here a call gets the address of what they are made of.
    """
    if not hasattr(function, "compile"):  # NUMBA_DISABLE_JIT
        return partial(function, *arguments)
    if not arguments:
        return cast(Any, function).compile(tuple(map(_type_of, later)))
    return _bound(((function, arguments),), later)


def bound_in_turn(steps: Sequence[Step]) -> Callable[[], Any]:
    """Return one compiled function that calls several ones in turn, each with its arguments bound, as `bound` does.

    Args:
        steps: compiled functions, each with its arguments; at least one.

    Returns:
        A function without arguments. It returns what the last step returns.
    """
    if not hasattr(steps[0][0], "compile"):  # NUMBA_DISABLE_JIT
        return lambda: [function(*arguments) for function, arguments in steps][-1]
    return _bound(tuple(steps), ())


def _bound(steps: tuple[Step, ...], later: tuple[Any, ...]) -> Callable[..., Any]:
    plain = [tuple(int(v) if isinstance(v, bool) else v for v in arguments) for _, arguments in steps]
    words = np.array([word for arguments in plain for word in _words(arguments)], np.int64)
    functions = tuple(function for function, _ in steps)
    kinds = tuple(tuple(map(_type_of, arguments)) for arguments in plain)
    made = partial(_entry(functions, kinds, tuple(map(_type_of, later))), words.ctypes.data)
    made.__dict__["kept"] = words, plain  # as long as the function may be called
    return made


def fields(kind: str, names: str, *shape: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return the fields of a record that are named by the words of `names`, all of this kind and shape."""
    return [(name, kind, shape) for name in names.split()]


def _type_of(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return numba.typeof(value)
    key = value.dtype, value.ndim, value.flags.num
    if key not in _TYPES:  # to find the type of a record takes a millisecond
        _TYPES[key] = numba.typeof(value)
    return _TYPES[key]


def _words(arguments: tuple[Any, ...]) -> Iterator[int]:
    """Give what numba makes of these, 8 bytes each (numba.core.datamodel.models.ArrayModel: no owner, no parent)."""
    for value in arguments:
        if isinstance(value, np.ndarray):
            yield from (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
        elif isinstance(value, tuple):
            yield from _words(value)
        elif isinstance(value, float):
            yield int(np.float64(value).view(np.int64))
        elif isinstance(value, int):
            yield value
        else:
            raise TypeError(f"an array, a tuple of arrays, an int or a float can be bound, not {value!r}")


@cache
def _entry(
    functions: tuple[Any, ...], bound_types: tuple[Any, ...], later_types: tuple[Any, ...]
) -> Callable[..., Any]:
    """Return what calls compiled functions in turn with arguments of these types, given the address of those that are
    bound. The last one gets the later arguments too.

    Compiled once for functions and types, and kept beside the first function's own machine code.
    """
    packed = types.Tuple([kind for own in bound_types for kind in own])

    @intrinsic
    def load(_typing: Any, _address: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, given: Any) -> Any:
            return builder.load(builder.inttoptr(given[0], context.get_value_type(packed).as_pointer()))

        return packed(types.intp), generate

    sources = [function.py_func for function in functions]
    others = "".join(f", a{k}" for k in range(len(later_types)))
    calls, first = [], 0
    for number, own in enumerate(bound_types):
        calls.append(f"function{number}({', '.join(f'bound[{first + k}]' for k in range(len(own)))}")
        first += len(own)
    lines = [f"    {call})\n" for call in calls[:-1]] + [f"    return {calls[-1]}{others})\n"]
    key = repr(([f"{s.__module__}.{s.__qualname__}" for s in sources[1:]], bound_types, later_types))
    name = f"{sources[0].__name__}_{hashlib.sha256(key.encode()).hexdigest()[:12]}"
    text = f"def {name}(address{others}):\n    bound = load(address)\n{''.join(lines)}"
    names = {f"function{number}": function for number, function in enumerate(functions)}
    names |= {"__name__": sources[0].__module__, "load": load}
    exec(compile(text, sources[0].__code__.co_filename, "exec"), names)
    entry: Any = compiled(nogil=functions[0].targetoptions.get("nogil", False))(names[name])
    return entry.compile((types.intp, *later_types))


def cache_folder() -> Path:
    """Return where machine code is kept, which other users cannot change: numba's files are pickles.

    The folder that the user chose for numba, else one of the user's cache, else one among the temporary files; where
    none of these is the user's alone, one that ends with this process.
    """
    chosen = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]  # numba sets it at import
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return _own_cache(chosen, cache, tempfile.gettempdir())


@cache
def _own_cache(chosen: str, user: str, temporary: str) -> Path:
    why = ""
    for base, *below in ([chosen], [user, "rtstack", "compiled"], [temporary, f"cache-{os.getuid()}", "compiled"]):
        if not base or base.startswith("~"):  # nothing was chosen, or there is no home
            continue
        folder = Path(base)
        try:
            for name in ("", *below):
                folder /= name
                folder.mkdir(0o700, parents=not name, exist_ok=True)
            refuse_foreign(folder)
            return folder
        except OSError as error:
            why = f"{error.filename}: {error.strerror}"
    folder = _ending.enter_context(private_folder("compiled"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)  # for the processes that this one starts
    print(f"rtstack: machine code is not kept ({why}): name a folder of your own by XDG_CACHE_HOME", file=sys.stderr)
    return folder


class _Locator(InTreeCacheLocator):
    """Names a folder of the user's for each folder of sources."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(cache_folder() / self.get_suitable_cache_subpath(file))


class _Files(CompileResultCacheImpl):
    _locator_classes = (_Locator, *CompileResultCacheImpl._locator_classes)  # the others: of functions without a file


class _Cache(FunctionCache):
    """numba's cache of one function, with its digest for the time of its file, and a lock.

    One process at a time loads or compiles it: another one that needs the same waits and loads what was made. Without a
    lock, two that compile different signatures at the same moment would also take the same number for their files.
    """

    _impl_class = _Files

    def __init__(self, function: Any) -> None:
        super().__init__(function.py_func)
        self._function = function
        self._lock, self._held = Path(self._cache_path) / f"{self._impl.filename_base}.lock", False

    def compile_alone(self, compile_here: Callable[[Any], Any], signature: Any) -> Any:
        """Load or compile, with numba's own method. What it calls is compiled within: no call leads back, so no two
        processes wait for one another.
        """
        with global_compiler_lock:
            if self._held:  # a function that calls itself
                return compile_here(signature)
            with locked(self._lock):
                self._held = True
                try:
                    return compile_here(signature)
                finally:
                    self._held = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # now, not when it is decorated: what it calls may stand below it
        self._cache_file._source_stamp = digest_of(self._function)
        return super().load_overload(sig, target_context)


def digest_of(function: Any) -> str:
    """Return a digest that changes with anything that the machine code of a numba dispatcher is made from.

    Its code, the constants that it takes from modules, and what it calls, found as numba finds them when it compiles:
    no list of files has to be kept, and functions of any package are covered. The code in memory counts, not its file.
    """
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
    # kept machine code names the module: it is imported when the code is loaded
    words, called = [source.__module__, source.__qualname__, repr(source.__defaults__)], []
    words.append(repr(getattr(function, "targetoptions", None)))
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
