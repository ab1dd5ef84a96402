"""Where each of several pytest workers keeps the code that it compiles: numba's cache is not made for two that write.

Both would take the next number for another signature of one function, and the index would name the one's code for the
other's call. The first worker shares the folder of everybody else, so that what runs later finds it compiled.
"""

import os
from pathlib import Path

WORKER = os.environ.get("PYTEST_XDIST_WORKER", "gw0")

if WORKER != "gw0":
    import rtstack  # noqa: F401  # says where the cache is
    from hal.compilation import keep_compiled_code_by_its_sources

    os.environ["NUMBA_CACHE_DIR"] = str(Path(os.environ["NUMBA_CACHE_DIR"]).parent / WORKER)
    keep_compiled_code_by_its_sources()
