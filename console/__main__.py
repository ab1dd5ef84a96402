"""The console's process.

    python -m console --run FOLDER --name NAME --logs DIR --cell TOML --listener FD

The supervisor (rtstack.live.stack) holds the listening socket and the other end of our standard input: a line there
says that the robot process is ready. Prints the address with the one-time token on standard output once it answers.
"""

import asyncio
import gc
import os
import socket
import sys
import warnings
from contextlib import ExitStack, closing, suppress

import uvicorn
from pydantic.warnings import UnsupportedFieldAttributeWarning

from console.address import Address
from console.app import create_app
from console.connections import Door, raise_descriptor_limit
from console.parts import assemble
from console.refused import Refused
from console.server import server_settings
from hal.base.configuration import ConfigurationError
from rtstack.access.authority import Authority
from rtstack.cells import profile_of
from rtstack.live.client import SOCKET_NAME
from rtstack.live.parent_watch import watch_parent
from rtstack.live.source import described_as
from rtstack.live.standalone import find_rings, process_arguments
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
            with suppress(BrokenPipeError):  # the supervisor was killed
                os.write(self._ready, f"{self._ready_line}\n".encode())


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGTERM, or until the supervisor is gone. Returns the exit status, 2 for what cannot work."""
    parser = process_arguments("console")
    parser.add_argument("--listener", type=int, required=True, help="file descriptor of the listening socket")
    parser.add_argument("--https", action="store_true", help="speak HTTPS alone, with the user's own authority")
    asked = parser.parse_args(arguments)
    # FastAPI hides it while it builds a model, but in whatever thread; two at once let it out
    warnings.filterwarnings("ignore", category=UnsupportedFieldAttributeWarning)

    ready = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is for the terminal, not the supervisor
    raise_descriptor_limit()
    listener = Door(socket.socket(fileno=asked.listener))
    host, port = listener.getsockname()
    if not asked.alone and not sys.stdin.readline():
        return 0  # the supervisor has gone
    address = Address(port, host, asked.https)
    with ExitStack() as stack:
        stack.enter_context(listener)
        try:
            tls = Authority.of_user().serve(host) if asked.https else None
            cell, name = described_as(asked.cell, asked.kind), f"{asked.name}-mailbox"
            mailbox = stack.enter_context(closing(Mailbox.attach(name)))
            rings, robot = Rings.attach(find_rings(asked.run)), asked.run / SOCKET_NAME
            profile = profile_of(asked.kind)
            parts = assemble(stack, address, cell, asked.cell, asked.logs, robot, mailbox, rings, profile)
        except (ConfigurationError, MailboxError, LogError, Refused, OSError) as error:
            print(f"console: {error}", file=sys.stderr)
            return 2
        config = server_settings(create_app(parts, address), tls)
        gc.collect()
        gc.freeze()  # all objects made so far stay: no later collection scans them and delays the signs of life
        server = _Server(config, f"{address.base}/?token={parts.sign_in.token}", ready)
        if not asked.alone:
            watch_parent(lambda: setattr(server, "should_exit", True), parts.watch.end)
        asyncio.run(server.serve([listener]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
