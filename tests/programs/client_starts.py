"""Of how many starts in real time a client's program makes something: a fresh server for each.

    python -m tests.programs.client_starts PROGRAM [PART...] [--rounds 24] [--lockstep]

PROGRAM is one of tests/programs/clients/*_program.py, such as aiofranka; PART one of its parts, if it has any: each is
counted by itself. What a failed one said last is printed below the table. Exit status 1 where one failed.
"""

import argparse
import collections
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.support.fci.client import program_path
from tests.support.fci.server import serve

LONGEST_S = 120.0


def last_words(program: Path, part: str, arguments: list[str]) -> str | None:
    """Run one part against a server of its own; None where it went well, or else the last line that it printed."""
    with serve(*arguments) as served:
        command = [sys.executable, str(program), served.left, *([part] if part else [])]
        try:
            finished = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        except subprocess.TimeoutExpired:
            return f"not finished after {LONGEST_S:.0f} s"
    lines = (finished.stdout + finished.stderr).replace("\r", "\n").strip().splitlines()
    return None if finished.returncode == 0 else lines[-1] if lines else f"exit status {finished.returncode}"


def main() -> int:
    """Count, and print the table."""
    parser = argparse.ArgumentParser(description="count a client's successful starts")
    parser.add_argument("program")
    parser.add_argument("parts", nargs="*", default=[""])
    parser.add_argument("--rounds", type=int, default=24)
    parser.add_argument("--lockstep", action="store_true")
    options = parser.parse_args()
    program = program_path(options.program)
    if not program.is_file():
        parser.error(f"there is no {program}")
    console, table = Console(), Table("program", "part", "succeeded", "of")
    failures: collections.Counter[str] = collections.Counter()
    for part in options.parts:
        arguments = ["--lockstep"] if options.lockstep else []
        words = [last_words(program, part, arguments) for _ in range(options.rounds)]
        table.add_row(options.program, part or "all", str(words.count(None)), str(options.rounds))
        failures.update(f"{part or 'all'}: {word}" for word in words if word is not None)
    console.print(table)
    for word, count in failures.most_common():
        console.print(f"{count} x {word}", markup=False)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
