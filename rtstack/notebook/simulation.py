"""The simulated cell as one object: each run is one call. rtstack.run_trial and the others are Simulation()'s."""

import atexit
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from shutil import rmtree
from tempfile import NamedTemporaryFile, mkdtemp
from threading import Event, current_thread, main_thread
from typing import Any, TypeVar

from pydantic import ValidationError

from hal.base.configuration import toml_text
from hal.base.realtime import end_with_parent
from hal.extensions import PLUG_INS_RAISE, raised
from rtstack.cells import kind_of, load_description
from rtstack.experiments.simulation import simulated
from rtstack.experiments.task import starting
from rtstack.log.writer import check_log_path
from rtstack.messages import problem
from rtstack.model.cell_description import CellDescription, ObjectDescription
from rtstack.notebook.table import TrialTable
from rtstack.teleoperation.policy import FASTEST_HZ, SLOWEST_HZ, Policy
from rtstack.trials.assembly import ControllerFactory, Parameters, cell_parameters
from rtstack.trials.carry_out import PreparedRun, R
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.object import object_of
from rtstack.trials.record import free_name
from rtstack.trials.result import DemonstrationResult, TeleoperationResult, TrialResult
from rtstack.trials.specification import (
    DemonstrationSpecification,
    TeleoperationSpecification,
    TrialSpecification,
    like,
)
from rtstack.trials.teleoperation import RATE_HZ, PreparedPolicy, prepare_teleoperation
from rtstack.trials.trial import PreparedTrial, prepare_trial

Reference = TrialSpecification | DemonstrationResult | Path | str
OneController = ControllerFactory | str
Task = tuple[PreparedTrial, str, Path, Path | None]  # arguments of `simulated`
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Simulation:
    """A simulated cell, opened anew for each run. Each method raises TrialError, LogError, ConfigurationError or
    HardwareError with one line that says what to do.

    Args:
        cell: Its kind, as `--cell` takes it: direct or lockstep, and a robot's profile behind a colon.
        cell_file: The cell's description (TOML); None: the grabbing cell that comes with rtstack.
        objects: Objects that are not in that file, by name. They are simulated with walls of cardboard.
    """

    cell: str = "direct"
    cell_file: Path | str | None = None
    objects: Mapping[str, ObjectDescription] = field(default_factory=dict)

    @property
    def parameters(self) -> Parameters:
        """All numbers of the controllers in this cell: `dataclasses.replace` makes a variant for `run_trial`."""
        return cell_parameters(self._described()[0])

    def demonstrate(self, log: Path | str | None = None, **fields: Any) -> DemonstrationResult:
        """Record a scripted demonstration, as `rtstack teach` does.

        Args:
            log: The recording to write, a new .mcap; None: one that is deleted at the end of this process.
            fields: Of DemonstrationSpecification, such as object, variation, seed, speed_m_s.
        """
        description, file = self._described()
        return self._run(prepare_demonstration(_checked(DemonstrationSpecification, **fields), description), file, log)

    def run_trial(
        self, reference: Reference, controller: OneController | None = None, *, parameters: Parameters | None = None,
        log: Path | str | None = None, **fields: Any,
    ) -> TrialResult:  # fmt: skip
        """Run a trial, as `rtstack trial` does.

        Args:
            reference: What `demonstrate` returned, the path of a recording or plan, or a whole TrialSpecification.
            controller: An installed controller's name, or a function that makes one of a ControllerRequest.
            parameters: The controller's numbers; None: the cell's.
            log: As in `demonstrate`.
            fields: Of TrialSpecification, such as displacement_mm, yaw_deg, seed, object, reaction, or detector: an
                impact detector's name, or a function of an arm that makes one.
        """
        description, file = self._described()
        asked = _trial(reference, fields if controller is None else fields | {"controller": controller})
        return self._run(prepare_trial(asked, description, parameters), file, log)

    def run_trials(
        self, reference: Reference, n: int = 20, controller: OneController | Sequence[OneController] | None = None, *,
        displacements: Iterable[float] | None = None, seeds: Iterable[int] | None = None, workers: int | None = None,
        parameters: Parameters | None = None, log_folder: Path | str | None = None, **fields: Any,
    ) -> TrialTable:  # fmt: skip
        """Run trials with each controller, at each displacement, with each seed. Ctrl-C ends it, and the rows so far
        are returned. The row of a seed is that of `run_trial`, whatever the number of workers.

        Args:
            reference: As in `run_trial`.
            n: Number of seeds, from 1 on; a trial with its demonstration's seed, 0, would repeat it.
            controller: As in `run_trial`, or several.
            displacements: Of the object along the world's y, mm; None: displacement_mm alone.
            seeds: In the place of 1 to n.
            workers: Processes, by default one a CPU. 1: this process, where a debugger and print work.
            parameters: As in `run_trial`.
            log_folder: Where each trial writes a log; None: nowhere.
            fields: As in `run_trial`.
        """
        description, file = self._described()
        prepared = prepare_trial(_trial(reference, fields), description, parameters)
        first = prepared.specification
        controllers = controller if isinstance(controller, list | tuple) else [controller or first.controller]
        shifts = [first.displacement_mm] if displacements is None else displacements
        asked = [
            _checked(like, TrialSpecification, first, controller=law, displacement_mm=mm, seed=seed)
            for law, mm, seed in product(controllers, shifts, range(1, n + 1) if seeds is None else seeds)
        ]
        if not asked or len({(each.controller, each.displacement_mm, each.seed) for each in asked}) < len(asked):
            raise TrialError(f"{len(asked)} trials: give one at least, and no controller, displacement or seed twice")
        logs: list[Path | None] = [None] * len(asked)
        if log_folder is not None:
            Path(log_folder).mkdir(exist_ok=True)
            for k, each in enumerate(asked):
                logs[k] = path = Path(log_folder) / f"{k + 1:04d}-{each.log_stem}.mcap"
                check_log_path(path)
        runs = (replace(prepared, specification=each) for each in asked)
        tasks = [(run, self.cell, file, log) for run, log in zip(runs, logs, strict=True)]
        found: dict[int, TrialResult | str] = {}
        try:
            for k, result in _results(tasks, min(len(asked), workers or len(os.sched_getaffinity(0)))):
                found[k] = result
                print(f"\r{len(found)} of {len(asked)} trials", end="", file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            print(" interrupted", end="", file=sys.stderr)
        print(file=sys.stderr)
        results = [found.get(k, "interrupted") for k in range(len(asked))]
        missing = [f"{one.title}: {each}" for one, each in zip(asked, results, strict=True) if isinstance(each, str)]
        if found and len(missing) == len(asked):
            raise TrialError(missing[0])
        return TrialTable(tuple(each for each in results if not isinstance(each, str)), tuple(missing))

    def run_policy(
        self, policy: Policy, *, displacement_mm: float = 0.0, rate_hz: float = RATE_HZ, log: Path | str | None = None,
        **fields: Any,
    ) -> TeleoperationResult:  # fmt: skip
        """Let a policy lead the arms until it has finished, 60 s at most, as `rtstack policy` does.

        Args:
            policy: An object with `act(observation)` and `close()`; it is not closed here.
            displacement_mm: Of the object along the world's y.
            rate_hz: Observations a second, 10 to 50.
            log: As in `demonstrate`.
            fields: Of TeleoperationSpecification: object, seed.
        """
        if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
            raise TrialError(f"rate_hz: expected {SLOWEST_HZ} to {FASTEST_HZ}, not {rate_hz}")
        description, file = self._described()
        asked = _checked(TeleoperationSpecification, type(policy).__name__, **fields)
        put = _checked(TrialSpecification, "policy", displacement_mm=displacement_mm).displacement
        run = prepare_teleoperation(asked, description)
        return self._run(PreparedPolicy(asked, run.description, policy, rate_hz, put), file, log)

    def _run(self, run: PreparedRun[R], file: Path, log: Path | str | None) -> R:
        path = free_name(_folder(), run.specification.log_stem) if log is None else Path(log)
        check_log_path(path)
        return simulated(run, self.cell, file, path)

    def _described(self) -> tuple[CellDescription, Path]:
        """Return the description and its file, one that has the objects, too: plant and logs read it."""
        description, file = load_description(None if self.cell_file is None else Path(self.cell_file), self.cell)
        kind, argument = kind_of(self.cell)
        if not kind.simulated(argument, description):
            raise TrialError(f"the cell {self.cell} has real arms: rtstack trial and rtstack up move them")
        if not self.objects:
            return description, file
        text = toml_text({"objects": {name: asdict(thing) for name, thing in self.objects.items()}})
        own = Path(mkdtemp(dir=_folder())) / file.name
        own.write_text(f"{file.read_text(encoding='utf-8')}\n{text}", encoding="utf-8")
        return load_description(own, self.cell)


def _attempt(task: Task) -> TrialResult | str:
    """Return the result of a trial, or in one line why it could not be run."""
    try:
        return simulated(*task)
    except PLUG_INS_RAISE as error:
        return raised(error)


def _results(tasks: Sequence[Task], workers: int) -> Iterator[tuple[int, TrialResult | str]]:
    """Yield number and result of each trial as it ends. Closed before, it lets those end that run."""
    if workers == 1:
        yield from enumerate(map(_attempt, tasks))
        return
    import cloudpickle

    with NamedTemporaryFile(dir=_folder()) as file:  # a pipe would be read once a worker has imported all
        cloudpickle.dump(tasks, file)  # a notebook's functions are in no module that a worker could import
        file.flush()
        pool = ProcessPoolExecutor(workers, get_context("spawn"), _begin, (file.name,))
        try:
            with starting():
                futures = {pool.submit(_attempt_number, k): k for k in range(len(tasks))}
            with _noted_interrupt() as interrupted:
                waiting = set(futures)
                while waiting and not interrupted.is_set():
                    done, waiting = wait(waiting, 0.1, FIRST_COMPLETED)
                    for future in done:
                        error = future.exception()
                        yield futures[future], future.result() if error is None else raised(error)
            if interrupted.is_set():
                raise KeyboardInterrupt
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _noted_interrupt() -> Iterator[Event]:
    """Note Ctrl-C and go on: raised within a callback of the pool it would be lost, and all trials would be run."""
    event = Event()
    if current_thread() is not main_thread():  # a signal is another thread's
        yield event
        return
    before = signal.signal(signal.SIGINT, lambda _number, _frame: event.set())
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


_tasks: list[Task] = []  # of a worker


def _begin(file: str) -> None:
    """Receive, in a worker, what it is to run. It ends with the process that has started it, not by Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    _tasks.extend(pickle.loads(Path(file).read_bytes()))


def _attempt_number(k: int) -> TrialResult | str:
    return _attempt(_tasks[k])


@cache
def _folder() -> Path:
    """Return the folder of what ends with this process."""
    folder = Path(mkdtemp(prefix="rtstack-"))
    atexit.register(rmtree, folder, ignore_errors=True)
    return folder


def _trial(reference: Reference, fields: Mapping[str, Any]) -> TrialSpecification:
    if isinstance(reference, TrialSpecification):
        return _checked(like, TrialSpecification, reference, **fields)
    path = reference.log if isinstance(reference, DemonstrationResult) else reference
    return _checked(TrialSpecification, str(path), **({"object": object_of(Path(str(path)))} | dict(fields)))


def _checked(make: Callable[..., T], *arguments: Any, **fields: Any) -> T:
    try:
        return make(*arguments, **fields)
    except ValidationError as error:
        raise TrialError(f"{problem(error, 'the arguments')}, not {error.errors()[0]['input']!r}") from None
