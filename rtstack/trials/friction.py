"""The file of an identified friction: what `rtstack identify-friction` writes, and what a cell or a trial names."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError, NotNegative, Real, load_toml, toml_text
from rtstack.control.parameters import FrictionParameters
from rtstack.samples import SIDES

Share = Annotated[float, Field(ge=-0.2, le=0.2, allow_inf_nan=False)]
Joints = tuple[Real, Real, Real, Real, Real, Real, Real]
Shares = tuple[Share, Share, Share, Share, Share, Share, Share]
Positives = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]


@checked(frozen=True, slots=True, config=STRICT)
class ArmFriction:
    """One arm's, joints 1 to 7: p1 Nm, p2 s/rad, p3 rad/s, gravity_share as in FrictionParameters. rms_nm: what the fit
    left of the feedback's torque in each tick, Nm; for people."""

    p1: Positives
    p2: Positives
    p3: Joints
    gravity_share: Shares
    rms_nm: Positives

    def parameters(self) -> FrictionParameters:
        """Return what a controller reads."""
        return FrictionParameters(
            np.array(self.p1), np.array(self.p2), np.array(self.p3), gravity_share=np.array(self.gravity_share)
        )


@checked(frozen=True, slots=True, config=STRICT)
class FrictionFile:
    """Each arm's friction, None for an arm that was not there, and where it comes from. runs: N_fric of (31)."""

    cell: str
    seed: Annotated[int, Field(ge=0)]
    runs: Annotated[int, Field(ge=1)]
    left: ArmFriction | None = None
    right: ArmFriction | None = None


def load_friction(path: Path, sides: Sequence[str] = SIDES) -> tuple[FrictionParameters, ...]:
    """Return the friction of the arms of these sides. Raises ConfigurationError with one line that names the key."""
    file, found = load_toml(path, FrictionFile), list[FrictionParameters]()
    for side in sides:
        arm: ArmFriction | None = getattr(file, side)
        if arm is None:
            raise ConfigurationError(f"{path}: key {side}: there is no friction of the {side} arm: identify it")
        found.append(arm.parameters())
    return tuple(found)


def friction_toml(file: FrictionFile) -> str:
    """Return the text of a friction file."""
    document = {key: value for key, value in asdict(file).items() if value is not None}
    for side in document.keys() & set(SIDES):
        document[side] = {name: [round(v, 6) for v in values] for name, values in document[side].items()}
    return toml_text(
        document,
        "Identified by `rtstack identify-friction`: Appendix A of the impact-map paper, one joint at a time.",
        'A cell\'s TOML names this file (joint_friction = "..."), or `rtstack trial --friction`.',
    )
