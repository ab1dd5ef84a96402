"""Every way to let go of arms that follow stops them, for the reason that it was. How soon: tests.programs.dead_man."""

import re

import pytest
from playwright.sync_api import sync_playwright

from tests.programs.dead_man import CAUSES, TRIES, stop_by
from tests.support.console.operator_scene import TOO_EARLY, Chromium, OperatorScene, SceneFailed

pytestmark = [pytest.mark.browser, pytest.mark.alone]
MOST_TICKS = 2  # from the tick that says why to both arms' first stopping torque: docs/watchdogs.md


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A stack, and an operator's page without the 3D scene, which this machine would have to draw itself."""
    with sync_playwright() as playwright:
        browser = Chromium(playwright)
        try:
            scene = OperatorScene(browser, tmp_path_factory.mktemp("dead-man") / "logs", drawn=False)
            yield scene
            assert scene.close() in ([], ["exit status 1"])  # the last cause ends it
        finally:
            browser.close()


@pytest.mark.parametrize("cause", CAUSES, ids=[cause.name.replace(" ", "-") for cause in CAUSES])
def test_whatever_lets_go_stops_both_arms_and_the_events_say_why(scene, cause):
    for _ in range(TRIES):  # a machine under load may lose the hand by itself
        try:
            stop = stop_by(cause, scene, 0.0)
            break
        except SceneFailed as failed:
            assert str(failed) == TOO_EARLY  # noqa: PT017 anything else is a failure
    else:
        pytest.fail(f"{TRIES} times {TOO_EARLY}")
    assert re.match(cause.says, stop.reason)
    assert 0 <= stop.ticks <= MOST_TICKS
