"""What a campaign ends in: claims, tables and figures, as report.json, PNG files and one HTML page that needs nothing
else.
"""

import base64
import html
import json
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from hal.base.files import write_whole
from rtstack.experiments.claims import Claim
from rtstack.experiments.registration import PLAN_DIGEST, Registration, file_digest

if TYPE_CHECKING:
    from rtstack.experiments.experiment import Experiment
    from rtstack.experiments.store import Store

FIGURES = "figures"
NUMBERS = "report.json"
PAGE = "report.html"


@dataclass(frozen=True, slots=True)
class Table:
    """A table in words. numbers_from: index of the first column that is set flush right."""

    title: str
    headings: Sequence[str]
    lines: Sequence[Sequence[str]]
    note: str = ""
    numbers_from: int = 1


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure. file: its name in the folder of figures; draw: writes it to the path that it is given."""

    file: str
    caption: str
    draw: Callable[[Path], None]


@dataclass(frozen=True, slots=True)
class Section:
    """A report under one set of conditions, or all of it. numbers: what report.json has of it beside its claims.

    about: the conditions in words.
    """

    name: str
    claims: Sequence[Claim] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)
    about: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """All of it. figures, tables: beside those of the parts. made: name and value of what else is said of how it was
    made.

    page: package and name of a template of its own (in the package's folder `pages`, extending page.html), to which
    `values` are given. left_out: cases that cannot be run and are none that are missing. summary: lines for stdout at
    the end; warnings: for stderr, a line each; reached: False where the program is to end with exit status 1.
    """

    parts: Sequence[Section]
    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()
    made: Sequence[tuple[str, str]] = ()
    page: tuple[str, str] = ("rtstack.experiments", "page.html")
    values: Mapping[str, Any] = field(default_factory=dict)
    left_out: int = 0
    summary: str = ""
    warnings: Sequence[str] = ()
    reached: bool = True


def write_preliminary(report: Report, experiment: "Experiment[Any, Any]", store: "Store") -> None:
    """Write figures and report.json, each whole whenever it is read, of a report that is not the last one."""
    out = store.out
    folder = out / FIGURES
    folder.mkdir(exist_ok=True)
    for figure in _figures(report):
        partial = folder / f".{figure.file}"  # with the figure's ending, by which Matplotlib knows the format
        figure.draw(partial)
        os.replace(partial, folder / figure.file)
    numbers = {
        "plan": experiment.specification.name,
        "digest": experiment.digest,
        "registration": registered(experiment, store),
        "conditions": [_part(part) for part in report.parts],
        "tables": [asdict(table) for table in report.tables],
    }  # fmt: skip
    write_whole(out / NUMBERS, json.dumps(numbers, indent=1) + "\n")


def write_report(
    report: Report, experiment: "Experiment[Any, Any]", store: "Store", rows: list[dict[str, Any]]
) -> Path:
    """Write all of it: results.csv, times.csv, figures/*.png, report.json and report.html. Returns the page's path."""
    out = store.out
    store.write_csv(rows)
    write_preliminary(report, experiment, store)
    captions = {figure.file: figure.caption for figure in _figures(report)}
    placed: set[str] = set()

    def figure(file: str) -> Markup:
        placed.add(file)
        data = base64.b64encode((out / FIGURES / file).read_bytes()).decode()
        text = html.escape(captions[file])
        return Markup(f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text} '
                      f"<code>{FIGURES}/{file}</code></figcaption></figure>")  # fmt: skip

    package, name = report.page
    environment = Environment(  # a template may include what all pages share, which is in our own folder `pages`
        loader=ChoiceLoader([PackageLoader(each, "pages") for each in (package, "rtstack.experiments")]),
        autoescape=True, undefined=StrictUndefined, trim_blocks=True,
    )  # fmt: skip
    page = environment.get_template(name).render(
        figure=figure, placed=placed, drawn=[figure.file for figure in report.figures],
        experiment=experiment, plan=experiment.specification, file=experiment.request.file, unit=experiment.unit,
        digest=experiment.digest, rows=rows, planned=experiment.specification.size(), left_out=report.left_out,
        parts=report.parts, tables=report.tables,
        verdicts=Counter(str(claim.verdict) for part in report.parts for claim in part.claims),
        registered=registered(experiment, store), commits=sorted({row["git_commit"] for row in rows}),
        made=report.made, pace=pace(store.invocations(), experiment.logged), **report.values,
    )  # fmt: skip
    path = out / PAGE
    write_whole(path, page)
    return path


def registered(experiment: "Experiment[Any, Any]", store: "Store") -> dict[str, Any]:
    """Return how the plan was fixed: commit; SHA-256 of its file now (digest) and when its first result was about to be
    made (first_digest); whether it was changed since; what other versions it was run with; and the plan's registration.
    """
    about, now = store.about(), file_digest(experiment.request.file.path)
    begun, *others = store.versions()
    first = about.get(PLAN_DIGEST, now)
    fixed: Registration = getattr(experiment.specification, "registration", None) or Registration()
    how = {"commit": about["plan_commit"], "digest": now, "first_digest": first, "changed": now != first}
    how["versions"] = [begun.difference(other) for other in others]
    return how | asdict(fixed)


def pace(invocations: Sequence[Mapping[str, Any]], logged: bool) -> str:
    """Return in words how fast a campaign's invocations went. logged: whether logs were written meanwhile."""
    robot_s, wall_s = (sum(each[name] for each in invocations) for name in ("robot_s", "wall_s"))
    if not wall_s or not robot_s:
        return "-"
    workers = sorted({int(each["workers"]) for each in invocations})
    return (
        f"{robot_s / wall_s:.1f}: {robot_s:.0f} s of the robot in {wall_s:.0f} s{', logs included' * logged}, with "
        f"{' or '.join(map(str, workers))} workers, as measured while it ran"
    )


def _figures(report: Report) -> list[Figure]:
    return [*(figure for part in report.parts for figure in part.figures), *report.figures]


def _part(part: Section) -> dict[str, Any]:
    claims = [
        {"where": claim.where, "claim": claim.says, "mark": claim.mark, "verdict": str(claim.verdict),
         "figures": claim.ours, "why": claim.why}
        for claim in part.claims
    ]  # fmt: skip
    return {"name": part.name, "claims": claims, "tables": [asdict(table) for table in part.tables], **part.numbers}
