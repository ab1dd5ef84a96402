"""What a reference does with the object: on this depends what counts as success."""

from enum import StrEnum


class Motion(StrEnum):
    """grab: both arms lift it, carry it, put it down. hit-and-push: one arm pushes it over the table."""

    GRAB = "grab"
    HIT_AND_PUSH = "hit-and-push"
