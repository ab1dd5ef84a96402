"""What is wrong with a controller of another author: one line with package, version, file, line and what to do."""

import re
import sys
from typing import Any

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.loop.watchdogs import SLOW_US, slow_tick
from rtstack.samples import Level

PLUG_IN = '''
import time

import numpy as np

from rtstack.control.modes import ModeMachine, Strategy
from rtstack.samples import QpStatus

CALLS = []


class Law:
    """Holds the arm by its last torque."""

    def __init__(self, arm):
        self.arm, self.ticks = arm, 0

    def follow(self, ante, post):
        pass

    def observe(self):
        self.ticks += 1

    def command(self, mode):
        self.arm.sample[0]["tau_desired"][:] = self.arm.workspace[0]["tau_previous"]
        return QpStatus.NOT_USED


def of(law):
    def make(request):
        return request.pair(request.modes(Strategy.NO_REFERENCE_SPREADING), [law(arm) for arm in request.arms])
    return make


class Nothing:
    pass


class Raises(Law):
    def command(self, mode):
        if self.ticks > 100:
            raise ValueError("my own bug")  # here: raises
        return super().command(mode)


class RaisesInNumpy(Law):
    def command(self, mode):
        if self.ticks > 100:
            np.linalg.solve(np.zeros((6, 6)), np.ones(6))  # here: numpy
        return super().command(mode)


class RaisesAtOnce(Law):
    def command(self, mode):
        raise ValueError("my own bug")  # here: at_once


class RaisesInFollow(Law):
    def follow(self, ante, post):
        if len(ante) > 10:
            raise ValueError("my own bug")  # here: follow


class ReturnsNone(Law):
    def command(self, mode):  # here: returns_none
        super().command(mode)


class ReturnsNoneLate(Law):
    def command(self, mode):  # here: none_late
        status = super().command(mode)
        return status if self.ticks < 100 else None


class Nan(Law):
    def command(self, mode):  # here: nan
        status = super().command(mode)
        if self.ticks > 100:
            self.arm.sample[0]["tau_desired"][2] = np.nan
        return status


class Impact(Law):
    def observe(self):
        self.arm.impact = "yes"


class Signature(Law):
    def command(self):  # here: signature
        return QpStatus.NOT_USED


class Slow(Law):
    def command(self, mode):
        time.sleep(0.0005)
        return super().command(mode)


class Noted(Law):
    def follow(self, ante, post):
        CALLS.append("follow")

    def observe(self):
        super().observe()
        CALLS.append("observe")

    def command(self, mode):
        CALLS.append("command")
        return super().command(mode)


class Modes(ModeMachine):
    def update(self, t_s):  # here: modes
        pass


def none(request):  # here: none
    return None


def fails(request):
    raise RuntimeError("no calibration found")  # here: fails


def modes(request):
    return request.pair(Modes(Strategy.PROPOSED, request.parameters.control, request.nominal_impact_s))


def one_law(request):  # here: one_law
    return request.pair(request.modes(Strategy.PROPOSED), (Law(request.arms[0]),))


def no_argument():  # here: no_argument
    return None


nothing, raises, numpy, at_once = of(lambda arm: Nothing()), of(Raises), of(RaisesInNumpy), of(RaisesAtOnce)
follow, returns_none, none_late, nan, impact = (
    of(law) for law in (RaisesInFollow, ReturnsNone, ReturnsNoneLate, Nan, Impact)
)
signature, slow, noted, holds = of(Signature), of(Slow), of(Noted), of(Law)
'''
NAMES = (
    "nothing", "raises", "numpy", "at_once", "follow", "returns_none", "none_late", "nan", "impact", "signature",
    "slow", "noted", "holds", "none", "fails", "modes", "one_law", "no_argument",
)  # fmt: skip
CANNOT_WORK = {
    "none": "made: TypeError: NoneType has no follow, no observe, no decide, no command, no finish",
    "nothing": "the controller cannot be made: TypeError: Nothing has no follow, no observe, no command",
    "fails": "the controller cannot be made: RuntimeError: no calibration found",
    "no_argument": "made: TypeError: no_argument() takes 0 positional arguments but 1 was given",
    "one_law": "the controller cannot be made: TypeError: it has 1 laws for 2 arms",
    "modes": "before any arm moves: TypeError: Modes.update() takes 2 positional arguments but 4 were given",
    "signature": "before any arm moves: TypeError: Signature.command() takes 1 positional argument but 2 were given",
    "at_once": "before any arm moves: ValueError: my own bug",
    "returns_none": "before any arm moves: TypeError: command returned None, not a QpStatus",
    "impact": "before any arm moves: TypeError: observe set impact to 'yes', not True or False",
    "follow": "the controller does not take the reference: ValueError: my own bug",
}
ENDS_THE_RUN = {
    "raises": "an exception in the control loop: ValueError: my own bug",
    "numpy": "an exception in the control loop: LinAlgError: Singular matrix",
    "none_late": "an exception in the control loop: TypeError: command returned None, not a QpStatus",
    "nan": "safety stop: left: joint 3: the desired torque is nan",
}


@pytest.fixture
def trial(install, command_line, demonstration, tmp_path):
    """Run a trial of one of the plug-in's controllers by the command line; return how it ended, and its log's path."""
    install("wrong_laws", PLUG_IN, "rtstack.controllers", **{f"wrong_{name}": name for name in NAMES})

    def run(name: str, *more: object) -> Any:
        log = tmp_path / f"{name}.mcap"
        words = ("--reference", demonstration.path, "--controller", f"wrong_{name}", "--log", log)
        return command_line("trial", *words, *more), log

    return run


def place(name: str) -> str:
    """Return the end of a message on what a line of the plug-in does."""
    lines = [number for number, line in enumerate(PLUG_IN.splitlines(), 1) if line.endswith(f"# here: {name}")]
    line = str(lines[0]) if lines else r"\d+"
    return rf"\(wrong_laws 1\.2, wrong_laws\.py:{line}\); mend it there, or uninstall the package"


@pytest.mark.parametrize("name", CANNOT_WORK)
def test_a_controller_that_cannot_work_is_bad_input_and_leaves_nothing(trial, name) -> None:
    done, log = trial(name)
    assert done.returncode == 2
    assert re.search(rf"^rtstack: .*{re.escape(CANNOT_WORK[name])} {place(name)}$", done.stderr, re.M), done.stderr
    assert "internal error" not in done.stderr
    assert not log.exists()  # it would refuse the same command


@pytest.mark.parametrize("name", ENDS_THE_RUN)
def test_a_law_that_ends_its_run_is_named_in_terminal_log_event_and_review(trial, command_line, name) -> None:
    done, path = trial(name)
    line = rf"{re.escape(ENDS_THE_RUN[name])} {place(name)}"
    assert done.returncode == 1
    assert re.search(rf"^failed: {line} \|", done.stdout), done.stdout
    log = read_log(path)
    assert re.fullmatch(line, log.metadata["result"]["failure_reason"])
    assert any(re.search(place(name), event["text"].decode()) for event in log.topic("/events"))
    assert re.search(line, " ".join(command_line("review", path).stdout.split()))


def test_the_traceback_of_a_law_is_kept_and_printed_where_it_is_asked_for(trial, monkeypatch) -> None:
    done, path = trial("raises")
    kept = next(each.data.decode() for each in read_log(path).attachments if each.name == "traceback.txt")
    assert 'raise ValueError("my own bug")' in kept
    assert "Traceback" not in done.stderr
    path.unlink()
    monkeypatch.setenv("RTSTACK_TRACEBACK", "1")
    assert kept.splitlines()[-3:] == trial("raises")[0].stderr.rstrip().splitlines()[-3:]


@pytest.mark.long
def test_a_slow_law_is_said_in_event_terminal_and_result(trial) -> None:
    done, path = trial("slow")
    log = read_log(path)
    warning = log.metadata["result"]["warning"]
    assert re.match(rf"the median tick takes \d+ us, allowed {SLOW_US:.0f}: ", warning)
    assert f"rtstack: warning: {warning}" in done.stderr
    said = [event for event in log.topic("/events") if event["name"] == b"loop"]
    assert [(event["level"], event["text"].decode()) for event in said] == [(Level.WARNING, warning)]


@pytest.mark.parametrize(("median_us", "slow"), [(SLOW_US, False), (SLOW_US + 1.0, True), (float("nan"), False)])
def test_the_limit_of_a_slow_tick(median_us, slow) -> None:
    assert bool(slow_tick(median_us)) == slow


def test_a_law_without_wrench_desired_has_no_force_norm(trial) -> None:
    done, path = trial("holds")
    log = read_log(path)
    assert "mean force norm - |" in done.stdout
    for name in ("average_force_norm", "average_force_norm_linear_n", "peak_force_norm"):
        assert log.metadata["result"][name] in ("", "null", "None")
    assert not np.any(log.topic("/left/control")["wrench_desired"])


def test_the_warm_up_calls_a_law_as_a_tick_does(trial) -> None:
    trial("noted")
    calls = sys.modules["wrong_laws"].CALLS
    first = calls[: calls.index("command") + 2]
    assert first == ["follow", "follow", "observe", "observe", "command", "command"]
    again = calls[len(first) :]
    assert again[:6] == first
