"""One complete log that the tests of the readers share."""

import pytest

from tests.support.log.samples import WrittenLog, write_log


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> WrittenLog:
    return write_log(tmp_path_factory.mktemp("logs") / "trial.mcap")
