"""Cells that were built otherwise than their file says, found from noisy points; wrong points are named.

`python -m tests.studies wrong_cells` does the same for 200 cells.
"""

import re
import socket
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hal.tracker import TrackerFrames
from hal.tracker_link import DATAGRAM, TrackerLink
from rtstack.calibration.fit import CalibrationError, SidesSwapped, calibrate
from rtstack.calibration.payload import payload
from rtstack.calibration.points import Point, changes, nominal_geometry, observations, outcome
from rtstack.cells import load_description
from rtstack.model.arm_model import ArmModel, build_model
from rtstack.model.tracker_description import TrackedBody
from rtstack.trials.errors import TrialError
from tests.support.wrong_cell import (
    SWAPS,
    Wrongness,
    accuracy,
    built,
    exchanged,
    measured,
    off,
    touched_points,
    with_bad_point,
)

CELL = load_description(None)[0]
FILE = nominal_geometry(CELL)


def a_wrong_cell(seed: int, how: Wrongness | None = None, tracked: bool = False, poses: int = 12):
    rng, how = np.random.default_rng(seed), how or Wrongness()
    real = built(CELL, rng, how)
    return real, measured(CELL, real, rng, how, poses, tracked), rng


@pytest.mark.parametrize("side", CELL.sides)
def test_one_arm_alone_is_calibrated_with_a_tracker_and_its_marker(side):
    cell = replace(CELL.only((side,)), simulated=False)
    rng, how = np.random.default_rng(6), Wrongness(noise_m=2e-4)
    real = built(cell, rng, how)
    points = measured(cell, real, rng, how)
    fit = calibrate(points, nominal_geometry(cell))
    assert set(fit.groups) == {f"{side} base", f"{side} pad", f"{side} marker", "tracker"}
    assert fit.geometry.bases.shape == (1, 4, 4)
    assert off(fit.geometry, real, points)[2] < 1.5e-3
    tables = {key[0] for key in changes(fit, {}, cell, date(2026, 11, 23))}
    assert tables == {side, "tracker", "calibration"}


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (Point("meet"), "pads: two pads cannot meet, grab has one arm, right: remove the point"),
        (Point("touch", "left", (0.0, 0.0, 0.3)), "pads: grab has no left arm, it has one arm, right"),
    ],
)
def test_a_point_of_an_arm_that_is_not_there_is_refused(point, words):
    cell = CELL.only(("right",))
    points = touched_points(cell, nominal_geometry(cell), 0.0)
    with pytest.raises(TrialError, match=words):
        outcome({**points, "pads": point}, cell, date.today())


@pytest.mark.parametrize(
    "tracked", [False, pytest.param(True, marks=pytest.mark.long)], ids=["touched", "with markers"]
)
def test_twelve_noisy_poses_find_the_bases_and_what_is_stated_covers_the_truth(tracked):
    found = [accuracy(seed, Wrongness(), tracked) for seed in range(10)]
    median, mean = ({key: of([each[key] for each in found]) for key in found[0]} for of in (np.median, np.mean))
    assert median["base_m"] < 1e-3
    assert np.degrees(median["base_rad"]) < 0.2
    assert mean["covered"] >= 0.8  # of 10 cells; 200 of them are the study's
    assert mean["spread"] >= 0.8
    assert mean["none_wrong"] >= 0.9


def test_points_without_noise_give_the_truth():
    real, points, _ = a_wrong_cell(1, Wrongness(noise_m=0.0, pad_m=0.0), tracked=True)
    fit = calibrate(points, FILE)
    base, turn, place = off(fit.geometry, real, points)
    assert max(base.max(), turn.max(), place) < 1e-8


@pytest.mark.parametrize("swap", SWAPS)
@pytest.mark.parametrize("seed", range(4))
def test_swapped_sides_are_named(swap, seed):
    _, points, _ = a_wrong_cell(seed)
    with pytest.raises(SidesSwapped, match="the sides are swapped"):
        calibrate(exchanged(points, swap), FILE)


@pytest.mark.parametrize("seed", range(8))
def test_a_bad_point_is_named_and_left_out(seed):
    real, points, rng = a_wrong_cell(seed)
    wrong, name = with_bad_point(points, rng)
    fit = calibrate(wrong, FILE)
    assert list(fit.wrong) == [name]
    assert name not in fit.residuals
    assert off(fit.geometry, real, points)[2] < 2.5e-3


def test_pads_that_meet_tell_where_an_arm_is_that_touches_no_gauge():
    how = Wrongness(noise_m=0.0, pad_m=0.0, base_m=0.02, base_rad=0.03)
    real, points, _ = a_wrong_cell(3, how)
    left = [point for point in points if point.side == 0]
    # the right flange stands where both pads' faces are at one place, turned as it was
    turned = np.linalg.inv(real.bases[1])
    meetings = []
    for number, point in enumerate(point for point in points if point.side == 1):
        place = real.pads(point.flanges[None])[0, 0]
        flange = point.flanges[1].copy()
        face = flange[:3, :3] @ real.faces[1]
        flange[:3, 3] = turned[:3, :3] @ place + turned[:3, 3] - face
        flanges = np.array([point.flanges[0], flange])
        meetings.append(replace(point, name=f"meet {number}", what="meet", flanges=flanges))
    base, turn, _ = off(calibrate([*left, *meetings], FILE).geometry, real, left)
    assert (base.max(), turn.max()) < (1e-7, 1e-7)


def test_points_that_say_too_little_are_refused():
    _, points, _ = a_wrong_cell(0)
    with pytest.raises(CalibrationError, match=r"2 points are too few for left base, right base"):
        calibrate(points[:2], FILE)
    with pytest.raises(CalibrationError, match=r"do not say where the (left|right) (base|marker)|too few"):
        calibrate([replace(point, what="see") for point in points], FILE)
    one = [replace(point, flanges=points[0].flanges, place=points[0].place) for point in points if point.side == 0]
    with pytest.raises(CalibrationError, match="the points do not say where the left base is"):
        calibrate(one, FILE)
    mixed = [replace(point, place=points[k - 5].place) for k, point in enumerate(points)]
    with pytest.raises(CalibrationError):
        calibrate(mixed, FILE)


def test_what_is_written_is_what_was_found():
    real, points, _ = a_wrong_cell(5, tracked=True)
    fit = calibrate(points, FILE)
    values = changes(fit, {}, CELL, date(2026, 11, 23))
    assert values["left", "base_position"] == pytest.approx(real.bases[0][:3, 3].tolist(), abs=3e-3)
    assert values["tracker", "position"] == pytest.approx(real.tracker[:3, 3].tolist(), abs=5e-3)
    assert values["calibration", "rms_mm"] == pytest.approx(1e3 * fit.rms_m, abs=0.01)
    assert values["calibration", "points"] == 48
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", str(values["calibration", "date"]))


@pytest.mark.parametrize("up", ["z", "y"])
def test_the_tracker_and_its_body_in_an_object_are_found_in_the_trackers_own_axes(up):
    rng, points = np.random.default_rng(4), dict[str, Point]()
    real = built(CELL, rng, Wrongness(pad_m=0.0))
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) if up == "y" else np.eye(3)
    own = np.linalg.inv(real.tracker)
    points |= touched_points(CELL, real, 0.0)
    for seen in observations(points, CELL):
        marker = replace(real, faces=real.markers).pads(seen.flanges[None])[0, seen.side]
        place = axes.T @ (own[:3, :3] @ marker + own[:3, 3])
        points[f"see {seen.name}"] = replace(points[seen.name], what="see", place=tuple(place.tolist()))
    in_body, pivot = Rotation.from_euler("z", 90.0, degrees=True), np.array([0.06, -0.03, 0.09])
    middle = np.array([0.0, 0.0, CELL.table.top_z + CELL.objects["rice_box"].size[2] / 2.0])
    body = middle - in_body.inv().apply(pivot)
    place = axes.T @ (own[:3, :3] @ body + own[:3, 3])
    points["stand"] = Point("stand", place=tuple(place.tolist()), object="rice_box")
    with pytest.raises(TrialError, match=r"no \[tracker.bodies.rice_box\]"):
        outcome(points, CELL, date.today())
    w, x, y, z = in_body.as_quat(scalar_first=True).tolist()
    follows = replace(CELL.tracker, up=up, bodies={"rice_box": TrackedBody(1, orientation_wxyz=(w, x, y, z))})
    values = outcome(points, replace(CELL, tracker=follows), date.today()).values
    assert values["tracker", "position"] == pytest.approx(real.tracker[:3, 3].tolist(), abs=2e-5)
    assert values["tracker", "bodies", "rice_box", "position"] == pytest.approx(pivot.tolist(), abs=5e-5)
    frames = TrackerFrames(
        up, values["tracker", "position"], values["tracker", "orientation_wxyz"],
        values["tracker", "bodies", "rice_box", "position"], (w, x, y, z),
    )  # fmt: skip
    link, datagram = TrackerLink(frames=frames), np.zeros(1, DATAGRAM)
    datagram["t_ns"], datagram["seen"], datagram["position"] = 1, 1, place
    turn = Rotation.from_matrix((real.tracker[:3, :3] @ axes).T) * in_body.inv()
    datagram["orientation_wxyz"] = turn.as_quat(scalar_first=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(datagram.tobytes(), link.address)
        assert link.latest().position == pytest.approx(middle.tolist(), abs=1e-4)
        assert np.abs(link.latest().orientation_wxyz[0]) == pytest.approx(1.0, abs=1e-6)
    link.close()


def test_a_payload_is_found_from_torques_at_rest_beside_an_offset_of_each_joint():
    rng = np.random.default_rng(0)
    pad, mounting = CELL.pad, CELL.left
    heavy = replace(pad, mass=0.55, flange_to_face=0.05)
    model, real = ArmModel(mounting, pad), ArmModel(mounting, heavy)
    q = np.array(mounting.home) + rng.uniform(-0.6, 0.6, (8, 7))
    tau = []
    for row in q:
        model.update(row, np.zeros(7))
        real.update(row, np.zeros(7))
        tau.append(real.g - model.g + rng.normal(0.0, 0.02, 7))
    told = (pad.mass, np.array([0.0, 0.0, pad.flange_to_face - pad.size[2] / 2]))
    found = payload(build_model(mounting, pad), told, q, np.array(tau) + rng.normal(0.0, 0.3, 7))
    assert abs(found.mass - 0.55) < found.mass_half < 0.05
    assert np.all(np.abs(found.centre - [0.0, 0.0, 0.035]) < found.centre_half)
    with pytest.raises(CalibrationError, match="3 postures at rest, not 2"):
        payload(build_model(mounting, pad), told, q[:2], np.array(tau[:2]))
    with pytest.raises(CalibrationError, match="too much alike"):
        payload(build_model(mounting, pad), told, np.tile(q[0], (4, 1)), np.array(tau[:4]))
