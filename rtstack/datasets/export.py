"""Logs become a data set. Each episode is a file of its own first, so that an export can be interrupted and goes on.

OUT.partial has the episodes until all are there; then they are joined, and OUT appears under its name at once.
"""

import contextlib
import os
import re
import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rtstack.datasets.episode import Candidate, Episode, read_episode, select, unreadable
from rtstack.log.errors import LogError

_OURS = re.compile(r"unfinished|whole|(\d{6}-)?[0-9a-f]{16}-[\w-]+")  # what an export leaves in OUT.partial


class Format:
    """A form of a data set. needs: the modules that it imports; settings: what its episodes' files depend on, as
    a part of their names; alike: all of its episodes have the same topics and cameras."""

    needs: tuple[str, ...]
    settings: str
    alike = False

    def check(self, episode: Episode) -> None:
        """Raise LogError for an episode that cannot be written."""

    def write(self, episode: Episode, path: Path) -> None:
        """Write an episode as a file or folder. Raises LogError for one that cannot be."""
        raise NotImplementedError

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        """Make the data set `whole` of the episodes' files. about: what was asked for, and the logs left out."""
        raise NotImplementedError


class NothingToExport(LogError):
    """No log can be exported. candidates: all logs, with the reasons."""

    def __init__(self, candidates: Sequence[Candidate]) -> None:
        self.candidates = candidates
        first, *others = candidates
        more = f"; {len(others)} more are left out" if others else ""
        super().__init__(f"there is nothing to export: {first.path}: {first.why}{more}")


@dataclass(frozen=True, slots=True)
class Exported:
    """present: episodes left by an interrupted export; robot_s: robot's time in the others; candidates: all logs."""

    episodes: int
    present: int
    robot_s: float
    candidates: tuple[Candidate, ...]


def export(
    places: Sequence[Path], out: Path, form: Format, progress: Callable[[float], None] | None = None, *,
    query: str = "", failed: bool = False, dry_run: bool = False,
) -> Exported:  # fmt: skip
    """Write the data set `out` of logs, an episode each, in their order, with a list of those that are left out.

    What an interrupted export of the same logs left in OUT.partial is not made again.

    Args:
        places: logs, and folders of logs.
        out: the data set's folder, which does not exist yet.
        form: how the data set is written.
        progress: takes the fraction that is done.
        query: words of the search in the list of logs, all of which have to hold; "" for all.
        failed: include those that did not succeed.
        dry_run: read everything and write nothing.

    Raises LogError with one line; NothingToExport where no log is left.
    """
    partial = out.with_name(out.name + ".partial")
    _check(out, partial, form)
    candidates = select(places, query, failed, form.alike)
    if not candidates:
        raise LogError("name the logs to export, or their folder")
    present, robot_s = 0, 0.0
    episodes: list[Path] = []
    try:
        for number, each in enumerate(candidates):
            remarks = each.row and zlib.crc32(repr((each.row.episode_verdict, each.row.tags)).encode())  # are in it too
            path = partial / f"{each.digest[:16]}-{remarks}-{form.settings}"
            if not each.why and path.exists() and not dry_run:
                present += 1
                episodes.append(path)
            elif not each.why:
                try:
                    robot_s += _made(each, path, form, dry_run)
                    episodes.append(path)
                except LogError as error:
                    candidates[number] = each.without(unreadable(each.path, error))
            if progress is not None:
                progress((number + 1) / (len(candidates) + 1))
        if not episodes:
            raise NothingToExport(candidates)
        if not dry_run:
            _remove(whole := partial / "whole")
            left_out = [{"log": each.path.name, "why": each.why} for each in candidates if each.why]
            form.join(episodes, whole, {"selection": query, "failed": failed, "left_out": left_out})
            os.rename(whole, out)
            shutil.rmtree(partial)
    except OSError as error:
        why = f"{error.strerror or error}; the same command goes on where this one ended"
        raise LogError(f"cannot write {out}: {why}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.rmdir()  # where nothing is in it, nothing was written
    return Exported(len(episodes), present, robot_s, tuple(candidates))


def _made(candidate: Candidate, path: Path, form: Format, dry_run: bool) -> float:
    """Write an episode's file, and return its robot's time, s. Raises LogError."""
    episode = read_episode(candidate.path, candidate.digest)
    form.check(episode)
    if not dry_run:
        path.parent.mkdir(exist_ok=True)
        _remove(unfinished := path.with_name("unfinished"))
        form.write(episode, unfinished)
        os.replace(unfinished, path)
    return 1e-9 * (max(int(each["t_ns"][-1]) for each in episode.records.values() if len(each)) - episode.start_ns)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


def _check(out: Path, partial: Path, form: Format) -> None:
    """Raise LogError for what can be known to be wrong before a log is read."""
    if out.exists():
        raise LogError(f"{out} exists already: choose another name, or remove it")
    if not out.parent.is_dir():
        raise LogError(f"cannot write {out}: the folder {out.parent} does not exist")
    if partial.exists() and not (partial.is_dir() and all(_OURS.fullmatch(each.name) for each in partial.iterdir())):
        raise LogError(f"{partial} is not what an export has left: choose another name for {out.name}, or remove it")
    check_installed(form.needs)


def check_installed(modules: Sequence[str]) -> None:
    """Raise LogError for modules of the extra `export` that are not there."""
    lacking = [name for name in modules if find_spec(name) is None]
    if lacking:
        raise LogError(f"{' and '.join(lacking)} is not installed: pip install 'rtstack[export]'")
