"""Friction identification: the fit on sweeps whose answer is known, and a short run on the simulated robot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.base.configuration import ConfigurationError
from rtstack.cells import default_cell_file, open_cell
from rtstack.cli.friction import identify_friction
from rtstack.control.parameters import FrictionParameters
from rtstack.identification.fit import JointSamples, fit_joint, sigmoid
from rtstack.identification.procedure import Identification, lowest_object
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, FrictionFile, friction_toml, load_friction
from rtstack.trials.record import open_log
from rtstack.trials.run_context import NO_CONTEXT
from rtstack.trials.specification import SweepSpecification
from sim_robot.cell import SimulatedArm
from tests.support.one_arm import one_arm_file

SPEEDS = np.linspace(-1.2, 1.2, 241)  # rad/s: what grabs and pushes use


def made_up(p1, p2, p3, share, inertia, rng, n=800):
    """Samples of a joint that swings at three speeds, with what feedback would add, and noise."""
    phase = np.linspace(0.0, 2.0 * np.pi, n)
    dq = np.concatenate([peak * np.cos(phase) for peak in (0.1, 0.3, 1.0)])
    ddq = np.concatenate([-3.0 * peak * np.sin(phase) for peak in (0.1, 0.3, 1.0)])
    gravity = np.concatenate([-20.0 + 8.0 * peak * np.sin(phase) for peak in (0.1, 0.3, 1.0)])
    M = np.full(3 * n, 1.1)
    feedback = sigmoid(dq, p1, p2, p3) + share * gravity + inertia * M * ddq
    return JointSamples(dq, ddq, M, gravity, feedback + 0.02 * rng.standard_normal(3 * n))


@settings(max_examples=25)
@given(
    st.floats(0.2, 1.5), st.floats(4.0, 18.0), st.floats(-0.05, 0.05), st.floats(-0.01, 0.01), st.floats(-0.05, 0.05),
    st.integers(0, 6), st.integers(0, 2**31),
)  # fmt: skip
def test_the_fit_tells_friction_from_gravity_and_inertia(p1, p2, p3, share, inertia, joint, seed):
    rng = np.random.default_rng(seed)
    runs = [made_up(p1, p2, p3, share, inertia, rng) for _ in range(2)]
    found = fit_joint(runs, FrictionParameters(), joint)
    error = sigmoid(SPEEDS, found.p1, found.p2, found.p3) - sigmoid(SPEEDS, p1, p2, p3)
    assert np.abs(error).max() < 0.02
    assert found.gravity_share == pytest.approx(share, abs=1e-3)
    assert found.rms_nm == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("sides", [("left", "right"), ("right",)])
def test_one_joint_of_the_simulated_robot_is_found_within_two_per_cent(tmp_path, sides):
    """Joint 4, which has most friction: what is left is far below what the seed has scattered it by."""
    file = default_cell_file() if len(sides) == 2 else one_arm_file(tmp_path, sides[0])
    cell = load_cell_description(file)
    identification, thing = Identification(cell), lowest_object(cell)
    simulated = open_cell("direct", thing, 0.0, 0, cell, noise_seed=7, cell_file=file)
    try:
        run = SweepSpecification(thing, 4, 0, 0)
        result = identification.prepared(run).run(simulated, NO_CONTEXT, None)
        assert result.success
        identification.take(4, result.columns)
        assert isinstance(simulated.arms[0], SimulatedArm)
        plant = simulated.arms[0]._cell.plant.joints.copy()
    finally:
        simulated.close()
    for side, found in zip(range(len(sides)), identification.friction(4), strict=True):
        p1, p2, p3, factor = (
            float(plant[side][name][3]) for name in ("friction_p1", "friction_p2", "friction_p3", "gravity_factor")
        )
        error = sigmoid(SPEEDS, found.p1, found.p2, found.p3) - sigmoid(SPEEDS, p1, p2, p3)
        assert np.abs(error).max() < 0.02 * p1
        assert found.gravity_share == pytest.approx(1.0 - factor, abs=5e-4)


def test_what_is_written_is_what_the_controller_reads(cell, tmp_path):
    rng = np.random.default_rng(3)
    left, right = (
        ArmFriction(*(tuple(rng.uniform(0.01, 0.05, 7).round(6).tolist()) for _ in range(5))) for _ in range(2)
    )
    path = tmp_path / "friction.toml"
    path.write_text(friction_toml(FrictionFile("grab", 0, 2, left, right)))
    described = type(cell)(**{name: getattr(cell, name) for name in cell.__slots__} | {"joint_friction": path})
    for read, arm in zip(cell_parameters(described).friction, (left, right), strict=True):
        for name in ("p1", "p2", "p3", "gravity_share"):
            np.testing.assert_array_equal(getattr(read, name), getattr(arm, name))
        assert read.scale == 1.0
    path.write_text(path.read_text().replace("p1 = [", "p1 = [-1.0, "))
    with pytest.raises(ConfigurationError, match=r"key left\.p1"):
        load_friction(path)


def test_what_cannot_be_written_is_refused_before_an_arm_moves(tmp_path):
    taken = tmp_path / "taken.toml"
    taken.write_text("")
    for path, said in (
        (tmp_path / "friction.txt", "is a .toml"),
        (taken, "exists"),
        (tmp_path / "no_such_folder" / "friction.toml", "does not exist"),
    ):
        with pytest.raises(TrialError, match=said):
            identify_friction(path)
    assert sorted(tmp_path.iterdir()) == [taken]


def test_logs_of_another_robot_are_not_taken(cell, tmp_path):
    identification, thing = Identification(cell), lowest_object(cell)
    path = tmp_path / "joint6-run0.mcap"
    source = default_cell_file()
    log = open_log(path, SweepSpecification(thing, 6, 0, seed=1), cell, "direct", source)
    log.wait_ready()
    assert log.close({"success": True}) is None
    with pytest.raises(TrialError, match="something else"):
        identification.take_log(SweepSpecification(thing, 6, 0, seed=0), path)
