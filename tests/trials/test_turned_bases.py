"""Bases that stand turned, as the cell's file says: nothing that is found out about a trial depends on how."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rtstack.calibration.points import write
from rtstack.cells import default_cell_file, load_description
from rtstack.cli.monitor import tune_monitor
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.monitor.records import Reason, Verdict
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import load_tuning, tuning_of
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.review import log_columns, review_log
from rtstack.trials.scoring import SuccessCriterion, score
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial
from rtstack.trials.tuning import GoodRun, replay
from rtstack.trials.unexpected import Unexpected, classify
from sim_robot.profile import load_profile
from sim_robot.scene import load_scene
from tests.support.built_cell import profile
from tests.support.runs import attempt, demonstrate

# mm, and deg as rotation vectors: both 20 mm higher, turned by 4 and 3 deg
TURNED: dict[str, object] = {
    "left_mm": [0.0, 0.0, 20.0], "right_mm": [0.0, 0.0, 20.0],
    "left_deg": [1.5, -1.0, 3.5], "right_deg": [-1.0, 1.2, -2.6],
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class BuiltCell:
    """kind: of the cell, as it is opened; file: its description's, with the bases where they are."""

    kind: str
    description: CellDescription
    file: Path

    @classmethod
    def write(cls, folder: Path, built: dict[str, object]) -> "BuiltCell":
        """Write the profile of a cell that was built so, and the cell's file, into a folder."""
        how, file = profile(folder / "built.toml", built), folder / "cell.toml"
        scene = load_profile(str(how)).built.scene(load_scene())
        file.write_text(default_cell_file().read_text(encoding="utf-8"), encoding="utf-8")
        bases = {
            (side, f"base_{key}"): list(getattr(place, f"T_world_base_{name}"))
            for side, place in (("left", scene.left), ("right", scene.right))
            for key, name in (("position", "position"), ("orientation_wxyz", "wxyz"))
        }
        write(file, bases)
        return cls(f"direct:{how}", load_description(file)[0], file)

    def teach(self, log: Path, variation: int = 0, seed: int = 0) -> DemonstrationResult:
        """Record a scripted demonstration."""
        asked = DemonstrationSpecification(variation=variation, seed=seed)
        return demonstrate(log, self.description, asked, kind=self.kind, file=self.file)

    def trial(
        self, recording: Path, log: Path, seed: int, displacement_mm: float = 0.0, faults: Path | None = None
    ) -> TrialResult:
        """Run a trial of a recording."""
        asked = TrialSpecification(str(recording), seed=seed, displacement_mm=displacement_mm)
        return attempt(asked, self.description, log, kind=self.kind, file=self.file, faults=faults)


HEAVIER = '[[fault]]\nkind = "object_mass"\nat_s = 0.0\nmass_factor = 3.0\n'


@dataclass(frozen=True, slots=True)
class Grabbed:
    """A demonstration and a trial of it."""

    cell: BuiltCell
    recording: Path
    trial: Path
    result: TrialResult


@pytest.fixture(scope="module")
def turned(tmp_path_factory) -> Grabbed:
    folder = tmp_path_factory.mktemp("turned")
    cell = BuiltCell.write(folder, TURNED)
    recording, trial = folder / "taught.mcap", folder / "trial.mcap"
    assert cell.teach(recording, variation=5, seed=5).success
    return Grabbed(cell, recording, trial, cell.trial(recording, trial, seed=1005))


def test_a_good_grab_with_turned_bases_is_expected(turned) -> None:
    assert turned.result.success
    assert (turned.result.impact_verdict, turned.result.impact_reason) == ("expected", None)


def test_a_heavier_object_is_told_with_turned_bases_too(turned, tmp_path) -> None:
    faults = tmp_path / "faults.toml"
    faults.write_text(HEAVIER)
    result = turned.cell.trial(turned.recording, tmp_path / "heavy.mcap", seed=7, faults=faults)
    assert (result.impact_verdict, result.impact_kind) == ("unexpected", Unexpected.TOO_HEAVY)


def test_its_log_says_the_same_again(turned) -> None:
    log = read_log(turned.trial)
    specification = TrialSpecification(str(turned.recording))
    reference = prepare_trial(specification, turned.cell.description).reference
    run = GoodRun("trial", log_columns(log), reference.impact, base_poses(turned.cell.description))
    monitor = replay(run, tuning_of("rice_box").monitor)
    assert monitor.verdict is Verdict.EXPECTED
    assert float(monitor.pair[0]["t_verdict_ns"]) * 1e-9 == turned.result.impact_verdict_time_s
    assert float(monitor.pair[0]["margin"]) == pytest.approx(turned.result.impact_margin, abs=1e-6)
    assert review_log(turned.trial).score.held


def test_a_tuning_is_made_of_logs_of_the_cell_that_is_named(turned, tmp_path) -> None:
    logs = [Path(shutil.copy(turned.trial, tmp_path / f"{k}.mcap")) for k in range(6)]
    with pytest.raises(TrialError, match="bases and pads elsewhere"):
        tune_monitor(logs, tmp_path / "ours.toml", 1.5)
    tune_monitor(logs, tmp_path / "theirs.toml", 1.5, turned.cell.file)
    bounds = load_tuning(tmp_path / "theirs.toml").monitor.net_force
    # what two pads that are pressed together with 45 N add up to along the axes of bases turned by 4 and 3 deg: 5 N
    assert max(bounds.x_n[-1], bounds.y_n[-1], bounds.z_n[-1]) < 2.0


def test_however_the_bases_stand_the_same_is_said_of_the_same_trial(cell, demonstration, tmp_path) -> None:
    """What the arms measure along their bases' axes, along those of others: kind, verdict and score stay."""
    faults = tmp_path / "faults.toml"
    faults.write_text(HEAVIER)
    specification = TrialSpecification(str(demonstration.path), seed=3)
    prepared = prepare_trial(specification, cell)
    path = tmp_path / "trial.mcap"
    result = attempt(prepared, cell, path, faults=faults)
    assert (result.impact_reason, result.impact_kind) == ("load", Unexpected.TOO_HEAVY)
    columns, stood, reference = log_columns(read_log(path)), base_poses(cell), prepared.reference
    bases = (_placed([0.0, 0.0, 1.5], [0.3, 0.9, 0.1]), _placed([-0.9, 0.3, 0.0], [-0.2, -0.7, 0.4]))
    arm = columns.arm.copy()
    for samples, was, now in zip(arm, stood, bases, strict=True):
        samples["O_T_EE"] = np.linalg.inv(now) @ was @ samples["O_T_EE"]
        turn = now[:3, :3].T @ was[:3, :3]
        for part in (slice(0, 3), slice(3, 6)):
            samples["O_F_ext_hat_K"][:, part] = samples["O_F_ext_hat_K"][:, part] @ turn.T
    start_ns = int(columns.arm[0]["t_ns"][0])
    way, period_s = reference.ante["position"], reference.period_s
    for seen, stand in ((columns, stood), (replace(columns, arm=arm), bases)):
        monitor = replay(GoodRun("trial", seen, reference.impact, stand), tuning_of("rice_box").monitor)
        assert (monitor.verdict, monitor.reason) == (Verdict.UNEXPECTED, Reason.LOAD)
        assert float(monitor.pair[0]["t_verdict_ns"]) * 1e-9 == pytest.approx(result.impact_verdict_time_s)
        assert classify(monitor, seen, stand, start_ns, way, period_s) is Unexpected.TOO_HEAVY
        values = score(
            seen, start_ns, reference.nominal_impact_s, reference.release_s, result.detected_impact_time_s,
            SuccessCriterion(), bases=stand,
        )  # fmt: skip
        assert values.held is result.success


def _placed(turn: list[float], place: list[float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return T
