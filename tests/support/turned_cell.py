"""A simulated cell in this process that was built otherwise, with the true bases in its file: as after a calibration
without any error."""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from hal.configuration import toml_text
from hal.displacement import Displacement
from rtstack.calibration.cell_file import write
from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.model.cell_description import CellDescription
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.profile import load_profile
from sim_robot.scene import load_scene

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
        profile, file = folder / "built.toml", folder / "cell.toml"
        ideal = (files("sim_robot") / "parameters/profiles/ideal.toml").read_text(encoding="utf-8")
        profile.write_text(ideal + toml_text({"built": built}), encoding="utf-8")
        scene = load_profile(str(profile)).built.scene(load_scene())
        file.write_text(default_cell_file().read_text(encoding="utf-8"), encoding="utf-8")
        bases = {
            (side, f"base_{key}"): list(getattr(place, f"T_world_base_{name}"))
            for side, place in (("left", scene.left), ("right", scene.right))
            for key, name in (("position", "position"), ("orientation_wxyz", "wxyz"))
        }
        write(file, bases)
        return cls(f"direct:{profile}", load_description(file)[0], file)

    def teach(self, log: Path, variation: int = 0, seed: int = 0) -> DemonstrationResult:
        """Record a scripted demonstration."""
        specification = DemonstrationSpecification(variation=variation, seed=seed)
        cell = open_cell(self.kind, "rice_box", 0.0, seed, self.description)
        try:
            opened = open_log(log, specification, self.description, self.kind, self.file)
            return run_demonstration(specification, self.description, cell, RunContext(opened))
        finally:
            cell.close()

    def trial(
        self, recording: Path, log: Path, seed: int, displacement_mm: float = 0.0, faults: Path | None = None
    ) -> TrialResult:
        """Run a trial of a recording."""
        specification = TrialSpecification(str(recording), seed=seed, displacement_mm=displacement_mm)
        prepared = prepare_trial(specification, self.description)
        shift = Displacement.given(displacement_mm)
        cell = open_cell(self.kind, "rice_box", shift, seed, self.description, faults)
        try:
            opened = open_log(log, specification, self.description, self.kind, self.file, reference=prepared.reference)
            return run_trial(prepared, cell, RunContext(opened))
        finally:
            cell.close()
