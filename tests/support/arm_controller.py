"""An arm's controller with the papers' numbers, for tests of the law."""

from rtstack.control.parameters import ControlParameters, DetectorParameters, FrictionParameters, InertiaParameters
from rtstack.control.tick import ArmController
from rtstack.model.arm_model import ArmModel
from rtstack.safety.limits import HARDWARE, SafetyLimits


def make_arm_controller(
    model: ArmModel,
    parameters: ControlParameters | None = None,
    *,
    inertia: InertiaParameters | None = None,
    friction: FrictionParameters | None = None,
    limits: SafetyLimits = HARDWARE,
) -> ArmController:
    """Return an arm's controller, with the papers' numbers by default."""
    return ArmController(
        model, parameters or ControlParameters(), DetectorParameters(), inertia or InertiaParameters(),
        friction or FrictionParameters(), limits=limits,
    )  # fmt: skip
