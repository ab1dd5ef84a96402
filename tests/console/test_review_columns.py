"""The columns of a log agree with the log; whatever is asked of them, no spike is lost."""

from itertools import pairwise

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from console.review.columns import BUCKET, Columns, ColumnWriter, LogColumns, read_index
from console.review.conversion import convert
from console.review.conversion import main as conversion
from console.review.series import Tabled, Window, csv_lines, curves, moment
from rtstack.log.analysis.signals import column_block, signals, topic_signals
from rtstack.log.reader import read_log
from rtstack.log.time_of_day import TimeOfDay, unix_of
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.samples import Mode
from rtstack.topics import PLOTTED_TOPICS, TOPICS

MS = 1_000_000
TICKS = 20_000
START_NS = 5 * 1_000_000_000
SPIKE_ROW = 12_345
OBJECT_EVERY = 4


def made_records(topic, ticks, rng):
    """Records of a topic: noise everywhere, 1 ms apart, the object every fourth tick."""
    rows = ticks // OBJECT_EVERY if topic == "/object/pose" else ticks
    records = np.zeros(rows, TOPICS[topic].record)
    for name in records.dtype.names:
        if records[name].dtype == np.float64:
            records[name] = rng.normal(size=records[name].shape)
    records["t_ns"] = START_NS + np.arange(rows) * MS * (OBJECT_EVERY if topic == "/object/pose" else 1)
    return records


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A log of 20 s with a spike of one sample, its records, its columns, and their index."""
    folder = tmp_path_factory.mktemp("made")
    rng = np.random.default_rng(3)
    columns = {topic: made_records(topic, TICKS, rng) for topic in PLOTTED_TOPICS}
    columns["/left/arm"]["tau_J"][SPIKE_ROW, 3] = 1000.0
    columns["/object/pose"]["seen"] = np.arange(TICKS // OBJECT_EVERY) >= 100
    for side, first in (("left", Mode.ANTE_IMPACT), ("right", Mode.TELEOPERATION)):
        columns[f"/{side}/control"]["mode"] = np.where(np.arange(TICKS) < 7000, first, Mode.POST_IMPACT)
    events = np.zeros(2, TOPICS["/events"].record)
    events["t_ns"] = START_NS + np.array([7000, 9000]) * MS
    events["level"], events["name"], events["text"] = (2, 4), (b"impact", b"safety"), (b"detected", b"<b>torque</b>")
    columns["/events"] = events
    path = folder / "made.mcap"
    with open(path, "wb") as file:
        writer = McapWriter(file)
        writer.write_metadata("trial", {"object": "rice_box", "seed": "3"})
        for start in range(START_NS, START_NS + TICKS * MS, 250 * MS):
            inside = {t: r[(r["t_ns"] >= start) & (r["t_ns"] < start + 250 * MS)] for t, r in columns.items()}
            writer.write(inside, {})
        writer.close()
    target = folder / "columns"
    target.mkdir()
    return path, columns, target, convert(read_log(path), target)


def signal(name):
    return signals()[name]


def test_every_signal_of_every_topic_is_what_the_log_has(made):
    path, _, folder, index = made
    log = read_log(path)
    for topic in PLOTTED_TOPICS:
        records = log.topic(topic)
        columns = Columns(folder, topic, index.rows[topic])
        np.testing.assert_array_equal(columns.t_ns, records["t_ns"])
        expected = column_block(topic, records)
        assert len(expected) == len(topic_signals(topic))
        for one in topic_signals(topic):
            np.testing.assert_array_equal(columns.values[one.column], expected[one.column])
            field = records[one.field].reshape(len(records), -1)
            place = [s.component for s in topic_signals(topic) if s.field == one.field].index(one.component)
            np.testing.assert_allclose(expected[one.column], field[:, place], rtol=1e-6)


def test_the_vectorised_decoding_agrees_with_the_protobuf_library(made):
    path, _, folder, index = made
    log = read_log(path)
    schema = next(schema for schema in log._contents.schemas.values() if schema.name == "rtstack.ArmSample")
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName("rtstack.ArmSample"))
    columns = Columns(folder, "/left/arm", index.rows["/left/arm"])
    for row, (t_ns, data) in enumerate(log.messages("/left/arm")[:200]):
        parsed = message.FromString(data)
        assert t_ns == columns.t_ns[row]
        for name, value in (("left.q.2", parsed.q[1]), ("left.tau_applied.7", parsed.tau_applied[6])):
            assert columns.values[signal(name).column][row] == np.float32(value)
        assert columns.values[signal("left.O_T_EE.x").column][row] == np.float32(parsed.O_T_EE[12])  # column-major


@pytest.mark.parametrize("width", [16, 100, 640, 1000, 5000])
@pytest.mark.parametrize(("start", "end"), [(-5.0, 30.0), (0.0, 20.0), (12.0, 13.0), (12.3401, 12.3499), (3.3, 17.77)])
def test_a_spike_of_one_sample_is_in_the_curve_at_every_zoom(made, start, end, width):
    _, columns, folder, index = made
    (found,) = curves(
        LogColumns(folder, index), [signal("left.tau_J.4"), signal("left.q.1")], Window(start, end, width)
    )
    values = columns["/left/arm"]["tau_J"][:, 3].astype(np.float32)
    assert found.high[0].max() == 1000.0
    place = int(np.argmax(found.high[0]))
    assert found.t_s[place] <= SPIKE_ROW * 1e-3 + 1e-9 <= found.t_s[place] + found.bucket * 1e-3
    assert len(found.t_s) <= width + 2 or found.bucket == 1
    assert found.bucket == 1 or len(found.t_s) >= width / 4
    # nothing is left out and nothing is made up, wherever the window begins
    first = round(found.t_s[0] * 1e3)
    covered = values[first : first + len(found.t_s) * found.bucket]
    assert covered.min() == found.low[0].min()
    inside = (np.arange(TICKS) * 1e-3 >= start) & (np.arange(TICKS) * 1e-3 < end)
    assert found.low[0].min() <= values[inside].min()


def test_buckets_of_whole_levels_and_of_samples_agree(made):
    _, columns, folder, index = made
    (found,) = curves(LogColumns(folder, index), [signal("left.dq.5")], Window(0.0, 20.0, 100))
    assert found.bucket == 256
    assert found.bucket > BUCKET
    values = columns["/left/arm"]["dq"][:, 4].astype(np.float32)
    starts = np.arange(0, TICKS, 256)
    np.testing.assert_array_equal(found.low[0], np.fmin.reduceat(values, starts))
    np.testing.assert_array_equal(found.high[0], np.fmax.reduceat(values, starts))


def test_an_object_is_nowhere_until_somebody_has_seen_it(made):
    _, _, folder, index = made
    (found,) = curves(LogColumns(folder, index), [signal("object.position.z")], Window(0.0, 20.0, 5000))
    assert found.t_s[0] == pytest.approx(0.4)
    assert moment(LogColumns(folder, index), [signal("object.position.z")], 0.2).values == {"object.position.z": None}
    assert moment(LogColumns(folder, index), [], 0.2).object is None
    assert moment(LogColumns(folder, index), [], 0.5).object is not None


def test_a_moment_is_the_newest_sample_before_it(made):
    _, columns, folder, index = made
    found = moment(LogColumns(folder, index), [signal("left.tau_J.4")], SPIKE_ROW * 1e-3 + 0.0004)
    assert found.values == {"left.tau_J.4": 1000.0}
    assert found.t_s == pytest.approx(SPIKE_ROW * 1e-3)
    np.testing.assert_allclose(found.q, [columns[f"/{side}/arm"]["q"][SPIKE_ROW] for side in ("left", "right")], 1e-6)
    before = moment(LogColumns(folder, index), [signal("left.tau_J.4")], -1.0)
    assert before.values == {"left.tau_J.4": None}
    assert before.q is None


def test_modes_and_events_are_those_of_the_log(made):
    *_, index = made
    assert index.modes["left"] == [
        (pytest.approx(0.0), pytest.approx(7.0), "ANTE_IMPACT"),
        (pytest.approx(7.0), pytest.approx(19.999), "POST_IMPACT"),
    ]
    assert [(mark.t_s, mark.level, mark.name, mark.text) for mark in index.events] == [
        (pytest.approx(7.0), "INFO", "impact", "detected"),
        (pytest.approx(9.0), "ERROR", "safety", "<b>torque</b>"),
    ]


def test_a_table_has_every_sample_and_gaps_where_a_topic_has_none(made):
    _, columns, folder, index = made
    names = ["left.tau_J.4", "object.position.z"]
    at_ns = unix_of("2026-06-01T23:59:59.004000Z")
    time = TimeOfDay(index.start_ns, at_ns, 1.0, 1e-3, False)
    lines = "".join(
        csv_lines([Tabled(LogColumns(folder, index), time=time)], [signal(name) for name in names], 1.0, 1.01)
    ).splitlines()
    assert lines[0] == "t_s,utc,left.tau_J.4,object.position.z"
    rows = [line.split(",") for line in lines[1:]]
    assert [row[0] for row in rows] == [f"{t / 1000:.6f}" for t in range(1000, 1010)]
    assert rows[0][1] == "2026-06-02T00:00:00.004000Z"
    assert rows[9][1] == "2026-06-02T00:00:00.013000Z"
    np.testing.assert_allclose([float(row[2]) for row in rows], columns["/left/arm"]["tau_J"][1000:1010, 3], rtol=1e-6)
    assert [bool(row[3]) for row in rows] == [t % OBJECT_EVERY == 0 for t in range(1000, 1010)]


def test_a_writer_that_is_fed_in_pieces_writes_the_same(tmp_path):
    rng = np.random.default_rng(1)
    records = made_records("/timing", 1000, rng)
    writer = ColumnWriter(tmp_path, "/timing", len(records))
    cuts = [0, 1, 63, 64, 65, 200, 512, 999, 1000]
    for first, last in pairwise(cuts):
        writer.append(records[first:last])
        columns = Columns(tmp_path, "/timing", writer.rows)
        values = columns.values[0]
        assert columns.high[0].max() == values.max()
        assert columns.low[0].min() == values.min()
    writer.close()
    np.testing.assert_array_equal(Columns(tmp_path, "/timing", 1000).values[0], records["period_us"].astype(np.float32))


def test_a_file_that_cannot_be_read_says_so_in_one_line(tmp_path, capsys):
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"\x89MCAP0\r\nand then nothing of use")
    assert conversion(str(broken), str(tmp_path)) == 2
    index = read_index(tmp_path)
    assert index is not None
    assert "not a log of ours" in (index.error or "")
    assert len(capsys.readouterr().err.splitlines()) == 1
