"""An analysis of another package in the review, in a real Chromium: its curve beside the others, numbers, errors."""

import shutil

import pytest
from playwright.sync_api import expect

from tests.support.console.chromium import leave_scene_undrawn
from tests.support.console.drawn_curves import drawn
from tests.support.console.look import misplaced, violations
from tests.support.console.served_console import serve_console
from tests.support.plugin import installed

pytestmark = pytest.mark.browser
PATIENCE_MS = 60_000
OFFERS = "[rtstack.analyses]\nbroken = lab_analyses:broken\nfriction = lab_analyses:friction\n"
MODULE = """
import numpy as np
from rtstack.log.analysis.offered import Analysis, Curve, Number


def friction(log):
    arm = log.topic("/left/arm")
    force = np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1)
    numbers = (Number("largest_force", "N", float(force.max())), Number("never_measured", "Nm", None))
    return Analysis((Curve("left_force", "N", arm["t_ns"], 0.5 * force),), numbers)


def broken(log):
    return log.nothing
"""


def test_curves_numbers_and_errors_of_analyses_in_the_review(browser, demonstration, tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("one", "two"):
        shutil.copy(demonstration.path, logs / f"{name}.mcap")
    with installed(tmp_path, OFFERS, {"lab_analyses": MODULE}), serve_console(logs) as served:
        context = browser.new_context(base_url=served.base, viewport={"width": 1280, "height": 720})
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        leave_scene_undrawn(page)
        page.goto(f"/?token={served.parts.sign_in.token}")
        ids = {row["name"]: row["id"] for row in page.request.get("/api/logs").json()}
        page.goto(f"/logs/{ids['one.mcap']}?signals=left.pad_force,friction.left_force")
        panel = page.locator("#analyses")
        expect(panel).to_contain_text("friction", timeout=PATIENCE_MS)
        expect(panel).to_contain_text("largest force")
        expect(panel.locator(".failed")).to_contain_text(
            "analysis 'broken': AttributeError: 'Log' object has no attribute"
        )
        expect(panel.locator(".failed")).to_contain_text("(lab-tools 1.2, lab_analyses.py:14); mend it there")
        box = page.locator("label[title='friction.left_force, N'] input")
        expect(box).to_be_checked(timeout=PATIENCE_MS)  # as the address says, once all of the log has been read
        for _ in range(100):
            if drawn(page, "friction.left_force"):
                break
            page.wait_for_timeout(100)
        ((own,), (half,)) = (drawn(page, name) for name in ("left.pad_force", "friction.left_force"))
        assert max(half["y"]) == pytest.approx(0.5 * max(own["y"]))
        assert max(half["y"]) > 5.0
        assert half["top"] != own["top"]  # a pane of its own
        page.select_option("#other", ids["two.mcap"])
        for _ in range(100):
            if len(drawn(page, "friction.left_force")) == 2:
                break
            page.wait_for_timeout(100)
        assert len(drawn(page, "friction.left_force")) == 2  # of the compared log, too
        wrong = {}
        for width, height in ((390, 844), (1280, 720)):
            page.set_viewport_size({"width": width, "height": height})
            if found := misplaced(page) + violations(page):
                wrong[width] = found
            page.screenshot(path=tmp_path / f"{width}.png", full_page=True)
        assert not wrong
        box.uncheck()
        expect(page.locator("#errors .error")).to_have_count(0)
        context.close()
