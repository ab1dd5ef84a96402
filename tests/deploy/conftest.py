"""What tests of the deployment share."""

import os
import shutil

import pytest

NO_CONTEXT = "65534"


@pytest.fixture
def unprivileged() -> list[str]:
    """What to put before a command so that it runs as a user without rights or capabilities; nothing where we are one.

    One right is left to it: to read everything, since the interpreter that runs the tests may be in root's own folder.
    """
    if os.getuid() != 0:
        return []
    setpriv = shutil.which("setpriv")
    if setpriv is None:
        pytest.skip("no setpriv: util-linux has it")
    only = "-all,+dac_read_search"
    return [
        setpriv, f"--reuid={NO_CONTEXT}", f"--regid={NO_CONTEXT}", "--clear-groups", "--no-new-privs",
        f"--inh-caps={only}", f"--ambient-caps={only}", f"--bounding-set={only}",
    ]  # fmt: skip
