"""The paper's controllers as entry points: proposed, its three baselines (part V), contact completion (part VI).

Its impact detector, Appendix B, is one, too: it is a part of each arm's observation.
"""

from enum import StrEnum

from rtstack.control.modes import Strategy
from rtstack.control.tick import ArmController
from rtstack.trials.assembly import following


class Controller(StrEnum):
    """Their names."""

    PROPOSED = "proposed"
    NO_REFERENCE_SPREADING = "no_reference_spreading"
    NO_VELOCITY_FEEDBACK = "no_velocity_feedback"
    NO_INTERIM = "no_interim"
    CONTACT_COMPLETION = "contact_completion"


proposed = following(Strategy.PROPOSED)
no_reference_spreading = following(Strategy.NO_REFERENCE_SPREADING)
no_velocity_feedback = following(Strategy.NO_VELOCITY_FEEDBACK)
no_interim = following(Strategy.NO_INTERIM)
contact_completion = following(Strategy.CONTACT_COMPLETION)


def appendix_b(arm: ArmController) -> None:
    """Leave the impact detector of an arm as it is."""


NAMES = {
    Controller.NO_REFERENCE_SPREADING: "No reference spreading",
    Controller.NO_VELOCITY_FEEDBACK: "No velocity feedback",
    Controller.NO_INTERIM: "No interim mode",
    Controller.PROPOSED: "Proposed approach",
}
BEYOND = {Controller.CONTACT_COMPLETION: "Contact completion"}  # ours: no part of what the paper compares
# Okabe and Ito's colours, safe for colour-blind eyes
COLOURS: dict[str, str] = {
    Controller.NO_REFERENCE_SPREADING: "#D55E00", Controller.NO_VELOCITY_FEEDBACK: "#CC79A7",
    Controller.NO_INTERIM: "#56B4E9", Controller.PROPOSED: "#000000", Controller.CONTACT_COMPLETION: "#009E73",
}  # fmt: skip
MARKERS = dict(zip(COLOURS, "sv^oD", strict=True))


def name_of(controller: str) -> str:
    """Return what a controller is called: one that the paper does not know by its own name."""
    known: dict[str, str] = {**NAMES, **BEYOND}
    return known.get(controller) or controller.replace("_", " ").capitalize()


def millimetres(displacement_mm: float) -> str:
    return f"{displacement_mm:+g} mm" if displacement_mm else "0 mm"
