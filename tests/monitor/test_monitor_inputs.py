"""What does not fit is refused in one line that names it; nothing that is passed ends the interpreter."""

import subprocess
import sys

import numpy as np
import pytest

from rtstack.monitor.monitor import Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Verdict

MS = 1_000_000
P = MonitorParameters(
    residual_rate_nm_s=(300.0, 300.0, 300.0), window=15, delay=15, decay_1_s=18.0, configuration_rad=0.067,
    time_s=0.1, horizon_s=0.1, velocity_rad_s=0.1, spacing_s=0.1,
)  # fmt: skip


def recording(ticks=400):
    """A motion with one impact, at 0.2 s, as it is meant."""
    t_ns = MS * np.arange(ticks)
    residual = np.zeros((ticks, 3))
    residual[200:, 1] = 1.0
    return {"t_ns": t_ns, "residual": residual, **{name: np.zeros((ticks, 3)) for name in ("q", "dq", "dq_ref")}}


def waiting():
    monitor = Monitor(P)
    monitor.expect(200 * MS, np.zeros(3))
    return monitor


FIVE_MILLION = """
import runpy, sys
import numpy as np
waiting = runpy.run_path(sys.argv[1])["waiting"]
rows = np.zeros((10, 3))
try:
    waiting().assess(np.arange(5_000_000), rows, rows, rows, rows)
except ValueError as error:
    print(error)
"""


def test_ten_rows_for_five_million_times_are_refused():
    done = subprocess.run([sys.executable, "-c", FIVE_MILLION, __file__], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "residual: expected shape (5000000, 3), found (10, 3)\n"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("residual", np.zeros((400, 5)), r"residual: expected shape \(400, 3\), found \(400, 5\)"),
        ("q", np.zeros((100, 3)), r"q: expected shape \(400, 3\), found \(100, 3\)"),
        ("dq_ref", np.zeros((900, 3)), r"dq_ref: expected shape \(400, 3\), found \(900, 3\)"),
        ("dq", np.full((400, 3), "a"), r"dq: expected numbers, found <U1"),
        ("dq", None, r"dq: expected numbers, found object"),
        ("dq", [[1.0], [1.0, 2.0]], r"dq: expected numbers, found list"),
        ("q", np.broadcast_to(0.0, (10**12, 3)), "q: expected at most 1,000,000,000 numbers, found 3,000,000,000,000"),
        ("t_ns", np.ma.masked_array(np.arange(400), np.arange(400) > 9), "t_ns: expected whole numbers"),
        ("t_ns", np.arange(400) * 1e-3, r"t_ns: expected whole numbers \(int64\), found float64"),
        ("t_ns", np.arange(400)[::-1], r"t_ns: expected increasing times, found 398 after 399"),
    ],
)
@pytest.mark.parametrize("method", ["assess", "follow"])
def test_a_recording_that_does_not_fit_is_refused_and_nothing_is_taken(method, name, value, message):
    monitor = waiting()
    before = monitor.state.tobytes()
    with pytest.raises(ValueError, match=message) as raised:
        getattr(monitor, method)(**(recording() | {name: value}))
    assert "\n" not in str(raised.value)
    assert monitor.state.tobytes() == before


def test_a_tick_and_what_is_expected_are_checked_too():
    monitor, three = waiting(), np.zeros(3)
    with pytest.raises(ValueError, match=r"q: expected shape \(3,\), found \(2,\)"):
        monitor.update(0, three, np.zeros(2), three, three)
    with pytest.raises(ValueError, match="t_ns: expected whole numbers"):
        monitor.update(0.5, three, three, three, three)
    monitor.update(5, three, three, three, three)
    with pytest.raises(ValueError, match="found 5 after 5"):
        monitor.update(5, three, three, three, three)
    with pytest.raises(ValueError, match=r"q_d: expected shape \(3,\), found \(7,\)"):
        monitor.expect(0, np.zeros(7))
    with pytest.raises(ValueError, match="q_d: expected finite numbers, found nan"):
        monitor.expect(0, np.full(3, np.nan))
    monitor.expect(0, three)  # the clock may begin anew
    monitor.update(1, three, three, three, three)
    with pytest.raises(TypeError, match="parameters: expected MonitorParameters, found dict"):
        Monitor({})


def test_any_layout_of_the_same_numbers_gives_the_same_bits():
    signals = recording()
    signals["dq"][200:, 1] = 0.05
    expected = waiting().follow(**signals)
    for change in (
        lambda a: np.asfortranarray(a), lambda a: np.repeat(a, 2, axis=0)[::2], lambda a: a[::-1].copy()[::-1],
        lambda a: a.tolist(), lambda a: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape),
    ):  # fmt: skip
        found = waiting().follow(**{name: change(values) for name, values in signals.items()})
        assert found.tobytes() == expected.tobytes()
    assert expected["verdict"][-1] == Verdict.EXPECTED


@pytest.mark.parametrize(
    ("name", "ticks"),
    [*((name, slice(150, None)) for name in ("residual", "q", "dq", "dq_ref")),
     *((name, slice(230, 231)) for name in ("residual", "dq", "dq_ref")), ("q", slice(200, 201))],
)  # fmt: skip
def test_what_is_no_number_where_it_is_judged_is_unexpected(name, ticks):
    signals = recording()
    signals[name][ticks, 1] = np.nan
    assert waiting().assess(**signals).verdict is Verdict.UNEXPECTED
    monitor = waiting()
    for t_ns, *tick in zip(*(signals[key].tolist() for key in ("t_ns", "residual", "q", "dq", "dq_ref")), strict=True):
        verdict = monitor.update(t_ns, *tick)
    assert verdict is Verdict.UNEXPECTED
