"""What the controllers are called in tables and figures, and how they are drawn."""

from rtstack.papers.reference_spreading.controllers import Controller

NAMES = {
    Controller.NO_REFERENCE_SPREADING: "No reference spreading",
    Controller.NO_VELOCITY_FEEDBACK: "No velocity feedback",
    Controller.NO_INTERIM: "No interim mode",
    Controller.PROPOSED: "Proposed approach",
}
BEYOND = {Controller.CONTACT_COMPLETION: "Contact completion"}  # ours: no part of what the paper compares
# Okabe and Ito's colours, safe for colour-blind eyes
COLOURS: dict[str, str] = {
    Controller.NO_REFERENCE_SPREADING: "#D55E00",
    Controller.NO_VELOCITY_FEEDBACK: "#CC79A7",
    Controller.NO_INTERIM: "#56B4E9",
    Controller.PROPOSED: "#000000",
    Controller.CONTACT_COMPLETION: "#009E73",
}
MARKERS = dict(zip(COLOURS, "sv^oD", strict=True))


def name_of(controller: str) -> str:
    """Return what a controller is called: one that the paper does not know by its own name."""
    known: dict[str, str] = {**NAMES, **BEYOND}
    return known.get(controller) or controller.replace("_", " ").capitalize()


def millimetres(displacement_mm: float) -> str:
    """Return a displacement in words."""
    return f"{displacement_mm:+g} mm" if displacement_mm else "0 mm"
