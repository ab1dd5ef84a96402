"""Where a campaign's recordings and logs are kept: a folder that all workers see, or an address that fsspec knows."""

import atexit
import contextlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from fsspec.core import url_to_fs

from hal.base.files import replacing
from hal.base.shared import private_folder
from rtstack.trials.errors import TrialError

S3 = "s3://"


@dataclass(frozen=True, slots=True)
class Archive:
    """place: an absolute path, the same on every machine, or s3://BUCKET/PREFIX. Names: references/NAME, logs/NAME."""

    place: str

    @property
    def distant(self) -> bool:
        """True where files go elsewhere than to a folder."""
        return "://" in self.place

    def check(self) -> None:
        """Raise TrialError with one line where the place cannot be used. Writes nothing."""
        if not self.distant:
            return
        try:
            files, root = _files(self.place)
            container = root.partition("/")[0]
            if self.place.startswith(S3) and not files.exists(container):
                raise FileNotFoundError(f"there is no {container!r}")
            files.exists(root)
        except ImportError as error:
            raise TrialError(f"--logs {self.place}: {error}; for s3:// install rtstack[s3]") from None
        except Exception as error:  # each protocol has errors of its own
            reason = " ".join(str(error).split()) or type(error).__name__
            raise TrialError(f"--logs {self.place} cannot be used: {reason}") from None

    @contextmanager
    def new(self, name: str) -> Iterator[Path]:
        """Give the path for a new file. It is kept when the block ends, if it is there; an exception keeps nothing."""
        path = self._local(name)
        try:
            yield path
            if self.distant and path.exists():
                files, root = _files(self.place)
                with contextlib.suppress(FileExistsError):
                    files.makedirs(f"{root}/{name}".rpartition("/")[0], exist_ok=True)
                files.put_file(str(path), f"{root}/{name}")
        finally:
            if self.distant:
                path.unlink(missing_ok=True)

    def file(self, name: str) -> Path:
        """Return a path to read; what is elsewhere is brought here once. Raises OSError where it is not there."""
        path = self._local(name)
        if self.distant and not path.exists():
            files, root = _files(self.place)
            with replacing(path) as partial:
                files.get_file(f"{root}/{name}", str(partial))
        return path

    def names(self, folder: str) -> set[str]:
        """Return the names of the files in `references` or `logs`, as they are now."""
        files, root = _files(self.place)
        files.invalidate_cache()
        try:
            found = files.ls(f"{root}/{folder}", detail=False)
        except FileNotFoundError:
            return set()
        return {entry.rstrip("/").rpartition("/")[2] for entry in found} - {"", folder}

    def remove(self, name: str) -> None:
        """Remove a file that may not be there."""
        files, root = _files(self.place)
        with contextlib.suppress(FileNotFoundError):
            files.rm_file(f"{root}/{name}")

    def _local(self, name: str) -> Path:
        path = (_scratch(self.place) if self.distant else Path(self.place)) / name
        path.parent.mkdir(exist_ok=True)
        return path


@lru_cache(maxsize=4)
def _files(place: str) -> tuple[Any, str]:
    files, root = url_to_fs(place)
    return files, root.rstrip("/")


@lru_cache(maxsize=4)
def _scratch(place: str) -> Path:
    """A folder of this process for what is on its way to or from `place`."""
    ending = ExitStack()
    atexit.register(ending.close)
    return ending.enter_context(private_folder("archive"))
