"""Scripted faults: each kind seen through the robot's own state, and files that are wrong."""

import contextlib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.base.configuration import ConfigurationError
from hal.errors import CommandRejected, RecoveryRefused
from hal.robot_errors import ROBOT_ERRORS, error_names
from hal.state import ArmState, RobotMode
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.faults.file import FaultNeedsLink, faults_in, load_faults
from sim_robot.faults.kinds import KINDS
from sim_robot.scene import load_scene
from tests.support.plant_object import object_pose
from tests.support.spring_grip import SpringGrip

STIFFNESS, DAMPING = np.array([200.0] * 4 + [50.0] * 3), np.array([20.0] * 4 + [3.0] * 3)
HOMES = (load_scene().left.home, load_scene().right.home)


def faulty_cell(*tables: dict, seed: int = 5) -> SimulatedCell:
    return simulated_cell("rice_box", 0.0, seed, faults=faults_in({"fault": list(tables)}, "script"))


def hold(cell: SimulatedCell, milliseconds: int) -> np.ndarray:
    """Hold both arms by a joint impedance; return what they report, (n, 2), dtype ARM_STATE."""
    seen = []
    for _ in range(milliseconds):
        seen.append([hold_one(cell, 0).record[0].copy(), hold_one(cell, 1).record[0].copy()])
    return np.array(seen)


def hold_one(cell: SimulatedCell, side: int) -> ArmState:
    arm = (cell.left, cell.right)[side]
    state = arm.read()
    arm.write(STIFFNESS * (HOMES[side] - state.q) - DAMPING * state.record["dq"][0])
    return state


def carry_on(cell: SimulatedCell, milliseconds: int) -> np.ndarray:
    """Hold what can be held; return both states as they are, whether or not they can be read, (n, 2)."""
    seen = []
    for _ in range(milliseconds):
        for side in range(2):
            with contextlib.suppress(CommandRejected):
                hold_one(cell, side)
        seen.append(cell.states.copy())
    return np.array(seen)


def at(kind: str, at_s: float = 0.1, arm: str = "left", **more) -> dict:
    table = {"kind": kind, "at_s": at_s, **more}
    return table | {"arm": arm} if KINDS[kind].of_an_arm else table


def test_a_push_is_felt_while_it_lasts() -> None:
    wrench = hold(faulty_cell(at("push", duration_s=0.2, force_N=[6.0, 0.0, -3.0])), 500)["O_F_ext_hat_K"]
    assert wrench[200:300, 0, :3].mean(axis=0) == pytest.approx([-6.0, 0.0, 3.0], abs=0.5)
    assert np.abs(wrench[:101, 0, :3]).max() < 1.0  # state 100 ends the ms before the push
    assert np.abs(wrench[102, 0, 0]) > np.abs(wrench[:101, 0, 0]).max()
    assert np.abs(wrench[400:, 0, :3].mean(axis=0)).max() < 0.2
    assert np.abs(wrench[:, 1, :3]).max() < 1.0


def test_a_push_on_a_joint_is_felt_there() -> None:
    torque = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, -1.0]
    states = hold(faulty_cell(at("joint_push", arm="right", torque_Nm=torque)), 400)
    assert states["tau_ext_hat_filtered"][250:, 1].mean(axis=0) == pytest.approx(-np.array(torque), abs=0.1)
    assert np.abs(states["tau_ext_hat_filtered"][250:, 0].mean(axis=0)).max() < 0.1
    assert states["q"][-1, 1, 2] > states["q"][99, 1, 2] + 5e-3  # it gives way


def test_pushes_add_up() -> None:
    both = [at("push", arm="both", force_N=[2.0, 0.0, 0.0]), at("push", arm="right", force_N=[3.0, 0.0, 0.0])]
    wrench = hold(faulty_cell(*both), 400)["O_F_ext_hat_K"][250:, :, 0].mean(axis=0)
    assert wrench == pytest.approx([-2.0, -5.0], abs=0.4)


def test_a_base_that_is_shaken_has_no_gravity_to_go_by() -> None:
    cell = faulty_cell(at("base_shaken", duration_s=0.2, acceleration=[0.0, 3.0, 0.0]))
    errors = carry_on(cell, 200)["current_errors"]
    assert error_names(int(errors[99, 0])) == ()
    assert error_names(int(errors[-1, 0])) == ("base_acceleration_invalid_reading",)
    assert errors[-1, 1] == 0
    with pytest.raises(RecoveryRefused, match="base_acceleration_initialization_timeout"):
        cell.left.recover()
    carry_on(cell, 200)
    cell.left.recover()
    assert cell.left.read().current_errors == 0


def test_more_friction_makes_a_joint_slower() -> None:
    speeds = []
    for factor in (1.0, 3.0):
        cell = faulty_cell(at("friction_change", at_s=0.0, arm="left", friction_factor=factor))
        for _ in range(300):
            cell.left.write(np.array([1.0, 0, 0, 0, 0, 0, 0]))
            speed = cell.left.read().record["dq"][0, 0]
        speeds.append(speed)
    assert speeds[1] < 0.7 * speeds[0]


def test_a_sensor_that_is_off_shows_a_torque_that_is_not_there() -> None:
    bias = np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    states = hold(faulty_cell(at("tau_sensor_bias", duration_s=0.3, bias_Nm=bias.tolist())), 700)
    tau_ext, tau = states["tau_ext_hat_filtered"][:, 0], states["tau_J"][:, 0]
    assert tau_ext[200:400].mean(axis=0) == pytest.approx(bias, abs=0.1)
    assert tau[101, 1] - tau[100, 1] == pytest.approx(1.5, abs=0.3)
    # the torque loop believes the sensor: the arm moves although nothing pushes, and comes back
    assert np.abs(states["q"][390, 0, 1] - states["q"][99, 0, 1]) > 1e-3
    assert np.abs(tau_ext[550:].mean(axis=0)).max() < 0.1
    assert states["q"][-1, 0, 1] == pytest.approx(states["q"][99, 0, 1], abs=1e-3)


def test_a_pad_that_slips_lets_the_box_fall() -> None:
    slippery = {"kind": "slip", "arm": "both", "when": "first_contact", "delay_s": 2.0, "friction_factor": 0.05}
    cell = faulty_cell(slippery, seed=3)
    height = SpringGrip(cell, press_n=35.0).run(3.6)[:, 2]
    assert height.max() > height[0] + 0.01
    assert height[-1] == pytest.approx(height[0], abs=2e-3)


def test_an_object_that_is_lost_presses_no_more_and_is_seen_no_more() -> None:
    cell = faulty_cell({"kind": "object_lost", "when": "first_contact", "delay_s": 0.4}, seed=3)
    grip = SpringGrip(cell, press_n=20.0)
    positions = grip.run(1.6)
    lost = int(np.argmax(positions[:, 0] > 1.0))
    assert 1400 < lost < 1500
    assert np.linalg.norm(cell.states["O_F_ext_hat_K"][:, :3], axis=1).max() < 3.0
    seen = cell.tracker.latest()
    assert abs(seen.t_ns - 1e6 * lost) < 6e6
    assert abs(seen.position[0]) < 0.05


def test_an_empty_cell_has_no_object_from_the_start_nor_after_somebody_has_tidied_up() -> None:
    cell = simulated_cell("none", 0.0, 3, faults=faults_in({"fault": [at("push", force_N=[0.0, 9.0, 0.0])]}, "script"))
    for _ in range(2):
        cell.plant.put_object_back()
        hold(cell, 150)
        assert not cell.tracker.latest().record["seen"][0]
        assert object_pose(cell.plant)[0][0] > 1.0


def test_an_object_weighs_what_the_script_says() -> None:
    cell = faulty_cell({"kind": "object_mass", "mass_factor": 3.0, "at_s": 0.05, "duration_s": 0.3})
    carried = []
    for _ in range(3):
        hold(cell, 200)
        carried.append(cell.plant.data.qfrc_constraint[16])
    weight = 1.25 * 9.81
    assert carried == pytest.approx([3.0 * weight, weight, weight], rel=0.02)


@pytest.mark.parametrize("tilt_deg", [15.0, -15.0])
def test_a_tilted_object_stands_on_its_wedge(tilt_deg: float) -> None:
    cell = faulty_cell({"kind": "object_tilted", "tilt_deg": tilt_deg})
    begin = object_pose(cell.plant)
    hold(cell, 1000)
    position, (w, x, y, z) = object_pose(cell.plant)
    assert np.degrees(2.0 * np.arctan2(x, w)) == pytest.approx(tilt_deg, abs=0.3)
    assert np.hypot(y, z) < 5e-3
    assert position == pytest.approx(begin[0], abs=2e-3)


def test_the_first_contact_sets_the_time() -> None:
    """The same script at another distance of the box acts later, by as much as the contact comes later."""
    times = []
    for displacement in (0.0, -0.03):
        script = faults_in({"fault": [{"kind": "object_lost", "when": "first_contact", "delay_s": 0.05}]}, "script")
        cell = simulated_cell("rice_box", displacement, 3, faults=script)
        grip, first = SpringGrip(cell, press_n=20.0), None
        for tick in range(1500):
            grip.run(1e-3)
            touching = np.linalg.norm(cell.states["O_F_ext_hat_K"][:, :3], axis=1).max() > 2.0
            first = tick if first is None and touching else first
            if object_pose(cell.plant)[0][0] > 1.0:
                break
        assert first is not None
        times.append((first, tick))
    for first, tick in times:
        assert 40 <= tick - first <= 52
    assert times[0] != times[1]


def test_a_reflex_stops_the_arm_and_lasts() -> None:
    cell = faulty_cell(at("reflex", duration_s=0.2, error="power_limit_violation"))
    with pytest.raises(CommandRejected, match="left arm in reflex: power_limit_violation"):
        hold(cell, 200)
    assert cell.plant.ticks == 101  # the state after the ms in which it began
    assert cell.states["robot_mode"].tolist() == [RobotMode.REFLEX, RobotMode.MOVE]
    with pytest.raises(RecoveryRefused, match="power_limit_violation"):
        cell.left.recover()
    states = carry_on(cell, 200)
    assert (states["robot_mode"] == (RobotMode.REFLEX, RobotMode.MOVE)).all()
    cell.left.recover()
    assert hold(cell, 50)["robot_mode"][-1].tolist() == [RobotMode.MOVE, RobotMode.MOVE]


def test_a_user_stop_refuses_everything_until_it_is_released() -> None:
    cell = faulty_cell(at("user_stop", arm="right", duration_s=0.1))
    with pytest.raises(CommandRejected, match="right arm: user stop pressed"):
        hold(cell, 200)
    assert cell.plant.ticks == 101
    for refused in (cell.right.read, lambda: cell.right.write(np.zeros(7))):
        with pytest.raises(CommandRejected, match="user stop"):
            refused()
    with pytest.raises(RecoveryRefused, match="release"):
        cell.right.recover()
    cell.right.stop()
    pressed = carry_on(cell, 98)  # one ms has gone by with the refused read
    assert (pressed["robot_mode"] == (RobotMode.MOVE, RobotMode.USER_STOPPED)).all()
    assert np.abs(pressed["dq"][50:, 1]).max() < 0.01
    released = carry_on(cell, 3)
    assert released["robot_mode"][:, 1].tolist() == [RobotMode.IDLE, RobotMode.MOVE, RobotMode.MOVE]


def test_a_user_stop_leaves_a_reflex_latched() -> None:
    cell = faulty_cell(at("reflex", error="joint_reflex"), at("user_stop", at_s=0.11, duration_s=0.05))
    modes = carry_on(cell, 200)["robot_mode"][:, 0].tolist()
    expected = [RobotMode.IDLE] + [RobotMode.MOVE] * 100 + [RobotMode.REFLEX] * 10
    assert modes == expected + [RobotMode.USER_STOPPED] * 50 + [RobotMode.REFLEX] * 39


def test_a_frozen_state_repeats_itself_under_rising_time() -> None:
    states = hold(faulty_cell(at("state_frozen", duration_s=0.05)), 300)[:, 0]
    frozen = states[101:151]
    assert np.array_equal(np.diff(states["t_ns"]), np.full(299, 1_000_000))
    assert len(np.unique(frozen["dq"], axis=0)) == 1
    assert len(np.unique(states["dq"], axis=0)) == 300 - 49


def test_a_state_shows_what_is_no_number_and_the_plant_goes_on() -> None:
    states = hold(faulty_cell(at("state_nan", duration_s=0.005, field="dtau_J")), 200)[:, 0]
    assert np.isnan(states["dtau_J"][101:106]).all()
    assert np.isfinite(np.delete(states["dtau_J"], np.s_[101:106], axis=0)).all()
    assert np.isfinite(states["q"]).all()


def test_a_clock_that_is_set_back_goes_on_from_there() -> None:
    t_ns = hold(faulty_cell(at("time_back", duration_s=0.005, back_ms=7.0)), 200)[:, 0]["t_ns"]
    assert np.array_equal(np.diff(t_ns)[99:107], [1e6, -6e6, *[1e6] * 4, 8e6, 1e6])


def poses(cell: SimulatedCell, milliseconds: int) -> np.ndarray:
    seen = []
    for _ in range(milliseconds):
        hold(cell, 1)
        seen.append(cell.tracker.latest().record[0].copy())
    return np.array(seen)


def test_a_blind_tracker_has_no_new_frames() -> None:
    seen = poses(faulty_cell(at("tracker_lost", duration_s=0.1)), 300)
    assert len(np.unique(seen["t_ns"])) == len(np.unique(seen["position"], axis=0)) == 75 - 25
    assert seen["seen"].all()
    gap = np.diff(seen["t_ns"]).max()
    assert gap == 104_000_000


def test_a_frozen_tracker_repeats_its_pose_at_new_times() -> None:
    seen = poses(faulty_cell(at("tracker_frozen", duration_s=0.1)), 300)
    assert len(np.unique(seen["t_ns"])) == 75
    assert len(np.unique(seen["position"], axis=0)) == 75 - 25


def test_nothing_changes_before_a_fault_and_without_one() -> None:
    plain, none = hold(simulated_cell("rice_box", 0.0, 5), 150), hold(faulty_cell(), 150)
    assert plain.tobytes() == none.tobytes()
    every = [
        at("push", force_N=[9.0, 0.0, 0.0]), at("slip", friction_factor=0.1), at("object_lost"), at("tracker_lost"),
        at("friction_change", friction_factor=2.0), at("tau_sensor_bias", bias_Nm=[1.0] * 7), at("state_frozen"),
        at("object_mass", mass_factor=3.0),
    ]  # fmt: skip
    faulty = hold(faulty_cell(*every), 150)
    assert plain[:101].tobytes() == faulty[:101].tobytes()
    assert plain[:103].tobytes() != faulty[:103].tobytes()


def test_the_link_is_not_in_this_process() -> None:
    tables = [at("stall", stall_ms=5.0), at("states_lost"), at("push", force_N=[0.0, 0.0, 1.0])]
    with pytest.raises(FaultNeedsLink, match=r"\(stall, states_lost\) need the robot behind its interface"):
        faulty_cell(*tables)


forces = st.tuples(*[st.floats(-30.0, 30.0)] * 3).map(list)
torques = st.tuples(*[st.floats(-3.0, 3.0)] * 7).map(list)
factors = st.floats(0.0, 5.0)
OWN = {
    "push": {"force_N": forces},
    "joint_push": {"torque_Nm": torques},
    "slip": {"friction_factor": factors},
    "object_lost": {},
    "object_mass": {"mass_factor": st.floats(0.1, 10.0)},
    "friction_change": {"friction_factor": factors},
    "tau_sensor_bias": {"bias_Nm": torques},
}


@st.composite
def plant_faults(draw: st.DrawFn) -> dict:
    kind = draw(st.sampled_from(sorted(OWN)))
    table = at(kind, draw(st.floats(0.0, 0.06)), draw(st.sampled_from(["left", "right", "both"])))
    if KINDS[kind].lasts and draw(st.booleans()):
        table["duration_s"] = draw(st.floats(1e-3, 0.05))
    return table | {key: draw(values) for key, values in OWN[kind].items()}


@settings(max_examples=15)
@given(st.lists(plant_faults(), max_size=4))
def test_any_script_gives_the_same_run_again(tables: list[dict]) -> None:
    def run() -> bytes:
        cell, seen = faulty_cell(*tables), []
        for _ in range(80):
            try:
                seen.append(hold(cell, 1).tobytes())
            except CommandRejected as error:
                seen.append(str(error).encode())
            seen.append(cell.tracker.latest().record.tobytes())
        return b"".join(seen)

    assert run() == run()


names = st.sampled_from([*KINDS, "fault", "arm", "at_s", "when", "delay_s", "duration_s", "error", "force_N", "left"])
scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.integers(-(10**320), 10**320), st.floats(), st.text(), names,
    st.dates(), st.sampled_from(ROBOT_ERRORS), st.just("first_contact"),
)  # fmt: skip
values = st.recursive(
    scalars, lambda inner: st.one_of(st.lists(inner, max_size=7), st.dictionaries(names, inner, max_size=5))
)
keys = ["kind", "arm", "at_s", "when", "delay_s", "duration_s", "force_N", "torque_Nm", "friction_factor", "error"]
optional = dict.fromkeys(keys[1:], values)
tables = st.fixed_dictionaries({"kind": st.one_of(names, values)}, optional=optional)


def complaint(load: Callable[[], object]) -> str:
    """What is wrong, or nothing. Any other exception is a failure."""
    try:
        load()
    except ConfigurationError as error:
        return str(error)
    return ""


@given(st.one_of(st.dictionaries(names, values), st.fixed_dictionaries({"fault": st.lists(tables, max_size=3)})))
def test_random_values_are_taken_or_refused_in_one_line(document: dict) -> None:
    said = complaint(lambda: faults_in(document, "script.toml"))
    assert said.startswith("script.toml") or not said
    assert "\n" not in said


@given(st.binary(max_size=60))
def test_random_bytes_are_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("faults") / "script.toml"
    path.write_bytes(data)
    said = complaint(lambda: load_faults(path))
    assert str(path) in said or not said  # comments and blanks are good
    assert "\n" not in said


GOOD = '[[fault]]\nkind = "push"\narm = "left"\nat_s = 1\nforce_N = [1, 2, 3]\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD + '[[fault]]\nkind = "shove"\n', r":7: fault 2: unknown kind 'shove'; choose one of push, "),
        (GOOD.replace("force_N", "force"), r":5: fault 1 \(push\): unknown key 'force'; its keys are kind, .*force_N"),
        (GOOD.replace("[1, 2, 3]", "[1, 2]"), r":5: fault 1 \(push\): key force_N.2: Field required"),
        (GOOD.replace("[1, 2, 3]", "[1, 2, 2e3]"), r":5: .*key force_N.2: Input should be less than or equal to 1000"),
        (GOOD.replace("[1, 2, 3]", "[1, 2, nan]"), r":5: .*force_N\.2: Input should be a finite number"),
        (GOOD.replace("at_s = 1", "at_s = 0x" + 9000 * "f"), r":1: fault 1 \(push\): "),
        (GOOD.replace("[1, 2, 3]", "[0x" + 9000 * "f" + ", 2, 3]"), r":5: .*found a number of"),
        (GOOD.replace("at_s = 1", ""), r":1: .*no moment: add at_s"),
        (GOOD.replace("at_s = 1", "at_s = -1"), r":4: .*at_s must be a number of seconds from 0"),
        (GOOD.replace("at_s = 1", "at_s = 1\ndelay_s = 2"), r":5: .*at_s and delay_s together"),
        (GOOD.replace("at_s = 1", 'when = "soon"'), r":4: .*say \"first_contact\""),
        (GOOD.replace('"left"', '"middle"'), r":3: .*arm cannot be 'middle'; say left, right or both"),
        (GOOD + "duration_s = 0", r":6: .*duration_s must be a number of seconds from 0.001"),
        ('[[fault]]\nkind = "stall"\nat_s = 1\nstall_ms = 5\narm = "left"', r":5: .*unknown key 'arm'"),
        ('[[fault]]\nkind = "reflex"\nat_s = 1\narm = "left"\nerror = "boom"', r":5: .*none of the vendor's"),
        ('[[fault]]\nkind = "reflex"\nat_s = 1\narm = "left"', r"key error: Field required"),
        ("fault = 3", r"write \[\[fault\]\]"),
        ("[faults]", r"unknown key 'faults'; each fault is a \[\[fault\]\] table"),
        ("[[fault]", r"not valid TOML"),
    ],
)
def test_a_wrong_file_is_one_line_with_the_place_and_the_remedy(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "script.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=f"script.toml{said}" if said.startswith(":") else said) as caught:
        load_faults(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "count"), [("push_during_grab", 2), ("robot_stops", 3)])
def test_the_examples_are_good(name: str, count: int) -> None:
    path = Path(str(files("sim_robot") / "faults" / f"{name}.toml"))
    assert len(load_faults(path)) == count
