"""The order of limits: what the controller asks for under an active limit passes the judge, on every cell."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import deploy
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.safety.judge import Cause, Judgement, SafetyJudge
from rtstack.safety.limits import SafetyLimits
from rtstack.samples import Mode, QpStatus
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.tightening import limits_of_arms
from tests.support.sampling import sampled

CELLS = sorted((Path(next(iter(deploy.__path__))) / "cells").glob("*.toml"))
OFTEN = CELLS[:2]
MODELS = ("fr3", "fer")
STEP_S = 1e-3


def cell_with(path: Path, model: str) -> CellDescription:
    """Return the cell of a file, with arms of this model."""
    cell = load_cell_description(path)
    return replace(cell, **{side: replace(arm, model=model) for side, arm in cell.mountings.items()})


def tightened(cell: CellDescription, rng: np.random.Generator) -> CellDescription:
    """Return the cell with each of the joints' limits drawn in, or not: positions by up to 0.6 of half the range."""
    limits, table = limits_of_arms(cell)[0], dict(cell.safety)
    lower, upper = np.array(limits.q_lower), np.array(limits.q_upper)
    half = (upper - lower) / 2
    drawn = {
        "q_lower": lower + rng.uniform(0.0, 0.6, 7) * half,
        "q_upper": upper - rng.uniform(0.0, 0.6, 7) * half,
        "dq_max": limits.dq_max * rng.uniform(0.05, 1.0, 7),
        "tau_max": limits.tau_max * rng.uniform(0.6, 1.0, 7),
        "tau_J_max": limits.tau_J_max * rng.uniform(0.6, 1.0, 7),
    }
    table |= {name: values.tolist() for name, values in drawn.items() if rng.random() < 0.7}
    if rng.random() < 0.5:
        table["tau_rate_max"] = limits.tau_rate_max * rng.uniform(0.1, 1.0)
    return replace(cell, safety=table)


def fastest(room: np.ndarray, limits: SafetyLimits) -> np.ndarray:
    """Return the judge's velocity limit (7,), rad/s, `room` (7,) rad before a position limit."""
    allowed = np.sqrt(2.0 * limits.arm.deceleration * room) - limits.arm.velocity_offset
    return np.minimum(limits.dq_max, np.maximum(0.0, allowed))


def state_inside(limits: SafetyLimits, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return joints and velocities (7,) that the judge allows, often near a limit and often at it."""
    lower, upper = np.array(limits.q_lower), np.array(limits.q_upper)
    room = (upper - lower) * rng.uniform(0.0, 1.0, 7) ** rng.choice([1.0, 6.0])
    q = np.where(rng.random(7) < 0.5, upper - room, lower + room)
    shares = rng.choice([0.0, 0.5, 0.9, 0.99, 1.0 - 1e-9], 7)
    up, down = fastest(upper - q, limits), fastest(q - lower, limits)
    return q, np.where(rng.random(7) < 0.5, shares * up, -shares * down)


def asked(cell: CellDescription, rng: np.random.Generator) -> QpStatus | None:
    """Have a far-away setpoint pursued from a state inside the limits, and have the judge look at the torque and at the
    next state that the controller's own model expects. Returns the QP's status, None where the arm cannot hold there.
    """
    limits = limits_of_arms(cell)[0]
    arm = arm_controllers(cell, cell_parameters(cell))[int(rng.integers(2)) % len(cell.arms)]
    q, dq = state_inside(limits, rng)
    arm.sample["q"][0], arm.sample["dq"][0] = q, dq
    arm.observe()
    work = arm.workspace[0]
    share = rng.uniform(-0.9, 0.9, 7)
    last = share * limits.tau_max
    if np.any(np.abs(last + work["gravity"]) > limits.tau_J_max):
        return None
    arm.sample["tau_J"][0] = last + work["gravity"]
    arm.setpoint["position"][0] = work["position"] + 0.3 * rng.normal(size=3)
    arm.setpoint["rotation"][0] = work["rotation"]
    arm.setpoint["twist"][0] = rng.normal(size=6)
    arm.setpoint["xi"] = q[0] + rng.normal()
    arm.setpoint["velocity_weight"] = 1.0
    arm.pursue(arm.parameters.stiffness, arm.parameters.posture_gain)
    judge = SafetyJudge(replace(limits, ee_lower=(-inf,) * 3, ee_upper=(inf,) * 3, ee_speed_max=inf, power_max=inf))
    judge.memory["tau_applied"][0] = work["tau_previous"][:] = last
    status = arm.command(Mode.ANTE_IMPACT)
    if status > QpStatus.SOLVED:
        return status
    assert judge.judge(arm.sample) is Judgement.PASS, judge.explanation
    # the torque that the QP asks for, before the torque's rate is limited
    tau = work["M"] @ work["ddq"] + work["coriolis"] + work["friction"]
    assert np.all(np.abs(tau) <= limits.tau_max)
    assert np.all(np.abs(tau + work["gravity"]) <= limits.tau_J_max)
    arm.sample["t_ns"] += 1_000_000
    arm.sample["q"][0] = q + dq * STEP_S + 0.5 * work["ddq"] * STEP_S**2
    arm.sample["dq"][0] = dq + work["ddq"] * STEP_S
    arm.sample["tau_desired"][0] = arm.sample["tau_applied"][0]
    assert judge.judge(arm.sample) is Judgement.PASS, judge.explanation
    assert judge.reason is Cause.NONE
    return status


@pytest.mark.parametrize("path", sampled(CELLS, OFTEN.__contains__), ids=lambda path: path.stem)
@pytest.mark.parametrize("model", MODELS)
@given(seed=st.integers(0, 2**31), tight=st.booleans())
@example(seed=115031, tight=True)  # of an FER: at full speed, one tick before the line of the position
@settings(max_examples=300, deadline=None)
def test_what_is_asked_for_under_an_active_limit_passes_the_judge(path, model, seed, tight):
    rng = np.random.default_rng(seed)
    cell = cell_with(path, model)
    asked(tightened(cell, rng) if tight else cell, rng)


@pytest.mark.parametrize("path", sampled(CELLS, OFTEN.__contains__), ids=lambda path: path.stem)
@pytest.mark.parametrize("model", MODELS)
def test_most_of_those_states_make_a_limit_active_and_have_an_answer(path, model):
    rng = np.random.default_rng(0)
    cell = cell_with(path, model)
    found = [asked(tightened(cell, rng) if k % 2 else cell, rng) for k in range(200)]
    assert sum(status is QpStatus.SOLVED for status in found) > 50
    # a cell that allows less torque than its arms need to brake makes the QP infeasible: the judge then stops them
    assert not [status for status in found[::2] if status is not None and status > QpStatus.SOLVED]
    assert sum(status is QpStatus.INFEASIBLE for status in found) <= 4
