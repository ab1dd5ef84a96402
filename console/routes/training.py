"""Training on a simulated cell: exercises, and the one that runs or was the last."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter
from fastapi.exceptions import HTTPException
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsParts, NeedsSession, takes_two_arms
from console.routes.jobs import start_job
from console.routes.problems import problems
from console.training.trainer import EXERCISES, SURPRISE, ExerciseView
from rtstack.messages import MESSAGE
from rtstack.trials.specification import DemonstrationSpecification, ObjectName

router = APIRouter(prefix="/api/training", tags=["training"], responses=problems(409))


@checked(frozen=True, slots=True, config=MESSAGE)
class ExerciseOrder:
    """Which fault is to come, by its name, or surprise; object: what the demonstration is with."""

    fault: Annotated[str, Field(min_length=1, max_length=40)] = SURPRISE
    object: ObjectName = "rice_box"


@dataclass(frozen=True, slots=True)
class TrainingView:
    """faults: names and words; exercise: the one that runs or was the last."""

    faults: dict[str, str]
    exercise: ExerciseView | None


@router.get("")
def training(parts: NeedsParts) -> TrainingView:
    """Return the exercises, and how the newest one went."""
    return TrainingView({exercise.name: exercise.words for exercise in EXERCISES}, parts.trainer.view)


@router.post("", status_code=202, responses=problems(503), dependencies=[takes_two_arms("a training")])
def begin(order: ExerciseOrder, session: NeedsSession, parts: NeedsParts) -> TrainingView:
    """Start a scripted demonstration in which the fault comes at a random moment. Only on simulated arms."""
    if not parts.cell.simulated:
        raise HTTPException(409, "these arms are real: faults are scripted on simulated ones only")
    exercise, at_s = parts.trainer.choose(order.fault)
    status = start_job(parts, DemonstrationSpecification(object=order.object), session, exercise.faults(at_s))
    parts.trainer.follow(exercise, at_s, status, order.fault == SURPRISE)
    return training(parts)
