"""The same command again and again, quiet and loaded, direct and lockstep: where do the logs differ but in the clocks?

`python -m tests.programs.same_logs [--runs 10] [--cells direct,lockstep] [--loops 2] [--out DIR]`: each run's log is
compared with the first one of its cell, message by message. A loaded run has as many busy loops beside it.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.support.log.same_log import RTSTACK, busy_loops, differences, messages


def run(*arguments: object) -> None:
    """Run a command of ours. Raises CalledProcessError."""
    subprocess.run([RTSTACK, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def main() -> int:
    """Print a table; 1 where a log differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--cells", default="direct,lockstep")
    parser.add_argument("--loops", type=int, default=2)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    with TemporaryDirectory() as temporary:
        folder = chosen.out or Path(temporary)
        reference = folder / "reference.mcap"
        run("teach", reference)
        failed = 0
        print("| cell | host | run | messages | differs in |\n|---|---|---|---|---|", flush=True)
        for cell in chosen.cells.split(","):
            first: Path | None = None
            for loops in (0, chosen.loops):
                for number in range(1, chosen.runs + 1):
                    log = folder / f"{cell}-{loops}-{number}.mcap"
                    with busy_loops(loops):
                        run("trial", "--reference", reference, "--cell", cell, "--displacement-mm", -30, "--log", log)
                    first = first or log
                    found = differences(first, log)
                    failed += bool(found)
                    host = f"{loops} busy loops" if loops else "quiet"
                    said = "; ".join(found) or "nothing"
                    print(f"| {cell} | {host} | {number} | {len(messages(log))} | {said} |", flush=True)
                    if chosen.out is None and log != first:
                        log.unlink()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
