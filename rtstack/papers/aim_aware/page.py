"""What the reports of both studies have in common: the tables of bands and of reasons, and the page's values."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rtstack.experiments.experiment import Row
from rtstack.papers.aim_aware.bands import bands
from rtstack.papers.aim_aware.claims import band_words, edge_words, side_words
from rtstack.papers.aim_aware.grid import Banded, Column, Found


def page_values(
    study: Any, tuned: Any, every: Sequence[Row], unseen: Sequence[Row], table_name: str, signals: str
) -> dict[str, Any]:
    """Return what study.html needs. unseen: rows that the tuning has not seen."""
    return {
        "study": study, "tuned": tuned, "unseen": len(unseen), "table_name": table_name, "signals": signals,
        "table": table_lines(study.tunings, tuned.tunings),
        "bands": _band_lines(study.tunings, every, unseen) if unseen else [],
        "reasons": _reason_lines(study.tunings, unseen), "cpu_s": cpu_s(every),
    }  # fmt: skip


def cpu_s(rows: Sequence[Row]) -> float:
    """Return how much of a CPU's time the rows took, s."""
    return sum(row["cpu_s"] for row in rows)


def table_lines(columns: Mapping[str, Column], tunings: Mapping[str, Found]) -> list[list[str]]:
    """Return the lines of the paper's table: symbol, and for each tuning the paper's value, and ours where found."""
    lines = []
    for symbol, name, unit in (
        ("m_max", "window", ""), ("m_c", "delay", ""), ("a", "decay_1_s", " 1/s"),
        ("epsilon", "configuration_rad", " rad"), ("zeta", "time_s", " s"), ("xi", "horizon_s", " s"),
        ("e_m", "velocity_rad_s", " rad/s"), ("iota", "spacing_s", " s"),
    ):  # fmt: skip
        cells = []
        for tuning, column in columns.items():
            found = getattr(tunings[tuning], name, None)
            cells += [f"{getattr(column, name):g}{unit}", "the same" if found is None else f"{found:g}{unit}"]
        lines.append([symbol, *cells])
    return lines


def _band_lines(columns: Mapping[str, Banded], every: Sequence[Row], unseen: Sequence[Row]) -> list[list[str]]:
    """Return a line for each tuning and each set of cases: always expected, sometimes, never."""
    lines = []
    seen_too = [("all cases", every, "")] if len(every) > len(unseen) else []
    for label, cases, prefix in (
        ("cases that the tuning has not seen", unseen, ""), *seen_too,
        ("the paper's table to the letter, unseen cases", unseen, "paper_"),
    ):  # fmt: skip
        for name, column in columns.items():
            found = bands(cases, prefix + name)
            lines.append(
                [f"({name}) {label}", str(found.cases), band_words(column.band), band_words(found.always),
                 side_words(found.sometimes), " and ".join(map(edge_words, found.never))]
            )  # fmt: skip
    return lines


def _reason_lines(columns: Mapping[str, Banded], rows: Sequence[Row]) -> list[list[str]]:
    """Return, for each tuning, which condition was the first that unexpected impacts did not meet."""
    lines = []
    for name in columns:
        counts = Counter(row[f"reason_{name}"] for row in rows if row[f"verdict_{name}"] == "unexpected")
        text = ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in counts.most_common())
        undecided = sum(row[f"verdict_{name}"] == "none" for row in rows)
        lines.append([f"({name})", text or "-", str(undecided)])
    return lines
