"""A campaign's folder to publish: columns, units and checksums that programs of others understand."""

import csv
import json
import shutil
import subprocess

from rtstack.experiments.package import unit_of


def test_units_are_in_the_columns_names():
    units = {"max_lift_mm": "mm", "swing_m_s": "m/s", "compute_us_p99": "us", "yaw_deg": "degree", "controller": ""}
    assert {name: unit_of(name) for name in units} == units


def test_a_packed_folder_checks_itself_and_names_every_column(finished, tmp_path, command_line):
    folder = tmp_path / "packed"
    shutil.copytree(finished.out, folder)
    done = command_line("campaign", "pack", str(folder))
    assert done.returncode == 0, done.stderr
    assert (folder / "sources" / "plan.toml").read_text().startswith("# What the reference-spreading paper ran")

    def check():
        return subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, capture_output=True)

    assert check().returncode == 0
    package = json.loads((folder / "datapackage.json").read_text())
    assert "version" not in package  # the format's own word, for a text
    assert dict(package["rtstack"]["made_by"]["packages"])["mujoco"]
    for resource in package["resources"]:
        with open(folder / resource["path"], newline="") as file:
            names = next(csv.reader(file))
        assert [field["name"] for field in resource["schema"]["fields"]] == names
    readme = (folder / "README.md").read_text()
    assert "| max_lift_mm | number | mm |" in readme
    assert "| success | boolean |  |" in readme
    log = next((folder / "logs").glob("*.mcap"))
    log.write_bytes(log.read_bytes()[:-1])
    assert check().returncode == 1
    assert command_line("campaign", "pack", str(folder)).returncode == 0  # again, once something has changed
    assert check().returncode == 0


def test_a_campaign_without_a_report_is_not_packed(finished, tmp_path, command_line):
    folder = tmp_path / "begun"
    shutil.copytree(finished.out, folder)
    (folder / "report.html").unlink()
    before = sorted(folder.iterdir())
    done = command_line("campaign", "pack", str(folder))
    assert done.returncode == 2
    assert "has no report yet: run its campaign to the end with --resume" in done.stderr
    assert sorted(folder.iterdir()) == before
