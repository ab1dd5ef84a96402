"""How a campaign ends on the command line."""

from pathlib import Path

import pytest
import typer

from rtstack.cli.campaign import end
from rtstack.experiments.report import Report


@pytest.mark.parametrize(("failures", "spoilt"), [({"case-7": "no worker left"}, False), ({}, True), ({}, False)])
def test_what_could_not_be_run_is_said_and_is_the_exit_status(capsys, failures, spoilt):
    status = None
    try:
        end(Path("report.html"), failures, Report([], reached=not spoilt))
    except typer.Exit as ending:
        status = ending.exit_code
    out, errors = capsys.readouterr()
    assert (out, status) == ("report: report.html\n", 1 if failures or spoilt else None)
    told = ["rtstack: case-7 could not be run: no worker left", "rtstack: run the same with --resume to try them again"]
    assert errors.splitlines() == (told if failures else [])
