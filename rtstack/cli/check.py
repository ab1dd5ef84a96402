"""`rtstack check`: what is missing on this machine and what it costs; with the arms' addresses also the link."""

import json as json_module
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from hal.base.configuration import ConfigurationError
from rtstack.check.finding import Finding
from rtstack.check.host import host_findings
from rtstack.check.network import arm_finding, gripper_finding, interface_finding
from rtstack.check.software import software_findings
from rtstack.cli.exit_status import FAILED
from rtstack.cli.options import CellFile, Json, LeftArm, LogsWritten, RightArm, Sign

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription

commands = typer.Typer()


@commands.command()
def check(
    left: LeftArm = None,
    right: RightArm = None,
    cell_file: CellFile = None,
    logs: LogsWritten = Path("logs"),
    sign: Sign = None,
    json: Json = False,
) -> None:
    """Say what this machine lacks, and what that costs; with their addresses hold the arms and judge the link."""
    from rtstack.cells import load_description

    arms = {side: address for side, address in (("left", left), ("right", right)) if address is not None}
    kind = f"fci:{arms.get('left', '')}" + f",{right}" * (right is not None) if arms else ""
    if arms:
        from rtstack.cells.fci import fci_addresses  # and with it pylibfranka, which not every Python has

        fci_addresses(kind)
    findings, description = host_findings() + software_findings(logs), None
    try:
        description, source = load_description(cell_file, kind)
        findings.append(Finding("cell", f"{description.name}, {source}", "pass"))
    except ConfigurationError as error:
        findings.append(Finding("cell", str(error), "fail", "correct the file", "nothing starts with it"))
    if arms:
        findings += _arm_findings(arms, kind, description, cell_file, sign, logs)
    if json:
        typer.echo(json_module.dumps({"findings": [asdict(finding) for finding in findings]}))
    else:
        typer.echo("\n".join(_table(findings)))
    if any(finding.verdict == "fail" for finding in findings):
        raise typer.Exit(FAILED)


def _table(findings: list[Finding]) -> list[str]:
    """Return the lines that a person reads: the facts, then what is missing, with what it costs and what to do."""
    width = max(len(finding.name) for finding in findings)
    lines = []
    for f in findings:
        lines.append(f"{f.verdict:<4}  {f.name:<{width}}  {f.value}")
        lines += [f"{'':<{width + 8}}costs: {f.cost}"] * bool(f.cost)
        lines += [f"{'':<{width + 8}}do:    {f.advice}"] * bool(f.advice)
    failed = [f.name for f in findings if f.verdict == "fail"]
    warned = sum(f.verdict == "warn" for f in findings)
    lines.append(f"missing: {', '.join(failed)}" if failed else f"all that is required is there; {warned} warnings")
    return lines


def _arm_findings(
    arms: dict[str, str], kind: str, description: "CellDescription | None", cell_file: Path | None,
    sign: str | None, logs: Path,
) -> list[Finding]:  # fmt: skip
    findings = [interface_finding(f"way to {side}", address) for side, address in arms.items()]
    findings += [arm_finding(f"{side} arm", address) for side, address in arms.items()]
    if any(finding.verdict == "fail" for finding in findings):
        return findings
    findings += [gripper_finding(f"{side} gripper", address) for side, address in arms.items()]
    if description is None:
        return findings
    from rtstack.cli.link import link_findings

    return findings + link_findings(kind, description, cell_file=cell_file, sign=sign, logs=logs)
