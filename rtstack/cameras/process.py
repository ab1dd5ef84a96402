"""The process of one camera: its pictures into its ring. Started by rtstack.cameras.start, never by hand."""

import json
import os
import signal
import sys
import time
from pathlib import Path

from PIL import Image
from pydantic import TypeAdapter

from hal.base.realtime import ordinary_thread
from hal.extensions import PLUG_INS_RAISE, ExtensionError, raised
from rtstack.cameras.source import CAMERAS, CameraRequest, draw_time
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.log.video import Encoder, jpeg_of
from rtstack.log.writing.pictures import PictureRing
from rtstack.model.camera_description import CameraDescription

_NICENESS = 10  # a picture may wait for everything else
_IDLE_S = 0.005


def main() -> int:
    job = json.loads(sys.argv[1])
    ending: list[int] = []
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    ordinary_thread()
    os.nice(_NICENESS)
    pictures, rings = PictureRing.attach(job["pictures"]), Rings.attach(job["rings"])
    described = TypeAdapter(CameraDescription).validate_python(job["camera"])
    try:
        video = Encoder(described.width, described.height, described.rate_hz) if described.format == "h264" else None
        request = CameraRequest(job["name"], described, rings, Path(job["cell_file"]), job["object"])
        camera = CAMERAS.load(described.kind)(request)
        pictures.opened()
        while os.getppid() == job["parent"]:
            found = camera.read()
            if found is None:
                if ending:
                    break
                time.sleep(_IDLE_S)
                continue
            t_ns, picture = found
            if described.stamped:
                draw_time(picture, t_ns)
            if video is not None:
                pictures.write(t_ns, video.encode(t_ns, picture))
            else:
                pictures.write(t_ns, jpeg_of(Image.fromarray(picture), described.quality))
        camera.close()
    except (OSError, LogError, ExtensionError, ImportError) as error:
        pictures.fail(" ".join(str(error).split()))
        return 1
    except PLUG_INS_RAISE as error:
        pictures.fail(f"camera {job['name']}: {raised(error)}", raised=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
