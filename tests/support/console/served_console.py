"""A console that serves for real, on a free port, beside a robot service without arms."""

import json
import shutil
import socket
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import uvicorn
from fastapi import FastAPI

from console.address import Address
from console.app import create_app
from console.connections import Door
from console.parts import Parts, assemble
from console.server import server_settings
from deploy import cells
from rtstack.access.tokens import Scope
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.live.job_manager import JobManager
from rtstack.live.robot import Service
from rtstack.live.source import live_source
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox
from rtstack.model.cell_description import load_cell_description

CELL = Path(cells.__file__).parent / "grab.toml"
LEASE_S = 600.0  # no program beats here, and a busy machine may take the real one's 2 s between two requests


@dataclass
class ServedConsole:
    """A console and what stands behind it."""

    base: str
    port: int
    parts: Parts
    rings: Rings
    mailbox: Mailbox
    job_manager: JobManager
    service: Service
    logs: Path
    application: FastAPI

    def stops_told(self) -> int:
        """How often the robot process was told of a STOP: after the answer, and it asks for the stop once more."""
        return [action for action, _ in self.trail()].count("stop")

    def trail(self) -> list[tuple[str, str | None]]:
        """Return what the audit trail has: action and operator."""
        lines = [json.loads(line) for line in (self.logs / FILE_NAME).read_text().splitlines()]
        return [(line["action"], line["operator"]) for line in lines]

    @contextmanager
    def signed_in(self) -> Iterator[tuple[httpx.Client, dict[str, str]]]:
        """Give a client with a session, and the headers that its changes have to carry."""
        with httpx.Client(base_url=self.base, trust_env=False, timeout=60.0) as client:
            token = self.parts.sign_in.token or ""
            client.get("/", params={"token": token}, follow_redirects=True).raise_for_status()
            session = self.parts.sign_in.session(client.cookies[self.parts.sign_in.cookie])
            assert session is not None
            yield client, {"x-csrf-token": session.csrf}

    def second_session(self, scope: Scope = Scope.OPERATE) -> tuple[dict[str, str], dict[str, str]]:
        """Sign somebody else in, by an invitation; return cookies and headers."""
        sign_in = self.parts.sign_in
        session = sign_in.redeem(sign_in.invite(scope))
        assert session is not None
        return {sign_in.cookie: session.key}, {"x-csrf-token": session.csrf}

    def cookie(self, client: httpx.Client) -> str:
        """Return the cookie header of a signed-in client."""
        name = self.parts.sign_in.cookie
        return f"{name}={client.cookies[name]}"


@contextmanager
def serve_console(logs: Path, cell_file: Path = CELL) -> Iterator[ServedConsole]:
    """Serve a console over real sockets; `logs` is an existing folder."""
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="rtstack-test-"))  # short: a socket's path has 107 letters at most
        stack.callback(shutil.rmtree, folder)
        mailbox = Mailbox.create(f"rtstack-test-{folder.name[-8:]}")
        stack.callback(mailbox.close)
        rings = stack.enter_context(Rings.create(capacity=1024))
        audit = AuditTrail(logs / FILE_NAME)
        stack.callback(audit.close)
        job_manager = JobManager(live_source(cell_file), mailbox, audit, logs)
        job_manager.authority._arming._lease_s = LEASE_S
        service = Service(job_manager, folder / "robot.sock")
        stack.callback(service.close)
        listener = Door(socket.create_server(("127.0.0.1", 0)))
        stack.callback(listener.close)
        port = listener.getsockname()[1]
        own_cell = Path(shutil.copy(cell_file, folder / "cell.toml"))  # what a calibration writes to
        parts = assemble(
            stack, Address(port), load_cell_description(cell_file), own_cell, logs, folder / "robot.sock",
            mailbox, rings, patience_s=20.0,  # a machine that is busy
        )  # fmt: skip
        application = create_app(parts, Address(port))
        server = uvicorn.Server(server_settings(application))
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        stack.callback(thread.join)
        stack.callback(setattr, server, "should_exit", True)
        yield ServedConsole(
            f"http://127.0.0.1:{port}", port, parts, rings, mailbox, job_manager, service, logs, application
        )
