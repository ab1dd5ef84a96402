"""A camera's pictures at the frames as a film of H.264, and back, by PyAV (the extra `video`)."""

import io
from fractions import Fraction
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from PIL import Image

from rtstack.datasets.episode import Pictures
from rtstack.log.video import load_av

# of x264: constant quality whose loss is hard to see, and every other frame a key frame, as in LeRobot's own films: a
# learner reads frames in any order
_OPTIONS = {"crf": "18", "g": "2", "preset": "veryfast"}
_JPEG_QUALITY = 95  # of a picture of the film: it is not to lose twice


def write_film(path: Path, pictures: Pictures, at: NDArray[Any], fps: int) -> dict[str, Any]:
    """Write the pictures of these numbers (n,) as a film of so many frames a second; return LeRobot's description.

    Raises LogError without PyAV.
    """
    av = load_av()
    shown = {k: Image.open(io.BytesIO(pictures.jpeg[k])) for k in set(at.tolist())}
    width, height = shown[int(at[0])].size
    form = "yuv444p" if width % 2 or height % 2 else "yuv420p"  # which has one colour for two rows and columns
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=fps, options=_OPTIONS)
        stream.width, stream.height, stream.pix_fmt = width, height, form
        stream.codec_context.thread_count = 1
        for number, k in enumerate(at.tolist()):
            frame = av.VideoFrame.from_image(shown[k].convert("RGB"))
            frame.pts, frame.time_base = number, Fraction(1, fps)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    return {
        "video.height": height, "video.width": width, "video.codec": "h264", "video.pix_fmt": form, "video.fps": fps,
        "video.channels": 3, "video.is_depth_map": False, "has_audio": False,
    }  # fmt: skip


def film_pictures(path: Path) -> list[bytes]:
    """Return the pictures of a film as JPEG. Raises LogError without PyAV."""
    found = []
    with load_av().open(str(path)) as film:
        for frame in film.decode(video=0):
            file = io.BytesIO()
            frame.to_image().save(file, "JPEG", quality=_JPEG_QUALITY)
            found.append(file.getvalue())
    return found
