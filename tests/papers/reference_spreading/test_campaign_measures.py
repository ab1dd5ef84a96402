"""What the report reads from a trial's samples, on a passage whose contacts, delays and steps are known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from hal.tracker import OBJECT_POSE
from rtstack.control.parameters import ControlParameters
from rtstack.loop.history import Columns
from rtstack.model.cell_description import base_frame
from rtstack.papers.reference_spreading.measures import measure
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, TIMING_SAMPLE, Mode

TICKS = 1500
SPEED = 0.35  # m/s
HIT, SECOND, DETECTED, POST = 500, 560, 504, 600  # ticks; nominal impact at 530
NOMINAL_S = 0.53
SIDES = (1.0, -1.0)  # y of the left and the right pad


@dataclass(frozen=True)
class Passage:
    """Samples of a grab: the right pad meets the box at HIT, the left one at SECOND."""

    columns: Columns

    def measured(self, cell, detected_s=DETECTED * 1e-3, displacement_mm=-30.0):
        return measure(self.columns, cell, "rice_box", displacement_mm, NOMINAL_S, detected_s)

    def with_control(self, change):
        control = self.columns.control.copy()
        change(control)
        return Passage(replace(self.columns, control=control))

    def with_faces(self, cell, move, height=0.0):
        """move: of the pads' distances from the middle, (2, n) m; height: of both pads, (n,) m."""
        arm = self.columns.arm.copy()
        for k, (mounting, sign) in enumerate(zip((cell.left, cell.right), SIDES, strict=True)):
            frame = base_frame(mounting)
            world = np.zeros((TICKS, 3))
            world[:, 1], world[:, 2] = sign * move[k], height
            arm[k]["O_T_EE"][:, :3, 3] = (world - frame.translation) @ frame.rotation
        return Passage(replace(self.columns, arm=arm))


def distances(half):
    """The pads' faces at constant speed up to the box, and on it from then on, pressed in by a hair."""
    t = np.arange(TICKS)
    return np.stack([half - 1e-7 + SPEED * 1e-3 * np.maximum(hit - t, 0) for hit in (SECOND, HIT)])


@pytest.fixture
def grab(cell):
    half = cell.objects["rice_box"].size[1] / 2.0
    t_ns = np.arange(TICKS) * 1_000_000
    arm, control = np.zeros((2, TICKS), ARM_SAMPLE), np.zeros((2, TICKS), CONTROL_SAMPLE)
    poses = np.zeros(TICKS // 5, OBJECT_POSE)
    poses["t_ns"] = t_ns[::5]
    poses["orientation_wxyz"] = (1.0, 0.0, 0.0, 0.0)
    for k, (mounting, sign) in enumerate(zip((cell.left, cell.right), SIDES, strict=True)):
        facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -sign], [0.0, sign, 0.0]])  # its z looks at the box
        arm[k]["t_ns"] = control[k]["t_ns"] = t_ns
        arm[k]["O_T_EE"][:, :3, :3] = base_frame(mounting).rotation.T @ facing
        arm[k]["O_T_EE"][:, 3, 3] = 1.0
    mode = control["mode"]
    mode[:] = Mode.ANTE_IMPACT
    mode[:, DETECTED:POST] = Mode.INTERIM
    mode[:, POST:] = Mode.POST_IMPACT
    return Passage(Columns(arm, control, np.zeros(TICKS, TIMING_SAMPLE), poses)).with_faces(cell, distances(half))


def test_contacts_and_the_delay_of_the_detection(grab, cell):
    seen = grab.measured(cell)
    assert seen.first_contact_s == pytest.approx(1e-3 * HIT)
    assert seen.second_contact_s == pytest.approx(1e-3 * SECOND)
    assert seen.detection_delay_ms == pytest.approx(DETECTED - HIT)


def test_a_shifted_box_is_met_where_it_is(grab, cell):
    poses = grab.columns.object.copy()
    poses["position"][:, 1] = -0.007  # 20 ticks nearer to the right pad at 0.35 m/s, and away from the left one
    shifted = Passage(replace(grab.columns, object=poses)).measured(cell)
    assert shifted.first_contact_s == pytest.approx(1e-3 * (HIT - 20))
    assert shifted.second_contact_s is None


def test_what_rises_before_the_detection_and_how_much_of_it_is_velocity(grab, cell):
    stiffness = ControlParameters().stiffness[1]

    def rise(control):
        face_y = -(cell.objects["rice_box"].size[1] / 2.0)
        control[1]["pose_ref"][:, 1] = face_y + 1e-3  # held on the box, it pushes by 1 mm of the stiffness
        control[1]["pose_ref"][:HIT, 1] = face_y
        before = np.arange(TICKS) < HIT
        control[1]["pose_ref"][before, 1] = face_y - SPEED * 1e-3 * (HIT - np.arange(TICKS)[before])
        control[1]["pose_ref"][HIT, 1] = face_y
        control[1]["wrench_desired"][HIT + 1 : DETECTED, 1] = stiffness * 1e-3 + 6.0
        control[1]["wrench_desired"][DETECTED:, 1] = 90.0  # the next mode's: no part of the delay

    seen = grab.with_control(rise).measured(cell)
    assert seen.delay_peak == pytest.approx(stiffness * 1e-3 + 6.0)
    assert seen.delay_peak_velocity_share == pytest.approx(6.0 / (stiffness * 1e-3 + 6.0), rel=1e-6)


def test_steps_are_seen_where_they_are(grab, cell):
    def jump(control):
        control[0]["wrench_desired"][DETECTED:, 0] = 3.0
        control[1]["wrench_desired"][DETECTED:, 1] = 4.0  # both arms' count: 5
        control[1]["wrench_desired"][POST:, 1] += 2.0
        control[1]["wrench_desired"][1000:, 1] += 50.0  # long after the impact

    seen = grab.with_control(jump).measured(cell)
    assert seen.step_to_interim == pytest.approx(5.0)
    assert seen.step_to_post == pytest.approx(2.0)
    assert seen.largest_step == pytest.approx(5.0)
    assert seen.largest_step_ms == pytest.approx(DETECTED - 1e3 * NOMINAL_S)
    assert seen.peak_in_window == pytest.approx(np.hypot(3.0, 6.0))


def test_a_stop_is_no_peak(grab, cell):
    def stop(control):
        control[0]["wrench_desired"][DETECTED:, 0] = 3.0
        control["wrench_desired"][:, 540:] = 400.0
        control["mode"][:, 540:] = Mode.STOPPING

    seen = grab.with_control(stop).measured(cell)
    assert seen.peak_in_window == pytest.approx(3.0)
    assert seen.largest_step == pytest.approx(3.0)


def test_settled_is_when_the_object_no_longer_slips(grab, cell):
    on_box = distances(cell.objects["rice_box"].size[1] / 2.0)
    rise = 1e-4 * np.clip(np.arange(TICKS) - HIT, 0, 120)  # 12 mm, and the box stays where it is
    slipped = grab.with_faces(cell, on_box, rise).measured(cell)
    assert slipped.settled_ms == pytest.approx(109)  # the last millimetre is within what counts as none
    assert slipped.slip_mm == pytest.approx(12.0)
    still = grab.with_faces(cell, on_box).measured(cell)
    assert (still.settled_ms, still.slip_mm) == (0.0, 0.0)


def test_a_slip_that_goes_on_has_no_time(grab, cell):
    rise = 1e-4 * np.maximum(np.arange(TICKS) - HIT, 0)
    on = grab.with_faces(cell, distances(cell.objects["rice_box"].size[1] / 2.0), rise).measured(cell)
    assert on.settled_ms is None
    assert on.slip_mm == pytest.approx(50.0)


def test_contact_is_lost_where_a_pad_that_felt_the_box_feels_it_no_more(grab, cell):
    def felt(left, right):
        arm = grab.columns.arm.copy()
        arm["O_F_ext_hat_K"][:, :, 0] = 2.0  # an offset of the estimate
        for k, (begin, gaps) in enumerate((left, right)):
            arm[k]["O_F_ext_hat_K"][begin:, 1] = 20.0
            for from_tick, to_tick in gaps:
                arm[k]["O_F_ext_hat_K"][from_tick:to_tick, 1] = 3.0
        return Passage(replace(grab.columns, arm=arm)).measured(cell).lost_ms

    assert felt((SECOND, []), (HIT, [])) == 0.0
    assert felt((SECOND, []), (HIT, [(520, 540)])) == 0.0  # before the other pad is there
    assert felt((SECOND, [(600, 630)]), (HIT, [(620, 640)])) == pytest.approx(30.0, rel=0.01)
    assert felt((TICKS, []), (HIT, [])) is None


def test_the_other_robot_and_the_posture_are_measured_too(grab, cell):
    def jump(control):
        control[0]["wrench_desired"][DETECTED:, 0] = 3.0
        control[1]["wrench_desired"][DETECTED:, 1] = 4.0
        control[0]["beta"][:] = 7.0
        control[1]["beta"][:] = -2.0
        control[1]["beta"][1000:] = 50.0  # long after the impact

    seen = grab.with_control(jump).measured(cell)  # at -30 mm the right arm is hit first
    assert seen.largest_step_other == pytest.approx(3.0)
    assert seen.posture_peak == pytest.approx(2.0)


def test_the_swing_is_of_the_pad_that_was_hit(grab, cell):
    t = np.arange(TICKS)
    swinging = distances(cell.objects["rice_box"].size[1] / 2.0)
    amplitude = 0.1  # m/s, at 10 Hz
    swinging[1] += np.where(t >= 530, amplitude / (20 * np.pi) * np.sin(20 * np.pi * 1e-3 * (t - 530)), 0.0)
    passage = grab.with_faces(cell, swinging)
    assert passage.measured(cell).swing_m_s == pytest.approx(2 * amplitude, rel=0.01)
    assert passage.measured(cell, displacement_mm=30.0).swing_m_s == pytest.approx(SPEED, rel=0.01)  # the left one's


def test_of_a_trial_without_contact_and_detection_what_there_is(grab, cell):
    away = grab.with_faces(cell, np.full((2, TICKS), 0.4)).measured(cell, detected_s=None)
    assert away.first_contact_s is None
    assert away.detection_delay_ms is None
    assert away.delay_peak is None
    assert away.settled_ms is None
    assert away.peak_in_window == 0.0


def test_a_tilted_pad_meets_the_box_with_its_corner(grab, cell):
    arm = grab.columns.arm.copy()
    tilt = 0.07
    about_z = np.array([[np.cos(tilt), -np.sin(tilt), 0.0], [np.sin(tilt), np.cos(tilt), 0.0], [0.0, 0.0, 1.0]])
    base = base_frame(cell.right).rotation
    arm[1]["O_T_EE"][:, :3, :3] = base.T @ about_z @ base @ arm[1]["O_T_EE"][:, :3, :3]
    seen = Passage(replace(grab.columns, arm=arm)).measured(cell)
    earlier_s = np.sin(tilt) * cell.pad.size[0] / 2.0 / SPEED
    assert seen.first_contact_s == pytest.approx(1e-3 * HIT - earlier_s, abs=1e-3)
