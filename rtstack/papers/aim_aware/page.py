"""The self-contained page that both studies end in, and the tables that they share."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from markupsafe import Markup

from rtstack.campaign.claims import Claim
from rtstack.campaign.page import PAGE, page_template
from rtstack.campaign.plan import PlanFile
from rtstack.campaign.store import Row, Store
from rtstack.studies.aim_aware.bands import bands
from rtstack.studies.aim_aware.claims import band_words, edge_words, side_words
from rtstack.studies.aim_aware.grid import Banded, Column, Found, Grid


class Study(Protocol):
    """What a page says of a study."""

    @property
    def title(self) -> str: ...
    @property
    def tunings(self) -> Mapping[str, Banded]: ...


class Run(Protocol):
    """What a page says of what was run."""

    @property
    def study(self) -> Study: ...
    @property
    def grid(self) -> Grid: ...


def kept_rows(store: Store, grid: Grid) -> list[Row]:
    """Write results.csv and times.csv of the grid's cases. Returns their rows."""
    wanted = {case.id for case in grid.cases()}
    rows = [row for row in store.rows() if row["id"] in wanted]
    store.write_csv(rows)
    return rows


def write_page(
    template: str, store: Store, run: Run, file: PlanFile, figures: Sequence[Markup], *, claims: Sequence[Claim],
    every: Sequence[Row], unseen: Sequence[Row], **more: Any,
) -> Path:  # fmt: skip
    """Write report.html from the template. unseen: rows that the tuning has not seen. Returns its path."""
    page = page_template(template, "rtstack.studies.aim_aware").render(
        run=run, study=run.study, file=file, planned=run.grid.size(), rows=every, unseen=len(unseen), claims=claims,
        verdicts=Counter(str(claim.verdict) for claim in claims), figures=figures,
        bands=_band_lines(run.study.tunings, every, unseen) if unseen else [],
        reasons=_reason_lines(run.study.tunings, unseen),
        plan_commit=store.about()["plan_commit"], commits=sorted({row["git_commit"] for row in every}),
        cpu_s=sum(row["cpu_s"] for row in every), **more,
    )  # fmt: skip
    path = store.out / PAGE
    path.write_text(page, encoding="utf-8")
    return path


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
