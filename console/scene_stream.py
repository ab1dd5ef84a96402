"""What a scene's server sends to its pages, packed once for all of them.

viser 1.1.1 packs every window of messages for each page anew, which is most of what a viewer costs. Pages that keep up
are sent the same windows; a page that does not gets its own, and what it is too late for is left out by viser itself.
The form is that of viser.infra._infra._message_producer, whose place this takes.
"""

import time
from collections import OrderedDict
from collections.abc import Sequence

import msgspec
import zstandard
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from viser.infra._messages import Message
from websockets.asyncio.server import ServerConnection

_KEPT = 8  # windows: pages are at most a few of them apart


class Packing:
    """Packs windows, and keeps the newest ones. Used in one thread, a server's own."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, ...], tuple[Sequence[Message], bytes]] = OrderedDict()
        self._compressor = zstandard.ZstdCompressor(level=1)

    def packed(self, window: Sequence[Message]) -> bytes:
        """Return a window as the page's script takes it; the same messages give the same bytes."""
        key = tuple(map(id, window))  # of messages that are kept with the bytes, so that no id is given anew
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = window, self._pack(window)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return kept[1]

    def _pack(self, window: Sequence[Message]) -> bytes:
        buffers: list[memoryview] = []
        messages = tuple(message.as_serializable_dict(buffers) for message in window)
        inner = msgspec.msgpack.encode(
            {
                "messages": messages,
                "timestampSec": time.perf_counter(),
                "binaryBufferLengths": tuple(buffer.nbytes for buffer in buffers),
            }
        )
        compressed = self._compressor.compress(inner)
        lengths = (len(inner).to_bytes(8, "little"), len(compressed).to_bytes(8, "little"))
        parts: list[bytes | memoryview] = [*lengths, compressed]
        _infra._append_aligned_buffers(parts, buffers, 16 + len(compressed))
        return b"".join(parts)


async def _produce(
    websocket: ServerConnection, buffer: AsyncMessageBuffer, client_id: int, backlog_done_message: Message | None = None
) -> None:
    """Send a page the windows of a buffer until it is closed."""
    packing = buffer.__dict__.setdefault("packing", Packing())
    windows = buffer.window_generator(client_id, backlog_done_message=backlog_done_message)
    try:
        async for window in windows:
            await websocket.send(packing.packed(window))
    finally:
        await windows.aclose()  # now, and not when it is collected: it holds a cursor of the buffer


def share_packing() -> None:
    """Have every viser server of this process pack once for all pages."""
    _infra._message_producer = _produce
