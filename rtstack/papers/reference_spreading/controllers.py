"""The paper's controllers, as entry points of rtstack.controllers: proposed and its three baselines (part V), and the
proposed one with a contact-completion detector (part VI).
"""

from enum import StrEnum

from rtstack.control.modes import Strategy
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
