"""Cells with arms of other models: demonstration and trial, what judge and controller keep to, what the log says."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.robots import FER, FR3, RobotModel
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.safety.judge import Cause, Judgement, SafetyJudge
from rtstack.safety.limits import hardware_limits
from rtstack.samples import ARM_SAMPLE
from rtstack.trials.assembly import arm_controllers, cell_parameters, safety_judges
from rtstack.trials.review import review_log
from tests.support.robot_files import DQ_MAX, cell_of, write_robot
from tests.support.sampling import sampled


@pytest.mark.parametrize(
    "models", sampled((("fer", "fer"), ("fer", "fr3"), ("shorty.toml", "shorty.toml")), lambda models: "fr3" in models)
)
def test_a_demonstration_and_a_trial_succeed(
    models: tuple[str, str], tmp_path: Path, command_line: Callable[..., CompletedProcess[str]]
) -> None:
    write_robot(tmp_path)
    cell, reference, path = cell_of(tmp_path, *models), tmp_path / "ref.mcap", tmp_path / "trial.mcap"
    taught = command_line("teach", reference, "--cell-file", cell)
    assert taught.returncode == 0, taught.stderr
    ran = command_line("trial", "--reference", reference, "--cell-file", cell, "--displacement-mm=-20", "--log", path)
    assert ran.returncode == 0, ran.stderr + ran.stdout
    log, review, robots = read_log(path), review_log(path), load_cell_description(cell).robots
    assert json.loads(review.recorded["safety_interventions"]) == 0
    assert review.score is not None
    assert review.score.held
    attached = {a.name: a.data.decode() for a in log.attachments if a.name.endswith(".urdf")}
    if robots[0] is robots[1]:
        assert attached == {f"{robots[0].name}.urdf": robots[0].urdf}
    else:
        assert attached == {"left_fer.urdf": FER.urdf, "right_fr3.urdf": FR3.urdf}
    fastest = [
        np.abs(log.topic(f"/{side}/arm")["dq"] / model.limits.dq_max).max()
        for side, model in zip(("left", "right"), robots, strict=True)
    ]
    assert review.score.peak_velocity_ratio == pytest.approx(max(fastest), rel=1e-12)
    assert review.score.peak_velocity_ratio < 1.0


def judged(model: RobotModel, joint: int, q: float, dq: float, cell: CellDescription) -> Cause:
    """Return why a model's judge stops where this joint (1 to 7) is at q and dq, the others at home and at rest."""
    limits = replace(hardware_limits(model), ee_speed_max=np.inf)
    judge, sample = SafetyJudge(limits, replace(cell.left, model=model.reference).base), np.zeros(1, ARM_SAMPLE)
    sample["q"][0] = cell.left.home
    sample["q"][0, joint - 1], sample["dq"][0, joint - 1] = q, dq
    verdict = judge.judge(sample)
    assert (verdict == Judgement.STOPPING) == judge.stopping
    return judge.reason


@pytest.mark.parametrize(
    ("joint", "q", "dq", "stopped", "reason"),
    [
        (1, 0.0, 2.3, FER, Cause.JOINT_VELOCITY),  # 98 % of 2.175 rad/s; the FR3: of 2.62
        (5, -1.6, 3.0, FER, Cause.JOINT_VELOCITY),
        (7, 2.9, 0.0, FER, Cause.JOINT_POSITION),  # 2.8973 rad; the FR3: 3.0196
        (6, 4.0, 0.0, FER, Cause.JOINT_POSITION),
        (1, 2.85, 0.0, FR3, Cause.JOINT_POSITION),  # 2.7501 rad; the FER: 2.8973
        (6, 0.3, 0.0, FR3, Cause.JOINT_POSITION),
        (3, 1.6, 2.4, FER, Cause.JOINT_VELOCITY),
    ],
)
def test_a_judge_stops_at_its_model_s_limits_and_the_other_one_does_not(
    cell: CellDescription, joint: int, q: float, dq: float, stopped: RobotModel, reason: Cause
) -> None:
    assert judged(stopped, joint, q, dq, cell) is reason
    assert judged(FR3 if stopped is FER else FER, joint, q, dq, cell) is Cause.NONE


@pytest.mark.parametrize("model", [FR3, FER])
def test_the_judge_s_lines_are_inside_the_robot_s_everywhere(model: RobotModel) -> None:
    limits, law = hardware_limits(model), model.limits
    offset, deceleration = law.enforced_velocity_law()
    for share in np.linspace(0.0, 1.0, 101):
        q = limits.q_lower + share * np.subtract(limits.q_upper, limits.q_lower)
        room = np.maximum(np.asarray(limits.q_upper) - q, 0.0)
        ours = np.minimum(limits.dq_max, np.maximum(0.0, np.sqrt(2 * law.deceleration * room) - law.velocity_offset))
        robots = np.minimum(law.dq_max, np.maximum(0.0, np.sqrt(2 * deceleration * (law.q_upper - q)) - offset))
        assert np.all(ours <= robots)


def test_each_arm_has_the_numbers_of_its_own_model(tmp_path: Path) -> None:
    path = write_robot(tmp_path)
    text = path.read_text().replace("B_theta = [0.2, 0.2,", "B_theta = [0.1, 0.1,")
    path.write_text(text.replace("p1 = [0.54615,", "p1 = [0.7,"))
    cell = load_cell_description(cell_of(tmp_path, "fer", "shorty.toml"))
    left, right = arm_controllers(cell, cell_parameters(cell))
    assert left.model.robot is FER
    assert right.model.robot.title == "Shorty"
    assert left.model.p7[0] != right.model.p7[0]  # the right arm is shorter
    assert [float(arm._observer["B_theta"].flat[0]) for arm in (left, right)] == [0.2, 0.1]
    assert [float(arm._observer["p1"].flat[0]) for arm in (left, right)] == [0.54615, 0.7]
    judges = safety_judges(cell)
    assert float(judges[1]._rules["dq_max"][0, 0]) == 0.98 * DQ_MAX[0]
    assert float(judges[0]._rules["dq_max"][0, 0]) == 0.98 * FER.limits.dq_max[0]


@pytest.mark.parametrize(
    ("left", "home", "complaint"),
    [
        ("ur5", None, r"lab\.toml:\d+: key left\.model: unknown robot model 'ur5': choose one of fer, fr3, or"),
        ("none.toml", None, r"lab\.toml:\d+: key left\.model: .*none\.toml: cannot be read"),
        ("fer", 3.9, r"lab\.toml:\d+: key left\.home: joint 6 at 3\.9 rad is not between -0\.0175 and 3\.7525"),
    ],
)
def test_a_cell_that_cannot_be_is_one_line(
    tmp_path: Path, left: str, home: float | None, complaint: str, command_line: Callable[..., CompletedProcess[str]]
) -> None:
    path = cell_of(tmp_path, left)
    if home is not None:
        path.write_text(path.read_text().replace("1.566484", str(home), 1))
    with pytest.raises(ConfigurationError, match=complaint):
        load_cell_description(path)
    out = tmp_path / "ref.mcap"
    said = command_line("teach", out, "--cell-file", path)
    assert said.returncode == 2
    assert len(said.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_a_cell_s_own_limits_may_not_be_wider_than_either_arm_s(tmp_path: Path) -> None:
    path = cell_of(tmp_path, "fr3", "fer")
    path.write_text(path.read_text().replace("[safety]\n", "[safety]\ndq_max = [2.5, 2.5, 2.5, 2.5, 2.5, 2.5, 2.5]\n"))
    with pytest.raises(ConfigurationError, match=r"safety\.dq_max = .*may only tighten, 2\.5 must be at most 2\.13"):
        load_cell_description(path)
