"""H.264 of a camera, by PyAV (the extra `video`): a key frame each second, and no picture that needs a later one.

That is what Foxglove asks of `foxglove.CompressedVideo`: Annex B, one picture a message, parameter sets in key frames.
"""

import io
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rtstack.log.errors import LogError

BEGINS = (b"\0\0\1", b"\0\0\0\1")  # a part in Annex B, and no JPEG
KEY_NS = 1_000_000_000  # from a key frame to the next one: what has to be decoded at most to see a picture
_CRF = "20"  # libx264's constant quality; its own default of 23 is for films


def pixels_of(jpeg: bytes) -> NDArray[np.uint8]:
    """Return a picture, (rows, columns, 3), RGB."""
    return np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))


def jpeg_of(picture: Image.Image, quality: int = 95) -> bytes:
    """Return a picture as JPEG. By default of such a quality that one that was decoded does not lose twice."""
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=quality)
    return file.getvalue()


def load_av() -> Any:
    """Return PyAV. Raises LogError where it is not installed."""
    try:
        import av
    except ImportError:
        raise LogError("H.264 and films are read and written by PyAV: pip install 'rtstack[video]'") from None
    return av


class Encoder:
    """Makes H.264 of pictures (height, width, 3), RGB. Raises LogError without PyAV."""

    def __init__(self, width: int, height: int, rate_hz: float) -> None:
        self._av = load_av()
        self._codec = codec = self._av.CodecContext.create("libx264", "w")
        codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
        codec.time_base, codec.thread_count = Fraction(1, 1_000_000_000), 1
        codec.framerate = Fraction(rate_hz).limit_denominator(1000)
        codec.options = {"preset": "veryfast", "tune": "zerolatency", "crf": _CRF, "forced-idr": "1", "g": "1000"}
        self._key_ns: int | None = None

    def encode(self, t_ns: int, picture: NDArray[np.uint8]) -> bytes:
        """Return the picture's part of the stream. t_ns: larger than the last one's."""
        frame = self._av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts = t_ns
        if self._key_ns is None or t_ns - self._key_ns >= KEY_NS:
            self._key_ns = t_ns
            frame.pict_type = self._av.video.frame.PictureType.I
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))


class Decoder:
    """Makes JPEG of a stream's pictures, from its first key frame on. Raises LogError without PyAV."""

    def __init__(self) -> None:
        self._av = load_av()
        self._codec = self._av.CodecContext.create("h264", "r")
        self._codec.thread_count = 1  # threads hold pictures back
        self._frames: list[Any] = []

    def take(self, data: bytes) -> bool:
        """Take the next part. Returns whether it has a picture: not before a key frame, nor where it is broken."""
        try:
            self._frames = self._codec.decode(self._av.Packet(data))
        except self._av.FFmpegError:
            self._frames = []
        return bool(self._frames)

    def jpeg(self) -> bytes:
        """Return the picture that was taken last."""
        return jpeg_of(self._frames[-1].to_image())
