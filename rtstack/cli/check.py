"""`rtstack check`: what this host allows, and with two addresses whether the link to the arms is good enough."""

from dataclasses import asdict

import typer

from hal.cell import Cell
from hal.errors import HardwareError
from rtstack.bench.host import Finding, host_findings
from rtstack.bench.link import GOOD_SUCCESS, bench_link
from rtstack.cli.cells import open_cell
from rtstack.trials.errors import TrialError

FAILED = 1
LINK_TICKS = 10_000


def check(left: str | None, right: str | None, json: bool) -> None:
    """Report, one line a finding; exit status 1 when something failed."""
    if (left is None) != (right is None):
        raise TrialError("a link test needs both arms: give --left and --right")
    findings = host_findings()
    if left is not None:
        findings += link_findings(f"fci:{left},{right}")
    if json:
        import json as json_module

        typer.echo(json_module.dumps({"findings": [asdict(finding) for finding in findings]}))
    else:
        for finding in findings:
            advice = f" ({finding.advice})" if finding.advice else ""
            typer.echo(f"{finding.verdict:<4}  {finding.name:<14}  {finding.value}{advice}")
    if any(finding.verdict == "fail" for finding in findings):
        raise typer.Exit(FAILED)


def link_findings(kind: str, ticks: int = LINK_TICKS) -> list[Finding]:
    """Hold both arms of a cell without a torque of ours for `ticks` ms, and judge the link."""
    cell: Cell | None = None
    try:
        cell = open_cell(kind, "", 0.0, 0)
        figures = bench_link(cell, ticks)
    except HardwareError as error:
        return [Finding("link", "broken", "fail", str(error))]
    finally:
        if cell is not None:
            cell.close()
    means, lows = figures.success_rate_mean, figures.success_rate_min
    value = f"success rate {means[0]:.3f} left, {means[1]:.3f} right, at least {min(lows):.2f}"
    value += f"; answered within {max(figures.answer_us_p99):.0f} us at p99"
    advice = "" if figures.verdict == "pass" else f"below {GOOD_SUCCESS}: a network and a host for the arms alone"
    return [Finding("link", value, figures.verdict, advice)]
