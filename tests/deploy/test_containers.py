"""The compose file and the container file: valid, without privileges, and starting commands that exist."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from rtstack.cli.app import app

ROOT = Path(__file__).parents[2]
COMPOSE = (ROOT / "deploy/compose.yaml").read_text()
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load(COMPOSE)["services"]


def instructions() -> list[tuple[str, str]]:
    """Return the container file's instructions, continued lines in one."""
    text = (ROOT / "deploy/Containerfile").read_text().replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines()]
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line and not line.startswith("#")]


def test_the_compose_file_is_one():
    parser = pytest.importorskip("compose_spec").PyCompose
    values = COMPOSE
    for default in re.findall(r"\$\{[A-Z_]+:-([^}]*)\}", COMPOSE):
        values = re.sub(r"\$\{[A-Z_]+:-[^}]*\}", default, values, count=1)
    merged = yaml.safe_load(values)  # the parser knows no merge keys
    spec = parser.from_yaml(yaml.safe_dump(merged, sort_keys=False)).to_spec()
    assert set(spec.services) == {"simulator", "robot", "console"}
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
    command, *options = service["command"]
    usage = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "300"})
    assert usage.exit_code == 0
    wanted = [option.partition("=")[0] for option in options if option.startswith("--")]
    assert wanted
    assert [option for option in wanted if not re.search(rf"{option}\b", usage.stdout)] == []


def test_robot_and_console_meet():
    robot, console = SERVICES["robot"], SERVICES["console"]
    assert console["ipc"] == "service:robot"  # rings and mailbox
    assert set(console["volumes"]) == set(robot["volumes"])
    assert robot["ulimits"] == {"rtprio": 90, "memlock": -1}
    volumes = {volume.partition(":")[0] for service in SERVICES.values() for volume in service["volumes"]}
    assert volumes == set(yaml.safe_load(COMPOSE)["volumes"])
    for service in SERVICES.values():
        assert (ROOT / "deploy" / service["build"]["context"] / service["build"]["dockerfile"]).is_file()


def test_the_container_file_takes_packages_by_name_and_ends_as_nobody():
    found = instructions()
    names = [name for name, _ in found]
    assert set(names) <= {"FROM", "COPY", "RUN", "ENV", "USER", "WORKDIR", "ENTRYPOINT", "CMD"}
    for image in (rest.split()[0] for name, rest in found if name == "FROM"):
        assert re.fullmatch(r"python:3\.\d+-slim", image)  # a name and a tag, no address
    for name, rest in found:
        if name == "COPY" and "--from" not in rest:
            assert (ROOT / rest.split()[0]).exists()
        if "pip install" in rest:
            assert "--constraint" in shlex.split(rest)
        assert not re.search(r"https?:|index-url|trusted-host|curl|wget", rest)
    last_stage = len(names) - names[::-1].index("FROM")
    users = [rest for name, rest in found[last_stage:] if name == "USER"]
    assert users == ["10001:10001"] == [SERVICES["robot"]["user"]]
    assert names.index("USER", last_stage) > max(k for k, name in enumerate(names) if name == "RUN")
