"""A console without arms on a stage: its page, and the moments to which it can be brought.

The console is a real one and the status the robot process's; of the arms there are only states, pushed into the rings.
"""

import shutil
import threading
from contextlib import contextmanager

import numpy as np

from hal.state import RobotMode
from rtstack.live.protocol import JobState, RunRequest
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, Mode
from rtstack.trials.specification import DemonstrationSpecification
from tests.support.console.chromium import leave_scene_undrawn
from tests.support.console.served_console import serve_console

PATIENCE_MS = 60_000
OPERATOR = "anna"
MOVING_RAD_S = 0.3


class Arms:
    """Both arms' states, 50 times a second: at rest, or in motion; silent: none."""

    def __init__(self, rings):
        self.dq = 0.0
        self.force_n = self.squeeze_n = 0.0  # along x; along y, of both pads on what they hold
        self.silent = False
        self._pushers = [rings.pusher(f"/{side}/{topic}") for side in ("left", "right") for topic in ("arm", "control")]
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._push, daemon=True)
        self._thread.start()

    def _push(self):
        arm, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
        arm["robot_mode"], control["mode"] = RobotMode.IDLE, Mode.IDLE
        arm["O_T_EE"] = np.eye(4)
        while not self._over.wait(0.02):
            if self.silent:
                continue
            arm["t_ns"] += 20_000_000
            control["t_ns"] = arm["t_ns"]
            arm["dq"] = self.dq
            arm["O_F_ext_hat_K"][:, 0] = self.force_n
            for place, (pusher, record) in enumerate(zip(self._pushers, (arm, control) * 2, strict=True)):
                arm["O_F_ext_hat_K"][:, 1] = self.squeeze_n * (-1 if place < 2 else 1)
                pusher.push(record)

    def close(self):
        self._over.set()
        self._thread.join()


class Stage:
    """A console, its page, and the moments in which STOP is pressed."""

    def __init__(self, served, page, arms, ids):
        self.served, self.page, self.arms, self.ids = served, page, arms, ids

    @property
    def operator(self):
        """Who has control, or would take it."""
        return self.served.job_manager.authority.view().holder or OPERATOR

    def bring_about(self, moment):
        """Bring the cell from rest to a moment: the page's word for it, or `guided`: no job of ours moves an arm."""
        jobs, operator = self.served.job_manager, self.operator
        if moment in ("armed", "preparing", "moving", "holding"):
            jobs.authority.take(operator)
            jobs.authority.arm(operator)
        if moment in ("preparing", "moving", "holding"):
            jobs.order(RunRequest(DemonstrationSpecification(), operator))
        if moment in ("moving", "holding"):
            self.begin(moment)
        elif moment == "guided":
            self.arms.dq = MOVING_RAD_S
        elif moment == "fault":
            jobs.authority.fault("safety stop: left arm: the end effector is too fast")

    def begin(self, moment):
        """Begin the motion that is prepared."""
        self.served.job_manager.started("demonstration.mcap")
        self.arms.dq = MOVING_RAD_S if moment == "moving" else 0.0

    def end(self):
        """Go back to arms at rest that are disarmed."""
        jobs, mailbox, operator = self.served.job_manager, self.served.mailbox, self.operator
        self.arms.dq = 0.0
        jobs.finished(JobState.STOPPED, None, None, None)
        if jobs.authority.view().phase == "fault":
            jobs.authority.recover(operator)
            jobs.authority.recovered()
        jobs.authority.disarm(operator)
        if jobs.authority.view().holder is not None:
            jobs.authority.release(operator)
        mailbox.clear_stop()


@contextmanager
def on_stage(browser, demonstration, logs):
    """Serve a console with one demonstration in its folder of logs, and sign in."""
    logs.mkdir()
    shutil.copy(demonstration.path, logs / "demonstration.mcap")
    with serve_console(logs) as served:
        arms = Arms(served.rings)
        context = browser.new_context(base_url=served.base)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        leave_scene_undrawn(page)
        page.goto(f"/?token={served.parts.sign_in.token}")
        rows = page.request.get("/api/logs").json()
        yield Stage(served, page, arms, {"log": rows[0]["id"]})
        context.close()
        arms.close()
