"""The contact of a simulated grab, and how much it differs between repetitions."""

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, NotNegative, Positive
from rtstack.cells import IDEAL


@checked(frozen=True, slots=True, config=STRICT)
class Conditions:
    """The contact of a trial, and how much it differs between repetitions. Scatter: standard deviations.

    pad_stiffness N/m; friction coefficients; friction_scatter a fraction of the pads' and of the table's friction;
    tau_ext_cutoff_hz of the robot's filter of the external torque, on which the impact detector waits; speed_m_s of the
    pads at the object's surface in the demonstration, if not the variation's own. profile: of the simulated robot
    (sim_robot.profile).
    """

    pad_stiffness: Positive
    pad_friction: Positive
    table_friction: Positive
    friction_scatter: NotNegative
    placement_mm: NotNegative
    placement_yaw_deg: NotNegative
    tau_ext_cutoff_hz: Positive
    speed_m_s: Positive | None = None
    profile: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] = IDEAL
