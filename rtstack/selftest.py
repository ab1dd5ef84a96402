"""`python -m rtstack.selftest`: whether an installation works, in four parts, on the simulated cell alone.

Exit status 1: a part failed. What stays on the machine is compiled code alone. A part imports what it needs, since
its extra may be missing, and so that Ctrl-C finds `main` waiting for it.
"""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from rtstack import refuse_shadows

_HELD_MS = 100
_PATIENCE_S = 60.0  # for a page, and for the end of the stack


class _Wrong(Exception):
    """A part came out wrong. The message says what was found and expected."""


def plant(_folder: Path) -> str:
    """Let gravity compensation alone hold both arms; compare their torques with their weight by Pinocchio."""
    import numpy as np

    from rtstack.cells import load_description, open_cell
    from rtstack.model.arm_model import ArmModel
    from rtstack.trials.estimate import torque_offset

    cell = load_description(None)[0]
    with closing(open_cell("direct", next(iter(cell.objects)), 0.0, 0, cell)) as opened:
        first = np.array([arm.read().q for arm in opened.arms])
        for _ in range(_HELD_MS):
            for arm in opened.arms:
                arm.write(np.zeros(7))
                arm.read()
        states = [arm.read() for arm in opened.arms]
        moved_rad = np.abs(np.array([state.q for state in states]) - first).max()
        models = (ArmModel(mounting, cell.pad) for mounting in cell.arms)
        off_nm = np.max([torque_offset(*pair)[0] for pair in zip(states, models, strict=True)])
    if not (moved_rad < 1e-3 and off_nm < 0.5):  # so that NaN fails
        raise _Wrong(f"held arms moved by {moved_rad:.4f} rad (limit 0.001), torques {off_nm:.2f} Nm off (limit 0.5)")
    return f"held within {1e3 * moved_rad:.2f} mrad, MuJoCo's torques {off_nm:.2f} Nm from Pinocchio's weight"


def tick(_folder: Path) -> str:
    """Compare a command with forward dynamics: the pad has to accelerate as its spring K e alone moves it, and joint 1,
    whose posture is kept, not at all."""
    import numpy as np
    import pinocchio as pin

    from rtstack.cells import load_description
    from rtstack.samples import Mode
    from rtstack.trials.assembly import arm_controllers, default_parameters

    cell, parameters = load_description(None)[0], default_parameters()
    arm, K, e = arm_controllers(cell, parameters)[0], parameters.control.stiffness, np.array([4e-4, -3e-4, 2e-4])
    q, rest, goal = np.array(cell.arms[0].home), np.zeros(7), arm.setpoint
    seen = arm.observed_at(q)
    goal["position"], goal["rotation"], goal["xi"] = seen["position"] + e, seen["rotation"], q[0]
    arm.pursue(K, parameters.control.posture_gain)
    arm.command(Mode.ANTE_IMPACT)
    model = arm.model.pin_model.copy()
    model.armature, data = cell.arms[0].robot.B_theta, model.createData()
    g, J = pin.computeGeneralizedGravity(model, data, q), pin.computeJointJacobians(model, data, q).copy()
    J[:3] -= pin.skew(seen["position"]) @ J[3:]  # at the pad, not at the world's origin
    wanted = J @ pin.aba(model, data, q, rest, g + J[:3].T @ (K[:3] * e))
    found = pin.aba(model, data, q, rest, g + arm.sample["tau_desired"][0])
    off = np.abs([*(J @ found - wanted), found[0]]).max() / np.abs(wanted).max()
    if not off < 1e-5:
        raise _Wrong(f"the commanded acceleration is {off:.0e} of itself off forward dynamics (limit 1e-05)")
    return f"a command within {off:.0e} of Pinocchio's forward dynamics"


def log(folder: Path) -> str:
    """Record a demonstration; count its messages with the package mcap and with our reader."""
    from mcap.reader import make_reader

    from rtstack.cells import load_description
    from rtstack.experiments.simulation import simulated
    from rtstack.log.reader import read_log
    from rtstack.trials.demonstration import prepare_demonstration
    from rtstack.trials.specification import DemonstrationSpecification

    (cell, file), path = load_description(None), folder / "motion.mcap"
    result = simulated(prepare_demonstration(DemonstrationSpecification(), cell), "direct", file, path)
    if not result.success:
        raise _Wrong(f"the demonstration failed: {result.failure_reason}")
    with path.open("rb") as stream:
        counts = Counter(channel.topic for _, channel, _ in make_reader(stream, validate_crcs=True).iter_messages())
    ours, topics = read_log(path), [f"/{side}/{name}" for side in ("left", "right") for name in ("arm", "control")]
    found = {topic: (counts[topic], len(ours.topic(topic))) for topic in topics}
    if set(found.values()) != {(result.ticks, result.ticks)}:
        raise _Wrong(f"{result.ticks} ticks, but messages by mcap and by rtstack: {found}")
    return f"{result.ticks} ticks, {counts.total()} messages, the object lifted by {result.max_lift_mm:.0f} mm"


def page(folder: Path) -> str:
    """Start the stack on a free port, sign in with its one-time token, and end it."""
    import httpx

    command = [sys.executable, "-m", "rtstack", "up", "--port", "0", "--logs", "logs"]
    own = os.environ | {"MPLCONFIGDIR": str(folder)}  # matplotlib keeps a list of fonts
    with (folder / "said").open("w+") as said:
        stack = subprocess.Popen(command, cwd=folder, env=own, stdout=subprocess.PIPE, stderr=said, text=True)
        try:
            address = (stack.stdout or said).readline().removeprefix("rtstack is up: ").strip()
            with httpx.Client(follow_redirects=True, trust_env=False, timeout=_PATIENCE_S) as client:
                status = client.get(address).status_code if address else None
        finally:
            stack.send_signal(signal.SIGINT)
            stack.communicate(timeout=_PATIENCE_S)
        said.seek(0)
        if (status, stack.returncode) != (200, 0):
            words = " ".join(said.read().split())[-500:]
            raise _Wrong(f"the page's status is {status} (expected 200), the stack's {stack.returncode}: {words}")
    return "signed in, status 200"


_VERSIONS = "`rtstack check` names packages of other versions than the tested ones"
# what runs it, the extras that it needs, what to do when it fails
PARTS = {
    "plant": (plant, ("sim",), _VERSIONS),
    "tick": (tick, (), _VERSIONS),
    "log": (log, ("sim",), f"make room for temporary files (TMPDIR); {_VERSIONS}"),
    "page": (page, ("console", "sim"), "`rtstack up --port 0` shows its messages"),
}


def _run(name: str, folder: Path) -> int:
    """Run a part and print its line. Returns 1 where it failed, else 0."""
    from hal.base.configuration import ConfigurationError
    from hal.base.extras import require
    from hal.extensions import raised

    part, extras, advice = PARTS[name]
    print(f"{name:<6}", end="", flush=True)
    began_s, status = time.monotonic(), 0
    try:
        list(map(require, extras))
    except ConfigurationError as error:
        print(f"skipped, {error}", flush=True)
        return 0
    try:
        line = f"ok, {part(folder)}"
    except Exception as error:
        status, line = 1, f"FAILED, {error if isinstance(error, _Wrong) else raised(error)}; {advice}"
    print(f"{line}, {time.monotonic() - began_s:.1f} s", flush=True)
    return status


def main() -> int:
    """Run all parts. Returns the exit status."""
    interrupted, status = False, 0

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True  # an exception may be lost within a callback of a library
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        refuse_shadows("sim_robot", "console", "deploy")
        with TemporaryDirectory(prefix="selftest-") as folder:
            for name in PARTS:
                status |= _run(name, Path(folder))
                if interrupted:
                    raise KeyboardInterrupt
        return status
    except KeyboardInterrupt:
        print("interrupted")
        return 130


if __name__ == "__main__":
    sys.exit(main())
