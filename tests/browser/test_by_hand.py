"""The whole way of a person who grabs by hand: sign in, drag both gizmos, record, accept, run, review, download.

The recording comes from the drag, not from the script.
"""

import re

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from playwright.sync_api import expect

from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode
from tests.support.console.operator_hands import READY_MS, ClutchLost

# in CI: a mouse alone in test_scene.py, and without a browser tests/console and tests/teleoperation
pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(900)]
ATTEMPTS = 5  # a page that a busy machine held up for longer than a clutch is held without a word has lost the hand
RAISED_M, CLOSED_M, LIFTED_M = 0.05, 0.31, 0.15
SPEED_M_S = "0.3"
IMPACT_N = 5.0  # Appendix B's force_high


def grab(operator):
    """Drag a grab, clutch held from the beginning to the end."""
    page = operator.page
    operator.begin("#record")
    expect(page.locator("#recording")).to_contain_text("REC")
    page.keyboard.press("1")
    page.fill("#speed", SPEED_M_S)
    operator.hold()
    operator.drag("left", 2, RAISED_M)
    operator.drag("right", 2, RAISED_M)
    operator.wait_at_rest()
    page.keyboard.press("2")
    operator.drag("left", 1, -CLOSED_M, "mirrored")
    operator.wait_at_rest()
    page.keyboard.press("3")
    operator.drag("left", 2, LIFTED_M, "linked")
    operator.wait_at_rest()
    operator.release()
    expect(page.locator("#job-line")).to_contain_text("succeeded")


def record_grab(operator):
    """Record a grab; what the page lost on the way is recorded once more, as a person would."""
    for _ in range(ATTEMPTS):
        try:
            return grab(operator)
        except ClutchLost as lost:
            print(f"recorded once more, since {lost}")
            operator.recover()
    raise AssertionError(f"the clutch was lost {ATTEMPTS} times")


def read(path):
    """Read a log with nothing of ours: events, and of each arm's topic the columns that are wanted."""
    events, columns = [], {}
    with open(path, "rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages(["/events", "/left/arm", "/right/arm", "/object/pose"]):
            if channel.topic == "/events":
                events.append((message.log_time, decoded.name, decoded.message))
            elif channel.topic == "/object/pose":
                columns.setdefault(channel.topic, []).append((message.log_time, decoded.pose.position.z))
            else:
                force = np.linalg.norm(decoded.O_F_ext_hat_K[:3])
                columns.setdefault(channel.topic, []).append((message.log_time, force))
    return events, {topic: np.array(rows) for topic, rows in columns.items()}


def hit_ns(rows):
    """When an arm's force was first more than an impact's, ns."""
    return rows[np.argmax(rows[:, 1] > IMPACT_N), 0]


def newest_log(page, tmp_path, kind):
    """Download the newest log of a kind, and read it."""
    row = page.locator("#logs tbody tr", has_text=kind).first
    expect(row).not_to_contain_text("being written")
    with page.expect_download() as download:
        row.locator("a[download]").click()
    path = tmp_path / "log.mcap"
    download.value.save_as(path)
    return read_log(path)


def test_nothing_moves_without_the_clutch(operator, tmp_path):
    """The same drag twice: what the arm does is what the second one asks for."""
    page = operator.page
    for _ in range(ATTEMPTS):
        try:
            operator.begin("#record")
            operator.drag("left", 2, RAISED_M, held=False)
            operator.reset_view()  # whatever the drag has done to it
            operator.hold()
            operator.drag("left", 2, RAISED_M)
            operator.wait_at_rest()
            operator.release()
            break
        except ClutchLost:
            operator.recover()
    control = newest_log(page, tmp_path, "recording").topic("/left/control")
    moving = control[control["mode"] == Mode.TELEOPERATION]
    assert np.ptp(moving["pose_ref"][:, 2]) == pytest.approx(RAISED_M, abs=0.4 * RAISED_M)


def check_recording(log):
    """Both arms went where the gizmos were dragged to, and stopped when they were let go of."""
    assert log.metadata["trial"]["kind"] == "recording"
    for side in SIDES:
        control = log.topic(f"/{side}/control")
        assert set(control["mode"]) == {Mode.TELEOPERATION, Mode.STOPPING}
        for places in (control["pose_ref"][:, :3], log.topic(f"/{side}/arm")["O_T_EE"][:, :3, 3]):
            _, aside, rise = np.ptp(places, axis=0)
            assert rise == pytest.approx(RAISED_M + LIFTED_M, abs=0.08)
            assert 0.1 < aside < 1.2 * CLOSED_M
        assert np.ptp(control["pose_ref"][:, 0]) < 0.01


def test_a_grab_by_hand_becomes_a_reference_and_its_trial_is_reviewed(console, operator, tmp_path):
    page = console.page
    record_grab(operator)
    expect(page.locator("#recording")).to_be_hidden()
    check_recording(newest_log(page, tmp_path, "recording"))

    row = page.locator("#logs tbody tr", has_text="recording").first
    row.get_by_text("accept or reject").click()
    expect(page.locator("#facts")).to_contain_text("Detected impact")
    expect(page.locator("#facts dd").nth(2)).to_have_text(re.compile(r"^\d+\.\d+ s$"))
    page.fill("#name", "a grab by hand")
    page.click("#accept")
    expect(page.locator("#verdict")).to_have_text("Accepted: trials may follow it.")

    page.goto("/")
    console.start_trial("proposed", "15")
    expect(page.locator("#trial select[name=reference] option")).to_have_count(1)
    expect(page.locator("#trial-card")).to_be_visible(timeout=2 * READY_MS)
    expect(page.locator("#card-ending")).to_have_text(re.compile("success|unexpected impact"))

    page.click(".rail a >> text=Logs")
    page.locator("#logs tbody tr", has_text="proposed").first.locator("a[href^='/logs/']").click()
    expect(page.locator("#figure-area")).to_have_attribute("data-points", re.compile("[1-9]"))
    expect(page.locator("#reading")).to_be_hidden()
    impacts = page.locator("#log-events li", has_text="impact: detected")
    expect(impacts).to_have_count(2)  # one an arm
    impact = impacts.first
    impact.locator("button").click()
    at_s = float(re.findall(r"[\d.]+", impact.locator(".at").inner_text())[0])
    expect(page.locator("#now")).to_have_text(f"{at_s:.3f} s")
    assert abs(float(page.locator("#slider").input_value()) - at_s) < 2e-3

    with page.expect_download() as download:
        page.click("#mcap")
    download.value.save_as(tmp_path / "trial.mcap")
    events, columns = read(tmp_path / "trial.mcap")
    start_ns = min(rows[0, 0] for rows in columns.values())
    found_ns = [t_ns for t_ns, name, _ in events if name == "impact"]
    assert abs((found_ns[0] - start_ns) * 1e-9 - at_s) < 2e-3
    hits_ns = sorted(hit_ns(columns[f"/{side}/arm"]) for side in ("left", "right"))
    assert np.abs(np.subtract(hits_ns, found_ns)).max() < 20e6
    assert 0 < hits_ns[1] - hits_ns[0] < 300e6  # 15 mm to one side: the arms hit one after the other
    height = columns["/object/pose"][:, 1]
    assert np.max(height) - height[0] > 0.5 * LIFTED_M
    assert console.errors == []
