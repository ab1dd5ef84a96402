"""The scene tells the experiment, and is looked at as an operator likes; a mouse alone moves the arms."""

import numpy as np
import pytest
from playwright.sync_api import expect

from rtstack.samples import SIDES
from tests.support.console.chromium import NODES, READY_MS, in_scene
from tests.support.console.look import switch_theme
from tests.support.console.operate_page import look, open_settings

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.timeout(900)]
FINDS_DEMONSTRATION = True
GRIP = np.array((0.0, 0.35, 0.26))  # of the left arm at home
ARROW_M, RAISED_M = 0.17, 0.05  # from the gizmo's middle to between the arrow's shaft and tip; how far it is dragged
# the scene's first camera: console/scene/scene.py
EYE, LOOK_AT, FIELD_OF_VIEW = np.array([-1.75, 0.0, 1.35]), np.array([-0.02, 0.0, 0.3]), 0.72
STEPS = 12


CAMERA = "window.__viserMutable?.camera?.position.toArray()"
GROUND = "getComputedStyle(document.body).backgroundColor"


def test_the_form_of_a_trial_is_seen_before_it_runs(console):
    """Nominal and shifted place, and both pads' way with its extensions."""
    page = console.page
    page.click("#tab-trial")
    expect(page.locator("#trial select[name=reference]")).not_to_have_value("")
    parts = ("ante", "extended", "before", "post", "impact")
    wanted = {f"/trial/{side}/{part}" for side in SIDES for part in parts}
    nodes = in_scene(page, NODES, lambda nodes: nodes and wanted <= set(nodes))
    assert "/trial/nominal" in nodes
    assert "/trial/put" not in nodes
    page.fill("#trial input[name=displacement_mm]", "-30")
    in_scene(page, NODES, lambda nodes: {"/trial/put", "/trial/shift"} <= set(nodes))
    shift = "window.__viserSceneTree.getState()['/trial/shift'].message.props.text"
    assert in_scene(page, shift) == "y -30 mm"
    page.click("#tab-demonstration")
    in_scene(page, NODES, lambda nodes: "/trial/nominal" not in nodes)
    page.click("#tab-trial")


SLOW_PLANS = """() => {
  const real = window.fetch;
  window.onTheirWay = window.most = 0;
  window.fetch = async (...request) => {
    if (!String(request[0]).includes('/api/scene/plan')) return real(...request);
    window.most = Math.max(window.most, ++window.onTheirWay);
    await new Promise((wake) => setTimeout(wake, 600));
    try { return await real(...request); } finally { window.onTheirWay -= 1; }
  };
}"""


def test_what_a_form_says_arrives_in_its_order(console):
    """One request at a time: of two, the first might come last, and the scene would keep it."""
    page = console.page
    page.click("#tab-trial")
    page.evaluate(SLOW_PLANS)
    for shift in ("-10", "-20", "-30"):
        page.fill("#trial input[name=displacement_mm]", shift)
        page.wait_for_timeout(250)
    shown = "window.__viserSceneTree.getState()['/trial/shift']?.message.props.text"
    in_scene(page, shown, lambda text: text == "y -30 mm")
    assert page.evaluate("window.most") == 1
    page.fill("#trial input[name=displacement_mm]", "0")


def test_what_was_chosen_stays_chosen(console):
    page = console.page
    page.click("#tab-trial")
    page.fill("#trial input[name=displacement_mm]", "-20")
    page.select_option("#trial select[name=object]", index=1)
    page.select_option("#trial select[name=controller]", index=1)
    chosen = {
        name: page.locator(f"#trial [name={name}]").input_value()
        for name in ("displacement_mm", "object", "controller")
    }
    page.click("#tab-hand")
    page.get_by_text("hold position", exact=True).click()
    page.get_by_text("mirrored", exact=True).click()
    page.goto("/logs")
    page.goto("/")
    expect(page.locator("#trial select[name=reference]")).not_to_have_value("")
    for name, value in chosen.items():
        expect(page.locator(f"#trial [name={name}]")).to_have_value(value)
    for name in ("release", "coupling"):
        expect(page.locator(f"input[name={name}]:checked")).to_have_value(
            {"release": "hold", "coupling": "mirrored"}[name]
        )
    page.click("#tab-hand")
    page.get_by_text("end recording", exact=True).click()
    page.get_by_text("separate", exact=True).click()
    page.click("#tab-trial")
    page.select_option("#trial select[name=object]", index=0)


@pytest.mark.long
def test_the_camera_goes_where_it_is_sent_and_the_scene_grows_without_covering_stop(console):
    page = console.page
    first = in_scene(page, CAMERA)
    places = [first]
    for button, key in (("front", "f"), ("top", "t"), ("along", "y")):
        look(page, button)
        before = places[-1]
        place = in_scene(page, CAMERA, lambda place, before=before: np.linalg.norm(np.subtract(place, before)) > 0.5)
        page.wait_for_timeout(2000)  # on its way
        place = in_scene(page, CAMERA)
        page.locator("body").press(key)
        page.wait_for_timeout(500)
        np.testing.assert_allclose(in_scene(page, CAMERA), place, atol=0.05)
        assert all(np.linalg.norm(np.subtract(place, other)) > 0.5 for other in places)
        places.append(place)
    small = page.locator(".scene").bounding_box()
    look(page, "enlarge")
    large, stop = page.locator(".scene").bounding_box(), page.locator("#stop").bounding_box()
    assert small
    assert large
    assert stop
    assert large["width"] > 1.3 * small["width"]
    assert large["height"] > 1.5 * small["height"]
    assert stop["y"] + stop["height"] <= large["y"]
    page.locator("#scene").content_frame.locator("body").press("Escape")
    expect(page.locator(".scene")).not_to_have_class("scene large")
    assert page.locator(".scene").bounding_box() == small
    page.locator("body").press("v")
    expect(page.locator(".scene")).to_have_class("scene large")
    page.locator("body").press("Escape")
    look(page, "reset view")


def test_the_ground_of_the_scene_is_the_themes(console):
    page = console.page
    grounds = set()
    for _ in range(2):
        switch_theme(page)
        wanted = page.locator(".scene").evaluate("place => getComputedStyle(place).backgroundColor")
        grounds.add(in_scene(page, GROUND, lambda ground, wanted=wanted: ground == wanted))
    assert len(grounds) == 2
    light = max(grounds, key=lambda ground: sum(map(int, ground.strip("rgb()").split(","))))
    assert min(map(int, light.strip("rgb()").split(","))) > 200  # no black floor in the light theme


DRAWN = "window.__viserTestpoints?.rendererInfo.render.frame ?? 0"


def drawn_anew(page):
    """Wait until the scene has been drawn anew some times: what is new in it is prepared at its first picture."""
    first = in_scene(page, DRAWN)
    in_scene(page, DRAWN, lambda now: now > first + 4)


def pixel(point, width, height):
    """Where the scene's first camera shows a point of the world."""
    forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    ray = point - EYE
    scale = height / 2 / np.tan(FIELD_OF_VIEW / 2) / (ray @ forward)
    return width / 2 + scale * (ray @ right), height / 2 - scale * (ray @ up)


def drag_up(page, pause_ms=0):
    """Drag the upward arrow of the left gizmo, which stands at home; stay at the end for so long."""
    box = page.frame_locator("#scene").locator("canvas").first.bounding_box()
    assert box is not None
    begin, end = (GRIP + (0.0, 0.0, ARROW_M + way) for way in (0.0, RAISED_M))
    first, last = (np.array(pixel(at, box["width"], box["height"])) + (box["x"], box["y"]) for at in (begin, end))
    page.mouse.move(*first)
    page.wait_for_timeout(200)
    page.mouse.down()
    for k in range(1, STEPS + 1):
        page.mouse.move(*(first + (last - first) * k / STEPS))
        page.wait_for_timeout(50)
    page.wait_for_timeout(pause_ms)
    page.mouse.up()


HEIGHT = "window.__viserMutable?.nodePoseData['/command/left']?.position[2]"


def test_a_mouse_alone_moves_an_arm_and_takes_it_back(console):
    """The button that drags the gizmo is the clutch; without it, and without C, the page says why nothing moves."""
    page = console.page
    page.click("#tab-hand")
    open_settings(page)
    page.uncheck("#drag-holds")
    page.get_by_text("hold position", exact=True).click()
    drawn_anew(page)
    console.arm()
    page.click("#practise")
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)
    drawn_anew(page)  # with the gizmos
    for key, coupling in (("2", "mirrored"), ("3", "linked"), ("1", "separate")):
        page.keyboard.press(key)
        expect(page.locator("input[name=coupling]:checked")).to_have_value(coupling)
    drag_up(page)
    expect(page.locator("#hand-line")).to_contain_text("the clutch is not held")
    in_scene(page, "window.before = 1")
    look(page, "reset view")  # from the first place again, for which the scene is loaded
    in_scene(page, "window.before ?? 0", lambda before: not before)
    drawn_anew(page)
    home = in_scene(page, HEIGHT)
    page.check("#drag-holds")
    drag_up(page, pause_ms=1500)
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready")  # let go with the mouse
    raised = in_scene(page, HEIGHT, lambda now: now - home > 0.5 * RAISED_M)
    assert raised - home < 1.5 * RAISED_M
    expect(page.locator("#undo")).to_be_enabled()
    page.click("#undo")
    expect(page.locator("#hand-line")).to_contain_text("The last drag is undone")
    in_scene(page, HEIGHT, lambda now: abs(now - home) < 0.005)
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready")  # let go of by itself
    expect(page.locator("#undo")).to_have_attribute("title", "No drag to undo")
    page.click("#finish")
    expect(page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    page.uncheck("#drag-holds")
    page.get_by_text("end recording", exact=True).click()


PAD = """() => {
const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
window.pad = { id: "a pad", mapping: "standard", axes: [0, 0, 0, 0], buttons };
navigator.getGamepads = () => [window.pad];
}"""


def test_a_gamepads_mapping_is_shown_as_it_is_pressed_with_its_rotation(console):
    page = console.page
    page.click("#tab-hand")
    open_settings(page)
    expect(page.locator("#gamepad")).to_be_hidden()
    page.evaluate(PAD)
    expect(page.locator("#gamepad li")).to_have_count(6)
    stick = page.locator("#gamepad li", has_text="left stick")
    expect(stick).to_contain_text("left hand moves")
    expect(stick).to_have_attribute("data-pressed", "false")
    page.evaluate("window.pad.axes[0] = 0.8; window.pad.buttons[5] = { pressed: true, value: 1 }")
    expect(stick).to_have_attribute("data-pressed", "true")
    expect(stick).to_contain_text("left hand tips over")
    page.evaluate("delete navigator.getGamepads")
    expect(page.locator("#gamepad")).to_be_hidden()


APART = """() => {
  const boxes = [...document.querySelectorAll('.newtons')].filter((each) => each.style.visibility === 'visible')
    .map((each) => [each.textContent, each.getBoundingClientRect()]);
  const over = ([, a], [, b]) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
  return [boxes.map(([text]) => text), boxes.some((one, k) => boxes.slice(k + 1).some((other) => over(one, other)))];
}"""


def test_forces_are_written_above_a_coarse_picture_and_apart(console):
    page = console.page
    console.record()
    page.click("#tab-trial")
    in_scene(page, "window.__viserSceneTree?.getState()['/hit/left/newtons']?.message.props.text")
    for _ in range(50):
        texts, crossing = page.evaluate(APART)
        if texts:
            break
        page.wait_for_timeout(200)
    assert all(text.endswith(" N") for text in texts)
    assert len([text for text in texts if text.startswith("at most")]) == 2
    assert not crossing
