"""What a worker does before the trials: demonstrations by the scripted operator, the recording, the training."""

from pathlib import Path

import numpy as np

from hal.base.arrays import Array
from hal.base.files import replacing
from hal.displacement import Displacement
from learned_grab.network import features, into, place_of, train
from learned_grab.scripted import OBJECT, STEP_S, release_s, scripted_way
from rtstack.cells import load_description, open_cell
from rtstack.experiments.seeds import seed_of
from rtstack.loop.history import Columns
from rtstack.papers.simulated_cell import simulated_files
from rtstack.teleoperation.policy import Chunk, Observation, Policy
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import RunSamples, open_log
from rtstack.trials.result import TeleoperationResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.scoring import Score, SuccessCriterion, score
from rtstack.trials.specification import DemonstrationSpecification, TeleoperationSpecification
from rtstack.trials.teleoperation import run_policy

RATE_HZ = 1.0 / STEP_S
LONGEST_S = 8.0
DEMONSTRATIONS, RECORDING, NETWORK = "demonstrations", "reference.mcap", "policy.npz"
_LABEL = "operator"


def place(seed: int, radius_mm: float, yaw_deg: float, *what: object) -> Displacement:
    """Return a place at a distance of radius_mm in any direction, turned by up to +-yaw_deg."""
    draw = np.random.default_rng(seed_of(seed, "place", *what))
    while True:
        angle, turn = draw.uniform(0.0, 2.0 * np.pi), draw.uniform(-yaw_deg, yaw_deg)
        found = Displacement.given(radius_mm * float(np.sin(angle)), radius_mm * float(np.cos(angle)), float(turn))
        low, high = simulated_files()[0].x_range(OBJECT, found.yaw_rad)
        if low <= found.x_m <= high:  # the table carries it
            return found


def run_watched(policy: Policy, displacement: Displacement, seed: int) -> tuple[TeleoperationResult, Score, str | None]:
    """Let a policy grab. Returns the result, the score of its samples, and why it has failed, None for a success."""
    description, _ = load_description(None)
    cell = open_cell("direct", OBJECT, displacement, seed, description)
    samples = RunSamples(Path("unwritten.mcap"))
    try:
        asked = TeleoperationSpecification(_LABEL, OBJECT, seed)
        result = run_policy(policy, asked, description, cell, RunContext(samples), rate_hz=RATE_HZ, longest_s=LONGEST_S)
    finally:
        cell.close()
    assert samples.columns is not None
    values = _score(samples.columns, result)
    held = None if values.held else "the object was not held until release"
    return result, values, result.failure_reason or held


def _score(columns: Columns, result: TeleoperationResult) -> Score:
    start_ns = int(columns.arm[0]["t_ns"][0])
    return score(columns, start_ns, 0.0, release_s(), result.detected_impact_time_s, SuccessCriterion())


class _Recorder:
    """A policy whose observations and answers are kept."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.kept: list[tuple[Observation, Array]] = []

    def act(self, observation: Observation) -> Chunk | None:
        answer = self._policy.act(observation)
        if answer is not None and answer.poses is not None:
            self.kept.append((observation, answer.poses))
        return answer

    def close(self) -> None:
        self._policy.close()


def demonstrate(out: Path, seed: int, numbers: range, radius_mm: float, yaw_deg: float) -> str | None:
    """Write a file for each demonstration that is missing: places anywhere within the radius. Returns None."""
    for number in numbers:
        path = out / DEMONSTRATIONS / f"{number:03d}.npz"
        if path.exists():
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        draw = np.random.default_rng(seed_of(seed, "radius", number))
        displacement = place(seed, radius_mm * float(np.sqrt(draw.uniform())), yaw_deg, "demonstration", number)
        recorder = _Recorder(scripted_way(number, displacement))
        _, values, reason = run_watched(recorder, displacement, seed_of(seed, "demonstration", number))
        shown = [(each, said) for each, said in recorder.kept if each.object_pose is not None]
        with replacing(path) as partial, open(partial, "wb") as file:
            np.savez(
                file, success=reason is None, reason=str(reason), lift_mm=values.max_lift_mm or 0.0,
                place=[displacement.x_m, displacement.y_m, displacement.yaw_rad],
                t_s=[each.t_s for each, _ in shown], pose=[each.pose for each, _ in shown],
                object_pose=np.array([each.object_pose for each, _ in shown]),
                said=[said for _, said in shown],
            )  # fmt: skip
    return None


def record(out: Path) -> str | None:
    """Record the demonstration that reference spreading follows. Returns why there is none."""
    description, file = load_description(None)
    asked = DemonstrationSpecification(OBJECT)
    cell = open_cell("direct", asked.object, 0.0, asked.seed, description)
    try:
        log = open_log(out / RECORDING, asked, description, cell.name, file, overwrite=True)
        return run_demonstration(asked, description, cell, RunContext(log)).failure_reason
    finally:
        cell.close()


def demonstrations(out: Path) -> list[dict[str, Array]]:
    """Return the successful demonstrations, in their order."""
    found = []
    for path in sorted((out / DEMONSTRATIONS).glob("*.npz")):
        with np.load(path) as file:
            if file["success"]:
                found.append({name: file[name] for name in ("t_s", "pose", "object_pose", "said", "place")})
    return found


def learn(out: Path, seed: int) -> str | None:
    """Train the network on the successful demonstrations. Returns None, or why it cannot."""
    found = demonstrations(out)
    if not found:
        return "no demonstration succeeded"
    seen, said = [], []
    for each in found:
        start = place_of(each["object_pose"][0])
        for t_s, pads, thing, answer in zip(each["t_s"], each["pose"], each["object_pose"], each["said"], strict=True):
            seen.append(features(float(t_s), start, pads, float(thing[2])))
            said.append(into(start, answer).ravel())
    count = len(seen[0])
    network, _ = train(np.array(seen), np.array(said), slice(count - 9, count - 1), seed)
    network.save(out / NETWORK)
    return None
