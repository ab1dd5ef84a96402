"""The public names with their signatures, from the source: what docs/reference/python.md lists.

    .venv/bin/python docs/generate/public_names.py      # writes docs/reference/public_names.txt

A test compares the file with the source, so that no public name changes without an entry in CHANGELOG.md.
"""

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/reference/python.md"
NAMES = ROOT / "docs/reference/public_names.txt"
_LISTED = re.compile(r"^::: ([\w.]+)\n(?:    options: \{members: \[([^\]]*)\]\}\n)?", re.MULTILINE)
_LONG = 120  # a default that is longer is left out
_FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)


class PageError(Exception):
    """The page lists what the source does not have."""


def listed() -> list[tuple[str, list[str] | None]]:
    """Return each module of the page with its members; None: all that have a docstring."""
    found = _LISTED.findall(PAGE.read_text())
    return [(module, re.split(r",\s*", members.strip()) if members else None) for module, members in found]


def lines() -> list[str]:
    """Return a line for each public name, class member included, in alphabetical order. Raises PageError."""
    made: list[str] = []
    for module, members in listed():
        for name in _documented(module) if members is None else members:
            made.extend(_described(f"{module}.{name}", *_definition(module, name)))
    return sorted(made)


def names() -> set[str]:
    """Return the public names of modules, with their module."""
    return {f"{module}.{name}" for module, some in listed() for name in (_documented(module) if some is None else some)}


@cache
def _tree(module: str) -> ast.Module:
    place = ROOT / module.replace(".", "/")
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    if not file.exists():
        raise PageError(f"{PAGE.name}: there is no module {module}")
    return ast.parse(file.read_text())


def _targets(node: ast.stmt) -> list[str]:
    """Return the names that a statement defines."""
    if isinstance(node, (*_FUNCTION, ast.ClassDef)):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]


def _documented(module: str) -> list[str]:
    """Return the names with a docstring that a module defines, in its order."""
    found, body = [], _tree(module).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, (*_FUNCTION, ast.ClassDef)):
            said = ast.get_docstring(node) is not None
        else:
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        found += [name for name in _targets(node) if said and not name.startswith("_")]
    return found


def _definition(module: str, name: str) -> tuple[str, ast.stmt]:
    """Return the module and the statement that define a name, also where a package imports it from its module."""
    for node in _statements(_tree(module).body):
        if name in _targets(node):
            return module, node
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _definition(node.module, alias.name)
    raise PageError(f"{PAGE.name}: {module} has no {name}: correct the page")


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    for node in body:
        yield node
        if isinstance(node, ast.If):  # TYPE_CHECKING
            yield from _statements(node.body)


def _described(path: str, module: str, node: ast.stmt) -> Iterator[str]:
    if isinstance(node, _FUNCTION):
        yield path + _signature(node)
    elif isinstance(node, ast.ClassDef):
        bases = ", ".join(map(ast.unparse, [*node.bases, *(each.value for each in node.keywords)]))
        yield f"{path}: class({bases})"
        for member in node.body:
            yield from _member(path, module, member)
    else:
        annotation = f": {ast.unparse(node.annotation)}" if isinstance(node, ast.AnnAssign) else ""
        yield path + annotation


def _member(path: str, module: str, node: ast.stmt) -> Iterator[str]:
    for name in _targets(node):
        if name.startswith("_") and name != "__init__":
            continue
        if isinstance(node, ast.ClassDef):
            yield f"{path}.{name}: class"
        elif not isinstance(node, _FUNCTION):
            said = ast.unparse(node)
            yield f"{path}.{said if len(said) < _LONG else said.partition(' = ')[0]}"
        elif {ast.unparse(each).rpartition(".")[2] for each in node.decorator_list} & {"property", "cached_property"}:
            yield f"{path}.{name}" + (f": {ast.unparse(node.returns)}" if node.returns else "")
        else:
            yield f"{path}.{name}{_signature(node)}"


def _signature(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    returned = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"({ast.unparse(node.args)}){returned}"


if __name__ == "__main__":
    try:
        NAMES.write_text("\n".join(lines()) + "\n")
    except PageError as error:
        sys.exit(str(error))
