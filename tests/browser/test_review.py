"""The review in a real Chromium: real trials' logs behind a console that serves for real."""

import csv
import io
import json
import re
import shutil

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from rtstack.log.reader import read_log
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.topics import TOPICS
from tests.support.console.chromium import centre_of_hue
from tests.support.console.drawn_curves import DRAWN, drawn
from tests.support.console.served_console import serve_console

_PX = "async t => (await import(document.querySelector('script[type=module]').src)).plots.chart.x(t)"
_SHOW = "how => ['bands', 'legends'].forEach((id) => { document.getElementById(id).style.visibility = how; })"
_REACH_PX = 3
_ASIDE_PX = 12  # from where the background is taken
_DIFFERS = 60  # sum over red, green and blue


def highest_seen(page: Page, name: str, t_s: float) -> float:
    """Return the largest value at which a curve's own colour is on the screen at a time; -inf where it is not.

    The page's cursor must be elsewhere. Bands, the lines of events and the legends are hidden meanwhile: they reach to
    a pane's top too.
    """
    place = drawn(page, name)[0]
    page.evaluate(_SHOW, "hidden")
    image = np.asarray(Image.open(io.BytesIO(page.locator("#figure-area").screenshot())).convert("RGB")).astype(int)
    page.evaluate(_SHOW, "")
    colour = np.array([int(place["colour"][k : k + 2], 16) for k in (1, 3, 5)])
    top, bottom, px = place["top"], place["bottom"], round(page.evaluate(_PX, t_s))
    pane = image[top:bottom]
    near = pane[:, max(0, px - _REACH_PX) : px + _REACH_PX + 1]
    behind = pane[:, [max(0, px - _ASIDE_PX), min(pane.shape[1] - 1, px + _ASIDE_PX)]].mean(axis=1, keepdims=True)
    away = near - behind  # how far a pixel is from its ground towards the curve's colour
    towards = colour - behind
    share = (away * towards).sum(axis=2) / np.maximum((towards**2).sum(axis=2), 1.0)
    seen = (np.abs(away).sum(axis=2) > _DIFFERS) & (share > 0.45)
    rows = np.flatnonzero(seen.any(axis=1))
    if not len(rows):
        return -np.inf
    low, high = place["range"]
    return float(high - rows[0] / (bottom - top) * (high - low))


pytestmark = pytest.mark.browser
SPIKE_NM, SPIKE_S = 400.0, 1.0


def add_spike(source, target):
    """Write a log again with one sample of 400 Nm in the left arm's fourth joint, and an event with markup."""
    log = read_log(source)
    columns = {topic: log.topic(topic) for topic in TOPICS}
    columns["/left/arm"]["tau_J"][round(SPIKE_S * 1e3), 3] = SPIKE_NM
    warning = np.zeros(1, TOPICS["/events"].record)
    warning["t_ns"] = columns["/left/arm"]["t_ns"][round(SPIKE_S * 1e3)]
    warning["level"], warning["name"], warning["text"] = 3, b"safety", b"<img src=x onerror=alert(1)>"
    columns["/events"] = np.concatenate([columns["/events"], warning])
    with open(target, "wb") as file:
        writer = McapWriter(file)
        writer.write_metadata("trial", log.metadata["trial"])
        for attachment in log.attachments:
            writer.attach(attachment.name, attachment.media_type, attachment.data)
        writer.write(columns, {})
        writer.write_metadata("result", log.metadata["result"])
        writer.close()


@pytest.fixture(scope="module")
def logs(runner, tmp_path_factory):
    """Logs of two trials with different controllers; the first has a spike."""
    folder = tmp_path_factory.mktemp("reviewed") / "logs"
    folder.mkdir()
    plain = folder.parent / "plain.mcap"
    runner.run(log=plain, seed=1)
    add_spike(plain, folder / "first.mcap")
    runner.run(Controller.NO_INTERIM, displacement_mm=15.0, seed=2, log=folder / "second.mcap")
    return folder


@pytest.fixture(scope="module")
def page(browser, logs):
    """A signed-in page, and at the end no script that failed and nothing fetched from elsewhere."""
    with serve_console(logs) as served:
        context = browser.new_context(
            viewport={"width": 1440, "height": 900}, color_scheme="dark", accept_downloads=True, base_url=served.base
        )
        page = context.new_page()
        page.set_default_timeout(60_000)
        errors, requests = [], []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(f"{said.text} {said.location}") if said.type == "error" else None)
        page.on("request", lambda request: requests.append(request.url))
        page.goto(f"/?token={served.parts.sign_in.token}")
        yield page
        context.close()
        assert errors == []
        assert [url for url in requests if not url.startswith((served.base, "blob:", "data:"))] == []


_LEGENDS = """async () => {
    const { panes } = (await import(document.querySelector('script[type=module]').src)).plots;
    return [...document.querySelectorAll('.legend')].map((legend, row) =>
        ({top: legend.offsetTop, height: legend.offsetHeight, pane: panes[row].top}));
}"""


def names(page: Page) -> list[str]:
    return page.locator("#logs tbody td.when").evaluate_all("cells => cells.map(cell => cell.title)")


def window(page: Page) -> tuple[float, float]:
    """What the curves on the screen show, s."""
    first, last = (page.locator("#figure-area").get_attribute("data-window") or "nan,nan").split(",")
    return float(first), float(last)


def open_log(page: Page, name: str, query: str = "") -> None:
    page.goto("/logs")
    address = page.locator(f"#logs tbody td.when[title='{name}'] a").get_attribute("href")
    page.goto(f"{address}{query}")
    expect(page.locator("#figure-area")).to_have_attribute("data-points", re.compile("[1-9]"))
    expect(page.locator("#reading")).to_be_hidden()
    expect(page.locator("#log-events li").first).to_be_visible()


def peak(page: Page, name: str) -> float:
    """Largest value that a curve shows, once it is drawn: its name is there before its samples are."""
    page.wait_for_function(f"async () => (await ({DRAWN})({json.dumps(name)})).length > 0")
    return max(drawn(page, name)[0]["y"])


def test_the_list_is_searched_and_sorted(page):
    page.click(".rail a >> text=Logs")
    expect(page.locator("#logs tbody tr")).to_have_count(2)
    page.click("th button[data-key=controller]")
    expect(page.locator("th[aria-sort] button")).to_have_text("Controller")
    expect(page.locator("#logs tbody tr").first).to_contain_text("no interim")
    page.click("th button[data-key=controller]")
    expect(page.locator("#logs tbody tr").first).to_contain_text("proposed")
    page.fill("#query", "seed:2 interim")
    expect(page.locator("#logs tbody tr")).to_have_count(1)
    assert names(page) == ["second.mcap"]
    page.fill("#query", "no such thing")
    expect(page.locator("#empty")).to_contain_text("No log matches")
    page.fill("#query", "")
    expect(page.locator("#picked")).to_be_hidden()
    page.locator("#logs tbody input").first.check()
    expect(page.locator("#compare")).to_be_disabled()
    expect(page.locator("#compare")).to_have_attribute("title", re.compile("Tick two to 6 logs"))


def test_as_many_logs_as_one_view_has_are_compared_from_the_list(page, logs):
    third = logs / "third.mcap"
    shutil.copy(logs / "second.mcap", third)
    try:
        page.goto("/logs")
        expect(page.locator("#logs tbody tr")).to_have_count(3)
        page.check("#tick-all")
        page.click("#compare")
        expect(page).to_have_url(re.compile(r"/logs/\w+\?.*other=\w+,\w+"))
        expect(page.locator("#figure-area")).to_have_attribute("data-points", re.compile("[1-9]"))
        expect(page.locator("#overlays button")).to_have_count(2)
    finally:
        page.goto("about:blank")  # it would ask for a log that is gone
        third.unlink()


def test_a_spike_of_one_sample_is_seen_from_the_whole_log_down_to_samples(page):
    open_log(page, "first.mcap", "?signals=left.force_norm")
    page.fill("#signal-search", "left tau_j 4")
    box = page.locator("#tree label[title^='left.tau_J.4,'] input")
    expect(box).to_be_visible()
    box.check()
    expect(page.locator(".legend")).to_have_count(2)
    expect(page.locator("#figure-area")).to_have_attribute("data-window", re.compile(r"^0,5\."))
    assert peak(page, "left.tau_J.4") == SPIKE_NM
    assert highest_seen(page, "left.tau_J.4", SPIKE_S) > 0.95 * SPIKE_NM
    figure = page.locator("#figure").bounding_box()
    assert figure is not None
    y = figure["y"] + figure["height"] / 3
    for half_s in (0.3, 0.05, 0.01):
        first, last = window(page)
        shown = page.locator("#figure-area").get_attribute("data-window") or ""
        left, right = figure["x"] + 64, figure["x"] + figure["width"] - 12
        place = left + (SPIKE_S - first) / (last - first) * (right - left)
        reach = max(8.0, half_s / (last - first) * (right - left))
        page.mouse.move(max(left + 1, place - reach), y)
        page.mouse.down()
        page.mouse.move(min(right - 1, place + reach), y, steps=4)
        page.mouse.up()
        expect(page.locator("#figure-area")).not_to_have_attribute("data-window", shown)
        assert peak(page, "left.tau_J.4") == SPIKE_NM
        assert highest_seen(page, "left.tau_J.4", SPIKE_S) > 0.95 * SPIKE_NM
    assert window(page)[1] - window(page)[0] < 0.5
    expect(page).to_have_url(re.compile(f"from={window(page)[0]:.3f}"))  # a link opens exactly this view


CHART = """async spiky => {
    const { Chart } = await import('/static/js/review/chart.js');
    const [n, spike] = [20000, 6000];
    const noise = (k) => ((k * 7919) % 1000) / 500 - 1;
    const y = Float32Array.from({length: n}, (_, k) => k > 12000 && k < 13000 ? NaN
        : k === spike ? 10 : spiky ? noise(k) : Math.sin(k / 3000));
    const x = Float64Array.from(y, (_, k) => k / 1000);
    const curve = {name: 'a', pane: 0, x, y, colour: '#ff0000', dash: 'solid', width: 1.5, opacity: 1};
    const chart = new Chart({width: 700, height: 300, from: 0, to: 20, panes: [{top: 20, bottom: 260}], curves: [curve]});
    const canvas = Object.assign(document.createElement('canvas'), {width: 700, height: 300});
    const context = canvas.getContext('2d');
    chart.draw(context);
    const { data } = context.getImageData(0, 0, 700, 300);
    const red = (px) => [...Array(240).keys()].map((row) => row + 20)
        .filter((row) => data[4 * (row * 700 + px)] > 100 && data[4 * (row * 700 + px) + 1] < 90 && data[4 * (row * 700 + px) + 3] > 90);
    const [low, high] = chart.panes[0].range, top = 20 + (high - 10) / (high - low) * 240;
    const at = Math.round(chart.x(spike / 1000));
    return {top, spike: Math.min(...[-1, 0, 1].flatMap((by) => red(at + by))),
        gap: red(Math.round(chart.x(12.5))).length, columns: [...Array(600).keys()].filter((px) => red(px + 66).length).length};
}"""  # noqa: E501


@pytest.mark.parametrize("spiky", [False, True])
def test_a_spike_and_a_gap_are_seen_in_a_smooth_curve_and_in_one_that_fills_its_pane(page, spiky):
    seen = page.evaluate(CHART, spiky)
    assert abs(seen["spike"] - seen["top"]) <= 2
    assert seen["gap"] == 0
    assert 0.94 * 600 < seen["columns"] < 0.96 * 600  # all but the gap


def test_the_wheel_zooms_about_the_pointer_and_moves_the_window_and_a_double_click_shows_all(page):
    open_log(page, "first.mcap", "?signals=left.force_norm,left.tau_J.4")
    area, figure = page.locator("#figure-area"), page.locator("#figure").bounding_box()
    assert figure is not None
    (_, end), width = window(page), figure["width"] - 76

    def after(act):
        shown = area.get_attribute("data-window") or ""
        act()
        expect(area).not_to_have_attribute("data-window", shown)
        return window(page)

    page.mouse.move(figure["x"] + 64 + 0.25 * width, figure["y"] + 100)
    closer = after(lambda: page.mouse.wheel(0, -200))
    assert closer == pytest.approx((end / 8, end * 5 / 8), abs=0.01)
    assert after(lambda: page.mouse.wheel(200, 0)) == pytest.approx((end / 4, end * 3 / 4), abs=0.01)
    assert after(lambda: page.mouse.dblclick(figure["x"] + 300, figure["y"] + 100)) == pytest.approx((0, end))
    told = "[...document.querySelectorAll('link[rel=modulepreload]')].map(link => link.href)"
    fetched = "performance.getEntriesByType('resource').map(one => one.name).filter(name => name.includes('/js/'))"
    scripts = page.evaluate("[...document.scripts].map(script => script.src).filter(Boolean)")
    assert {*page.evaluate(told), *scripts} == {*page.evaluate(fetched), *scripts}  # no script is found one by one


def test_the_event_list_goes_to_the_spike_and_markup_stays_text(page):
    page.select_option("#level", "WARNING")
    expect(page.locator("#log-events li")).to_have_count(1)
    expect(page.locator("#log-events li")).to_contain_text("<img src=x onerror=alert(1)>")
    page.click("#log-events li button")
    expect(page.locator("#now")).to_have_text("1.000 s")
    expect(page.locator(".legend .entry", has_text="left 4").locator(".value")).to_have_text("400.0")
    page.select_option("#level", "INFO")
    page.click("h1")
    page.keyboard.press("]")
    expect(page.locator("#now")).not_to_have_text("1.000 s")
    page.keyboard.press("[")
    expect(page.locator("#now")).to_have_text("1.000 s")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#now")).to_have_text("1.001 s")
    page.keyboard.press("0")
    expect(page.locator("#figure-area")).to_have_attribute("data-window", re.compile(r"^0,5\."))


def test_cursor_slider_and_scene_move_together(page):
    slider, now = page.locator("#slider"), page.locator("#now")
    canvas = page.frame_locator("#scene").locator("canvas").first
    expect(canvas).to_be_visible()

    def pads_apart():
        for _ in range(60):
            image = Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")
            places = [centre_of_hue(image, colour, 20) for colour in ((86, 180, 233), (230, 159, 0))]
            if None not in places:
                return places[1] - places[0]
            page.wait_for_timeout(500)
        raise AssertionError("the pads are not in the scene")

    def settled():
        page.wait_for_timeout(3000)
        return pads_apart()

    slider.evaluate("slider => { slider.value = 0; slider.dispatchEvent(new Event('input')); }")
    expect(now).to_have_text("0.000 s")
    far = settled()
    figure = page.locator("#figure").bounding_box()
    assert figure is not None
    first, last = window(page)
    x = figure["x"] + 64 + (2.5 - first) / (last - first) * (figure["width"] - 76)
    page.mouse.click(x, figure["y"] + 100)
    expect(now).to_have_text(re.compile(r"^2\.[45]"))
    assert abs(float(slider.input_value()) - 2.5) < 0.02
    close = settled()
    assert close < 0.9 * far, (close, far)
    page.click("#play")
    expect(page.locator("#play")).to_have_text("Pause")
    page.click("#play")
    assert float(slider.input_value()) > 2.5


def test_a_second_log_is_aligned_at_the_impact_and_the_differences_are_listed(page, logs):
    page.locator("#other").select_option(label=page.locator("#other option", has_text="second.mcap").inner_text())
    chip = page.locator("#overlays .chip summary")
    expect(chip).to_have_text("no interim, +15 mm")
    expect(chip).to_have_attribute("title", "no interim, +15 mm (second.mcap)")
    impacts = [first_impact_s(read_log(logs / name)) for name in ("first.mcap", "second.mcap")]
    moved = pytest.approx(impacts[0] - impacts[1], abs=0.02)
    for _ in range(100):  # until the other log's impact has been read
        found = [curve["x"][0] for curve in drawn(page, "left.force_norm")]
        if len(found) == 2 and found[1] - found[0] == moved:
            break
        page.wait_for_timeout(200)
    assert found[1] - found[0] == moved
    expect(page).to_have_url(re.compile("other="))
    difference = page.locator("#overlays .difference")
    expect(difference).to_be_hidden()
    chip.click()
    expect(difference).to_contain_text("second.mcap")
    expect(difference.locator("tbody tr").first).to_have_text(re.compile("controller.*proposed.*no interim"))
    page.keyboard.press("Escape")
    expect(difference).to_be_hidden()
    page.click("#overlays button")
    expect(page.locator("#comparing")).to_be_hidden()
    expect(page.locator("#values")).to_be_hidden()


@pytest.mark.long
def test_logs_over_a_log_differences_references_and_layouts(page, logs):
    """Five logs over one, the same one a second time is none; what is drawn is what the logs have."""
    copies = ("third", "fourth", "fifth", "sixth")
    for name in copies:
        (logs / f"{name}.mcap").write_bytes((logs / "second.mcap").read_bytes())
    open_log(page, "first.mcap", "?signals=left.pad_velocity.vy,left.tau_J.4&from=0.5&to=2.5&t=1")
    for name in ("second", *copies):
        page.locator("#other").select_option(label=page.locator("#other option", has_text=name).inner_text())
    expect(page.locator("#overlays button")).to_have_count(5)
    expect(page.locator("#values tbody tr").first.locator("td", has_text=re.compile(r"\d"))).to_have_count(6)
    page.set_viewport_size({"width": 1280, "height": 720})
    plots, main = (page.locator(which).bounding_box() or {} for which in ("#plots", "#review"))
    assert plots["y"] - main["y"] <= 120 + 8  # what is above the curves, and the gap below it
    page.set_viewport_size({"width": 1440, "height": 900})
    page.check("#reference")
    for _ in range(200):
        curves = drawn(page, "left.pad_velocity.vy") + drawn(page, "left.twist_ref.vy")
        if len(curves) == 12:
            break
        page.wait_for_timeout(200)
    assert len({curve["colour"] for curve in drawn(page, "left.pad_velocity.vy")}) == 6
    assert len({curve["top"] for curve in curves}) == 1  # in one pane: over what is to follow it
    expect(page.locator(".legend").first).to_contain_text("left vy reference")
    expect(page).to_have_url(re.compile("reference=1"))

    page.check("#minus")
    expect(page.locator(".legend b").first).to_have_text("difference of pad velocity, m/s")
    for _ in range(200):
        found = drawn(page, "left.tau_J.4")
        if len(found) == 5:
            break
        page.wait_for_timeout(200)
    spike = min(found[0]["y"])
    assert -SPIKE_NM - 60.0 < spike < -SPIKE_NM + 120.0  # the other log less this one, at the spike
    page.click("#layouts summary")
    page.fill("#layout-name", "around the impact")
    page.click("#layout-form button[type=submit]")
    expect(page.locator("#layout")).to_have_value("around the impact")

    open_log(page, "second.mcap", "?layout=around the impact")
    first, second = (first_impact_s(read_log(logs / name)) for name in ("first.mcap", "second.mcap"))
    expect(page.locator("#tree input:checked")).to_have_count(2)
    shown = f"{0.5 - first + second:.3f}"
    expect(page).to_have_url(re.compile(f"from={re.escape(shown[:-1])}"))
    expect(page.locator("#reference")).to_be_checked()
    page.click("#layouts summary")
    page.click("#layout-remove")
    expect(page.locator("#layout option")).to_have_count(1)
    for name in copies:
        (logs / f"{name}.mcap").unlink()
    open_log(page, "first.mcap", "?signals=left.force_norm,left.tau_J.4")


@pytest.mark.long
def test_a_compared_log_that_ends_earlier_says_so_and_long_legends_hide_no_curve(page, logs):
    before = page.url
    page.set_viewport_size({"width": 1280, "height": 720})
    open_log(page, "second.mcap", f"?t=1&signals=left.force_norm,{','.join(f'left.tau_J.{k}' for k in range(1, 8))}")
    page.locator("#other").select_option(label=page.locator("#other option", has_text="first.mcap").inner_text())
    ghost, values = page.locator("#ghost"), page.locator("#values td:nth-child(3)")
    expect(ghost).to_have_text(re.compile(r"^proposed, 0 mm at \d"))
    expect(values.first).to_have_text(re.compile(r"\d"))
    places = page.evaluate(_LEGENDS)
    assert max(legend["height"] for legend in places) >= 40  # two lines
    assert all(legend["top"] + legend["height"] <= legend["pane"] for legend in places)
    page.locator("#slider").evaluate("s => { s.value = s.max; s.dispatchEvent(new Event('input')); }")
    log = read_log(logs / "first.mcap")
    end_s = (log.topic("/left/arm")["t_ns"][-1] - log.start_ns) * 1e-9
    expect(ghost).to_have_text(f"proposed, 0 mm ended at {end_s:.3f} s")
    expect(values.first).to_have_text("")
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(before)


def test_a_comparison_begins_at_the_impact_and_is_in_sight_in_small_windows(page, logs):
    ids = {row["name"]: row["id"] for row in page.request.get("/api/logs").json()}
    compared = f"/logs/{ids['first.mcap']}?other={ids['second.mcap']}"
    impact = f"{first_impact_s(read_log(logs / 'first.mcap')):.3f} s"
    try:
        for width, height in ((390, 844), (640, 360), (1280, 720)):
            page.set_viewport_size({"width": width, "height": height})
            page.goto(compared)
            expect(page.locator("#now")).to_have_text(impact)
            expect(page.locator("#values td:nth-child(3)").first).to_have_text(re.compile(r"\d"))
            expect(page.locator("#log-events li[aria-current]")).to_have_count(1)
            assert page.evaluate("scrollY") == 0
        assert (
            page.locator("#plots").evaluate("plots => plots.scrollHeight - plots.clientHeight") == 0
        )  # the axis is there
        page.select_option("#across", "left.q.1")
        expect(page).to_have_url(re.compile("x=left"))
        assert page.locator("#plots").evaluate("plots => plots.scrollHeight - plots.clientHeight") == 0
        page.locator("#plots").press("n")
        expect(page.locator("#note-text")).to_be_focused()
        form, cancel = (page.locator(which).bounding_box() or {} for which in ("#note-form", "#note-cancel"))
        assert cancel["x"] + cancel["width"] <= form["x"] + form["width"]
        page.keyboard.press("Escape")
        page.goto(f"{compared}&t=0.000")
        expect(page.locator("#values td:nth-child(2)").first).to_have_text(re.compile(r"\d"))
        expect(page.locator("#now")).to_have_text("0.000 s")
    finally:
        page.set_viewport_size({"width": 1440, "height": 900})


_CARD = """async () => {
    const { TrialCard } = await import('/static/js/trial_card.js');
    const impact = {at_s: 1.25, t_ms: [-1, 1], left: [0, 1], right: [0, 1], modes: []};
    const card = new TrialCard({onView: () => {}});
    card.fill({row: {id: 'a'}, before: 'b', impact, numbers: [], ending: '', what: '', sentence: ''});
    return document.getElementById('card-compare').getAttribute('href');
}"""


def test_a_trial_is_compared_with_the_last_one_at_its_impact(page):
    page.goto("/")
    assert page.evaluate(_CARD) == "/logs/a?other=b&t=1.250"


def test_a_value_and_a_name_are_written_once_and_without_a_sign_of_nothing(page):
    open_log(page, "first.mcap", "?signals=left.force_norm,left.tau_J.4")
    texts = "async () => (await import('/static/js/review/legends.js')).valueText"
    written = f"async values => {{ const text = await ({texts})(); return values.map((value) => text(value, 3)); }}"
    assert page.evaluate(written, [-0.0004, 0.0, -0.0006, -12.34, -1000.4]) == [
        "0.000",
        "0.000",
        "-0.001",
        "-12.3",
        "-1000",
    ]
    norm, torque = page.locator(".legend").all()
    expect(norm.locator("b")).to_have_text("force norm (Eq. 33), N, Nm")
    expect(norm.locator("b")).to_have_attribute("title", "force_norm")
    expect(norm.locator(".faint")).to_be_empty()
    expect(torque.locator(".faint")).to_have_text("tau_J")


_PAINTED = """() => {
    const canvas = document.getElementById('figure'), { width, height } = canvas;
    dispatchEvent(new Event('beforeprint'));
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    dispatchEvent(new Event('afterprint'));
    let painted = 0;
    for (let place = 3; place < data.length; place += 4) painted += data[place] > 0;
    return [painted / (data.length / 4), canvas.width === width && canvas.height === height];
}"""


@pytest.mark.long
def test_a_comparison_is_printed_on_one_page_without_the_bar(page):
    open_log(page, "first.mcap")
    page.locator("#other").select_option(label=page.locator("#other option", has_text="second.mcap").inner_text())
    expect(page.locator("#values tbody tr").first).to_contain_text(re.compile(r"\d"))
    theme, printed = (
        page.get_attribute("html", "data-theme"),
        page.locator("#figure").evaluate("canvas => canvas.width"),
    )
    for paper in ("A4", "Letter"):
        assert len(re.findall(rb"/Type\s*/Page\b", page.pdf(format=paper))) == 1
    painted, as_before = page.evaluate(_PAINTED)
    assert painted > 0.4  # the bands of the modes, on the curves' own canvas: on paper it hides the one behind it
    assert as_before
    assert page.get_attribute("html", "data-theme") == theme
    assert page.locator("#figure").evaluate("canvas => canvas.width") == printed
    page.emulate_media(media="print")
    for gone in (".bar", "#stop", ".rail", "#strip", "#full", "#tree", "#scene"):
        expect(page.locator(gone)).to_be_hidden()
    for there in ("h1", "#what", "#figure", "#log-events li", "#values"):
        expect(page.locator(there).first).to_be_visible()
    page.emulate_media(media="screen")


@pytest.mark.long
def test_signals_are_drawn_against_a_signal(page, logs):
    open_log(page, "first.mcap", "?signals=left.tau_J.4,left.pad_force&x=left.q.1&t=1&from=0.5&to=2")
    expect(page.locator("#across")).to_have_value("left.q.1")
    curves = [drawn(page, name)[0] for name in ("left.tau_J.4", "left.pad_force")]
    over_time = read_log(logs / "first.mcap").topic("/left/arm")
    rows = slice(499, 2001)
    np.testing.assert_allclose(curves[0]["x"], over_time["q"][rows, 0], atol=1e-6)
    np.testing.assert_allclose(curves[0]["y"], over_time["tau_J"][rows, 3], atol=1e-4)
    figure, row = page.locator("#figure").bounding_box(), 1200
    assert figure is not None
    x = page.evaluate(_PX, curves[1]["x"][row])
    low, high = curves[1]["range"]
    share = (high - curves[1]["y"][row]) / (high - low)
    y = curves[1]["top"] + share * (curves[1]["bottom"] - curves[1]["top"])
    page.mouse.click(figure["x"] + x, figure["y"] + y)
    expect(page.locator("#now")).to_have_text(re.compile(r"^1\.(69|70)"))  # the sample that is there
    expect(page.locator("#pdf")).to_have_attribute("aria-disabled", "true")
    page.select_option("#across", "")
    expect(page.locator("#pdf")).to_have_attribute("aria-disabled", "false")
    expect(page).not_to_have_url(re.compile("x=left"))
    over_time = drawn(page, "left.pad_force")[0]["x"]
    assert (over_time[0], over_time[-1]) == pytest.approx((0.5, 2.0), abs=0.02)


def first_impact_s(log):
    """When a log's first impact was, s after its first sample."""
    return (next(event.t_ns for event in log.events if event.name == "impact") - log.start_ns) * 1e-9


@pytest.mark.long
def test_what_is_on_the_screen_comes_down(page, logs, tmp_path):
    open_log(page, "first.mcap", "?signals=left.tau_J.4,left.force_norm,left.q.1")
    for suffix in ("pdf", "svg", "png", "csv", "mcap"):
        expect(page.locator(f"#{suffix}")).to_have_attribute("href", re.compile("^/api/logs/"))
        page.locator("#export").evaluate("menu => (menu.open = true)")
        with page.expect_download() as download:
            page.click(f"#{suffix}")
        download.value.save_as(tmp_path / f"got.{suffix}")
        assert download.value.suggested_filename == f"first.{suffix}"
        expect(page.locator("#export")).not_to_have_attribute("open", "")
    image = Image.open(tmp_path / "got.png").convert("RGB")
    assert image.width > 1000
    assert len(np.unique(np.asarray(image).reshape(-1, 3), axis=0)) > 20
    assert (tmp_path / "got.pdf").read_bytes().startswith(b"%PDF")
    drawing = (tmp_path / "got.svg").read_text()  # Matplotlib says a drawn text in a comment
    places = [drawing.index(name) for name in ("joint torque", "force norm", "joint position")]
    assert places == sorted(places)  # as on the page
    rows = list(csv.DictReader((tmp_path / "got.csv").read_text().splitlines()))
    assert max(float(row["left.tau_J.4"]) for row in rows) == SPIKE_NM
    assert (tmp_path / "got.mcap").read_bytes() == (logs / "first.mcap").read_bytes()


@pytest.mark.parametrize("late", ["**/api/logs/signals", "**/api/logs/*/series*"])
def test_nothing_can_be_pressed_before_it_does_something(page, late):
    """Whatever the page waits for: neither a button nor a key does something by halves."""
    held = []
    page.route(late, lambda route: route.continue_() if held else held.append(route))
    page.reload(wait_until="commit")
    for _ in range(300):
        if held:
            break
        page.wait_for_timeout(100)
    expect(page.locator("#full")).to_be_disabled()
    if late.endswith("signals"):  # the log's length is not known either
        expect(page.locator("#slider")).to_be_disabled()
    for link in ("#png", "#csv"):
        expect(page.locator(link)).to_have_attribute("aria-disabled", "true")
        expect(page.locator(link)).not_to_have_attribute("href", re.compile(""))
    page.keyboard.press("+")
    held[0].continue_()
    for control in ("#full", "#slider"):
        expect(page.locator(control)).to_be_enabled()
    for link in ("#png", "#csv"):
        expect(page.locator(link)).to_have_attribute("href", re.compile("^/api/logs/"))
    expect(page.locator(".legend b").first).to_be_visible()
    expect(page.locator("#errors")).to_be_empty()
    page.unroute(late)


@pytest.mark.long
def test_everything_is_reached_by_the_keyboard(page):
    page.click("h1")
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()
    page.evaluate("document.activeElement.blur()")
    page.locator("#export").evaluate("menu => (menu.open = true)")  # Enter opens it
    reached = set()
    focused = "document.activeElement.id || document.activeElement.closest('aside, nav')?.className"
    for _ in range(400):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(focused))
    controls = {"other", "full", "png", "csv", "mcap", "further", "play", "speed", "slider", "level"}
    assert controls | {"tree", "rail"} <= reached
