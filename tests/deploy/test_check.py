"""`rtstack check`: what it finds, what it calls required, and what it says that a lack costs."""

import json
import os
import socket
import subprocess
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from rtstack.cells import default_cell_file
from rtstack.check.host import host_findings
from rtstack.check.software import software_findings, versions_tested

COMMAND = Path(sys.executable).with_name("rtstack")
LEFT, RIGHT = (f"127.{number}.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}" for number in (203, 204))


def test_what_is_required_is_here_and_every_lack_has_its_cost(tmp_path):
    command = [str(COMMAND), "check", "--json", "--logs", str(tmp_path / "logs")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    findings = json.loads(done.stdout)["findings"]
    names = [finding["name"] for finding in findings]
    for name in ("scheduler", "memory lock", "kernel", "CPU governor", "isolated CPUs", "clock", "Python", "packages",
                 "mujoco", "disk", "shared memory", "cell"):  # fmt: skip
        assert name in names
    for finding in findings:
        lacking = finding["verdict"] != "pass"
        assert bool(finding["cost"]) == bool(finding["advice"]) == lacking
    assert done.returncode == any(finding["verdict"] == "fail" for finding in findings)
    assert not (tmp_path / "logs").exists()


def test_an_arm_that_does_not_answer_and_a_bad_cell_fail(tmp_path, command_line):
    cell = tmp_path / "cell.toml"
    cell.write_text(default_cell_file().read_text().replace("mass = 0.35", "weight = 0.35"))
    weight = cell.read_text()[: cell.read_text().index("[pad]")].count("\n") + 1  # of the table that lacks it
    with socket.socket() as arm:  # something listens at one address only
        arm.bind((LEFT, 1337))
        arm.listen()
        done = command_line("check", "--left", LEFT, "--right", RIGHT, "--cell-file", cell)
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    assert any(line.startswith("pass  left arm") for line in lines)
    assert any(line.startswith("fail  right arm") and "Connection refused" in line for line in lines)
    assert any(line.startswith("fail  cell") and f"{cell}:{weight}: key pad.mass" in line for line in lines)
    assert lines[-1] == "missing: cell, right arm"


def test_a_machine_made_for_it_has_no_warning_about_its_kernel(tmp_path):
    cpu = tmp_path / "devices/system/cpu"
    for path, text in (
        (tmp_path / "kernel/realtime", "1"), (cpu / "isolated", "0"),
        (cpu / "cpu0/cpufreq/scaling_governor", "powersave"),
        (tmp_path / "devices/system/clocksource/clocksource0/current_clocksource", "tsc"),
    ):  # fmt: skip
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    found = {finding.name: finding for finding in host_findings(tmp_path)}
    assert [found[name].verdict for name in ("kernel", "isolated CPUs", "clock")] == ["pass"] * 3
    assert found["CPU governor"].verdict == "warn"
    (cpu / "isolated").write_text("9000-9007\n")
    isolated = next(f for f in host_findings(tmp_path) if f.name == "isolated CPUs")
    assert (isolated.verdict, "taskset --cpu-list 0-9007" in isolated.advice) == ("warn", True)


def test_a_package_that_is_not_the_tested_one_is_told(monkeypatch, tmp_path):
    from rtstack.check import software

    assert versions_tested()["mujoco"].count(".") == 2
    found = {finding.name: finding for finding in software_findings(tmp_path)}
    assert found["packages"].verdict == "pass"
    monkeypatch.setattr(software, "version", lambda name: "0.0.1")
    found = {finding.name: finding for finding in software_findings(tmp_path)}
    assert found["mujoco"].verdict == "warn"
    import_module("pylibfranka")  # the one whose version is pinned; not every Python has it
    assert found["packages"].verdict == "fail"
    assert "pylibfranka 0.0.1 is not ==" in found["packages"].value


def test_what_is_not_published_for_this_python_is_told_with_what_it_costs(monkeypatch, tmp_path):
    from rtstack.check import software

    def version(name: str) -> str:
        if name == "pylibfranka":
            raise PackageNotFoundError(name)
        return versions_tested()[name]

    monkeypatch.setattr(software, "version", version)
    found = next(finding for finding in software_findings(tmp_path) if finding.name == "pylibfranka")
    assert (found.value, found.verdict) == ("missing", "warn")
    assert "no real arms" in found.cost
    assert 'python_version < "3.13"' in found.advice


def test_a_file_is_no_folder_of_logs(tmp_path):
    (tmp_path / "logs").write_text("mine")
    disk = next(finding for finding in software_findings(tmp_path / "logs" / "today") if finding.name == "disk")
    assert (disk.verdict, disk.value) == ("fail", f"{tmp_path / 'logs'} is no folder")


@pytest.mark.parametrize("arguments", [("--cell-file",), ("--cell", "lab.toml")])
def test_bad_input_is_one_line(command_line, arguments):
    done = command_line("check", *arguments)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
