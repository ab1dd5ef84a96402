"""The time of day of a log: UTC of the robot's times, wherever the log was written."""

import time
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from rtstack.log import time_of_day as module
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.log.time_of_day import TIMES, begun, iso, take_pair, time_of_day, time_record, unix_of
from rtstack.log.writer import LogProcess
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.topics import CLOCK_TOPIC, TIMING_TOPIC
from rtstack.trials.record import free_name
from tests.support.log.samples import random_records

MS = 1_000_000
NOON_NS = unix_of("2026-06-01T12:00:00.000000Z")


class HostClocks:
    """The host's clocks as a test moves them; each reading takes a microsecond."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monotonic_ns, self.offset_ns = 5_000_000_000, NOON_NS - 5_000_000_000
        monkeypatch.setattr(module.time, "monotonic_ns", self._monotonic)
        monkeypatch.setattr(module.time, "time_ns", lambda: self._monotonic() + self.offset_ns)

    def _monotonic(self) -> int:
        self.monotonic_ns += 1000
        return self.monotonic_ns


def written(path: Path, times: np.ndarray, clock: np.ndarray | None = None) -> Path:
    """Write a log with these TIMES."""
    with open(path, "wb") as file:
        writer = McapWriter(file, times=times)
        writer.begin([("trial", {"seed": "7"})], [])
        writer.write({"/left/arm": random_records("/left/arm", 10)})
        if clock is not None:
            writer.write({CLOCK_TOPIC: clock})
        writer.finish({}, "closed", None, {})
    return path


@pytest.mark.parametrize("simulated", [True, False])
@pytest.mark.parametrize("set_s", [0.0, 3600.0, -0.25])
def test_a_log_says_its_time_of_day_and_that_the_clock_was_set(monkeypatch, tmp_path, simulated, set_s) -> None:
    host = HostClocks(monkeypatch)
    times = begun(np.zeros(1, TIMES), simulated)
    take_pair(times, 7_000 * MS, 400.0)
    first_ns = host.monotonic_ns + host.offset_ns
    host.offset_ns += round(1e9 * set_s)
    host.monotonic_ns += 3_000 * MS
    take_pair(times, 9_000 * MS if simulated else 10_000 * MS, 400.0)
    log = read_log(written(tmp_path / "a.mcap", times))
    found = time_of_day(log)
    assert found is not None
    assert found.simulated is simulated
    assert found.set_s == pytest.approx(set_s, abs=1e-5)
    # The clock is compared at the end: the state was read 0.4 ms before, and was up to 2 ms old where time goes by
    before_ns = 0.2 * MS if simulated else 1.2 * MS
    assert found.unix_ns(7_000 * MS) - first_ns == pytest.approx(1e9 * set_s - before_ns, abs=0.02 * MS)
    assert found.uncertainty_s == pytest.approx(before_ns * 1e-9, abs=1e-5)
    assert found.rate == pytest.approx(1.5 if simulated else 1.0, abs=1e-5)
    late = 2.0 * found.rate
    assert found.utc(9_000 * MS) - found.utc(7_000 * MS) == timedelta(seconds=round(late, 6))
    assert np.array_equal(found.unix_ns(np.array([7_000 * MS, 9_000 * MS])),
                          [found.unix_ns(7_000 * MS), found.unix_ns(9_000 * MS)])  # fmt: skip


def test_the_robots_own_clock_is_exact_by_its_topic(monkeypatch, tmp_path) -> None:
    HostClocks(monkeypatch)
    times = begun(np.zeros(1, TIMES), simulated=False)
    take_pair(times, 7_000 * MS, 400.0)
    clock = random_records(CLOCK_TOPIC, 2)
    clock["t_ns"], clock["unix_ns"] = (8_000 * MS, 9_000 * MS), (NOON_NS + 1, NOON_NS + 1_000_020_000)
    clock["drift_ppm"], clock["uncertainty_us"] = 20.0, 3.0
    found = time_of_day(read_log(written(tmp_path / "a.mcap", times, clock)))
    assert found is not None
    assert found.unix_ns(9_000 * MS) == NOON_NS + 1_000_020_000
    assert found.unix_ns(4_000 * MS) == NOON_NS + 1_000_020_000 - 5_000 * MS - 100_000
    assert found.uncertainty_s == pytest.approx(3e-6)


def test_a_log_without_an_end_has_it_and_one_without_a_tick_only_when_it_was_opened(monkeypatch, tmp_path) -> None:
    HostClocks(monkeypatch)
    times = begun(np.zeros(1, TIMES), simulated=True)
    assert "t_ns" not in time_record(times, ended=True)
    assert time_of_day(read_log(written(tmp_path / "none.mcap", times))) is None
    assert read_log(tmp_path / "none.mcap").metadata["time"]["utc"].startswith("2026-06-01T12:00:00.")
    take_pair(times, 0, 0.0)
    file = BytesIO()
    writer = McapWriter(file, times=times)
    writer.write({TIMING_TOPIC: random_records(TIMING_TOPIC, 10), "/left/arm": random_records("/left/arm", 10)})
    writer.flush()
    (tmp_path / "cut.mcap").write_bytes(file.getvalue())
    found = time_of_day(read_log(tmp_path / "cut.mcap", truncated=True))
    assert found is not None
    assert iso(found.unix_ns(0)).startswith("2026-06-01T12:00:00.")


@pytest.mark.parametrize("record", [
    {"t_ns": "x", "utc": "2026-06-01T12:00:00Z"}, {"t_ns": "1", "utc": "noon"}, {"t_ns": "1"}, {"clock_set_s": "much"},
    {"t_ns": "1", "utc": "2026-06-01T12:00:00", "robot_time": "own clock", "utc_uncertainty_s": "0"},
])  # fmt: skip
def test_a_record_that_cannot_be_read_is_no_time_of_day(tmp_path: Path, record: dict[str, str]) -> None:
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = McapWriter(file)
        writer.begin([("trial", {"seed": "7"}), ("time", record)], [])
        writer.write({"/left/arm": random_records("/left/arm", 10)})
        writer.finish({}, "closed", None, {})
    assert time_of_day(read_log(tmp_path / "a.mcap")) is None


def test_the_log_process_writes_it(tmp_path: Path) -> None:
    with Rings.create(capacity=64) as rings:
        begun(rings.times, simulated=False)
        log = LogProcess.start(tmp_path / "a.mcap", rings, {"trial": {"seed": "7"}})
        log.wait_ready()
        earliest = datetime.now(UTC)
        take_pair(rings.times, 42 * MS, 0.0)
        log.close()
    record = read_log(tmp_path / "a.mcap").metadata["time"]
    assert datetime.fromisoformat(record["utc"]) - earliest > -timedelta(milliseconds=2)
    assert record["t_ns"] == "42000000"
    assert record["clock_set_s"] == "0.0"


@pytest.mark.parametrize("zone", ["Asia/Tokyo", "America/St_Johns", "UTC"])
def test_a_name_has_utc_in_every_time_zone_and_sorts_beside_older_ones(monkeypatch, tmp_path, zone) -> None:
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        before, name, after = datetime.now(UTC), free_name(tmp_path, "trial").name, datetime.now(UTC)
    finally:
        monkeypatch.undo()
        time.tzset()
    stamp = datetime.strptime(name, "%Y%m%d-%H%M%SZ-trial.mcap").replace(tzinfo=UTC)
    assert before.replace(microsecond=0) <= stamp <= after
    older = f"{before - timedelta(days=1):%Y%m%d-%H%M%S}-trial.mcap"  # of a version that took the local time
    assert sorted([name, older]) == [older, name]
