"""Tests of `make test` that look deeper than there: more sequences, requests, branches, pages, commands.

coverage: the judge and the arming state machine, every branch run by their tests. explore: 10,000 sequences of events,
no motion without arming, no way out of a fault but recovery. fuzz-api: ten minutes of made-up requests to a console of
its own. screenshots: looks at every page and takes the pictures of docs/screenshots anew. docs-commands: every command
of the documentation, also those that take minutes.

Takes minutes; docs-commands an hour.
"""

import os
import subprocess
import sys
from pathlib import Path

import typer

from tests.programs import program

PYTEST = ("-m", "pytest", "--timeout=0")
# without the plant: uncompiled, a trial takes minutes
JUDGE = [str(path) for path in sorted(Path("tests/safety").glob("test_*.py")) if not path.stem.endswith("_plant")]
COVERAGE = ("-m", "coverage", "run", "--branch", "--source=rtstack/safety", "-m", "pytest", "-q")
# name -> environment, commands of Python
LOOKS: dict[str, tuple[dict[str, str], list[tuple[str, ...]]]] = {
    "coverage": (
        {"NUMBA_DISABLE_JIT": "1"},
        [(*COVERAGE, *JUDGE), ("-m", "coverage", "report", "--show-missing", "--fail-under=100")],
    ),
    "explore": (
        {"RTSTACK_SEQUENCES": "10000"},
        [(*PYTEST, "--hypothesis-show-statistics", "tests/safety/test_arming.py")],
    ),
    "fuzz-api": ({"RTSTACK_FUZZ_SECONDS": "200"}, [(*PYTEST, "-s", "tests/console/test_api_schema.py")]),
    "screenshots": (
        {"RTSTACK_SCREENSHOTS": "1"},
        [(*PYTEST, "-m", "long or not long", "tests/browser/test_look.py", "tests/browser/test_panels_page.py")],
    ),
    "docs-commands": ({"RTSTACK_DOCS": "all"}, [(*PYTEST, "tests/docs/test_commands.py")]),
}


def main(look: str) -> int:
    """Run one of them."""
    if look not in LOOKS:
        raise typer.BadParameter(f"there is no {look!r}: choose from {', '.join(LOOKS)}")
    environment, commands = LOOKS[look]
    for command in commands:
        if status := subprocess.run([sys.executable, *command], env=os.environ | environment).returncode:
            return status
    return 0


if __name__ == "__main__":
    program(main)
