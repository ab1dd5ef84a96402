"""Analyses of another package: their curves and numbers in a terminal, and one line for what is wrong with them."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rtstack.figures.log_data import figure_log
from rtstack.log.analysis.offered import ANALYSES, Number, analyse, analysed
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from tests.support.console.review_log import write_log
from tests.support.plugin import installed

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"
WRONG = {
    "raises": ("return {}[1]", "KeyError: 1 (lab-tools 1.2, lab_raises.py:5); mend it there, or uninstall the package"),
    "quits": ("raise SystemExit(3)", "SystemExit: 3 (lab-tools 1.2, lab_quits.py:5)"),
    "nothing": ("return None", "TypeError: expected an Analysis, found NoneType (lab-tools 1.2, lab_nothing.py:4)"),
    "spelt": (
        "return Analysis((Curve('My curve', '', T, T),))",
        "TypeError: expected at most 64 names of a-z, 0-9 and _, each once, found My curve (lab-tools 1.2, ",
    ),
    "twice": (
        "return Analysis(numbers=(Number('n', '', 1), Number('n', '', 2)))",
        "TypeError: expected at most 64 names",
    ),
    "ragged": (
        "return Analysis((Curve('c', 'N', T, T[:2]),))",
        "TypeError: curve c: expected t_ns (n,), int64 in order, and values (n,); found t_ns int64 (3,), values (2,)",
    ),
    "seconds": ("return Analysis((Curve('c', 'N', 1e-9 * T, T),))", "TypeError: curve c: expected t_ns (n,), int64"),
    "backwards": ("return Analysis((Curve('c', 'N', T[::-1], T),))", "TypeError: curve c: expected t_ns (n,), int64"),
    "words": ("return Analysis(numbers=(Number('n', '', 'high'),))", "TypeError: must be real number, not str"),
    "left": ("return Analysis()", "TypeError: an analysis cannot be called 'left': give its entry point another name"),
}


def module(body: str) -> str:
    return (
        "import numpy as np\nfrom rtstack.log.analysis.offered import Analysis, Curve, Number\n"
        f"T = np.arange(3)\ndef analysis(log):\n    {body}\n"
    )


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """A log of two seconds."""
    write_log(tmp_path / "log.mcap", {"kind": "trial"})
    return read_log(tmp_path / "log.mcap")


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install what the package of examples/plugin offers as analyses."""
    offered = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]["rtstack.analyses"]
    lines = "".join(f"{name} = {value}\n" for name, value in offered.items())
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE))
    folder = tmp_path / "package"
    folder.mkdir()
    with installed(folder, f"[rtstack.analyses]\n{lines}", {}, name="joint-tracking"):
        yield


def rtstack(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rtstack", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_example_gives_the_squeeze_of_a_grab(example: None, demonstration) -> None:
    log = read_log(demonstration.path)
    ((said, curves),) = analysed(log)
    assert (said.name, said.package, said.error) == ("squeeze", "joint-tracking 1.2", None)
    assert [(signal.name, signal.unit, signal.group) for signal in said.signals] == [("squeeze.force", "N", "squeeze")]
    forces = [np.linalg.norm(log.topic(f"/{side}/arm")["O_F_ext_hat_K"][:, :3], axis=1) for side in ("left", "right")]
    np.testing.assert_array_equal(curves[0].values, np.minimum(*forces))
    np.testing.assert_array_equal(curves[0].t_ns, log.topic("/left/arm")["t_ns"])
    largest, held = said.numbers
    assert largest == Number("largest", "N", float(np.minimum(*forces).max()))
    assert held.value is not None
    assert 0.2 < held.value < log.duration_s


@pytest.mark.long
def test_a_terminal_shows_numbers_and_draws_curves(example: None, demonstration, tmp_path: Path) -> None:
    text = rtstack("review", demonstration.path)
    assert (text.returncode, text.stderr) == (0, "")
    assert "  squeeze of joint-tracking 1.2\n    largest " in text.stdout
    (said,) = json.loads(rtstack("review", demonstration.path, "--json").stdout)["analyses"]
    assert [(number["name"], number["unit"]) for number in said["numbers"]] == [("largest", "N"), ("held", "s")]
    for words in (["squeeze.force"], ["squeeze", "left.pad_force"]):
        drawn = rtstack("plot", demonstration.path, *words, "--svg", "--output", tmp_path / "figure.svg")
        assert (drawn.returncode, drawn.stderr) == (0, "")
    figure = figure_log(demonstration.path, [], ["squeeze"])
    assert [trace.signal.name for trace in figure.traces] == ["squeeze.force"]
    assert figure.traces[0].t_s[0] == pytest.approx(0.0, abs=1e-3)
    wrong = rtstack("plot", demonstration.path, "squeeze.speed", "--output", tmp_path / "wrong.png")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr == "rtstack: unknown signal 'squeeze.speed': the analysis gives squeeze.force\n"
    assert not (tmp_path / "wrong.png").exists()


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_an_analysis_is_one_line(log: Log, tmp_path: Path, name: str) -> None:
    body, line = WRONG[name]
    with installed(tmp_path, f"[rtstack.analyses]\n{name} = lab_{name}:analysis\n", {f"lab_{name}": module(body)}):
        said, curves = analyse(log, name)
        assert (said.signals, said.numbers, curves) == ((), (), ())
        assert said.error is not None
        assert said.error.startswith(f"analysis '{name}': {line}")
        assert "\n" not in said.error
        with pytest.raises(LogError, match=f"^analysis '{name}': "):
            figure_log(log.path, [], [name])


def test_a_review_goes_on_past_a_broken_analysis(log: Log, tmp_path: Path) -> None:
    offers = (
        "[rtstack.analyses]\nraises = lab_raises:analysis\nmissing = lab_missing:analysis\nfine = lab_fine:analysis\n"
    )
    fine = module("return Analysis(numbers=(Number('n', '', float('nan')), Number('m', 'mm', 2.5)))")
    with installed(tmp_path, offers, {"lab_raises": module(WRONG["raises"][0]), "lab_fine": fine}):
        text = rtstack("review", log.path)
    assert (text.returncode, text.stderr) == (0, "")
    assert "  analysis 'raises': KeyError: 1 (lab-tools 1.2, lab_raises.py:5)" in text.stdout
    assert (
        "  analysis 'missing': lab_missing:analysis of lab-tools 1.2 cannot be loaded: ModuleNotFoundError"
        in text.stdout
    )
    assert "  fine of lab-tools 1.2\n    n                    -\n    m                    2.5 mm\n" in text.stdout
    assert "events" in text.stdout


def test_without_an_analysis_nothing_is_said(log: Log) -> None:
    assert ANALYSES.names() == ()
    assert list(analysed(log)) == []
    assert json.loads(rtstack("review", log.path, "--json").stdout)["analyses"] == []
