"""A picture of a log, as far as SECONDS, in Rerun's own viewer. By hand: rerun_picture.py LOG.mcap OUT.png SECONDS

Needs rerun-sdk, and of Debian xvfb and mesa-vulkan-drivers: a screen in memory, and Vulkan on the processor.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import rerun
from rerun.chunk import McapReader

from rtstack.viewers.rerun_view import APPLICATION, blueprint

WINDOW = "1280x800"


def main(log: Path, out: Path, seconds: float) -> None:
    """Write the picture. Raises CalledProcessError where the viewer cannot start."""
    program = Path(sys.executable).with_name("rerun")
    with TemporaryDirectory() as folder:
        recording = Path(folder) / "log.rrd"
        stream = rerun.RecordingStream(APPLICATION)
        stream.save(recording, default_blueprint=blueprint(following=True))
        stream.send_chunks(McapReader(log, end_time_ns=round(seconds * 1e9)).stream())
        stream.disconnect()
        screen = ["xvfb-run", "-a", "-s", "-screen 0 1600x1000x24"]
        viewer = [program, "--renderer", "vulkan", "--window-size", WINDOW, "--screenshot-to", out, recording]
        subprocess.run([*screen, *viewer], check=True, env={**os.environ, "HOME": folder, "XDG_RUNTIME_DIR": folder})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
