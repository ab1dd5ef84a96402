"""Two short logs for the tests of data sets."""

import pytest

from tests.support.log.samples import TRIAL, WrittenLog, write_log

THING = {**TRIAL, "object": "rice_box"}


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[WrittenLog, WrittenLog]:
    """One that `rtstack up` would have named so, and another one."""
    folder = tmp_path_factory.mktemp("logs")
    names = "20261122-234722-trial-rice_box.mcap", "other.mcap"
    first, second = (write_log(folder / name, 430 + 17 * k, k, THING) for k, name in enumerate(names))
    return first, second
