"""numba's cache of compiled code, for several processes that compile at once.

numba numbers the files of one function's signatures from what its index has, and writes index and file one after the
other. Two processes that compile different signatures at the same moment take the same number, and the index then names
the one's machine code for the other's call. Here each of them waits for the other one to have written both.
"""

import fcntl
from functools import wraps
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile, UserProvidedCacheLocator


class SharedCacheLocator(UserProvidedCacheLocator):
    """numba's locator of a folder that somebody has named. Whoever imports it writes under a lock."""


def _under_a_lock(save: Any) -> Any:
    @wraps(save)
    def locked(self: Any, key: Any, data: Any) -> None:
        with open(Path(self._index_path).with_suffix(".lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(self, key, data)

    return locked


IndexDataCacheFile.save = _under_a_lock(IndexDataCacheFile.save)
