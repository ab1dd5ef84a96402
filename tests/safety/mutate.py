"""Mutation testing of the judge: change one thing in its source, run its tests, see whether they notice.

    .venv/bin/python tests/safety/mutate.py [--minutes 30] [--jobs 1] [--module stop]

Own code, because the known tools cannot see it: mutmut leaves decorated functions alone, and all that counts here is
under `njit`; cosmic-ray rewrites the sources in place, under a stack that may be running them. Here the compiled
functions run as the plain Python that they are (NUMBA_DISABLE_JIT), a mutant is an import hook in a forked process, and
nothing is written. Prints killed / total; exit status 1 where a survivor is not listed in mutation_survivors.txt.
"""

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGE = ROOT / "rtstack" / "safety"
MODULES = ("stop", "checks", "judge", "geometry", "limits", "records", "body", "reasons")
TESTS = [
    str(HERE / f"test_{name}.py") for name in ("judge_boundaries", "judge_pair", "judge_stop", "judge", "safety_limits")
]
# what needs many runs of the judge says nothing about a mutant that the others do not; it runs with the compiled judge
SLOW = "not from_any_state and not masses_that and not whatever_is_wanted and not definitions and not no_chain"
SURVIVORS = HERE / "mutation_survivors.txt"
PATIENCE_S = 120

COMPARISONS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult}
FUNCTIONS = {"min": "max", "max": "min", "abs": "float", "all": "any"}

Change = tuple[str, Callable[[ast.AST], None]]


def _constant(value: object) -> Callable[[ast.AST], None]:
    def change(node: ast.AST) -> None:
        node.value = value

    return change


def _become(kind: type[ast.AST], **fields: object) -> Callable[[ast.AST], None]:
    def change(node: ast.AST) -> None:
        node.__class__ = kind
        for name, value in fields.items():
            setattr(node, name, value)

    return change


def _test(value: bool) -> Callable[[ast.AST], None]:
    def change(node: ast.AST) -> None:
        node.test = ast.copy_location(ast.Constant(value), node.test)

    return change


def changes(node: ast.AST) -> Iterator[Change]:
    """Yield what can be changed at a node: a description and a function that changes a copy in place."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            if type(op) in COMPARISONS:
                other = COMPARISONS[type(op)]

                def compare(n: ast.AST, k: int = k, other: type = other) -> None:
                    n.ops[k] = other()

                yield f"{type(op).__name__} -> {other.__name__}", compare
    elif isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC:
        other = ARITHMETIC[type(node.op)]

        def operate(n: ast.AST, other: type = other) -> None:
            n.op = other()

        yield f"{type(node.op).__name__} -> {other.__name__}", operate
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign or not dropped", _become(ast.BoolOp, op=ast.And(), values=[node.operand, node.operand])
    elif isinstance(node, ast.BoolOp):
        swapped = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield "and <-> or", lambda n: setattr(n, "op", swapped)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        if isinstance(node.value, bool):
            yield f"{node.value} -> {not node.value}", _constant(not node.value)
        else:
            yield f"{node.value} -> {node.value + 1}", _constant(node.value + 1)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        name = FUNCTIONS[node.func.id]
        yield (
            f"{node.func.id} -> {name}",
            lambda n: setattr(n, "func", ast.copy_location(ast.Name(name, ast.Load()), n)),
        )
    if isinstance(node, ast.If | ast.IfExp):
        yield "if -> if True", _test(True)
        yield "if -> if False", _test(False)
    if isinstance(node, ast.Assign | ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield "statement removed", _become(ast.Expr, value=ast.copy_location(ast.Constant(None), node))


def _mutable(tree: ast.Module) -> Iterator[int]:
    """Yield the indices in ast.walk of what may be changed: not decorators, annotations, nor the presence of names."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        parts = [
            *getattr(node, "decorator_list", []),
            getattr(node, "annotation", None),
            getattr(node, "returns", None),
        ]
        for part in filter(None, parts):
            skipped.update(id(inner) for inner in ast.walk(part))
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.Expr):
            skipped.add(id(node))
    return (i for i, node in enumerate(ast.walk(tree)) if id(node) not in skipped)


def mutants(module: str) -> Iterator[tuple[str, ast.Module]]:
    """Yield every mutant of a module: its name (module, function, line's text, change), and its tree."""
    source = (PACKAGE / f"{module}.py").read_text()
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    lines = source.splitlines()
    for index in _mutable(tree):
        for description, change in changes(nodes[index]):
            mutated = copy.deepcopy(tree)
            change(list(ast.walk(mutated))[index])
            line, column = nodes[index].lineno, nodes[index].col_offset
            yield f"{module}:{column}: {lines[line - 1].strip()} | {description}", mutated


class Import(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module from a tree instead of its file."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self._name, self._tree = f"rtstack.safety.{module}", ast.fix_missing_locations(tree)

    def find_spec(self, fullname: str, path: object, target: object = None):
        return importlib.util.spec_from_loader(fullname, self) if fullname == self._name else None

    def exec_module(self, module) -> None:
        exec(compile(self._tree, f"<mutant of {self._name}>", "exec"), module.__dict__)


def start(module: str, tree: ast.Module) -> int:
    """Fork a process that runs the tests on the mutant; it exits with 0 where they all pass. Returns its id."""
    child = os.fork()
    if child:
        return child
    signal.alarm(PATIENCE_S)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    status = 1
    try:
        import pytest

        for name in [n for n in sys.modules if n.startswith("rtstack.safety")]:
            del sys.modules[name]
        sys.meta_path.insert(0, Import(module, tree))
        status = pytest.main(
            [*TESTS, "-x", "-q", "--noconftest", "-p", "no:cacheprovider", "-W", "ignore", "--assert=plain", "-k", SLOW]
        )
    finally:
        os._exit(0 if status == 0 else 1)


def main() -> int:
    """Run all mutants within the time; return the exit status."""
    arguments = argparse.ArgumentParser(description="Mutation testing of the safety judge.")
    arguments.add_argument("--minutes", type=float, default=30.0, help="stop after this long; what was not run is told")
    arguments.add_argument("--jobs", type=int, default=1)
    arguments.add_argument("--module", choices=MODULES, action="append")
    options = arguments.parse_args()
    os.nice(19)
    sys.path[:0] = [str(ROOT), str(HERE)]
    os.chdir(ROOT)
    import hypothesis
    import numba  # noqa: F401 - loaded once, before the forks
    import pytest  # noqa: F401

    import rtstack.samples  # noqa: F401

    hypothesis.settings.register_profile("mutants", deadline=None, database=None, max_examples=30)
    hypothesis.settings.load_profile("mutants")
    start("stop", ast.parse((PACKAGE / "stop.py").read_text()))
    if os.wait()[1] != 0:
        print("the tests fail on the judge as it is: see to that first", file=sys.stderr)
        return 2
    waiting = [(m, name, tree) for m in options.module or MODULES for name, tree in mutants(m)]
    random.Random(0).shuffle(waiting)
    total, done, survivors = len(waiting), 0, []
    running: dict[int, str] = {}
    end = time.monotonic() + 60.0 * options.minutes
    while running or (waiting and time.monotonic() < end):
        while waiting and len(running) < options.jobs and time.monotonic() < end:
            module, name, tree = waiting.pop()
            running[start(module, tree)] = name
        child, status = os.wait()
        name = running.pop(child)
        done += 1
        if status == 0:
            survivors.append(name)
            print(f"survived  {name}", flush=True)
        elif done % 50 == 0:
            print(f"          {done} of {total}", flush=True)
    listed = {line.split(" # ")[0] for line in SURVIVORS.read_text().splitlines() if " # " in line}
    unlisted = [name for name in survivors if name not in listed]
    print(f"killed {done - len(survivors)} / {done}, of {total} mutants; {len(survivors)} survivors, "
          f"{len(unlisted)} of them not listed in {SURVIVORS.name}; not run: {total - done}")  # fmt: skip
    return 1 if unlisted or done < total else 0


if __name__ == "__main__":
    sys.exit(main())
