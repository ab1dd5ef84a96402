"""The calibration on the page, to its end: a cell that is built wrong is led, touched, fitted, written, and grabs."""

import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from hal.state import RobotMode
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import load_cell_description
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Mode
from sim_robot.cell import simulated_cell
from sim_robot.profile import load_profile
from tests.support.built_cell import led, profile
from tests.support.console.chromium import leave_scene_undrawn
from tests.support.console.operate_page import choose_tab
from tests.support.console.served_console import serve_console

pytestmark = pytest.mark.browser

BUILT: dict[str, object] = {
    "left_mm": [25.0, -28.0, 24.0], "right_mm": [-20.0, 18.0, 23.0], "left_deg": [1.5, -1.0, 3.5],
    "right_deg": [-1.0, 1.2, -2.6], "tracker_mm": [300.0, -400.0, 50.0], "tracker_deg": [0.0, 0.0, 90.0],
    "pivot_mm": [60.0, -30.0, 90.0],
}  # fmt: skip
NOISE_M, OBJECT, POSES = 3e-4, "rice_box", 12
BAD = 4  # of the poses: a gauge that was read wrong
WIDTHS = (390, 1280, 1920)
COMMAND = Path(sys.executable).with_name("rtstack")


@contextmanager
def shown(rings, cell):
    """Show the states of the cell's arms, 200 times a second, as they stand."""
    over = threading.Event()

    def run():
        arms, control = np.zeros((2, 1), ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
        arms["robot_mode"], arms["O_T_EE"], control["mode"] = RobotMode.IDLE, np.eye(4), Mode.IDLE
        pushers = [[rings.pusher(f"/{side}/{topic}") for topic in ("arm", "control")] for side in SIDES]
        while not over.wait(5e-3):
            arms["t_ns"] += 5_000_000
            control["t_ns"] = arms["t_ns"][0]
            arms["q"][:, 0], arms["dq"][:, 0] = cell.states["q"], cell.states["dq"]
            for sample, (arm, mode) in zip(arms, pushers, strict=True):
                arm.push(sample)
                mode.push(control)

    thread = threading.Thread(target=run)
    thread.start()
    yield
    over.set()
    thread.join()


@pytest.fixture
def console(browser, tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    cell_file = tmp_path / "cell.toml"
    cell_file.write_text(f"{default_cell_file().read_text()}\n[tracker.bodies.{OBJECT}]\nid = 1\n")
    with serve_console(logs, cell_file) as served:
        context = browser.new_context(base_url=served.base, viewport={"width": 1280, "height": 800})
        page = context.new_page()
        page.set_default_timeout(60_000)
        leave_scene_undrawn(page)
        page.goto(f"/?token={served.parts.sign_in.token}")
        yield served, page
        context.close()


class Wizard:
    """A person at the tab Calibrate."""

    def __init__(self, page):
        self.page, self.rows = page, page.locator("#calibration-points tr")

    def add(self, what, place, side="", thing=""):
        """Add a point; return its row, which is the first one until the next is added."""
        before = self.rows.count()
        self.page.select_option("#calibration [name=what]", what)
        if side:
            self.page.select_option("#calibration [name=side]", side)
        if thing:
            self.page.select_option("#calibration [name=object]", thing)
        for axis, metres in zip("xyz", place, strict=True):
            self.page.fill(f"#calibration [name={axis}]", f"{metres:.4f}")
        self.page.click("#calibration [type=submit]")
        expect(self.rows).to_have_count(before + 1)
        return self.rows.first

    def take(self, row):
        """Take a point as the arms stand."""
        row.get_by_role("button", name="Take").click()
        expect(row.get_by_role("button", name="Again")).to_be_visible()


def test_an_older_answer_does_not_take_the_place_of_a_newer_one(console):
    _, page = console
    older = []
    page.route("**/api/calibration", lambda route: older.append((route, route.fetch())), times=1)
    page.reload()
    page.click("#take")
    choose_tab(page, "calibration")
    page.select_option("#calibration [name=what]", "meet")
    page.click("#calibration [type=submit]")
    page.wait_for_timeout(1000)  # the answer to it, unless it waits for the older one
    ((route, answer),) = older
    route.fulfill(response=answer)
    page.click("#calibration [type=submit]")
    expect(page.locator("#calibration-points tr")).to_have_count(2)
    expect(page.locator("#errors p")).to_have_count(0)


@pytest.mark.long
@pytest.mark.timeout(420)
def test_a_cell_that_is_built_wrong_is_calibrated_on_the_page_and_grabs(console, tmp_path):
    served, page = console
    arms_alone = {key: value for key, value in BUILT.items() if not key.startswith(("tracker", "pivot"))}
    cell = simulated_cell("none", 0.0, 1, profile=str(profile(tmp_path / "arms.toml", arms_alone)))
    how = profile(tmp_path / "built.toml", BUILT)
    data, scene, there, rng = cell.plant.data, cell.scene, load_profile(str(how)).built, np.random.default_rng(1)
    homes, wizard = cell.states["q"].copy(), Wizard(page)
    with shown(served.rings, cell):
        page.click("#take")
        choose_tab(page, "calibration")
        expect(page.locator("#calibration-now")).to_contain_text("has no date of a calibration")
        for k in range(POSES):
            led(cell, homes, rng)
            for side, name in enumerate(SIDES):
                body = cell.plant.pad_bodies[side]
                marker, turn = data.xpos[body], data.xmat[body].reshape(3, 3)
                place = marker + turn @ cell.plant.face_in_pad[side] + NOISE_M * rng.standard_normal(3)
                place[1] += 0.03 * ((k, side) == (BAD, 0))
                wizard.take(wizard.add("touch", place, name))
                if k % 2:
                    wizard.take(wizard.add("see", there.to_tracker(marker) + NOISE_M * rng.standard_normal(3), name))
    middle = np.array([0.0, 0.0, scene.table.top_z + scene.objects[OBJECT].size[2] / 2.0])
    wizard.add("stand", there.to_tracker(there.body(middle, np.array([1.0, 0.0, 0.0, 0.0]))), thing=OBJECT)
    wrong = wizard.rows.filter(has_text="WRONG")
    expect(wrong).to_have_count(1)
    expect(wrong).to_contain_text("mm WRONG, left out: take it again")
    expect(page.locator("#calibration-found")).to_contain_text("in 95 % of such calibrations no pad is off")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 844 if width < 900 else 1080})
        assert page.locator("body").evaluate("each => each.scrollWidth <= innerWidth"), width
        assert page.locator("#calibration").evaluate("each => each.scrollWidth <= each.clientWidth"), width
    found = Axe().run(page, context="#calibration", options={"runOnly": ["wcag2a", "wcag2aa"], "iframes": False})
    assert found.response["violations"] == []
    wrong.get_by_role("button", name="Remove").click()
    expect(wrong).to_have_count(0)
    expect(page.locator("#calibration-write")).to_be_enabled()
    page.click("#calibration-write")
    page.get_by_role("alertdialog").get_by_role("button", name="Write").click()
    expect(page.locator("#calibration-now")).to_contain_text("was calibrated on")
    file = served.parts.calibration._file
    description = load_cell_description(file)
    right = data.body("right_link0").xpos
    assert np.abs(np.array(description.right.base_position) - right).max() < 2e-3
    pivot = 1e-3 * np.array(there.pivot_mm)
    assert np.abs(np.array(description.tracker.bodies[OBJECT].position) + pivot).max() < 2e-3
    where = ["--cell", f"lockstep:{how}", "--cell-file", str(file)]
    for command in (["teach", "taught.mcap"], ["trial", "--reference", "taught.mcap"]):
        done = subprocess.run([COMMAND, *command, *where], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr + done.stdout
