"""The sections of the examples' page, from the examples."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))


def title_of(path: Path) -> str:
    """Return `01 run a trial` for 01_run_a_trial.py."""
    return path.stem.replace("_", " ")


def examples() -> str:
    """Return a section for each example, in Markdown."""
    parts = []
    for path in EXAMPLES:
        source = path.read_text()
        tree = ast.parse(source)
        said = ast.get_docstring(tree) or ""
        code = "\n".join(source.splitlines()[tree.body[0].end_lineno :]).strip("\n")
        parts.append(f"## {title_of(path)}\n\n{said}\n\n```python\n{code}\n```\n")
    return "\n".join(parts)
