"""Where the code departs from a paper's text: one record each, from which the page Departures is made."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Departure:
    """paper: its short name; equation: number or section; we_do: from the code's own settings; effect: what was
    measured, with the command or the test that measures it.
    """

    paper: str
    equation: str
    paper_does: str
    we_do: str
    why: str
    effect: str
