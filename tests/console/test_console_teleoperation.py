"""The hand through the console: who may move what, and what reaches the mailbox."""

import json
import time
from dataclasses import replace
from itertools import count

import httpx
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from console.scene.scenes import Detail
from console.teleoperation.devices import Coupling, Grips, led
from console.teleoperation.quaternion import angle_between, product, quaternion, squared
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import JobState
from rtstack.loop.mailbox import TARGET, Release
from rtstack.loop.watchdogs import CLUTCH_S
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Mode
from rtstack.teleoperation.stamp import Sender, Stamp
from tests.support.console.client import TRIES, arm, cookie_header, say, socket, wait_for

POSES = np.array([[0.0, 0.35, 0.26, 1.0, 0.0, 0.0, 0.0], [0.0, -0.35, 0.26, 1.0, 0.0, 0.0, 0.0]])
ORDER = {"object": "rice_box"}
_HOURS = count(0, 3600)  # s
HAND = "/api/teleoperation/hand"


def target(served):
    """What the loop would read."""
    record = np.zeros(1, TARGET)
    served.mailbox.read_target(record)
    return record[0]


@pytest.fixture
def running(served):
    """A console whose robot process carries out a teleoperation; arms that say where they were told to be."""
    with served.signed_in() as (client, headers):
        arm(client, headers)
        assert client.post("/api/jobs/teleoperation", json=ORDER, headers=headers).status_code == 202
        served.job_manager.started("x.mcap")
        sample, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
        sample["O_T_EE"] = np.eye(4)
        control["mode"] = Mode.TELEOPERATION
        for side, pose in zip(SIDES, POSES, strict=True):
            control["pose_ref"] = pose
            served.rings.pusher(f"/{side}/arm").push(sample)
            served.rings.pusher(f"/{side}/control").push(control)
        wait_for(lambda: served.parts.watch.command() is not None and served.parts.teleop.running)
        yield served, client, headers


def moved(**hands):
    """A message that holds the clutch and places hands."""
    return {"clutch": True, "pose": hands}


def test_the_holder_moves_both_arms_and_the_loop_reads_it_whole(running):
    served, client, headers = running
    left = [0.02, 0.3, 0.3, 1.0, 0.0, 0.0, 0.0]
    answer = say(client, headers, **moved(left=left), speed_m_s=0.1, stiffness_n_m=150.0)
    said = answer.json()
    assert served.parts.watch.picture_ns(said.pop("picture")) is not None
    said["dropped"] = [0, 0, 0, 0]  # a slow machine says it again
    assert said == {
        "held": True, "coupling": "separate", "speed_m_s": 0.1, "stiffness_n_m": 150.0, "refusal": None, "policies": [],
        "handles": "move", "drags": 0, "dropped": [0, 0, 0, 0], "latency": None, "policy": None,
        "leading": False,
    }  # fmt: skip
    read = target(served)
    np.testing.assert_allclose(read["pose"], [left, POSES[1]])
    assert (read["job"], read["finish"], read["speed"], read["stiffness"]) == (1, 0, 0.1, 150.0)
    assert 0 <= time.monotonic_ns() - read["clutch_ns"] < 60e9
    say(client, headers, clutch=False)
    assert (target(served)["clutch_ns"], target(served)["release"]) == (0, Release.RELEASED)


def test_nothing_moves_without_the_clutch_the_lease_or_a_teleoperation(served):
    with served.signed_in() as (client, headers):
        assert "take control first" in say(client, headers, clutch=True).json()["error"]
        arm(client, headers)
        wait_for(lambda: served.parts.watch.view.status.holder is not None)
        assert "no teleoperation runs" in say(client, headers, clutch=True).json()["error"]
        assert "hold the clutch" in say(client, headers, pose={"left": POSES[0].tolist()}).json()["error"]
        assert client.post("/api/teleoperation/hand", json={"clutch": True}).status_code == 403  # without the word
    assert served.mailbox.target_sequence == 0


def test_a_viewer_moves_nothing_by_any_way(running):
    served, _, _ = running
    cookies, others = served.second_session()
    before = served.mailbox.target_sequence
    with httpx.Client(base_url=served.base, cookies=cookies, trust_env=False, timeout=60.0) as viewer:
        for message in ({"clutch": True}, {"pose": {"left": POSES[0].tolist()}}, {"speed_m_s": 0.4}):
            assert say(viewer, others, **message).status_code == 409
        assert viewer.post("/api/teleoperation/finish", json={}, headers=others).status_code == 409
    with socket(served, HAND, additional_headers=cookie_header(cookies)) as page:
        page.send(json.dumps({"clutch": True}))
        assert "has control" in json.loads(page.recv(timeout=60))["error"]
    assert served.mailbox.target_sequence == before


def gizmo(x):
    """What viser's client sends when a gizmo is dragged."""
    return [
        msgspec.msgpack.encode({"type": f"TransformControls{kind}Message", "name": "/grip/left", "owner": "", **pose})
        for kind, pose in (
            ("DragStart", {}),
            ("Update", {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.35, 0.26]}),
            ("Update", {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [x, 0.35, 0.26]}),
        )
    ]


def test_a_gizmo_moves_the_arm_for_the_holder_and_for_nobody_else(running):
    served, client, headers = running
    cookies, _ = served.second_session()
    for headers_of, moves in ((cookie_header(cookies), False), (cookie_header(client.cookies), True)):
        with socket(served, "/viser/light", additional_headers=headers_of) as page:
            page.recv(timeout=60)
            figures = served.parts.scenes._made[Detail.LIGHT]._gizmos
            # a page without a camera is not drawn for
            figures.show(served.parts.watch.measured(), served.parts.watch.command(), served.parts.watch.forces())

            def drag(page=page):
                say(client, headers, clutch=True)
                for message in [*gizmo(0.1), b"\xc1 no message at all"]:
                    page.send(message)
                time.sleep(0.1)
                return target(served)["pose"][0, 0] == pytest.approx(0.1)

            if moves:
                wait_for(drag)
            else:
                assert not drag()
                np.testing.assert_allclose(target(served)["pose"], POSES)


def test_a_socket_that_closes_lets_go_at_once(running):
    served, client, _ = running
    with socket(served, HAND, client) as page:
        sender, answer = Sender(), {"held": False}
        while not answer["held"]:
            page.send(json.dumps(sender.stamped({"clutch": True, "sent": 12.5})))
            answer = sender.saw(json.loads(page.recv(timeout=60)))
            assert (answer["sent"], answer["error"]) == (12.5, None)
    wait_for(lambda: target(served)["clutch_ns"] == 0)
    assert target(served)["release"] == Release.LOST


@pytest.mark.parametrize(
    "message",
    [
        {"pose": {"left": [0.0] * 6}}, {"pose": {"left": [1e300] * 7}}, {"speed_m_s": 5.0}, {"stiffness_n_m": -1.0},
        {"deflection": {"left": [2.0] * 6}}, {"coupling": "upside down"}, {"clutch": "yes"}, {"else": 1},
    ],
)  # fmt: skip
def test_a_bad_message_is_one_line_and_moves_nothing(running, message):
    served, client, headers = running
    say(client, headers, clutch=True)
    before = served.mailbox.target_sequence
    answer = say(client, headers, **message)
    assert answer.status_code == 422
    assert "\n" not in answer.json()["error"]
    assert served.mailbox.target_sequence == before


def test_a_jump_and_a_pose_that_is_none_are_refused_with_the_reason(running):
    served, client, headers = running
    for left in ([0.5, 0.35, 0.26, 1, 0, 0, 0], [0, 0.35, 0.26, 0, 0, 0, 0], [0, 0.35, 0.26, 0, 1, 0, 0]):
        answer = say(client, headers, **moved(left=left)).json()
        assert answer.get("refusal") or "let go" in answer["error"]
        np.testing.assert_allclose(target(served)["pose"], POSES)
        say(client, headers, clutch=False)


def hand_at(x=0.0, quaternion=(1.0, 0.0, 0.0, 0.0)):
    return [0.4 + x, 0.1, 1.0, *quaternion]


def test_a_hand_that_jumps_is_let_go_until_its_grip_was_opened(running):
    served, client, headers = running
    for bad in ({"hands": {"left": hand_at(0.4)}}, {"hands": {"left": hand_at(0.0, (0.9, 0.0, 0.0, 0.0))}},
                {"hands": {"left": hand_at()}, "sensed": {"left": hand_at(2.0, (0.0, 1.0, 0.0, 0.0))}},
                {"hands": {"left": hand_at()}, "tracked": False}):  # fmt: skip
        rest = {"clutch": True, "hands": {"left": hand_at()}, "sensed": {"left": hand_at()}}
        for _ in range(TRIES):  # on a machine so slow that the clutch goes quiet between both, the hand begins anew
            say(client, headers, clutch=False)
            assert say(client, headers, **rest).json()["held"]
            answer = say(client, headers, **({"clutch": True} | bad))
            if answer.status_code != 200:
                break
        assert answer.status_code == 409
        assert "let go" in answer.json()["error"]
        assert (target(served)["clutch_ns"], target(served)["release"]) == (0, Release.DROPPED)
        for again in ({"clutch": True, "hands": {"left": hand_at()}}, {"clutch": True, "pose": {"left": hand_at()}}):
            say(client, headers, clutch=False, lost=True)  # a page that lost the hand has not seen the grip opened
            assert say(client, headers, **again).json() == answer.json()
        assert served.parts.teleop.view.refusal == answer.json()["error"]
        np.testing.assert_array_equal(target(served)["pose"], POSES)
        say(client, headers, clutch=False)
        assert served.parts.teleop.view.refusal is None


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    steps=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=4, max_size=30),
    jump=st.tuples(*[st.floats(-0.4, 0.4)] * 3).filter(lambda way: np.linalg.norm(way) > 0.06),
)
def test_a_hand_is_followed_as_it_is_and_a_jump_moves_no_request(running, steps, jump):
    """steps: accelerations along each axis, m/s2, at 50 Hz."""
    served, _, _ = running
    teleop, grips = served.parts.teleop, Grips()
    by = served.parts.watch.view.status.holder
    teleop.release(by)
    teleop.press(by)

    def track(place):
        nonlocal at_ms
        at_ms += 20.0
        hand = np.array([*place, 1.0, 0.0, 0.0, 0.0])
        teleop._motion.advance(Stamp("a", 1, at_ms, 1, 0.0), round(1e6 * at_ms))
        teleop.press(by)
        teleop.track(by, [hand, None])
        return grips.track([hand, None], POSES, Coupling.SEPARATE)

    at_ms, drawn = 1e3 * next(_HOURS), 0.02 * np.cumsum(np.cumsum(0.02 * np.array(steps), axis=0), axis=0)
    for place in np.array([0.4, 0.1, 1.0]) + drawn:
        np.testing.assert_array_equal(track(place), target(served)["pose"])
    before = target(served)["pose"].copy()
    for at in (place + jump, place):
        with pytest.raises(RobotRefused, match="let go"):
            track(at)
        np.testing.assert_array_equal(target(served)["pose"], before)


def test_keys_and_sticks_move_as_far_as_they_are_held_and_both_arms_where_they_are_linked(running):
    served, client, headers = running
    say(client, headers, clutch=True, coupling="linked", speed_m_s=0.2)
    for _ in range(3):
        say(client, headers, clutch=True, deflection={"left": [0, 0, 1, 0, 0, 0]})
        time.sleep(0.05)
    rise = target(served)["pose"][:, 2] - POSES[:, 2]
    assert rise[0] == pytest.approx(rise[1])
    assert 0.0 < rise[0] <= 3 * 0.1 * 0.2 + 1e-9


def test_linked_hands_turn_about_their_middle_and_mirrored_ones_close(running):
    turned = led(POSES, 0, np.zeros(3), quaternion(np.array([0.0, 0.0, np.pi / 2])), Coupling.LINKED)
    np.testing.assert_allclose(turned[:, :3], [[-0.35, 0.0, 0.26], [0.35, 0.0, 0.26]], atol=1e-12)
    closed = led(POSES, 1, np.array([0.01, 0.1, 0.02]), quaternion(np.array([0.1, 0.2, 0.3])), Coupling.MIRRORED)
    np.testing.assert_allclose(closed[:, :3], [[0.01, 0.25, 0.28], [0.01, -0.25, 0.28]])
    np.testing.assert_allclose(closed[0, 3:], closed[1, 3:] * [1, -1, 1, -1])


@pytest.fixture
def clock_ns(running, monkeypatch):
    """The hand's clock, which only the test moves: [ns]."""
    now_ns = [time.monotonic_ns()]
    monkeypatch.setattr(running[0].parts.teleop, "_clock", lambda: now_ns[0])
    return now_ns


def test_a_clutch_that_goes_quiet_is_shown_as_let_go(running, clock_ns):
    served, client, headers = running
    say(client, headers, clutch=True)
    clock_ns[0] += round(CLUTCH_S * 1e9)
    assert served.parts.teleop.view.held
    clock_ns[0] += 1
    assert not served.parts.teleop.view.held
    assert "hold the clutch" in say(client, headers, pose={"left": POSES[0].tolist()}).json()["error"]


def test_finishing_asks_the_loop_for_the_end(running):
    served, client, headers = running
    assert client.post("/api/teleoperation/finish", json={}, headers=headers).status_code == 200
    assert (target(served)["finish"], target(served)["job"]) == (1, 1)
    served.job_manager._change(state=JobState.DONE)
    wait_for(lambda: not served.parts.teleop.running)
    assert replace(served.parts.teleop.view, held=True).held


LIFTED = np.array([0.0, 0.35, 0.31, 1.0, 0.0, 0.0, 0.0])  # 50 mm above POSES


def drag(served, *phases, grip=LIFTED):
    """Drag the left gizmo, as the scene says it."""
    for phase in phases:
        served.parts.teleop.drag(0, POSES[0] if phase == "start" else grip, phase)


def test_a_drag_without_the_clutch_moves_nothing_and_says_why(running):
    served, _, _ = running
    drag(served, "start", "update")
    assert served.mailbox.target_sequence == 0
    assert "clutch is not held" in served.parts.teleop.view.refusal


@pytest.mark.parametrize("first", ["grip", "drag"])
def test_a_mouse_that_drags_a_gizmo_holds_the_clutch_until_it_lets_go(running, clock_ns, first):
    """Whichever of the two sockets is heard first."""
    served, client, headers = running
    teleop = served.parts.teleop
    if first == "grip":
        assert not say(client, headers, grip=True).json()["held"]  # the camera may be what is dragged
        assert served.mailbox.target_sequence == 0
        drag(served, "start")
    else:
        drag(served, "start")
        assert say(client, headers, grip=True).json()["held"]
    drag(served, "update", "update")
    assert teleop.view.held
    assert teleop.view.refusal is None
    assert target(served)["clutch_ns"] > 0
    if first == "drag":
        assert target(served)["pose"][0, 2] == pytest.approx(POSES[0, 2])  # it began where the clutch was taken
    else:
        assert target(served)["pose"][0, 2] == pytest.approx(LIFTED[2])
    drag(served, "end")
    assert not teleop.view.held
    assert (target(served)["clutch_ns"], target(served)["release"]) == (0, Release.RELEASED)


def test_a_mouse_that_is_not_heard_of_any_more_has_let_go(running, clock_ns):
    """No latch: the page says all the time that the button is down, and a drag alone is no sign of life."""
    served, client, headers = running
    say(client, headers, grip=True)
    drag(served, "start", "update")
    assert served.parts.teleop.view.held
    clock_ns[0] += round(CLUTCH_S * 1e9) + 1
    drag(served, "update")
    assert not served.parts.teleop.view.held
    assert time.monotonic_ns() - target(served)["clutch_ns"] < 60e9  # the loop itself sees that it is old


def test_only_the_holder_of_the_lease_lets_a_drag_hold_the_clutch(running):
    served, _, _ = running
    cookies, others = served.second_session()
    with httpx.Client(base_url=served.base, cookies=cookies, trust_env=False, timeout=60.0) as viewer:
        assert say(viewer, others, grip=True).status_code == 409
        drag(served, "start", "update")
        assert not served.parts.teleop.view.held


def test_the_last_drag_is_undone_while_the_clutch_is_held_and_no_faster_than_the_hands_go(running, clock_ns):
    """By a clock of the test: on a machine that stalls the clutch goes quiet, and the drag is no longer led back."""
    served, client, headers = running
    assert "no drag" in say(client, headers, clutch=True, lead="undo").json()["error"]
    drag(served, "start", "update", "end")
    assert served.parts.teleop.view.drags == 1
    for k in range(200):
        before = target(served)["pose"].copy()
        assert say(client, headers, clutch=True, lead="undo", speed_m_s=0.2).status_code == 200
        assert np.linalg.norm((target(served)["pose"] - before)[:, :3], axis=1).max() <= 0.1 * 0.2 + 1e-9
        if k and (target(served)["pose"] == before).all():
            break
        clock_ns[0] += 20_000_000
    np.testing.assert_allclose(target(served)["pose"], POSES, atol=1e-9)
    assert served.parts.teleop.view.drags == 0


def test_one_drag_after_the_other_is_undone_while_the_clutch_stays_held(running, clock_ns):
    """What leads is said by each command; the next one after none leads back before the next drag."""
    served, client, headers = running
    say(client, headers, clutch=True)
    for _ in range(2):
        drag(served, "start", "update", "end")
    assert served.parts.teleop.view.drags == 2
    for left in (1, 0):
        while not (ended := served.parts.teleop.view.drags == left and not served.parts.teleop.view.leading):
            clock_ns[0] += 20_000_000
            assert say(client, headers, clutch=True, lead="undo", speed_m_s=0.2).status_code == 200
        assert ended
        say(client, headers, clutch=True)
        assert not served.parts.teleop.view.leading
    np.testing.assert_allclose(target(served)["pose"], POSES, atol=1e-4)


def test_a_click_on_a_gizmo_is_nothing_to_undo(running, clock_ns):
    served, client, headers = running
    say(client, headers, clutch=True)
    drag(served, "start", "update", "end", grip=POSES[0])
    assert served.parts.teleop.view.drags == 0


def test_hands_are_straightened_to_the_nearest_square_orientation(running):
    served, client, headers = running
    tilted = quaternion(np.array([0.1, -0.2, 0.15]))
    say(client, headers, **moved(left=[*POSES[0, :3], *tilted.tolist()]))
    for _ in range(200):
        say(client, headers, clutch=True, lead="straighten")
        time.sleep(0.01)
        if np.allclose(target(served)["pose"][0, 3:], [1.0, 0.0, 0.0, 0.0], atol=1e-9):
            break
    np.testing.assert_allclose(target(served)["pose"], POSES, atol=1e-9)


def test_square_orientations_stay_and_others_come_near_one():
    for turn in ([0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0], [0.0, np.pi, 0.0]):
        square = quaternion(np.array(turn))
        for off in ([0.0, 0.0, 0.0], [0.2, 0.1, -0.3]):
            assert angle_between(squared(product(quaternion(np.array(off)), square)), square) == pytest.approx(
                0.0, abs=1e-6
            )


def test_a_gizmo_has_arrows_or_rings_and_never_both(running):
    served, client, headers = running
    served.parts.scenes.server(Detail.LIGHT)
    gizmos = served.parts.scenes._made[Detail.LIGHT]._gizmos
    for handles, rings in (("turn", True), ("move", False)):
        assert say(client, headers, handles=handles).json()["handles"] == handles
        gizmos.show(served.parts.watch.measured(), served.parts.watch.command(), served.parts.watch.forces())
        for grip in [hand._grip for hand in gizmos._hands]:
            assert (grip.disable_axes, grip.disable_rotations, grip.disable_sliders) == (rings, not rings, True)


@pytest.mark.parametrize("simulated", [True, False])
def test_on_real_arms_a_clutch_is_held_for_every_motion(served, simulated, monkeypatch):
    description = replace(served.job_manager._description, simulated=simulated)
    monkeypatch.setattr(served.job_manager, "_description", description)
    with served.signed_in() as (client, headers):
        arm(client, headers)
        assert client.post("/api/jobs/demonstration", json=ORDER, headers=headers).status_code == 202
        served.job_manager.started("x.mcap")
        wait_for(lambda: served.parts.watch.view.status.job is not None)
        wait_for(lambda: served.parts.watch.view.status.job.state is JobState.RUNNING)
        answer = say(client, headers, clutch=True)
        if simulated:
            assert "no teleoperation runs" in answer.json()["error"]
            return
        assert answer.json()["held"]
        assert (target(served)["job"], target(served)["clutch_ns"] > 0) == (1, True)
        say(client, headers, clutch=False)
        assert (target(served)["clutch_ns"], target(served)["release"]) == (0, Release.RELEASED)
