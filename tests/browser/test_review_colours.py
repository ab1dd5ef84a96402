"""Compared logs are told apart by colour and by dash, in both themes and in figures, also by colour-blind eyes."""

from itertools import combinations

import pytest

from rtstack.figures.log_figure import DASHES, OVERLAYS
from tests.support.colour_vision import VISIONS, contrast, distance
from tests.support.console.served_console import serve_console

pytestmark = pytest.mark.browser
LEAST_DISTANCE = 15.0  # Delta E*ab; some 2.3 is just noticed (M. Mahy et al., Color Research and Application 19, 1994)
LEAST_CONTRAST = 3.0  # of graphics: WCAG 2.2, 1.4.11
LOOKS = """async () => {
    const { MOST_OTHERS } = await import('/static/js/review/view.js');
    const { overlayLook } = await import('/static/js/review/style.js');
    const { token } = await import('/static/js/theme.js');
    const places = [...Array(MOST_OTHERS).keys()];
    const found = {};
    for (const theme of ['dark', 'light']) {
        document.documentElement.dataset.theme = theme;
        found[theme] = {ground: token('surface'), looks: places.map((place) => overlayLook(place, false, false))};
    }
    return found;
}"""


def check(colours, dashes, ground):
    assert len(set(dashes)) == len(dashes) == 5
    for vision in VISIONS:
        apart = {pair: distance(*pair, vision) for pair in combinations(colours, 2)}
        assert min(apart.values()) >= LEAST_DISTANCE, (vision, apart)
    assert min(contrast(colour, ground) for colour in colours) >= LEAST_CONTRAST


def test_each_compared_log_has_a_colour_and_a_dash_of_its_own(browser, tmp_path):
    with serve_console(tmp_path) as served:
        context = browser.new_context(base_url=served.base)
        page = context.new_page()
        page.goto(f"/?token={served.parts.sign_in.token}")
        page.goto("/logs")
        for found in page.evaluate(LOOKS).values():
            colours, dashes = ([look[what] for look in found["looks"]] for what in ("colour", "dash"))
            check(colours, dashes, found["ground"])
        context.close()


def test_so_have_those_of_a_figure():
    check(OVERLAYS, DASHES, "#ffffff")


def test_the_distance_is_that_of_a_colour_space():
    """White and black are 100 apart, red and green far only for eyes that have both cones."""
    assert distance("#000000", "#ffffff", "normal") == pytest.approx(100.0, abs=0.01)
    assert distance("#ff0000", "#00ff00", "normal") == pytest.approx(170.6, abs=0.1)
    assert distance("#d55e00", "#857b00", "deuteranopia") < LEAST_DISTANCE < distance("#d55e00", "#857b00", "normal")
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
