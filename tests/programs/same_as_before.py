"""Compare the logs of this checkout with those of another commit, message by message.

Each checkout runs `rtstack teach`, then `rtstack trial --displacement-mm -30` on its own recording, in the direct cell.
What the host's clock measures is left out. Run it after a change that must leave the bits of a trial as they were.
`--all`: 48 trials, every controller of the paper x three displacements x four seeds, in the direct cell and again in
lockstep, where robot and controller are two processes. `--law-inertia` is given to the commands of this checkout alone.
Exit status 1 where a log differs.

Takes a minute; with `--all` half an hour.
"""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.programs import program
from tests.support.log.same_log import differences, messages

HERE = Path(__file__).resolve().parents[2]
CONTROLLERS = ("proposed", "no_interim", "no_velocity_feedback", "no_reference_spreading")
DISPLACEMENTS_MM, SEEDS, CELLS = (-30, 0, 20), (0, 1, 2, 3), ("direct", "lockstep")
RECORDING = "ref.mcap"


def trials(every: bool) -> dict[str, tuple[str, ...]]:
    """Return the options of the trials to compare, by the name of the log."""
    if not every:
        return {"trial.mcap": ("--displacement-mm", "-30")}
    return {
        f"{cell}.{controller}.{shift}.{seed}.mcap": (
            "--cell", cell, "--controller", controller, "--displacement-mm", str(shift), "--seed", str(seed),
        )
        for cell, controller, shift, seed in product(CELLS, CONTROLLERS, DISPLACEMENTS_MM, SEEDS)
    }  # fmt: skip


def source_of(revision: str, folder: Path) -> Path:
    """Return a folder with the source of a commit. Raises CalledProcessError."""
    folder.mkdir()
    packed = subprocess.run(["git", "-C", str(HERE), "archive", revision], check=True, stdout=subprocess.PIPE)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed.stdout, check=True)
    return folder


def python(source: Path, *arguments: str) -> str:
    """Run Python with the packages of a source, and return its output."""
    around = {**os.environ, "PYTHONPATH": str(source)}
    done = subprocess.run([sys.executable, "-B", *arguments], cwd=source, env=around, stdout=subprocess.PIPE, text=True)
    return done.stdout


def record(source: Path, out: Path, every: bool, *options: str) -> None:
    """Write the logs of a source to `out`. Raises RuntimeError if another source ran."""
    out.mkdir()
    told = python(source, "-c", "import rtstack; print(rtstack.__file__)")
    if not Path(told.strip()).is_relative_to(source):
        raise RuntimeError(f"{told.strip()} was imported in the place of {source}")
    reference = str(out / RECORDING)
    python(source, "-m", "rtstack", "teach", reference, *options)  # a trial that fails has a log, too
    for name, chosen in trials(every).items():
        log = str(out / name)
        python(source, "-m", "rtstack", "trial", "--reference", reference, *chosen, "--log", log, *options)


def main(revision: str, law_inertia: str | None = None, all: bool = False) -> int:
    """Print where the logs differ; 1 where they do."""
    law = () if law_inertia is None else ("--law-inertia", law_inertia)
    with TemporaryDirectory() as name:
        folder = Path(name).resolve()
        before, now = folder / "before", folder / "now"
        source = source_of(revision, folder / "source")
        with ThreadPoolExecutor() as both:
            for recorded in [both.submit(record, source, before, all), both.submit(record, HERE, now, all, *law)]:
                recorded.result()
        different = 0
        for log in (RECORDING, *trials(all)):
            where = differences(before / log, now / log)
            different += bool(where)
            print(f"{log}: {len(messages(now / log))} messages, differs in {'; '.join(where) or 'nothing'}", flush=True)
    return int(different > 0)


if __name__ == "__main__":
    program(main)
