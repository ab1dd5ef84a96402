"""A robot's description whose numbers no body has, or whose joints make no tree, is one line that names the part."""

import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest

from hal.robots import FR3, RobotError, read_robot
from hal.robots.bodies import DescriptionError, check_joint, check_link
from rtstack.log.viewers.solids import shapes_in
from rtstack.safety.body import Base, Tool, arm_body
from sim_robot.arm_description import arm_description
from tests.support.robot_files import with_key

OURS = files("hal.robots")
URDF, TOML = (OURS / "franka.urdf").read_text(), (OURS / "fr3.toml").read_text()
NO_NUMBERS = (
    "nan",
    "-nan",
    "inf",
    "-inf",
    "1e999",
    "1,5",
    "1e",
    "1_0",
    "0x10",
    "\u0661",
    "12 kg",
    "${mass}",
    "",
    "1 2",
)
ZEROS = 'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"'
INERTIA_OF_LINK4 = (
    '<inertia ixx="0.025853" ixy="0.007796" ixz="-0.001332" iyy="0.019552" iyz="0.008641" izz="0.028323"/>'
)


def write(folder: Path, urdf: str, toml: str = TOML) -> Path:
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    (folder / "arm.toml").write_text(with_key(toml, "urdf", '"arm.urdf"'), encoding="utf-8")
    return folder / "arm.toml"


def changed(before: str, after: str) -> str:
    assert before in URDF
    return URDF.replace(before, after, 1)


def inertia_of_link4(**moments: float) -> str:
    values = {"ixx": 0.02, "iyy": 0.02, "izz": 0.02, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0} | moments
    return changed(INERTIA_OF_LINK4, "<inertia " + " ".join(f'{key}="{value}"' for key, value in values.items()) + "/>")


def joint4(more: str) -> str:
    return changed('<joint name="joint4" type="revolute">', f'<joint name="joint4" type="revolute">{more}')


REFUSED = {
    "mass in g": (changed('"3.587895"', '"3587.895"'), "link 'link4': mass value='3587.895', expected .* at most 1000"),
    "a light mass in g": (changed('"0.646926"', '"646.926"'), "its links weigh 662.* kg, expected at most 200"),
    "inertia in kg mm^2": (inertia_of_link4(ixx=2e4, iyy=2e4, izz=2e4), "link4.* radius of gyration of 74"),
    "no triangle": (inertia_of_link4(ixx=0.05), r"link4.*no body has the principal moments 0\.02, 0\.02, 0\.05"),
    "no triangle, turned": (inertia_of_link4(ixx=0.011, iyy=0.011, izz=0.023, ixy=0.01), "link4.*principal moments"),
    "not positive definite": (inertia_of_link4(ixy=0.03), r"link4.*principal moments -0\.01"),
    "a moment of 0": (inertia_of_link4(izz=0.0), "link4.*principal moments 0,"),
    "no izz": (changed(' izz="0.028323"', ""), "link 'link4': inertia has no izz, expected a finite number"),
    "no mass": (changed('<mass value="3.587895"/>', ""), "link 'link4': mass has no value"),
    "two masses": (
        changed('<mass value="3.587895"/>', '<mass value="3.6"/><mass value="3"/>'),
        "link4.*more than one mass",
    ),
    "massless body": (
        changed('<mass value="3.587895"/>', '<mass value="0.0"/>'),
        "link4.*mass value='0', expected .*above 0",
    ),
    "lengths in mm": (changed('xyz="0 0 0.333"', 'xyz="0 0 333"'), "joint 'joint1': origin xyz='0 0 333'.*not mm"),
    "degrees": (changed('rpy="-1.5707963267948966 0 0"', 'rpy="-90 0 0"'), "joint 'joint2': origin rpy.*not degrees"),
    "no radius": (changed(' radius="0.06"', ""), "link 'link0': cylinder has no radius"),
    "no length": (re.sub(r'length="0.283"', 'length="0"', URDF), "link 'link1': cylinder length='0'"),
    "radius in mm": (URDF.replace('radius="0.06"', 'radius="60"'), "link 'link0': cylinder radius='60'.*not mm"),
    "two shapes": (changed("<geometry>", '<geometry><box size="1 1 1"/>'), "link0.*no shape or several"),
    "a box of two sizes": (
        URDF.replace('<sphere radius="0.06"/>', '<box size="1 1"/>'),
        "link0.*box size='1 1', expected three",
    ),
    "an axis of two numbers": (changed('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>'), "joint1': axis xyz='0 1'"),
    "an axis of zeros": (changed('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), "joint1': must turn about its z axis"),
    "a limit upside down": (
        joint4('<limit lower="1" upper="-1" velocity="1" effort="1"/>'),
        "joint4.*lower=1 upper=-1",
    ),
    "a limit in degrees": (joint4('<limit lower="-166" upper="166" velocity="1" effort="1"/>'), "joint4.*not degrees"),
    "no velocity": (joint4('<limit lower="-1" upper="1" velocity="0" effort="1"/>'), "joint4.*velocity='0'"),
    "no effort": (joint4('<limit lower="-1" upper="1" velocity="1"/>'), "joint4.*limit has no effort"),
    "an unknown type": (
        changed(
            "</robot>",
            '<joint name="j" type="hinge"><parent link="link8"/><child link="x"/></joint><link name="x"/></robot>',
        ),
        "joint 'j': type 'hinge', expected one of revolute",
    ),
    "two links of a name": (changed("</robot>", '<link name="link3"/></robot>'), "link 'link3': 2 have this name"),
    "two joints of a name": (changed('name="joint5"', 'name="joint4"'), "joint 'joint4': 2 have this name"),
    "a loop": (
        changed(
            "</robot>",
            '<link name="a"/><link name="b"/><joint name="x" type="fixed"><parent link="a"/>'
            '<child link="b"/></joint><joint name="y" type="fixed"><parent link="b"/>'
            '<child link="a"/></joint>'
            "</robot>",
        ),
        "link 'a': the joints make a loop",
    ),
    "a link of two joints": (
        changed("</robot>", '<joint name="x" type="fixed"><parent link="link0"/><child link="link8"/></joint></robot>'),
        "link 'link8' is the child of two joints",
    ),
    "a loose link": (
        changed("</robot>", '<link name="loose"/></robot>'),
        "links 'link0' and 'loose': no joint connects",
    ),
    "an unknown parent": (
        changed('<parent link="link3"/>', '<parent link="elbow"/>'),
        "joint 'joint4': no link 'elbow'",
    ),
    "a hand in mm": (
        changed(
            "</robot>",
            '<joint name="x" type="fixed"><parent link="link8"/><child link="hand"/></joint><link name="hand">'
            '<collision><geometry><sphere radius="40"/></geometry></collision></link></robot>',
        ),
        "link 'hand': sphere radius='40', expected .*not mm",
    ),
    "an entity": (changed("<robot", '<!DOCTYPE robot [<!ENTITY m "1">]><robot'), "has a DOCTYPE"),
    "an external entity": (changed("<robot", '<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot'), "has a DOCTYPE"),
    "deep": (changed("<inertial>", "<a>" * 5000 + "</a>" * 5000 + "<inertial>"), "recursion"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_arm_is_refused_with_its_part(tmp_path: Path, what: str) -> None:
    urdf, complaint = REFUSED[what]
    path = write(tmp_path, urdf)
    with pytest.raises(RobotError, match=rf"^{path}: key urdf: {tmp_path}/arm\.urdf.*{complaint}") as caught:
        read_robot(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


FRAME = (
    '<joint name="f" type="fixed"><parent link="link8"/><child link="frame"/></joint>'
    '<link name="frame">{}</link></robot>'
)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('<origin xyz="0 0 0.107" rpy="0 0 0"/>', '<origin xyz="0 0 0.107"/>'),
        ('<origin xyz="0 0 0" rpy="-1.5707963267948966 0 0"/>', '<origin rpy="-1.5707963267948966 0 0"/>'),
        ('<parent link="link6"/>', '<parent   link="link6" />'),
        ('<joint name="joint4" type="revolute">', '<joint name="joint4" type="continuous">'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>'),
        ("</robot>", FRAME.format("")),
        ("</robot>", FRAME.format(f'<inertial><mass value="0"/><inertia {ZEROS}/></inertial>')),
        ("<?xml", "\ufeff<?xml"),
        ("\n", "\r\n"),
    ],
)
def test_what_the_format_allows_makes_the_same_model(tmp_path: Path, before: str, after: str) -> None:
    assert before in URDF
    found = ElementTree.fromstring(read_robot(write(tmp_path, URDF.replace(before, after))).urdf)
    ours = ElementTree.fromstring(FR3.urdf)
    for one, other in ((found, ours), (ours, found)):
        for origin in one.iter("origin"):
            origin.attrib.setdefault("xyz", "0 0 0"), origin.attrib.setdefault("rpy", "0 0 0")
            origin.attrib = dict(sorted(origin.attrib.items()))
        one.set("name", "same"), ElementTree.indent(other)
    assert ElementTree.tostring(found) == ElementTree.tostring(ours)


def attributes(part: Element) -> Iterator[tuple[Element, str]]:
    """Yield each attribute of a link or joint that has numbers."""
    for element in part.iter():
        yield from ((element, key) for key, value in element.items() if re.match(r"[-+.\d]", value))


def test_no_number_of_a_link_or_joint_can_be_another_text() -> None:
    """Each number of each link and joint, in turn, is no number, one too many, or not there."""
    tried = 0
    for part in ElementTree.fromstring(URDF):
        check = check_link if part.tag == "link" else check_joint
        for element, key in list(attributes(part)):
            right = element.attrib[key]
            words = right.split()
            wrong = [" ".join([*words[:k], bad, *words[k + 1 :]]) for k in range(len(words)) for bad in NO_NUMBERS]
            for text in (*wrong, f"{right} 0", "text"):
                element.attrib[key] = text
                with pytest.raises(DescriptionError, match=rf"^{part.tag} '{part.get('name')}': {element.tag} {key}="):
                    check(part)
                tried += 1
            element.attrib[key] = right
            if element.tag in ("mass", "cylinder", "sphere"):
                for text in ("0", f"-{right}", None):
                    element.attrib.pop(key) if text is None else element.attrib.update({key: text})
                    with pytest.raises(DescriptionError, match=rf"^link '{part.get('name')}': "):
                        check(part)
                element.attrib[key] = right
        check(part)
    assert tried > 5000


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("q_upper", "[157, 102, 166, 8, 161, 259, 173]", r"limits\.q_upper: .*\(rad\): was another unit meant"),
        ("dq_max", "[150, 150, 150, 150, 300, 240, 300]", r"limits\.dq_max: .*at most 30"),
        ("translation", "[3000.0, 9000.0, 4500000.0]", r"cartesian\.translation: .*was another unit meant"),
        ("B", "[0.6, 0.6, nan, 0.45, 0.2, 0.2, 0.2]", r"motor_inertia\.B\.2: .*finite number, found nan"),
        ("tau_max", "[inf, 87, 87, 87, 12, 12, 12]", r"limits\.tau_max\.0: Input should be a finite number, found inf"),
        ("p1", "[-1, 1, 1, 1, 1, 1, 1]", r"friction\.p1\.0: .*greater than or equal to 0, found -1"),
        ("p2", "[5, 9, 10, 5, 8, 17, 10, 1]", r"friction\.p2: .*at most 7 items"),
        ("p3", f"[{'1' * 400}, 0, 0, 0, 0, 0, 0]", r"friction\.p3\.0: .*finite number, found a number of \d+ digits"),
        ("tau_rate_max", '"1000"', r"limits\.tau_rate_max: .*valid number, found '1000'"),
        ("tau_rate_max", "1,5", r"not valid TOML: .*; 1,5 has a decimal comma: write 1\.5"),
        ("meshes", '"a"\n[plant]\nB = [1, 1]', r"plant\.B"),
        ("meshes", '"a"\n[plant]\nstiffness = [1, 1, 1, 1, 1, 1, 1]', r"plant\.stiffness"),
        ("urdf", '"a\\u0000b"', r"key urdf: .* cannot be read: "),
    ],
)
def test_a_number_of_the_toml_that_no_arm_has_is_refused(tmp_path: Path, key: str, value: str, complaint: str) -> None:
    path = write(tmp_path, URDF)
    path.write_text(with_key(path.read_text(), key, value))
    with pytest.raises(RobotError, match=complaint) as caught:
        read_robot(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "\ufeff" + URDF)
    path.write_text("\ufeff" + path.read_text(), encoding="utf-8")
    assert read_robot(path).title == FR3.title


@pytest.mark.parametrize("origin", ['<origin xyz="0 0 0"/>', '<origin rpy="0 0 0"/>', ""])
def test_an_origin_may_lack_what_is_zero(tmp_path: Path, origin: str) -> None:
    """Joint 6's, and that of a capsule of link 2: judge, plant and drawing read the same arm as with all zeros."""
    lacking = re.sub(r'(link="link6"/>\s*)<origin xyz="0 0 0" rpy="1[^>]*/>', rf"\1{origin}", URDF)
    lacking = lacking.replace('<collision><origin xyz="0 0 0" rpy="0 0 0"/>', f"<collision>{origin}")
    whole = re.sub(
        r'(link="link6"/>\s*)<origin xyz="0 0 0" rpy="1[^>]*/>', r'\1<origin xyz="0 0 0" rpy="0 0 0"/>', URDF
    )
    folders = tmp_path / "lacking", tmp_path / "whole"
    bodies, arms, shapes = [], [], []
    for folder, urdf in zip(folders, (lacking, whole), strict=True):
        assert urdf != URDF
        folder.mkdir()
        found = read_robot(write(folder, urdf))
        bodies.append(arm_body(Base(robot=found), Tool()))
        arms.append(arm_description(found).T_parent_joint)
        shapes.append(shapes_in(found.urdf))
    assert bodies[0].tobytes() == bodies[1].tobytes()
    assert arms[0].tolist() == arms[1].tolist()
    assert shapes[0] == shapes[1]
