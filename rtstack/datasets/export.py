"""Logs become a data set. Each episode is a file of its own first, so that an export can be interrupted and goes on.

OUT.partial has the episodes until all are there; then they are joined, and OUT appears under its name at once.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from rtstack.datasets.episode import Episode, check_log, digest_of, read_episode
from rtstack.log.errors import LogError


class Format(Protocol):
    """A form of a data set. needs: the modules that it imports; settings: what its episodes' files depend on, as
    a part of their names."""

    needs: tuple[str, ...]
    settings: str

    def write(self, episode: Episode, path: Path) -> None:
        """Write an episode as a file. Raises LogError for one that cannot be."""
        ...

    def join(self, episodes: Sequence[Path], whole: Path) -> None:
        """Make the data set `whole`, which is not there, of the episodes' files, which stay."""
        ...


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export did. present: episodes that an interrupted one had left; robot_s: robot's time in the others."""

    episodes: int
    present: int
    robot_s: float


def export(logs: Sequence[Path], out: Path, form: Format, progress: Callable[[float], None] | None = None) -> Exported:
    """Write the data set `out` of logs, an episode each, in their order. Raises LogError with one line.

    Everything that a file's summary can tell is checked before anything is written. What an interrupted export of the
    same logs left in OUT.partial is not made again.
    """
    _check(logs, out, form)
    partial = out.with_name(out.name + ".partial")
    present, robot_s = 0, 0.0
    episodes: list[Path] = []
    try:
        partial.mkdir(exist_ok=True)
        for number, path in enumerate(logs):
            digest = digest_of(path)
            episodes.append(partial / f"{number:06d}-{digest[:16]}-{form.settings}")
            if episodes[-1].exists():
                present += 1
            else:
                episode = read_episode(path, digest)
                unfinished = partial / "unfinished"
                unfinished.unlink(missing_ok=True)
                form.write(episode, unfinished)
                os.replace(unfinished, episodes[-1])
                robot_s += 1e-9 * int(max(records["t_ns"][-1] for records in episode.records.values() if len(records)))
                robot_s -= 1e-9 * episode.start_ns
            if progress is not None:
                progress((number + 1) / (len(logs) + 1))
        whole = partial / "whole"
        if whole.is_dir():
            shutil.rmtree(whole)
        whole.unlink(missing_ok=True)
        form.join(episodes, whole)
        os.rename(whole, out)
        shutil.rmtree(partial)
    except OSError as error:
        raise LogError(
            f"cannot write {out}: {error.strerror or error}; the same command goes on where this one ended"
        ) from None
    return Exported(len(logs), present, robot_s)


def _check(logs: Sequence[Path], out: Path, form: Format) -> None:
    if out.exists():
        raise LogError(f"{out} exists already: choose another name, or remove it")
    if not out.parent.is_dir():
        raise LogError(f"cannot write {out}: the folder {out.parent} does not exist")
    if len(set(logs)) < len(logs):
        raise LogError("a log is named twice: an episode would be in the data set twice")
    for path in logs:
        check_log(path)
    check_installed(form.needs)


def check_installed(modules: Sequence[str]) -> None:
    """Raise LogError for modules of the extra `export` that are not there."""
    lacking = [name for name in modules if find_spec(name) is None]
    if lacking:
        raise LogError(f"{' and '.join(lacking)} is not installed: pip install 'rtstack[export]'")
