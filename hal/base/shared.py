"""What the processes of one user share in places that all users write: shared memory, the folder of temporary files.

No other user may change it. What none of its processes holds a lock of was left behind: the next start removes it.
"""

import errno
import fcntl
import mmap
import os
import pwd
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

from hal.base.configuration import ConfigurationError

MEMORY = Path("/dev/shm")  # shm_overview(7): where Linux keeps named shared memory
PREFIX, _SUFFIX = "rtstack-", ".held"  # of a folder; a block has the prefix alone
_OVERFLOW_UID = 65534  # user_namespaces(7): who owns, in a container, what belongs to a user outside of it, such as /
_ALL_USERS = "4294967295"  # uid_map: how many users a process outside of containers can see


def user_name(uid: int | None = None) -> str:
    """Return a user's name, by default that of this process; `uid NUMBER` where the machine has none for it."""
    uid = os.geteuid() if uid is None else uid
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"


def user_folder(variable: str, default: str) -> Path:
    """Return rtstack's folder in $variable, by default in `default` of the user's home. Raises ConfigurationError."""
    try:
        return Path(os.environ.get(variable) or Path.home() / default) / "rtstack"
    except RuntimeError:
        raise ConfigurationError(f"{user_name()} has no home folder: set HOME, or {variable}") from None


def refuse_foreign(path: Path) -> None:
    """Raise PermissionError, which says why, where another user may change what is at a path.

    Each folder above it, and each link on the way, has to belong to this user or root; others may write folders above
    it with a sticky bit, such as /tmp. Raises OSError.
    """
    trusted = {0, os.geteuid()}
    if Path("/proc/self/uid_map").read_text().split()[-1] != _ALL_USERS:
        trusted.add(_OVERFLOW_UID)
    for whole in (path.absolute(), path.resolve()):
        for each in (whole, *whole.parents):
            status = each.lstat()
            open_to_all = status.st_mode & 0o022 and not stat.S_ISLNK(status.st_mode)
            if status.st_uid not in (trusted if each != path.resolve() else {os.geteuid()}):
                raise PermissionError(errno.EPERM, f"it belongs to {user_name(status.st_uid)}", str(each))
            if open_to_all and (each == whole or not status.st_mode & stat.S_ISVTX):
                raise PermissionError(errno.EPERM, "other users may write it", str(each))


class Block:
    """Named shared memory. memory: its bytes; views of it may outlive the block."""

    __slots__ = ("_owner", "_path", "memory")

    def __init__(self, path: Path, descriptor: int, owner: bool) -> None:
        self._path, self._owner = path, owner
        self.memory = mmap.mmap(descriptor, 0)  # it keeps a copy of the descriptor, and by it the lock

    @property
    def name(self) -> str:
        return self._path.name

    @classmethod
    def create(cls, name: str, size: int) -> "Block":
        """Create a block of `size` bytes, all 0.

        All pages are taken at once: a write beyond the last free one would be a SIGBUS. Raises OSError, also where
        there is no memory for all of it.
        """
        remove_left_once()
        path = MEMORY / name
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            fcntl.flock(descriptor, fcntl.LOCK_SH)
            if os.fstat(descriptor).st_nlink:
                break
            os.close(descriptor)  # before it was locked, another process took it for left behind
        try:
            os.posix_fallocate(descriptor, 0, size)
            return cls(path, descriptor, owner=True)
        except BaseException:
            path.unlink()
            raise
        finally:
            os.close(descriptor)

    @classmethod
    def attach(cls, name: str) -> "Block":
        """Attach to a block of another process of this user. Raises OSError where there is none."""
        path = MEMORY / name
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
        try:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o022:
                raise PermissionError(errno.EPERM, "it is not this user's alone", str(path))
            fcntl.flock(descriptor, fcntl.LOCK_SH)
            return cls(path, descriptor, owner=False)
        finally:
            os.close(descriptor)

    def close(self) -> None:
        """Remove the name, in the process that created it. May be called twice."""
        if self._owner:
            self._owner = False
            self._path.unlink(missing_ok=True)


def remove_block(name: str) -> None:
    """Remove a block whose owner was killed, if it is there. Its processes may go on with it. Raises OSError."""
    (MEMORY / name).unlink(missing_ok=True)


@contextmanager
def private_folder(kind: str) -> Iterator[Path]:
    """Give a new temporary folder of this user alone, removed at the end. kind: a word of its name. Raises OSError."""
    remove_left_once()
    with ExitStack() as stack:
        while True:
            folder = Path(tempfile.mkdtemp(_SUFFIX, f"{PREFIX}{kind}-"))
            with suppress(FileNotFoundError):  # before it was locked, another process took it for left behind
                stack.enter_context(held(folder))
                break
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        refuse_foreign(folder)
        yield folder


@contextmanager
def held(path: Path, alone: bool = False) -> Iterator[None]:
    """Hold a block or folder: it stays. alone: raise BlockingIOError where a process has it. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB if alone else fcntl.LOCK_SH)
        path.lstat()
        if alone and _mapped(path):
            raise BlockingIOError(errno.EWOULDBLOCK, "its process maps it", str(path))
        yield
    finally:
        os.close(descriptor)


def _mapped(path: Path) -> bool:
    """Return whether the process that a block's name has the id of maps it: older versions of the program lock none."""
    for number in re.findall(r"\d+", path.name):
        with suppress(OSError):
            if f" {path}\n".encode() in Path(f"/proc/{number}/maps").read_bytes():
                return True
    return False


def shared() -> list[Path]:
    """Return the blocks and folders of all users that are there."""
    return sorted([*MEMORY.glob(f"{PREFIX}*"), *Path(tempfile.gettempdir()).glob(f"{PREFIX}*{_SUFFIX}")])


def left_behind() -> dict[Path, str]:
    """Return what no process uses any more and, of other users, what one may use: whose it is, by its path."""
    found = {}
    for path in shared():
        with suppress(OSError):
            uid = path.lstat().st_uid
            try:
                with held(path, alone=True):
                    found[path] = user_name(uid)
            except PermissionError:
                found[path] = f"{user_name(uid)}, who may be using it"
    return found


def remove_left() -> None:
    """Remove this user's blocks and folders that no process uses any more."""
    for path in shared():
        with suppress(OSError):
            if path.lstat().st_uid == os.geteuid():
                with held(path, alone=True):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()


remove_left_once = cache(remove_left)  # in a process
