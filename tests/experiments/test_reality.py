"""The comparisons with measurements of others, on sets in their files' formats that are made from known robots."""

import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from reality import hits, human_force, torque, tosses
from reality.experiment import COMPARISONS, Reality, RealityPlan
from scipy.io import savemat

from hal.robots import FER
from rtstack.experiments.experiment import Request
from rtstack.experiments.registry import plan_file
from rtstack.identification.fit import sigmoid
from rtstack.trials.errors import TrialError

RNG = np.random.default_rng(4)


def make_panda(folder: Path, scale: float) -> None:
    """Write an exciting trajectory of the described arm, its friction `scale` times the published one."""
    t = np.arange(0.0, 6.0, 1.02e-3)
    phases = np.arange(7.0)
    q = np.array([0.0, 0.3, 0.0, -1.8, 0.0, 2.0, 0.5]) + 0.4 * np.sin(3.0 * t[:, None] + phases)
    dq, ddq = 1.2 * np.cos(3.0 * t[:, None] + phases), -3.6 * np.sin(3.0 * t[:, None] + phases)
    model = pin.buildModelFromXML(FER.urdf)
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *each) for each in zip(q, dq, ddq, strict=True)])
    tau += scale * np.column_stack([sigmoid(dq[:, j], *(p[j] for p in FER.friction)) for j in range(7)])
    folder.mkdir(parents=True)
    for name, values in (("positions", q), ("velocity", dq), ("torques", tau), ("time", t)):
        np.savetxt(folder / f"exciting_traj_{name}.txt", values.reshape(-1))


def make_hits(folder: Path) -> None:
    """Write tables of a light and a heavy box that obey the map of rigid links, the first 20 hits of each missed."""
    rng = np.random.default_rng(21)
    folder.mkdir(parents=True)
    for name in ("D1-robot_agnostic", "D2_clean_clean"):
        flux, inertia = rng.uniform(0.5, 1.0, 100), rng.uniform(4.0, 5.0, 100)
        robot = np.where(np.arange(100) % 3 == 0, 14, 7)
        distance = np.where(robot == 7, 0.45, 0.40) * flux**2
        distance[:20] = 1e-3
        rows = zip(robot, flux, distance, inertia, strict=True)
        lines = "\n".join(",".join(map(str, row)) for row in rows)
        (folder / f"{name}.csv").write_text(f"IiwaNumber,HittingFlux,DistanceTraveled,HittingInertia\n{lines}\n")


def save_tensor(path: Path, values: NDArray[np.float64]) -> None:
    """Write what PyTorch wrote before 1.6, without PyTorch."""

    def named(module: str, name: str) -> bytes:
        return b"c" + f"{module}\n{name}\n".encode()

    n, m = values.shape
    with path.open("wb") as file:
        for header in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}):
            pickle.dump(header, file, protocol=2)
        file.write(b"\x80\x02" + named("torch._utils", "_rebuild_tensor_v2") + b"((")
        file.write(
            b"X\x07\x00\x00\x00storage" + named("torch", "DoubleStorage") + b"X\x01\x00\x00\x000X\x03\x00\x00\x00cpu"
        )
        file.write(f"I{n * m}\nNtQ".encode())  # a persistent id: the tuple above
        file.write(f"I0\n(I1\nI{n}\nI{m}\nt(I{n * m}\nI{m}\nI1\nt".encode())
        file.write(b"I00\n" + named("collections", "OrderedDict") + b")RtR.")
        pickle.dump(["0"], file, protocol=2)
        file.write((n * m).to_bytes(8, "little") + np.ascontiguousarray(values, "<f8").tobytes())


def make_tosses(folder: Path, contact: tuple[float, float, float], count: int) -> None:
    """Write tosses that the plant's contact solver has made."""
    path = folder / "tosses_processed"
    path.mkdir(parents=True)
    for number in range(count):
        first = np.zeros((40, 19))
        first[0, :3] = 0.0, 0.0, 2.0
        first[:, 3:7] = RNG.normal(size=4)
        first[0, 7:10] = 15.0 * RNG.normal(size=3) - np.array([0.0, 0.0, 10.0])
        save_tensor(path / f"{number}.pt", first)
        start = tosses.states(path / f"{number}.pt")
        first[:, :7] = tosses.tossed(contact, start)
        first[:, :3] /= tosses.HALF_WIDTH_M
        first[0, 3:7] = start[0, 3:7]
        save_tensor(path / f"{number}.pt", first)


def test_friction_of_an_arm_is_found_where_the_published_one_is_wrong(tmp_path):
    make_panda(tmp_path / "set", 2.0)
    found = torque.compare(tmp_path / "set").lines
    assert min(found["rigid body"]) > 0.2
    assert max(np.divide(found["with fitted friction"], found["with published friction"])) < 0.5


def test_the_published_friction_is_right_for_the_arm_that_it_was_published_of(tmp_path):
    make_panda(tmp_path / "set", 1.0)
    found = torque.compare(tmp_path / "set").lines
    assert max(np.divide(found["with published friction"], found["rigid body"])) < 0.3


def test_hits_that_obey_the_map_are_predicted_and_misses_left_out(tmp_path):
    make_hits(tmp_path / "set")
    finding = hits.compare(tmp_path / "set")
    assert (finding.samples, finding.held_out) == (160, 80)
    assert finding.lines[finding.better][0] < 0.01 < finding.lines[finding.worse][0]


def test_two_boxes_of_other_mass_tell_the_arms_inertia(tmp_path):
    make_hits(tmp_path / "set")
    lines = hits.compare(tmp_path / "set").lines
    heavy = {name.removeprefix("impact map, "): values[3] for name, values in lines.items()}
    assert heavy["rigid links"] < 0.01 < heavy["with reflected inertia"] < heavy["arm as one rigid body"]
    assert heavy["arm as one rigid body"] < heavy["arm of infinite inertia"]


def test_a_table_of_an_unknown_box_is_refused(tmp_path):
    (tmp_path / "X1.csv").write_text("IiwaNumber,HittingFlux,DistanceTraveled,HittingInertia\n")
    with pytest.raises(TrialError, match="the mass of its box is open"):
        hits.compare(tmp_path)


def test_contact_is_fitted_on_some_tosses_and_predicts_the_others(tmp_path):
    make_tosses(tmp_path / "set", (0.15, 3e4, 0.2), 15)
    finding = tosses.compare(tmp_path / "set")
    assert (finding.samples, finding.held_out) == (15, 12)
    fitted, given = (finding.lines[name] for name in (finding.better, finding.worse))
    assert fitted[0] < 0.5 * given[0]


def test_a_pickle_that_names_anything_else_is_refused(tmp_path):
    path = tmp_path / "evil.pt"
    path.write_bytes(b"".join([pickle.dumps(1, protocol=2)] * 3) + b"\x80\x02cos\nsystem\n.")
    with pytest.raises(pickle.UnpicklingError, match=r"os\.system is not expected"):
        tosses.states(path)


@pytest.mark.parametrize(("newton", "alarms"), [(0.0, False), (-20.0, True)])
def test_an_alarm_is_a_force_against_the_motion(tmp_path, newton, alarms):
    force, velocity = np.zeros((3, 3000)), np.zeros((3, 3000))
    velocity[0] = 0.1
    force[0, 1500:1600] = newton
    recording = np.empty(1, [("pos", "O"), ("vel", "O"), ("F", "O")])
    recording[0] = (velocity, velocity, force)
    savemat(tmp_path / "symbol_data.mat", {"symbol_data": recording})
    lines = human_force.compare(tmp_path).lines
    assert (lines["detector, from the tare"][0] > 0.0) is alarms
    assert lines["detector, from the tare"][1] == 0.0


@pytest.mark.long
def test_the_campaign_compares_what_is_there_and_says_how_to_get_the_rest(reality, tmp_path):
    make_panda(tmp_path / "data" / "panda_dynamics", 1.0)
    command = [sys.executable, "-m", "rtstack", "campaign", "reality", "--workers", "1"]
    command += ["--data", str(tmp_path / "data"), "--out", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    assert "DAIRLab/contact-nets" in result.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [part["name"] for part in report["conditions"]] == ["Joint torques of a real Panda"]
    assert (tmp_path / "out" / "figures" / "panda_dynamics.png").is_file()


@pytest.mark.parametrize(("given", "says"), [(False, "give the folder"), (True, "panda_dynamics is the four files")])
def test_without_data_it_says_what_to_do(reality, tmp_path, given, says):
    plan = RealityPlan("reality", "reality", "Reality", tuple(COMPARISONS), ())
    with pytest.raises(TrialError, match=says):
        Reality(plan, Request(plan_file("reality"), tmp_path, data=tmp_path if given else None))
