"""`make program [NAME=...]`: run a program, or say which there are. NAME: a module, or `studies` and a study's name."""

import ast
import sys
from pathlib import Path
from runpy import run_module

FOLDER = Path(__file__).parent
STUDIES = FOLDER.with_name("studies")


def programs() -> dict[str, tuple[str, str]]:
    """Return what each program shows, and how long it takes, from the docstrings: nothing is imported."""
    files = {path.stem: path for path in sorted(FOLDER.glob("[!_]*.py"))}
    files |= {f"studies {plan.stem}": plan.with_suffix(".py") for plan in sorted(STUDIES.glob("*.toml"))}
    found = {}
    for name, path in files.items():
        shows, *_, takes = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "\n").splitlines()
        found[name] = (shows, takes)
    return found


def main(arguments: list[str]) -> None:
    """Run the program that is named first, or print the table."""
    known = programs()
    if not arguments:
        for name, (shows, takes) in known.items():
            print(f"{name}\n    {shows}\n    {takes}")
        return
    name = arguments[0]
    if name not in known and name != STUDIES.name:
        print(f"there is no program {name!r}: `make program` lists them", file=sys.stderr)
        sys.exit(2)
    sys.argv[1:] = arguments[1:]
    run_module(
        f"tests.{name}" if name == STUDIES.name else f"tests.programs.{name}", run_name="__main__", alter_sys=True
    )


if __name__ == "__main__":
    main(sys.argv[1:])
