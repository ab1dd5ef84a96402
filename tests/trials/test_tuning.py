"""The monitor's parameters from good runs: what they follow from, what they then find, and the file."""

from dataclasses import replace

import numpy as np
import pytest

from hal.tracker import OBJECT_POSE
from rtstack.cli.monitor import Recorded, split, tune_monitor, tuning_toml
from rtstack.loop.history import Columns
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.records import Reason, Verdict
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, TIMING_SAMPLE
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import load_tuning, tuning_folder, tuning_of
from rtstack.trials.scoring import UPRIGHT
from rtstack.trials.tuning import Check, GoodRun, check, replay, tune

TICKS, T_D = 1500, 0.5
WEIGHT_N = 12.0
_T_S = np.arange(TICKS) * 1e-3
CARRIED = np.where(_T_S[:, None] > T_D, np.array([0.0, 0.0, WEIGHT_N]), 0.0)
IMPACT = ExpectedImpact(T_D, np.zeros((2, 7)), np.zeros((2, 7)), np.zeros((2, TICKS, 7)), CARRIED, 1.3, 1.4)


def run(seed: int, hits_s: tuple[float, float], weight: float = 1.0) -> GoodRun:
    """A grab in which the arms are hit at these times and then carry so many times the weight."""
    noise = np.random.default_rng(seed)
    arm, control = np.zeros((2, TICKS), ARM_SAMPLE), np.zeros((2, TICKS), CONTROL_SAMPLE)
    arm["t_ns"] = np.arange(TICKS) * 1_000_000
    arm["q"] = 0.01 * np.sin(_T_S)[:, None]
    arm["O_F_ext_hat_K"][:, :, :3] = 0.5 * weight * CARRIED + 0.1 * noise.standard_normal((2, TICKS, 3))
    residual = 0.02 * noise.standard_normal((2, TICKS, 7))
    for side, hit_s in enumerate(hits_s):
        residual[side, round(hit_s * 1e3) :] += 5.0
    control["momentum_residual"] = residual
    columns = Columns(arm, control, np.zeros(TICKS, TIMING_SAMPLE), np.zeros(0, OBJECT_POSE))
    return GoodRun(f"run {seed}", columns, IMPACT, UPRIGHT)


GOOD = [run(1, (0.48, 0.505)), run(2, (0.51, 0.47)), run(3, (0.502, 0.504)), run(4, (0.5, 0.5))]


def test_bounds_are_the_worst_good_run_times_the_sensitivity() -> None:
    parameters = tune(GOOD, 1.5)
    assert parameters.arm.time_s == pytest.approx(1.5 * 0.03)
    assert parameters.later_s == pytest.approx(1.5 * 0.01)
    assert parameters.arm.configuration_rad == pytest.approx(1.5 * 0.01 * np.sin(0.51) * 7**0.5, rel=0.01)
    # neither noise nor the impact: 0.02 Nm of noise a tick are at most some 100 Nm/s, the impact is 5000
    assert all(100.0 < bound < 1000.0 for bound in parameters.arm.residual_rate_nm_s)
    assert parameters == tune(GOOD, 1.5)
    sharper, blunter = tune(GOOD, 1.1), tune(GOOD, 2.0)
    assert sharper.arm.time_s < parameters.arm.time_s < blunter.arm.time_s
    assert max(sharper.net_force.z_n) < max(blunter.net_force.z_n)


def test_what_was_tuned_finds_what_is_wrong_and_nothing_else() -> None:
    parameters = tune(GOOD, 1.5)
    found = check([run(9, (0.49, 0.506)), run(10, (0.47, 0.51))], parameters)
    assert found.false_alarms == ()
    assert 0.0 < found.smallest_margin < 1.0
    for wrong, reason in (
        (run(11, (0.44, 0.505)), Reason.TIME),
        (run(12, (0.46, 0.47)), Reason.PAIR_TIME),
        (run(13, (0.5, 0.5), weight=1.0 / 3.0), Reason.LOAD),
        (run(14, (0.5, 2.0)), Reason.ONE_SIDE),
    ):
        monitor = replay(wrong, parameters)
        assert (monitor.verdict, monitor.reason) == (Verdict.UNEXPECTED, reason)
    assert check([run(11, (0.44, 0.505))], parameters).false_alarms == ("run 11",)
    with pytest.raises(TrialError, match="run 14, right arm: no impact"):
        tune([run(14, (0.5, 2.0))], 1.5)


def test_a_file_comes_back_as_it_was(tmp_path) -> None:
    monitor, path = tuning_of("rice_box").monitor, tmp_path / "monitor.toml"
    used, held_out = split([Recorded(GOOD[0], "rice_box", f"rice_box-{k // 2}", -3.0, k) for k in range(6)])
    path.write_text(tuning_toml(monitor, 1.3, Check(2, (), 0.5), used, held_out))
    again = load_tuning(path)
    assert again.monitor == monitor
    assert again.provenance["object"] == "rice_box"
    assert again.provenance["held_out_demonstrations"] == ["rice_box-2"]
    assert again.provenance["held_out_seeds"] == [4, 5]
    assert tuning_of("nothing") is None


def test_a_tuning_of_the_users_counts_before_the_installed_one(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    installed = tuning_of("rice_box").monitor
    wider = replace(installed, later_s=2.0 * installed.later_s)
    used, held_out = split([Recorded(GOOD[0], "rice_box", f"rice_box-{k // 2}", -3.0, k) for k in range(6)])
    tuning_folder().mkdir(parents=True)
    for name, monitor in (("rice_box", wider), ("crate", installed)):
        text = tuning_toml(monitor, 1.3, Check(2, (), 0.5), used, held_out)
        (tmp_path / "rtstack" / "monitor" / f"{name}.toml").write_text(text)
    assert tuning_of("rice_box").monitor == wider
    assert tuning_of("crate").monitor == installed
    assert tuning_of("parcel") is not None  # of the package


def test_runs_of_one_demonstration_are_held_out_one_by_one() -> None:
    used, held_out = split([Recorded(GOOD[0], "rice_box", "a", 0.0, k) for k in range(7)])
    assert [record.seed for record in held_out] == [2, 5]
    assert [record.seed for record in used] == [0, 1, 3, 4, 6]


def test_bad_input_writes_nothing(tmp_path) -> None:
    there = tmp_path / "there.toml"
    there.touch()
    with pytest.raises(TrialError, match="exists: choose another name"):
        tune_monitor([], there)
    with pytest.raises(TrialError, match="too few"):
        tune_monitor([tmp_path / "a.mcap"], tmp_path / "out.toml")
    assert not (tmp_path / "out.toml").exists()
