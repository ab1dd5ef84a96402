"""A camera's pictures at the frames as a film of H.264, and back, by PyAV (the extra `video`)."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from rtstack.log.video import jpeg_of, load_av, pixels_of

# x264 at a constant quality whose loss is hard to see. Every other frame is a key frame, as in LeRobot's films: a
# learner reads frames in any order.
_OPTIONS = {"crf": "18", "g": "2", "preset": "veryfast"}


def film_info(height: int, width: int, fps: int) -> dict[str, Any]:
    """Return LeRobot's description of a film."""
    form = "yuv444p" if width % 2 or height % 2 else "yuv420p"  # which has one colour for two rows and columns
    return {
        "video.height": height, "video.width": width, "video.codec": "h264", "video.pix_fmt": form, "video.fps": fps,
        "video.channels": 3, "video.is_depth_map": False, "has_audio": False,
    }  # fmt: skip


def write_film(path: Path, pictures: Sequence[bytes], fps: int) -> None:
    """Write JPEG pictures as a film of so many frames a second. Raises LogError without PyAV."""
    av = load_av()
    shown = {jpeg: pixels_of(jpeg) for jpeg in set(pictures)}
    height, width, _ = shown[pictures[0]].shape
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=fps, options=_OPTIONS)
        stream.width, stream.height = width, height
        stream.pix_fmt = film_info(height, width, fps)["video.pix_fmt"]
        stream.codec_context.thread_count = 1
        for number, jpeg in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(shown[jpeg], format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, fps)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))


def film_pictures(path: Path) -> list[bytes]:
    """Return the pictures of a film as JPEG. Raises LogError without PyAV."""
    with load_av().open(str(path)) as film:
        return [jpeg_of(frame.to_image()) for frame in film.decode(video=0)]
