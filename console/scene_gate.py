"""Which of a page's messages reach the scene's server: cameras from all sessions, gizmos from the holder of control.

viser would take any message from any page. Here, in front of it, a page is a session, and a session a name.
"""

import msgspec

_FOR_EVERYBODY = frozenset({"ViewerCameraMessage"})
_FOR_THE_HOLDER = frozenset(
    {"TransformControlsUpdateMessage", "TransformControlsDragStartMessage", "TransformControlsDragEndMessage"}
)


class _Kind(msgspec.Struct):
    type: str


_decoder = msgspec.msgpack.Decoder(_Kind)


def lets_through(message: bytes, holder: bool) -> bool:
    """Whether a message of viser's client may pass; holder: whether its session has control. Others may not."""
    try:
        kind = _decoder.decode(message).type
    except msgspec.MsgspecError:
        return False
    return kind in _FOR_EVERYBODY or (holder and kind in _FOR_THE_HOLDER)
