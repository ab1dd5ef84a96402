"""The countdown before a motion of real arms: counted where the cell's file wants it, and ended by a stop."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from rtstack.cells import load_description
from rtstack.trials import carry_out
from rtstack.trials.errors import TrialError
from rtstack.trials.run_context import RunContext

REAL = replace(load_description(None)[0], simulated=False, countdown_s=3)


@pytest.fixture
def clock(monkeypatch):
    """A clock that turns by what is slept."""
    now = SimpleNamespace(s=0.0)

    def sleep(seconds: float) -> None:
        now.s += seconds

    monkeypatch.setattr(carry_out.time, "monotonic", lambda: now.s)
    monkeypatch.setattr(carry_out.time, "sleep", sleep)
    return now


def run(description, led=False, shadow=False):
    return SimpleNamespace(description=description, led=led, shadow=shadow)


def test_each_second_is_announced(clock):
    said: list[str] = []
    carry_out._count_down(run(REAL), RunContext(), said.append)  # type: ignore[arg-type]
    assert said == [f"the arms move in {left} s" for left in (3, 2, 1)]
    assert clock.s == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    "silent",
    [
        run(replace(REAL, simulated=True)),
        run(replace(REAL, countdown_s=0)),
        run(REAL, led=True),
        run(REAL, shadow=True),
    ],
)
def test_arms_that_are_simulated_led_or_not_moved_are_not_counted_for(clock, silent):
    carry_out._count_down(silent, RunContext(), pytest.fail)
    assert clock.s == 0.0


def test_a_stop_ends_it(clock):
    stop, said = SimpleNamespace(stop_requested=False), []

    def announce(text: str) -> None:
        said.append(text)
        stop.stop_requested = len(said) == 2

    with pytest.raises(TrialError, match="nothing has moved"):
        carry_out._count_down(run(REAL), RunContext(stop=stop), announce)  # type: ignore[arg-type]
    assert len(said) == 2
