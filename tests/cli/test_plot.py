"""Figures and lists of logs from the terminal: what is drawn is what the log has, and what is wrong is one line."""

import json
import re
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rtstack.cli.progress import LINE_S, Lines
from rtstack.figures.log_data import figure_log, with_references
from rtstack.figures.log_figure import MOST_LOGS, aligned, draw, panes_of
from rtstack.log.analysis.derived import DerivedSamples, base_pose, derived
from rtstack.log.analysis.signals import matching, signals
from rtstack.log.reader import read_log
from rtstack.trials.review import log_columns

COMMAND = Path(sys.executable).with_name("rtstack")


@pytest.fixture(scope="module")
def trial(runner, tmp_path_factory) -> Path:
    """The log of a trial with the box out of its place: its two impacts are 100 ms apart."""
    path = tmp_path_factory.mktemp("trials") / "trial.mcap"
    assert runner.run(displacement_mm=-30.0, log=path).success
    return path


def test_derived_signals_are_those_of_the_samples(trial, cell):
    log = read_log(trial)
    made = derived(log, "/left/derived")
    columns = log_columns(log)
    arm, control = columns.arm[0], columns.control[0]
    np.testing.assert_array_equal(made["t_ns"], arm["t_ns"])
    np.testing.assert_allclose(made["pad_force"], np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1))
    place = arm["O_T_EE"][:, :3, 3] + np.array(cell.left.base_position)  # no base is turned in this cell
    np.testing.assert_allclose(made["pad_position"], place, atol=1e-12)
    np.testing.assert_allclose(
        made["tracking_error"], 1e3 * np.linalg.norm(control["pose_ref"][:, :3] - place, axis=1), atol=1e-9
    )
    np.testing.assert_allclose(made["pad_velocity"][2:-2], (place[4:] - place[:-4]) / 0.004, atol=1e-9)
    approach = (log.start_ns + 1.0e9 < made["t_ns"]) & (made["t_ns"] < log.start_ns + 1.2e9)
    behind = (control["twist_ref"][:, 1] * made["lag"] / 1e3)[approach]  # along y, as the approach is
    np.testing.assert_allclose(behind, (control["pose_ref"][:, 1] - place[:, 1])[approach], atol=2e-3)


@pytest.mark.parametrize("step", [1, 7, 1000])
def test_derived_samples_do_not_depend_on_how_they_come(trial, step):
    log = read_log(trial)
    whole = derived(log, "/right/derived")
    arm, control = log.topic("/right/arm"), log.topic("/right/control")
    making, parts = DerivedSamples(base_pose(log, "right")), []
    for start in range(0, 3000, step):
        parts.append(making.add(arm[start : start + step], control[start : start + step]))
    assert sum(map(len, parts)) >= 2990
    together = np.concatenate(parts)
    for name in whole.dtype.names:
        np.testing.assert_array_equal(together[name], whole[name][: len(together)])


def test_a_figure_has_panes_with_units_and_the_reference_over_what_follows_it(trial):
    wanted = with_references(matching(["pad_velocity.vy", "force_norm", "left.tau_J"]))
    log = figure_log(trial, wanted)
    panes = panes_of([log])
    assert [pane.label for pane in panes] == [
        "pad velocity, m/s", "force norm (Eq. 33), N, Nm", "joint torque, measured, Nm",
    ]  # fmt: skip
    assert [line.label for line in panes[0].lines] == [
        "left vy", "right vy", "left vy reference", "right vy reference",
    ]  # fmt: skip
    assert len({line.colour for line in panes[2].lines}) == 7
    figure = draw([log], 1.0, 1.5)
    assert len(figure.axes) == 3
    drawn = figure.axes[0].lines[0]
    t_s, values = np.asarray(drawn.get_xdata()), np.asarray(drawn.get_ydata())
    assert (t_s[0], t_s[-1]) == pytest.approx((1.0, 1.5), abs=2e-3)
    made = derived(read_log(trial), "/left/derived")
    np.testing.assert_array_equal(values, made["pad_velocity"][np.searchsorted(log.traces[0].t_s, t_s), 1])
    assert [side for _, side in log.impacts] == ["right", "left"]


def test_several_logs_are_aligned_at_the_first_impact(trial, demonstration):
    wanted = matching(["pad_force"])
    logs = aligned([figure_log(path, wanted) for path in (trial, demonstration.path)])
    (hit_s, _), *_ = logs[0].impacts
    other_s = min(t_s for t_s, _ in logs[1].impacts)
    assert other_s + logs[1].offset_s == pytest.approx(hit_s)
    lines = panes_of(logs)[0].lines
    assert len({line.colour for line in lines}) == 3  # left, right, and one for the other log
    assert lines[2].label == "left (ref)"


def test_each_kind_of_figure_is_whole(trial, tmp_path, command_line):
    shutil.copy(trial, tmp_path / "t.mcap")
    for kind in ("png", "pdf", "svg", "html"):
        done = command_line("plot", "t.mcap", "pad_force", "lag", f"--{kind}", "--impact", cwd=tmp_path)
        assert (done.returncode, done.stdout) == (0, f"wrote t.{kind}\n"), done.stderr
    with Image.open(tmp_path / "t.png") as image:
        assert image.width > 1000
    pdf = (tmp_path / "t.pdf").read_bytes()
    streams = b"".join(
        zlib.decompress(part) for part in re.findall(rb"/FlateDecode[^>]*>>\s*stream\r?\n(.*?)endstream", pdf, re.S)
    )
    assert b"/FontFile2" in pdf + streams  # the font is in the file
    assert b"/Type3" not in pdf + streams
    assert "<svg" in (tmp_path / "t.svg").read_text()
    page = (tmp_path / "t.html").read_text()
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page.replace("xlink:href", ""))
    assert "url(http" not in page
    first = (tmp_path / "t.pdf").read_bytes()
    assert command_line("plot", "t.mcap", "pad_force", "lag", "--pdf", "--impact", cwd=tmp_path).returncode == 0
    assert (tmp_path / "t.pdf").read_bytes() == first  # the same figure is the same file


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["t.mcap", "forse"], ["unknown signal 'forse'", "pad_force", "left, right:", "timing:"]),
        (["t.mcap", "--pdf", "--svg"], ["--pdf", "--svg"]),
        (["t.mcap", "--output", "x.gif"], ["x.gif", ".pdf"]),
        (["t.mcap", "--output", "none/x.pdf"], ["none/x.pdf"]),
        (["t.mcap", "--from", "3", "--to", "2"], ["--from 3", "--to 2"]),
        (["pad_force"], ["no log"]),
        (["t.mcap"] * (MOST_LOGS + 1), [f"at most {MOST_LOGS}"]),
        (["none.mcap"], ["none.mcap"]),
    ],
)
def test_a_figure_that_cannot_be_is_one_line_and_no_file(trial, tmp_path, command_line, arguments, words):
    (tmp_path / "t.mcap").symlink_to(trial)
    done = command_line("plot", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert all(word in done.stderr for word in words), done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["t.mcap"]


def test_every_signal_has_plain_words_and_its_reference_is_a_signal_with_its_unit():
    for signal in signals().values():
        assert signal.plain
        if signal.reference:
            assert signals()[signal.reference].unit == signal.unit
    assert signals()["left.wrench_desired.mx"].unit == "Nm"
    assert signals()["left.force_norm"].whose == "both arms"


def test_logs_are_listed_shown_and_compared(trial, demonstration, tmp_path, command_line):
    logs = tmp_path / "logs"
    logs.mkdir()
    shutil.copy(trial, logs / "trial.mcap")
    shutil.copy(demonstration.path, logs / "ref.mcap")
    rows = json.loads(command_line("logs", "list", "kind:trial", "--json", cwd=tmp_path).stdout)["logs"]
    assert [(row["name"], row["displacement_mm"]) for row in rows] == [("trial.mcap", -30.0)]
    listed = command_line("logs", "list", cwd=tmp_path).stdout
    assert "trial.mcap" in listed
    assert "expected" in listed
    assert "no log matches" in command_line("logs", "list", "nothing-like-it", cwd=tmp_path).stdout
    (tmp_path / "run" / "logs").mkdir(parents=True)
    meant = command_line("logs", "list", "run/logs", cwd=tmp_path)
    line = "rtstack: run/logs is a folder, and words are searched for: use --logs run/logs\n"
    assert (meant.returncode, meant.stderr) == (2, line)
    shown = json.loads(command_line("logs", "show", "logs/trial.mcap", "--json", cwd=tmp_path).stdout)
    assert shown["settings"]["trial.specification.displacement_mm"] == "-30.0"
    assert shown["topics"]["/left/arm"] == len(read_log(trial).topic("/left/arm"))
    both = command_line("logs", "compare", "logs/trial.mcap", "logs/ref.mcap", "--json", cwd=tmp_path)
    compared = json.loads(both.stdout)
    assert compared["settings"]["trial.kind"] == ["trial", "demonstration"]
    assert next(iter(compared["settings"])).startswith("trial.specification.")
    assert "set differently" in command_line("logs", "compare", "logs/trial.mcap", "logs/ref.mcap", cwd=tmp_path).stdout


def test_a_review_has_a_picture_and_a_specification_that_can_be_read(trial, tmp_path, command_line):
    said = command_line("review", trial, cwd=tmp_path).stdout
    assert re.search(r"^  controller +proposed$", said, re.M)
    assert "{" not in said
    left, right = [line for line in said.splitlines() if re.match("  (left|right) pad", line)]
    force = derived(read_log(trial), "/left/derived")["pad_force"]
    assert left.endswith(f"| {force.max():.0f} N at most")
    assert "█" in left + right
    assert "ante-impact" in said
    assert command_line("review", trial, "--plot", "f.svg", cwd=tmp_path).stdout == "wrote f.svg\n"


def test_the_version_and_completions(tmp_path, command_line):
    assert re.fullmatch(r"rtstack \d+\.\d+\.\d+, Python \d+\.\d+\.\d+\n", command_line("--version").stdout)
    script = command_line("completion", "bash").stdout
    typed = f"COMP_WORDS=(rtstack logs c); COMP_CWORD=2; _rtstack_completion {COMMAND}; echo ${{COMPREPLY[@]}}"
    asked = ["bash", "-c", f"{script}\n{typed}"]
    done = subprocess.run(asked, capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert (done.stdout, done.stderr) == ("compare\n", "")
    for shell in ("zsh", "fish"):
        assert "rtstack" in command_line("completion", shell).stdout
    assert command_line("completion", "tcsh").returncode == 2


def test_progress_without_a_terminal_is_a_line_now_and_then(capsys):
    now_s = [0.0]
    lines = Lines("reading", lambda: now_s[0])
    compiled_s = now_s[0] = 100.0
    for tenth in range(11):
        now_s[0] = compiled_s + tenth * LINE_S / 2
        lines(tenth / 10)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == f"rtstack: reading: 20 %, {0.8 * 5 * LINE_S:.0f} s left"
    assert len(said) == 5


@pytest.mark.long
def test_a_log_becomes_a_picture_that_moves(trial, tmp_path):
    target = tmp_path / "grab.webp"
    asked = ("plot", trial, "--output", target, "--from", "1.2", "--to", "1.35")
    # in a process of its own: MuJoCo chooses how it draws when it is imported
    subprocess.run([COMMAND, *map(str, asked)], check=True, capture_output=True, text=True)
    with Image.open(target) as picture:
        assert (picture.n_frames, picture.size) == (19, (480, 360))
        frames = []
        for number in (0, picture.n_frames - 1):
            picture.seek(number)
            frames.append(np.array(picture.convert("RGB"), dtype=float))
            assert picture.info["duration"] == 83  # ms: 1/120 s of the log, ten times slower
    moved = np.abs(frames[1] - frames[0]).max(axis=2) > 60.0
    assert 100 < moved.sum() < 0.2 * moved.size  # the arms, and not the cell
