"""Robot models: ours against the vendor's numbers, one of a user's, and what is refused."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from hal.robots import FER, FR3, ROBOTS, RobotError, RobotModel, read_robot, robot
from tests.support.robot_files import SHORTER, with_key, write_robot


def test_ours_are_registered_as_any_package_s_are() -> None:
    assert {"fr3", "fer"} <= set(ROBOTS.names())
    assert robot() is robot("fr3") is FR3
    assert robot("fer") is FER


def test_an_unknown_model_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(RobotError, match=r"unknown robot model 'ur5': choose one of fer, fr3, or the path of a TOML$"):
        robot("ur5")


@pytest.mark.parametrize("model", [FR3, FER])
def test_the_urdf_has_the_limits_of_the_table(model: RobotModel) -> None:
    found = pin.buildModelFromXML(model.urdf)
    np.testing.assert_array_equal(found.lowerPositionLimit, model.limits.q_lower)
    np.testing.assert_array_equal(found.upperPositionLimit, model.limits.q_upper)
    np.testing.assert_array_equal(found.velocityLimit, model.limits.dq_max)
    np.testing.assert_array_equal(found.effortLimit, model.limits.tau_max)
    laws = [law.attrib for law in ElementTree.fromstring(model.urdf).iter("position_based_velocity_limits")]
    offset, deceleration = model.limits.enforced_velocity_law()
    np.testing.assert_array_equal([float(law["velocity_offset"]) for law in laws], offset)
    np.testing.assert_array_equal([float(law["deceleration_limit"]) for law in laws], deceleration)


def test_the_fer_s_arm_reaches_where_the_vendor_says() -> None:
    """The vendor's Denavit-Hartenberg table (Craig's convention), the flange 0.107 m beyond joint 7, at some pose."""
    table = ((0, 0.333, 0), (0, 0, -1), (0, 0.316, 1), (0.0825, 0, 1), (-0.0825, 0.384, -1), (0, 0, 1), (0.088, 0, 1))
    q = np.array([0.3, -0.4, 0.5, -1.9, 0.7, 1.8, -0.6])
    expected = pin.SE3.Identity()
    for (a, d, quarter), angle in zip(table, q, strict=True):
        expected = expected * pin.SE3(pin.rpy.rpyToMatrix(quarter * np.pi / 2, 0, 0), np.array([a, 0.0, 0.0]))
        expected = expected * pin.SE3(pin.rpy.rpyToMatrix(0, 0, angle), np.array([0.0, 0.0, d]))
    expected = expected * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.107]))
    model = pin.buildModelFromXML(FER.urdf)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    np.testing.assert_allclose(data.oMf[model.getFrameId("link8")].homogeneous, expected.homogeneous, atol=1e-12)


@pytest.mark.parametrize("model", [FR3, FER])
def test_a_joint_can_brake_from_the_velocity_law_before_its_position_limit(model: RobotModel) -> None:
    law = model.limits
    for share in np.linspace(0.0, 1.0, 50):
        room = share * (law.q_upper - law.q_lower)
        fastest = law.dq_upper(law.q_upper - room)
        assert np.all(fastest**2 / (2.0 * np.maximum(law.ddq_max, law.deceleration)) <= room + 1e-12)


def test_the_fer_itself_stops_at_one_velocity_wherever_a_joint_is() -> None:
    offset, deceleration = FER.limits.enforced_velocity_law()
    for room in (0.0, 0.01, 1.0):
        np.testing.assert_array_equal(np.sqrt(2.0 * deceleration * room) - offset, FER.limits.dq_max)
    assert FR3.limits.enforced_velocity_law() == (FR3.limits.velocity_offset, FR3.limits.deceleration)


def test_a_model_is_two_files_in_a_folder_of_the_user_s(tmp_path: Path) -> None:
    path = write_robot(tmp_path)
    found = robot(str(path))
    assert found is robot(str(path))
    assert found.reference == str(path)
    assert found.title == "Shorty"
    names = [joint.attrib["name"] for joint in ElementTree.fromstring(found.urdf).findall("joint")]
    assert names == [f"joint{number}" for number in range(1, 9)]
    model = pin.buildModelFromXML(found.urdf)
    assert model.jointPlacements[1].translation[2] == SHORTER * 0.333


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("rate_hz", "500", r"key rate_hz: 500; this stack controls at 1000 Hz"),
        ("dq_max", "[1.0, 2.0]", r"key limits\.dq_max\.2: "),
        ("tau_max", "[87, 87, 87, 87, 12, 12, -12]", r"key limits\.tau_max\.6: .*greater than 0"),
        ("ddq_max", None, r"key limits\.ddq_max: "),
        ("q_lower", "[3, -1, -1, -1, -1, -1, -1]", r"key limits\.q_lower: joint 1: 3 is not below 2\.7501"),
        ("limits", None, r"key sources: no entry says where limits\.\w+ comes from"),
        ("friction", None, r"key sources: no entry says where friction\.\w+ comes from"),
        ("flange", '"tool"', r"key urdf: .*shorty\.urdf: no fixed joint has the child link 'tool', the flange"),
        ("urdf", '"other.urdf"', r"key urdf: .*other\.urdf cannot be read: No such file"),
        ("title", '"a" "b"', r"not valid TOML"),
    ],
)
def test_a_mistake_is_one_line_with_its_key(tmp_path: Path, key: str, value: str | None, complaint: str) -> None:
    path = write_robot(tmp_path)
    path.write_text(with_key(path.read_text(), key, value))
    with pytest.raises(RobotError, match=rf"^{path}(:\d+)?: {complaint}") as caught:
        read_robot(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ('<axis xyz="0 0 1" />', '<axis xyz="0 1 0" />', "joint 'shorty_joint1': must turn about its z axis"),
        ('name="shorty_joint4"', 'name="elbow"', "no joint 'shorty_joint4'"),
        (
            '<parent link="shorty_link2" />',
            '<parent link="shorty_link1" />',
            "joint 'shorty_joint3': its parent is not",
        ),
        ("inertial>", "weight>", "link 'shorty_link0': has no inertial"),
        ("cylinder", "sphere", "0 collision cylinders, expected 1 to 15"),
        ("<robot", "<robot <", "not valid XML"),
        ('xyz="0 0 0.107"', 'xyz="0.01 0 0.107"', "the flange must lie along the last joint's z"),
    ],
)
def test_a_mistake_in_the_urdf_names_the_part(tmp_path: Path, before: str, after: str, complaint: str) -> None:
    path = write_robot(tmp_path)
    urdf = path.with_suffix(".urdf")
    text = urdf.read_text()
    assert before in text
    urdf.write_text(text.replace(before, after))
    with pytest.raises(RobotError, match=complaint):
        read_robot(path)
