"""The console's process.

    python -m console --run FOLDER --name NAME --logs DIR --cell TOML --listener FD

Started by the supervisor (rtstack.live.stack), which holds the listening socket and the other end of our standard
input: a line there says that the robot process is ready. Prints one line on standard output once it answers: the
address with the one-time token.
"""

import argparse
import asyncio
import gc
import os
import socket
import sys
import warnings
from contextlib import ExitStack, closing
from pathlib import Path

import uvicorn
from pydantic.warnings import UnsupportedFieldAttributeWarning

from console.address import Address
from console.app import create_app
from console.authority import Authority
from console.calibration import CellCalibration
from console.campaigns.campaigns import Campaigns
from console.heartbeats import OperatorHeartbeats
from console.parts import Parts
from console.preview import Preview
from console.questions import Questions
from console.queue.file import FILE_NAME as QUEUE_FILE
from console.queue.file import QueueFileError
from console.queue.queue import Queue
from console.queue.runner import QueueRunner
from console.review.cache import ReviewCache
from console.review.layouts import Layouts
from console.review.scene import ReviewScenes
from console.scene_ghost import GhostPlayer
from console.scenes import Scenes
from console.server import server_settings
from console.sign_in import SignIn
from console.teleoperation.teleop_input import TeleopInput
from console.tokens import Tokens
from console.training.trainer import Trainer
from console.watch import STATUS_TIMEOUT_S, Watch
from hal.configuration import ConfigurationError
from rtstack.cells import profile_of
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.live.client import SOCKET_NAME, RobotClient
from rtstack.live.parent_watch import watch_parent
from rtstack.live.source import described_as
from rtstack.live.standalone import find_rings
from rtstack.log.catalogue import Catalogue
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox, MailboxError


class _Server(uvicorn.Server):
    """Says when it answers."""

    def __init__(self, config: uvicorn.Config, ready_line: str, ready: int) -> None:
        super().__init__(config)
        self._ready_line = ready_line
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            os.write(self._ready, f"{self._ready_line}\n".encode())


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGTERM, or until the supervisor is gone. Returns the exit status, 2 for what cannot work."""
    parser = argparse.ArgumentParser(prog="console")
    parser.add_argument("--run", type=Path, required=True, help="folder of the robot process's socket")
    parser.add_argument("--name", required=True, help="name of the shared memory")
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--cell", type=Path, required=True, help="cell description")
    parser.add_argument("--kind", default="direct", help="kind of cell, as the command line spells it")
    parser.add_argument("--listener", type=int, required=True, help="file descriptor of the listening socket")
    parser.add_argument("--https", action="store_true", help="speak HTTPS alone, with the user's own authority")
    parser.add_argument("--alone", action="store_true", help="without a supervisor: a service of its own")
    asked = parser.parse_args(arguments)
    # FastAPI hides it while it builds a model, but in whatever thread; two at once let it out
    warnings.filterwarnings("ignore", category=UnsupportedFieldAttributeWarning)

    ready = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is for the terminal, not the supervisor
    listener = socket.socket(fileno=asked.listener)
    host, port = listener.getsockname()
    if not asked.alone and not sys.stdin.readline():
        return 0  # the supervisor has gone
    address = Address(port, host, asked.https)
    with ExitStack() as stack:
        stack.enter_context(listener)
        try:
            tls = Authority.of_user().serve(host) if asked.https else None
            parts = _parts(asked, address, stack)
        except (ConfigurationError, MailboxError, LogError, QueueFileError, OSError) as error:
            print(f"console: {error}", file=sys.stderr)
            return 2
        config = server_settings(create_app(parts, address), tls)
        gc.collect()
        gc.freeze()  # all objects made so far stay: no later collection scans them and delays the signs of life
        server = _Server(config, f"{address.base}/?token={parts.sign_in.token}", ready)
        if not asked.alone:
            watch_parent(lambda: setattr(server, "should_exit", True))
        asyncio.run(server.serve([listener]))
    return 0


def _parts(asked: argparse.Namespace, address: Address, stack: ExitStack) -> Parts:
    audit = stack.enter_context(closing(AuditTrail(asked.logs / FILE_NAME)))
    cell = described_as(asked.cell, asked.kind)
    mailbox = stack.enter_context(closing(Mailbox.attach(f"{asked.name}-mailbox")))
    rings = Rings.attach(find_rings(asked.run))
    socket_path = asked.run / SOCKET_NAME
    client = stack.enter_context(closing(RobotClient(socket_path)))
    heartbeats = OperatorHeartbeats()
    watch = stack.enter_context(closing(Watch(rings, RobotClient(socket_path, STATUS_TIMEOUT_S), heartbeats, cell)))
    watch.start()
    teleop = TeleopInput(mailbox, watch)
    ghost = GhostPlayer(asked.logs)
    scenes = stack.enter_context(closing(Scenes(cell, watch, teleop, asked.cell, ghost)))
    review_cache = stack.enter_context(closing(ReviewCache(asked.logs)))
    review_scenes = stack.enter_context(closing(ReviewScenes(cell)))
    catalogue = Catalogue(asked.logs)
    queue = Queue(asked.logs / QUEUE_FILE)
    queue_client = stack.enter_context(closing(RobotClient(socket_path, STATUS_TIMEOUT_S)))
    runner = stack.enter_context(closing(QueueRunner(queue, queue_client, catalogue, watch.learn)))
    runner.start()
    campaigns = stack.enter_context(closing(Campaigns(asked.logs)))
    questions = stack.enter_context(closing(Questions(cell)))
    return Parts(
        sign_in=SignIn(address, Tokens(asked.logs), audit),
        audit=audit,
        cell=cell,
        client=client,
        mailbox=mailbox,
        heartbeats=heartbeats,
        watch=watch,
        catalogue=catalogue,
        scenes=scenes,
        teleop=teleop,
        review_cache=review_cache,
        review_scenes=review_scenes,
        queue=queue,
        campaigns=campaigns,
        preview=stack.enter_context(closing(Preview(asked.cell, ghost, profile_of(asked.kind)))),
        trainer=stack.enter_context(closing(Trainer(watch))),
        questions=questions,
        layouts=Layouts(asked.logs),
        calibration=CellCalibration(asked.cell, asked.logs, questions, watch),
        profile=profile_of(asked.kind),
    )


if __name__ == "__main__":
    sys.exit(main())
