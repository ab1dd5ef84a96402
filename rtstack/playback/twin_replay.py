"""The commands of a log, run again on the simulated robot of a profile, such as a twin's: which forces follow there?

The loop is closed: the session that made the log runs again, with the same reference, or with the logged setpoints of
arms that were led by hand, and the twin answers its torques.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.displacement import Displacement
from rtstack.cells import open_cell, with_profile
from rtstack.model.cell_description import CellDescription
from rtstack.playback.logged_cell import LoggedStop, Turns
from rtstack.playback.replay import LoggedRun, read_run
from rtstack.samples import SIDES
from rtstack.trials.errors import TrialError

FREE_TICKS = 300  # a log begins away from everything: what the estimate shows then is no contact
CONTACT_N = 5.0  # of the estimated force: what of the log counts as contact
AT_HOME_RAD = 0.02  # arms that are led by hand begin there, or the simulated ones would jump
OTHER_ARM = 1 << 20  # added to the log's seed: what is not identified of a simulated arm must not be that of the log's


@dataclass(frozen=True, slots=True)
class Contact:
    """An arm: the estimated force on it, N, in the log and in the twin. mean: over the ticks with contact in the log.

    ticks: these. path_mm, torque_nm, velocity: RMS of the distance of the hands, and of the difference of the joints'
    torques and velocities, rad/s.
    """

    side: str
    ticks: int
    mean_n: tuple[float, float]
    peak_n: tuple[float, float]
    path_mm: float
    torque_nm: tuple[float, ...]
    velocity: tuple[float, ...]

    @property
    def off(self) -> float | None:
        """How far the twin's mean force is off, a share of the log's; None without contact."""
        return self.mean_n[1] / self.mean_n[0] - 1.0 if self.ticks else None


@dataclass(frozen=True, slots=True)
class TwinReplay:
    """ticks: of the log, and of the run in the twin."""

    log: str
    kind: str
    twin: str
    ticks: int
    replayed_ticks: int
    arms: tuple[Contact, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the replay as JSON-ready values."""
        return asdict(self) | {"force_off": [arm.off for arm in self.arms]}


def replay_in_twin(path: Path, profile: str) -> TwinReplay:
    """Run a log's commands in the simulated robot of a profile, a name or a path. Raises TrialError with one line."""
    run = read_run(path)
    kind = with_profile("direct", profile)
    replayed = run.again(_opened(run, kind), LoggedStop(run.columns, Turns()))
    arms = tuple(_contact(side, run.columns.arm[k], replayed.arm[k]) for k, side in enumerate(SIDES))
    return TwinReplay(str(path), run.kind, profile, run.columns.arm.shape[1], replayed.arm.shape[1], arms)


def _opened(run: LoggedRun, kind: str) -> Callable[[Path, CellDescription], Any]:
    asked, seed = run.asked, int(run.asked["seed"]) + OTHER_ARM
    shift = Displacement.given(*(asked.get(name, 0.0) for name in ("displacement_mm", "displacement_x_mm", "yaw_deg")))

    def opened(folder: Path, description: CellDescription) -> Any:
        for samples, mounting in zip(run.columns.arm, (description.left, description.right), strict=True):
            away = float(np.abs(samples["q"][0] - np.array(mounting.home)).max())
            if run.kind not in ("trial", "demonstration") and away > AT_HOME_RAD:
                raise TrialError(f"{run.log.path}: an arm begins {away:.2f} rad away from home, where a twin begins")
        return open_cell(kind, asked["object"], shift, seed, description, cell_file=folder / "cell.toml")

    return opened


def _contact(side: str, logged: NDArray, twin: NDArray) -> Contact:
    n = min(len(logged), len(twin))
    ours, its = (_force(samples)[:n] for samples in (logged, twin))
    touched = ours > CONTACT_N
    means = (float(ours[touched].mean()), float(its[touched].mean())) if touched.any() else (0.0, 0.0)
    apart = np.linalg.norm(logged["O_T_EE"][:n, :3, 3] - twin["O_T_EE"][:n, :3, 3], axis=1)
    torque, velocity = (np.sqrt(np.mean((logged[name][:n] - twin[name][:n]) ** 2, axis=0)) for name in ("tau_J", "dq"))
    return Contact(
        side, int(touched.sum()), means, (float(ours.max()), float(its.max())), float(1e3 * np.sqrt(np.mean(apart**2))),
        tuple(torque.tolist()), tuple(velocity.tolist()),
    )  # fmt: skip


def _force(samples: NDArray) -> NDArray[np.float64]:
    force = samples["O_F_ext_hat_K"][:, :3]
    return np.linalg.norm(force - np.median(force[:FREE_TICKS], axis=0), axis=1)
