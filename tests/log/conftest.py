"""One complete log that the tests of the readers share."""

import numpy as np
import pytest

from rtstack.log.ring import Rings
from rtstack.log.writer import Attachment, CellFrames, LogProcess
from rtstack.topics import TOPICS
from tests.support.log.samples import RESULT, TICKS, TRIAL, WrittenLog, push_all, random_records


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> WrittenLog:
    path = tmp_path_factory.mktemp("logs") / "trial.mcap"
    columns = {topic: random_records(topic, 5 if topic == "/events" else TICKS) for topic in TOPICS}
    left, right = np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])
    left[:3, 3], right[:3, 3] = (0.0, 0.4, 0.1), (0.0, -0.4, 0.1)
    cell = CellFrames(left, right, (0.1, 0.1, 0.03), (0.2, 0.3, 0.2), (0.08, 0.0, 0.1), (0.56, 0.8, 0.2))
    with Rings.create() as rings:
        attachments = [Attachment("cell.toml", "application/toml", b"name = 'grab'\n")]
        log = LogProcess.start(path, rings, {"trial": TRIAL}, attachments, cell)
        push_all(rings, columns, log)
        summary = log.close(RESULT)
    return WrittenLog(path, columns, cell, summary)
