"""What goes with a release: wheel and sdist of the last commit, hashes of all that the wheel needs, and an SBOM.

The wheel is built twice, in two folders, and has to come out the same. It is then installed into an environment of its
own, by constraints.txt; from there come `requirements.txt`, for `pip install --require-hashes`, and `sbom.json`
(CycloneDX). The hashes are those of the files that pip chose here: of this platform and this Python. Needs pip's index.

Takes some minutes.
"""

import gzip
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import venv
from io import BytesIO
from pathlib import Path

from hal.base.files import write_whole
from tests.programs import program

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ("build==1.6.1", "cyclonedx-bom==7.5.0")


def run(*command: object, **environment: str) -> None:
    """Run a command. Raises CalledProcessError."""
    subprocess.run([*map(str, command)], check=True, env=os.environ | environment, stdout=sys.stderr)


def environment(folder: Path) -> Path:
    """Make an environment; return its python."""
    venv.create(folder, with_pip=True)
    return folder / "bin" / "python"


def built(python: Path, folder: Path) -> list[Path]:
    """Build wheel and sdist of the last commit in a new folder, with the commit's time in their archives."""
    run("git", "clone", "--quiet", ROOT, folder / "source")
    said = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True, check=True)
    when_s = int(said.stdout)
    run(python, "-m", "build", "--outdir", folder / "dist", folder / "source", SOURCE_DATE_EPOCH=str(when_s))
    for path in (folder / "dist").glob("*.tar.gz"):
        path.write_bytes(timeless(path, when_s))
    return sorted((folder / "dist").iterdir())


def timeless(path: Path, when_s: int) -> bytes:
    """Return an sdist whose files have one time and no owner: setuptools writes the clock and the user into it."""
    packed = BytesIO()
    with (
        tarfile.open(path) as given,
        gzip.GzipFile("", "wb", mtime=when_s, fileobj=packed) as compressed,
        tarfile.open(fileobj=compressed, mode="w") as made,
    ):
        for member in sorted(given.getmembers(), key=lambda each: each.name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = when_s, 0, 0, "", ""
            member.pax_headers = {}
            made.addfile(member, given.extractfile(member) if member.isfile() else None)
    return packed.getvalue()


def hashed(report: dict) -> str:
    """Return pip's report of an installation as requirements with hashes, without our own wheel."""
    lines = []
    for each in report["install"]:
        known = each["download_info"].get("archive_info", {}).get("hashes", {})
        if each["metadata"]["name"] != "rtstack":
            lines.append(f"{each['metadata']['name']}=={each['metadata']['version']} --hash=sha256:{known['sha256']}")
    return "\n".join(sorted(lines, key=str.lower)) + "\n"


def main(out: Path = ROOT / "out" / "release") -> int:
    """Make all of it in a new folder, and say what differs between the two builds."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        tools = environment(work / "tools")
        run(tools, "-m", "pip", "install", "--quiet", *TOOLS)
        first, second = (built(tools, work / name) for name in ("one", "two"))
        same = True
        for a, b in zip(first, second, strict=True):
            equal = a.read_bytes() == b.read_bytes()
            print(f"{a.name}: {'the same' if equal else 'NOT the same'} in two builds")
            same &= equal
            shutil.copy(a, out)
        (wheel,) = out.glob("*.whl")
        python, report = environment(work / "installed"), work / "report.json"
        pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        run(*pip, "-c", ROOT / "constraints.txt", "--report", report, f"{wheel}[all]")
        write_whole(out / "requirements.txt", hashed(json.loads(report.read_text())))
        run(*pip, "--dry-run", "--ignore-installed", "--no-deps", "--require-hashes", "-r", out / "requirements.txt")
        bill = ("environment", "--output-reproducible", "--pyproject", ROOT / "pyproject.toml")
        run(tools.with_name("cyclonedx-py"), *bill, "--output-file", out / "sbom.json", python)
    parts = len(json.loads((out / "sbom.json").read_text())["components"])
    print(f"{out}: {len((out / 'requirements.txt').read_text().splitlines())} hashes, an SBOM of {parts} components")
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}" for file in sorted(out.iterdir())]
    write_whole(out / "SHA256SUMS", "\n".join(sums) + "\n")
    return 0 if same else 1


if __name__ == "__main__":
    program(main)
