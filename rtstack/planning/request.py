"""What a plan is asked to do: data, checked key by key."""

from typing import Annotated, Any, TypeVar

from pydantic import Field, ValidationError
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError
from rtstack.impact_map import MapKind, ReflectedInertia

Time = Annotated[float, Field(gt=0.0, le=10.0, allow_inf_nan=False)]
Length = Annotated[float, Field(ge=-0.5, le=0.5, allow_inf_nan=False)]
Distance = Annotated[float, Field(gt=0.0, le=0.5, allow_inf_nan=False)]
# m/s: slower hits are below what the detector of Appendix B sees (0.025 m/s), faster ones above ee_speed_max's room
SLOWEST_M_S = 0.05
Speed = Annotated[float, Field(ge=SLOWEST_M_S, le=0.8, allow_inf_nan=False)]
# the validation campaign's range is 0.8 to 1.2
Scale = Annotated[float, Field(ge=0.5, le=1.5, allow_inf_nan=False)]
Give = Annotated[float, Field(ge=0.0, le=1e-3, allow_inf_nan=False)]
Momentum = Annotated[float, Field(ge=0.0, le=0.2, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-1.5, le=1.5, allow_inf_nan=False)]


class PlanError(ConfigurationError):
    """A motion that cannot be planned as asked. The message says in one line why, and what to change."""


class TooFast(PlanError):
    """A motion that breaks a limit which a slower impact may keep. fastest: m/s, a speed that does; None: none does."""

    def __init__(self, message: str, fastest: float | None = None) -> None:
        super().__init__(message)
        self.fastest = fastest


@checked(frozen=True, slots=True, config=STRICT)
class GrabPlan:
    """A dual-arm grab. Lengths m, times s, along the world's axes.

    speed, rise: of both pads when they meet the object, inwards and upwards, m/s; height: of the pads' centres over the
    object's there; posture: joint 1 of the left arm there, rad from home (the right arm's is the mirror image);
    squeeze: the force of each pad that is wanted, N; momentum_s: how long after the impact momentum alone lifts,
    without a force upwards in the feedforward: the pads slow down as the object's weight slows them, by two thirds at
    most. 0: they go on at constant velocity for steady_s, and the weight is fed forward at once; give: how far a pad
    goes in under a force, m/N, by its silicone and the object's wall, as a static squeeze shows. post_impact_scale:
    what the velocities after the impact are multiplied with (the validation campaign plans 0.8 to 1.2); inertia: of the
    motors, as the map counts it; map: which of both maps gives the velocities after the impact. With single_step the
    pads keep their orientation, as in the impact-map paper (IV-A): a single step turns pads and object apart.
    compensate: whether weight, friction and inertia of the object are in the feedforward after the impact, (26)-(27).
    """

    speed: Speed = 0.35
    rise: Speed = 0.25
    height: Length = 0.02
    posture: Angle = 0.0
    squeeze: Annotated[float, Field(gt=0.0, le=120.0, allow_inf_nan=False)] = 40.0
    give: Give = 0.0
    momentum_s: Momentum = 0.1
    lift: Distance = 0.25
    carry: Length = 0.05
    post_impact_scale: Scale = 1.0
    inertia: ReflectedInertia = ReflectedInertia.B_THETA
    map: MapKind = MapKind.CONVERGED
    compensate: bool = True
    rest_s: Time = 0.3
    steady_s: Time = 0.05  # at constant velocity before the impact, and after it where no momentum lifts
    lift_s: Time = 1.2
    carry_s: Time = 0.6
    lower_s: Time = 1.1
    release_s: Time = 0.6
    retreat: Distance = 0.12


@checked(frozen=True, slots=True, config=STRICT)
class PushPlan:
    """A hit-and-push by the left arm, away from it along y, while the right one gives way upwards. See GrabPlan.
    travel: how far the object goes after the impact."""

    speed: Speed = 0.5
    height: Length = 0.0
    posture: Angle = 0.0
    travel: Distance = 0.25
    give: Give = 0.0
    post_impact_scale: Scale = 1.0
    inertia: ReflectedInertia = ReflectedInertia.B_THETA
    map: MapKind = MapKind.CONVERGED
    compensate: bool = True
    rest_s: Time = 0.8
    steady_s: Time = 0.05
    release_s: Time = 0.6
    retreat: Distance = 0.05
    way_up: Distance = 0.3


Plan = TypeVar("Plan", GrabPlan, PushPlan)
AnyPlan = TypeVar("AnyPlan", bound=GrabPlan | PushPlan)


def checked_plan(kind: type[AnyPlan], **values: Any) -> AnyPlan:
    """Return a plan of these values. Raises PlanError with the first one out of range."""
    try:
        return kind(**values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise PlanError(f"plan: {key}: {first['msg']}, got {first['input']}") from None
