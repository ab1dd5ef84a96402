"""The trial that the form asks for, before it runs and while it runs: what the scene draws of it, for all who look."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from console.questions.questions import Question, Questions
from console.questions.trial_path import TrialPath
from console.refused import Refused
from hal.displacement import Displacement
from rtstack.live.protocol import JobKind, Status


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """What is put where, and the file that is followed; None: nothing yet."""

    object: str
    displacement: Displacement
    reference: Path | None


class TrialPlans:
    """The form's trial and the running one, each with the question for its path. May be used from any thread."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self._form: tuple[TrialPlan | None, Question | None] = None, None
        self._running: tuple[int, TrialPlan, Question | None] | None = None

    def set(self, plan: TrialPlan | None) -> None:
        """Take what a form says now; None: no form is shown."""
        self._form = plan, None if plan is None else self._asked(plan)

    def ordered(self, job: int, plan: TrialPlan) -> None:
        """Take what was ordered, as this job."""
        self._running = job, plan, self._asked(plan)

    def current(self, status: Status | None) -> tuple[TrialPlan | None, TrialPath | None]:
        """Return what is to be drawn: of a running trial its own plan, if it is known, else the form's.

        The path is None until the plan's reference was read, and where it has none.
        """
        job = None if status is None else status.job
        plan, question = self._form
        if job is not None and job.active:
            own = job.kind is JobKind.TRIAL and self._running is not None and self._running[0] == job.number
            plan, question = self._running[1:] if own and self._running is not None else (None, None)
        if question is not None and question.done():
            with suppress(Refused):
                return plan, TrialPath(**question.answer())
        return plan, None

    def _asked(self, plan: TrialPlan) -> Question | None:
        with suppress(OSError):
            return None if plan.reference is None else self._questions.ask("path", plan.reference)
        return None
