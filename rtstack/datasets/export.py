"""Logs become a data set. Each episode is a file of its own first, so that an export can be interrupted and goes on.

OUT.partial has the episodes until all are there; then they are joined, and OUT appears under its name at once.
"""

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from rtstack.datasets.episode import PICTURES, Episode, check_log, digest_of, read_episode
from rtstack.log.errors import LogError
from rtstack.log.reader import Log
from rtstack.topics import TICK_TOPICS

_OURS = re.compile(r"unfinished|whole|\d{6}-[0-9a-f]{16}-[\w-]+")  # what an export leaves in OUT.partial


class Format(Protocol):
    """A form of a data set. needs: the modules that it imports; settings: what its episodes' files depend on, as
    a part of their names; alike: all of its episodes have the same topics and cameras."""

    needs: tuple[str, ...]
    settings: str
    alike: bool

    def write(self, episode: Episode, path: Path) -> None:
        """Write an episode as a file. Raises LogError for one that cannot be."""

    def join(self, episodes: Sequence[Path], whole: Path) -> None:
        """Make the data set `whole`, which is not there, of the episodes' files, which stay."""


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
    partial = out.with_name(out.name + ".partial")
    digests = _check(logs, out, partial, form)
    present, robot_s = 0, 0.0
    episodes: list[Path] = []
    try:
        partial.mkdir(exist_ok=True)
        for number, (path, digest) in enumerate(zip(logs, digests, strict=True)):
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
    finally:
        with contextlib.suppress(OSError):
            partial.rmdir()  # where nothing is in it, nothing was written
    return Exported(len(logs), present, robot_s)


def _check(logs: Sequence[Path], out: Path, partial: Path, form: Format) -> list[str]:
    """Return the digest of each log. Raises LogError for what can be known to be wrong before anything is written."""
    if out.exists():
        raise LogError(f"{out} exists already: choose another name, or remove it")
    if not out.parent.is_dir():
        raise LogError(f"cannot write {out}: the folder {out.parent} does not exist")
    if partial.exists() and not (partial.is_dir() and all(_OURS.fullmatch(each.name) for each in partial.iterdir())):
        raise LogError(f"{partial} is not what an export has left: choose another name for {out.name}, or remove it")
    have = [_have(check_log(path)) for path in logs]
    for path, each in zip(logs, have, strict=True):
        if form.alike and each != have[0]:
            other = ", ".join(sorted(each ^ have[0]))
            raise LogError(f"{path}: not both it and {logs[0]} have {other}: export it by itself")
    check_installed(form.needs)
    digests: dict[str, Path] = {}  # a copy or another name of a log is the same episode
    for path in logs:
        digest = digest_of(path)
        if digest in digests:
            raise LogError(
                f"a log is named twice, {path} is {digests[digest]}: an episode would be in the data set twice"
            )
        digests[digest] = path
    return list(digests)


def _have(log: Log) -> set[str]:
    """Return the topics that decide which features the frames of a log have."""
    return {name for name in log.topics if log.count(name) and (name in TICK_TOPICS or PICTURES.fullmatch(name))}


def check_installed(modules: Sequence[str]) -> None:
    """Raise LogError for modules of the extra `export` that are not there."""
    lacking = [name for name in modules if find_spec(name) is None]
    if lacking:
        raise LogError(f"{' and '.join(lacking)} is not installed: pip install 'rtstack[export]'")
