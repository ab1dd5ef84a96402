"""The table of departures from the papers, from records that read the code's settings."""

from departures.aim_aware import DEPARTURES as AIM_AWARE
from departures.impact_maps import DEPARTURES as IMPACT_MAPS
from departures.reference_spreading import DEPARTURES as REFERENCE_SPREADING

HEAD = ["| where | the paper | here | why | effect measured |", "|---|---|---|---|---|"]


def departures() -> str:
    """Return a table for each paper, in Markdown."""
    parts = []
    for some in (REFERENCE_SPREADING, AIM_AWARE, IMPACT_MAPS):
        rows = [
            "| "
            + " | ".join(cell.replace("|", "\\|") for cell in (d.equation, d.paper_does, d.we_do, d.why, d.effect))
            + " |"
            for d in some
        ]
        parts.append("\n".join([f"## {some[0].paper}", "", *HEAD, *rows]))
    return "\n\n".join(parts)
