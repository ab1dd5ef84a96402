"""The changes that mutation testing makes to a source: one mutant for each of them.

Left alone: names, texts, decorators, annotations, and whether a module's own assignments are there at all.
"""

import ast
import marshal
import pickle
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

COMPARISONS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult}
FUNCTIONS = {"min": "max", "max": "min", "abs": "float", "all": "any"}

Change = tuple[str, Callable[[Any], None]]  # of a node of the kind that it was found at


def _constant(value: object) -> Callable[[Any], None]:
    def change(node: Any) -> None:
        node.value = value

    return change


def _become(kind: type[ast.AST], **fields: object) -> Callable[[Any], None]:
    def change(node: Any) -> None:
        node.__class__ = kind
        for name, value in fields.items():
            setattr(node, name, value)

    return change


def _test(value: bool) -> Callable[[Any], None]:
    def change(node: Any) -> None:
        node.test = ast.copy_location(ast.Constant(value), node.test)

    return change


def changes(node: ast.AST) -> Iterator[Change]:
    """Yield what can be changed at a node: a description and a function that changes a copy in place."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            if type(op) in COMPARISONS:
                other = COMPARISONS[type(op)]

                def compare(n: Any, k: int = k, other: type = other) -> None:
                    n.ops[k] = other()

                yield f"{type(op).__name__} -> {other.__name__}", compare
    elif isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC:
        other = ARITHMETIC[type(node.op)]

        def operate(n: Any, other: type = other) -> None:
            n.op = other()

        yield f"{type(node.op).__name__} -> {other.__name__}", operate
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign or not dropped", _become(ast.BoolOp, op=ast.And(), values=[node.operand, node.operand])
    elif isinstance(node, ast.BoolOp):
        swapped = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield "and <-> or", lambda n: setattr(n, "op", swapped)
        neutral = isinstance(node.op, ast.And)
        for k in range(len(node.values)):

            def drop(n: Any, k: int = k) -> None:
                n.values[k] = ast.copy_location(ast.Constant(neutral), n)

            yield f"condition {k + 1} dropped", drop
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
    elif isinstance(node, ast.Return) and not isinstance(node.value, ast.Constant | None):
        yield "return None", _become(ast.Return, value=ast.copy_location(ast.Constant(None), node))
    if isinstance(node, ast.If | ast.IfExp):
        yield "if -> if True", _test(True)
        yield "if -> if False", _test(False)
    if isinstance(node, ast.Assign | ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield "statement removed", _become(ast.Expr, value=ast.copy_location(ast.Constant(None), node))


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed module. function: the path of the changed function in it, or none where the change is outside of any.

    name: module.function:column: the line | the change, and which one, where a function has several of that name.
    lines: first and last of what was changed, a test that runs none of them cannot notice. code: the module's.
    """

    name: str
    module: str
    function: str | None
    lines: tuple[int, int]
    code: CodeType


def mutants(path: Path) -> Iterator[Mutant]:
    """Yield the mutants of a module that differ from it, and from one another, as compiled."""
    source = path.read_text()
    tree = ast.parse(source)
    nodes: list[Any] = list(ast.walk(tree))
    lines, pickled = source.splitlines(), pickle.dumps(tree)
    homes = dict(_homes(tree, None, (0, 0)))
    seen, names = {_content(compile(tree, str(path), "exec"))}, Counter[str]()
    for index, node in enumerate(nodes):
        if node not in homes:
            continue
        function, span = homes[node]
        for description, change in changes(node):
            mutated = pickle.loads(pickled)
            change(_nth(mutated, index))
            code = compile(ast.fix_missing_locations(mutated), str(path), "exec")
            where = f"{path.stem}.{function or 'module'}:{node.col_offset}"
            name = f"{where}: {lines[node.lineno - 1].strip()} | {description}"
            names[name] += 1
            if _content(code) not in seen:
                seen.add(_content(code))
                number = f" ({names[name]})" if names[name] > 1 else ""
                yield Mutant(name + number, path.stem, function, span, code)


def functions(code: CodeType) -> Iterator[tuple[str, CodeType]]:
    """Yield path and code of the functions and classes that stand in a module's code or a class's."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant.co_qualname, constant
            if not constant.co_flags & 0x2:  # CO_NEWLOCALS: a function; what is inside belongs to it
                yield from functions(constant)


def _nth(tree: ast.Module, index: int) -> ast.AST:
    return next(node for k, node in enumerate(ast.walk(tree)) if k == index)


def _homes(
    node: ast.AST, function: str | None, span: tuple[int, int], path: str = ""
) -> Iterator[tuple[ast.AST, tuple[str | None, tuple[int, int]]]]:
    """Yield what may be changed, and for each the function that it is in and the lines that it runs with."""
    for name, value in ast.iter_fields(node):
        if name in ("decorator_list", "annotation", "returns"):
            continue
        # defaults are computed where the function is defined, not in it
        inside = function or (path if isinstance(node, ast.FunctionDef) and name == "body" else None)
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST):
                continue
            lines, deeper = span, path
            if isinstance(child, ast.stmt | ast.arguments):
                lines = _span(child)
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                deeper = f"{path}.{child.name}" if path else child.name
            yield from _homes(child, inside, lines, deeper)
            if hasattr(child, "lineno") and not (isinstance(node, ast.Module) and not _is_compound(child)):
                yield child, (inside, lines)


def _is_compound(node: ast.AST) -> bool:
    return hasattr(node, "body")


def _span(node: Any) -> tuple[int, int]:
    """Return the lines of a statement, of a compound one those of its head."""
    first = getattr(node, "lineno", 0)
    if _is_compound(node):
        return first, max(first, node.body[0].lineno - 1)
    return first, getattr(node, "end_lineno", first)


def _content(code: CodeType) -> bytes:
    """Return what a code does, without the places in the source where it stands."""

    def bare(value: object) -> Any:
        if isinstance(value, CodeType):
            constants = tuple(bare(constant) for constant in value.co_consts)
            return value.replace(co_consts=constants, co_linetable=b"", co_firstlineno=1)
        return value

    return marshal.dumps(bare(code), 2)
