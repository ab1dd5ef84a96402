"""The examples' page, from the examples."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))

_HEAD = """# Examples

Each is a few lines of Python, to be read and to be changed. They run in the order of their numbers, in one folder:
later ones read what earlier ones have written. All of them run in our tests. `examples/first_grab.ipynb` is a notebook.
"""


def title_of(path: Path) -> str:
    """Return `01 run a trial` for 01_run_a_trial.py."""
    return path.stem.replace("_", " ")


def examples_page() -> str:
    """Return the page, in Markdown."""
    parts = [_HEAD]
    for path in EXAMPLES:
        source = path.read_text()
        tree = ast.parse(source)
        said = ast.get_docstring(tree) or ""
        code = "\n".join(source.splitlines()[tree.body[0].end_lineno :]).strip("\n")
        parts.append(f"## {title_of(path)}\n\n{said}\n\n```python\n{code}\n```\n")
    return "\n".join(parts)
