"""Programs and studies: each starts, says what it shows and how long it takes, and one helper makes command lines."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from tests.programs import BAD_INPUT, INTERRUPTED, NOT_PERMITTED, claims, program
from tests.programs.__main__ import programs
from tests.studies.__main__ import NAMES, kind_of

ROOT = Path(__file__).resolve().parents[1]
# the smallest run of each program that computes something, and what it prints then; OUT is a folder of its own
FIRST_STEPS = {
    "claims": ("--page OUT/claims.md", r"of \d+ claims have a run"),
    "fuzz": ("--messages 50 --seconds 1 --lockstep", "a real client is served +True"),
    "impact_oracles": ("--configurations 1", "every oracle agrees"),
    "impact_sequence": ("--objects box_130", "not squeezed"),
    "input_fuzz": ("--calls 1", "1 calls, seed 0, .*wrong: 0"),
    "log_fuzz": ("--count 1", "1 logs, seed 0"),
    "mutate": ("--module arming --test test_arming_steps --count 1 --jobs 1", "killed 1 / 1 mutants"),
    "qp_parts": ("--references 1", '"references": 1'),
    "start_motions": ("--cases 1", '"arrived": 1'),
    "tick_beside_mink": ("--rounds 1", "of mink's"),
}
# where that takes longer: each test tries the imports and the command line, `make long` this
LONG_FIRST_STEPS = {
    "cluster": ("OUT/cluster --trials 1", "network namespaces"),
    "commissioning_walk": ("--lockstep", r"commands, .* minutes"),
    "compare": ("--seconds 1 --rounds 1 --out OUT/compare.md", "tick of two arms"),
    "dead_man": ("--repetitions 1 --bare --cause 'key released'", r'"trouble": \[\]'),
    "deeper": ("coverage", "TOTAL .*100%"),
    "fault_matrix": ("--case nan-torque.interim --jobs 1 --out OUT/faults", "1 of 1 cases, 0 missed"),
    "homes": ("--cells 1", r'"wrong": \[\]'),
    "impact_references": ("--out OUT/references", "m/s"),
    "interrupted_campaign": ("--moments 1 --out OUT/interrupted", "lost 0, twice 0, wrong 0; tracebacks 0"),
    "killed": ("--kills 1 --disks 0 --folders 0 --stacks 0", "left behind: nothing"),
    "operator_tasks": ("--only none", "failed: 0"),
    "page_changes": ("--count 1 --busy 0", "trials; the queue stopped"),
    "record_runs": ("--out OUT/recorded", r"\d+ ticks, \d+ kB"),
    "release": ("--out OUT/release", "hashes, an SBOM of"),
    "reproduce": ("--quick --out OUT/reproduce", r"claims of the papers: \d+ hold"),
    "robot_hours": ("--hours 0.01", '"robot_hours"'),
    "same_as_before": ("HEAD", "trial.mcap: .*differs in nothing"),
    "soak": ("--minutes 0.1", '"trouble"'),
    "stop_times": ("--times 1 --way 'STOP by button' --load nothing --out OUT/stop_times", r'"trouble": \[\]'),
    "studies good_trials": ("--quick --out OUT/good_trials", "Good trials"),
    "studies random_plans": ("--quick --out OUT/random_plans", "Random plans"),
    "studies wrong_cells": ("--quick --out OUT/wrong_cells", "Wrong cells"),
    "wrong_setups": ("--setup 'table 50 mm lower' --pace lockstep --out OUT/wrong_setups", "1/1 table 50 mm lower"),
}
# what a first step needs more for than this machine, and the test that takes it, or the one line that says so
ELSEWHERE = {
    "one_hour": ("OUT/hour --cell-file deploy/cells/grab.toml", "one arm"),  # tests/hil/test_one_hour.py: a terminal
    "other_readers": ("--node OUT", "there is no @mcap/core in"),
    "recompute": ("OUT", "there is no .*results.csv"),  # a campaign's folder, which `reproduce` makes
}
# each in a process of its own, forked from one that has imported all of them: an import takes longer than a first step
IN_TURN = """
import importlib, json, os, sys, traceback
from tests.programs.__main__ import main, programs
failed, found = {}, {}
for name in programs():
    module = f"tests.programs.{name}" if " " not in name else "tests.studies." + name.split()[1]
    try:
        if name != "mutate":  # which leaves numba out
            importlib.import_module(module)
    except Exception:
        failed[name] = traceback.format_exc()
    sys.modules.pop(module, None)
for name, words in json.loads(sys.argv[1]).items():
    with open(sys.argv[2], "w+") as said:
        child = os.fork()
        if child == 0:
            os.dup2(said.fileno(), 1), os.dup2(said.fileno(), 2)
            if name in ("mutate", "qp_parts"):  # without numba; code that numba finds by the name of a module
                os.execv(sys.executable, [sys.executable, "-m", "tests.programs", name, *words])
            try:
                main([*name.split(), *words])
            except SystemExit as ended:
                sys.stdout.flush()
                os._exit(ended.code or 0)  # at once: to take down what was imported takes a second
        _, status, used = os.wait4(child, 0)
        said.seek(0)
        status = os.waitstatus_to_exitcode(status)
        found[name] = [1, failed[name], 0.0] if name in failed else [status, said.read(), used.ru_utime + used.ru_stime]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Exit status and output of each program's first step, or of its --help where that takes longer."""
    out = tmp_path_factory.mktemp("programs")
    steps = {name: _words(words, out) for name, (words, _) in (FIRST_STEPS | ELSEWHERE).items()}
    steps |= {name: ["--help"] for name in LONG_FIRST_STEPS}
    command = [sys.executable, "-c", IN_TURN, json.dumps(steps), str(out / "said")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for name, (status, _, took_s) in json.loads(done.stdout).items():
        print(f"{name}: exit status {status} after {took_s:.1f} s of a processor")  # shown where a test fails
    return {name: (status, text) for name, (status, text, _) in json.loads(done.stdout).items()}


def _words(words: str, out: Path) -> list[str]:
    return shlex.split(words.replace("OUT", str(out)))


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", FIRST_STEPS)
def test_the_first_step_of_a_program_computes_something(name: str, started: dict[str, tuple[int, str]]) -> None:
    status, said = started[name]
    assert status == 0, said
    assert re.search(FIRST_STEPS[name][1], said), said


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", LONG_FIRST_STEPS)
def test_a_program_whose_first_step_takes_long_imports_and_has_its_options(
    name: str, started: dict[str, tuple[int, str]]
) -> None:
    status, said = started[name]
    assert status == 0, said
    for option in re.findall(r"--[a-z]+", LONG_FIRST_STEPS[name][0]):
        assert re.search(rf"{option}\b", said), said


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_program_that_needs_more_says_so_in_one_line(name: str, started: dict[str, tuple[int, str]]) -> None:
    status, said = started[name]
    assert (status, said.count("\n")) == (BAD_INPUT, 1), said
    assert re.search(ELSEWHERE[name][1], said), said


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", LONG_FIRST_STEPS)
def test_the_long_first_step_of_a_program_computes_something(name: str, tmp_path: Path) -> None:
    words, expected = LONG_FIRST_STEPS[name]
    command = [sys.executable, "-m", "tests.programs", *name.split(), *_words(words, tmp_path)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode == NOT_PERMITTED or "cannot be installed by pip" in done.stdout:
        pytest.skip(done.stdout.splitlines()[-1])
    assert done.returncode == 0, done.stdout
    assert re.search(expected, done.stdout), done.stdout


def test_each_program_has_a_first_step():
    assert {*FIRST_STEPS, *LONG_FIRST_STEPS, *ELSEWHERE} == set(programs())


def test_the_tests_that_mutation_testing_runs_need_no_conftest():
    """It forks a process a mutant, in which no fixture of tests/conftest.py is known."""
    files = sorted(path for path in (ROOT / "tests/safety").glob("test_*.py") if not path.stem.endswith("_plant"))
    options = ["--noconftest", "--setup-plan", "-q", "-p", "no:cacheprovider", "-c", os.devnull, "-W", "ignore"]
    done = subprocess.run([sys.executable, "-m", "pytest", *options, *files], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]


@pytest.mark.parametrize("target", re.findall(r"(?m)^([a-z]+):.*##", (ROOT / "Makefile").read_text()))
def test_the_recipe_of_a_target_names_programs_that_there_are(target: str):
    """What a recipe runs is there: a command of the environment, a module of this repository, or make's own shell."""
    words = {"run": [], "hil": ["CELL=a,b"], "reproduce": ["QUICK=1", "DATA=data"], "program": ["NAME=soak"]}
    done = subprocess.run(["make", "-n", target, *words.get(target, [])], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for command in re.findall(r"\.venv/bin/([\w-]+)", done.stdout):
        assert command in ("python", "uv") or shutil.which(command, path=str(Path(sys.executable).parent)), command
    for module in re.findall(r"-m tests\.programs ([a-z_]+)", done.stdout):
        assert module in programs()


# claims


def test_the_page_of_claims_is_what_the_list_and_the_runs_give():
    """`python -m tests.programs claims` writes it."""
    text = claims.page(claims.claims(), claims.runs(), claims.version())
    assert claims.PAGE.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("claim", claims.claims().values(), ids=claims.claims())
def test_the_page_of_a_claim_names_a_command_that_there_is(claim: claims.Claim):
    words = shlex.split(claim.command)
    page = (ROOT / claim.page).read_text(encoding="utf-8")
    if words[0] == "make":
        assert f"make {words[1]}" in page
        assert re.search(rf"(?m)^{words[1]}:", (ROOT / "Makefile").read_text())
        return
    assert words[:3] == ["python", "-m", "tests.programs"]
    name = " ".join(words[3:5]) if words[3] == "studies" else words[3]
    assert name in programs()
    assert re.search(rf"(NAME=|tests\.programs[. ]|tests\.){name.split()[0]}\b", page)
    assert name.split()[-1] in page


def test_a_run_takes_the_place_of_the_one_before_and_failures_are_told(tmp_path: Path):
    kept = tmp_path / "claims.tsv"
    claim = claims.Claim("tick", "A claim", "docs/speed.md", "python -c \"print('a 1 b 22 c')\"", r"\d+")
    run = claims.carry_out(claim)
    assert (run.status, run.result, run.version) == ("0", "1; 22", claims.version())
    claims.keep(run, kept)
    claims.keep(replace(run, status="1"), kept)
    (row,) = claims.runs(kept).values()
    page = claims.page({"tick": claim}, {"tick": row}, run.version).splitlines()[-1]
    assert page.endswith("| failed (exit status 1): `1; 22` |")
    assert (
        claims.page({"tick": claim}, {"tick": row}, "9.9").splitlines()[-1].endswith("| not run on this version |  |")
    )


# command lines


def act(what: str, times: int = 1, loud: bool = False) -> int:
    """Do what is asked."""
    if what == "wait":
        raise KeyboardInterrupt
    if what == "refuse":
        raise typer.BadParameter("not this")
    return times + 10 * loud


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["x"], 1, ""), (["x", "--times", "0"], 0, ""), (["x", "--loud"], 11, ""),
        (["wait"], INTERRUPTED, "test_programs: ended"), (["refuse"], BAD_INPUT, "test_programs: .*not this"),
        (["x", "--times", "two"], BAD_INPUT, "test_programs: .*--times"), ([], BAD_INPUT, "test_programs: Missing"),
        (["x", "--no-loud"], BAD_INPUT, "test_programs: .*--no-loud"),
    ],
)  # fmt: skip
def test_a_signature_is_a_command_line_and_its_ends_are_one_line(words, status, said, capsys, monkeypatch):
    monkeypatch.setattr("tests.programs.signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        program(act, words)
    assert ended.value.code == status
    errors = capsys.readouterr().err
    assert errors.count("\n") == bool(said)
    assert re.match(said, errors)


def test_the_list_says_of_each_what_it_shows_and_how_long_it_takes():
    found = programs()
    assert {path.stem for path in (ROOT / "tests/programs").glob("[!_]*.py")} <= set(found)
    for name, (shows, takes) in found.items():
        assert shows.endswith((".", "?")), name
        assert takes.startswith("Takes "), name
    assert all(kind_of(name).COLUMNS for name in NAMES)


def test_an_unknown_program_is_one_line():
    command = [sys.executable, "-m", "tests.programs", "no-such"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (BAD_INPUT, 1)
