"""The changes that mutation testing makes to a source: one mutant for each of them."""

import ast
import copy
from collections.abc import Callable, Iterator
from pathlib import Path

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


def mutants(path: Path) -> Iterator[tuple[str, ast.Module]]:
    """Yield every mutant of a module: its name (module, column, line's text, change), and its tree."""
    source = path.read_text()
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    lines = source.splitlines()
    for index in _mutable(tree):
        for description, change in changes(nodes[index]):
            mutated = copy.deepcopy(tree)
            change(list(ast.walk(mutated))[index])
            line, column = nodes[index].lineno, nodes[index].col_offset
            yield f"{path.stem}:{column}: {lines[line - 1].strip()} | {description}", mutated
