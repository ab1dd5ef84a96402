"""Does an accelerometer at each end of each link tell an impact sooner than joint torque sensors do?

`python -m tests.programs.accelerometers [--grabs 200] [--tuning 60] [--seed 1]`: grabs in the direct cell of four
objects, displaced by up to 30 mm. Each way to detect is the detector of Appendix B on another signal, with thresholds
by one rule: 1.2 times the largest value in free motion on the tuning grabs, whose arms, noise and demonstrations the
judged ones never meet. A delay counts from the first millisecond in which the plant's contacts exert anything on that
arm; 0: the state at its end shows it.

The signals: the robot's own estimate of the external force (`O_F_ext_hat_K`); the same force from M ddq + C dq + g -
tau_J without an observer (as arXiv 2505.08334 computes it), ddq either the quotient of measured velocities alone, or
fused with accelerometers; and the jump of the acceleration at the last joint. An accelerometer is what robot_state.py
says of it, and sits where that fills it.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numba import njit

from hal.limits import CONTROL_PERIOD_S
from rtstack.cells import load_description, open_cell
from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters
from rtstack.model.arm_model import ArmModel
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial
from sim_robot.cell import simulated_cell
from sim_robot.fci.robot_state import ACCELEROMETER_BIT, ACCELEROMETER_NOISE, ACCELEROMETER_RANGE
from sim_robot.kinematics import forward_kinematics
from sim_robot.plant_parameters import load_plant_parameters

OBJECTS = ("rice_box", "parcel", "two_parcels", "bottles")
TUNING, JUDGED = (61,), (71, 72)  # demonstrations, by variation
DISPLACED_MM = 30.0
DQ_NOISE = load_plant_parameters().sensors.dq_noise
MARGIN = 1.2
AFTER_TICKS = 40  # that are kept after both arms have met the object
SETTLED = 250  # ticks: the detector's window is full, and filters have settled
TARE_S = 0.1  # what a model's error leaves changes more slowly
SIGNALS = ("robot's estimate", "direct, encoders alone", "direct, with accelerometers", "jump at joint 7")


class Recorder:
    """Keeps what the robot measures and what is true, each millisecond, and stops the trial after both contacts."""

    def __init__(self, object_name: str, displacement_m: float, seed: int) -> None:
        self.cell = simulated_cell(object_name, displacement_m, seed)
        self.rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.contact = [-1, -1]
        self._next, self.cell.next_state = self.cell.next_state, self._advance

    def _advance(self) -> None:
        self._next()
        plant = self.cell.plant
        tau_ext = plant.motors["tau_ext"]
        for side in range(2):
            if self.contact[side] < 0 and np.abs(tau_ext[side]).max() > 0.0:
                self.contact[side] = len(self.rows)
        self.rows.append((self.cell.states.copy(), plant.data.qpos[:14].copy(), plant.data.qvel[:14].copy()))

    @property
    def stop_requested(self) -> bool:
        """Whether all has been seen."""
        return min(self.contact) >= 0 and len(self.rows) > max(self.contact) + AFTER_TICKS


@dataclass(slots=True)
class Grab:
    """Of each arm: its contact's tick, and each signal's force (ticks, 3) on the end effector with its velocity."""

    contact: tuple[int, int]
    signals: list[list[np.ndarray]]
    velocity: list[np.ndarray]


@njit(error_model="numpy")
def points(body, dq, J, drift):
    """J (18, 7) of the origins of joints 2 to 7 at the pose of `body`, and dJ/dt dq (18,), along the base's axes."""
    J[:] = 0.0
    w, dw, a = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(6):
        axis = body.axes[i]
        dw += np.cross(w, axis) * dq[i]
        w += axis * dq[i]
        r = body.origins[i + 1] - body.origins[i]
        a += np.cross(dw, r) + np.cross(w, np.cross(w, r))
        drift[3 * i : 3 * i + 3] = a
        for j in range(i + 1):
            J[3 * i : 3 * i + 3, j] = np.cross(body.axes[j], body.origins[i + 1] - body.origins[j])


@njit(error_model="numpy")
def sense(bodies, qpos, qvel, noise, sigma):
    """What accelerometers at the joints' origins read (n, 18), m/s^2, less gravity, which is known."""
    body, n = bodies[0], qpos.shape[0]
    reads, J, drift = np.zeros((n, 18)), np.zeros((18, 7)), np.zeros(18)
    last = np.zeros(18)
    for k in range(n):
        forward_kinematics(body, qpos[k])
        points(body, qvel[k], J, drift)
        velocity = J @ qvel[k]
        acceleration = (velocity - last) / CONTROL_PERIOD_S if k > 0 else np.zeros(18)
        last = velocity
        for i in range(18):
            read = min(max(acceleration[i] + sigma[i] * noise[k, i], -ACCELEROMETER_RANGE), ACCELEROMETER_RANGE)
            reads[k, i] = ACCELEROMETER_BIT * np.round(read / ACCELEROMETER_BIT)
    return reads


@njit(error_model="numpy")
def estimate(bodies, states, M, bias, reads, sigma, forces, velocity):
    """Fill forces (4, n, 3) of all SIGNALS, along the base's axes, and the pad's velocity (n, 3)."""
    body, n = bodies[0], reads.shape[0]
    J, drift, tares = np.zeros((18, 7)), np.zeros(18), np.zeros((4, 3))
    quotient_sigma = np.sqrt(2.0) * DQ_NOISE / CONTROL_PERIOD_S
    for k in range(n):
        state = states[k]
        forward_kinematics(body, state.q)
        velocity[k] = body.J[:3] @ state.dq
        for i in range(3):
            forces[0, k, i] = -state.O_F_ext_hat_K[i]
        if k == 0:
            continue
        points(body, state.dq, J, drift)
        quotient = (state.dq - states[k - 1].dq) / CONTROL_PERIOD_S
        A, b = np.eye(7) / quotient_sigma**2, quotient / quotient_sigma**2
        for i in range(18):
            for r in range(7):
                b[r] += J[i, r] * (reads[k, i] - drift[i]) / sigma[i] ** 2
                for c in range(7):
                    A[r, c] += J[i, r] * J[i, c] / sigma[i] ** 2
        torque = 0.5 * (state.tau_J + states[k - 1].tau_J)
        normal = body.J @ body.J.T + 0.005**2 * np.eye(6)
        for number in (1, 2):
            ddq = quotient if number == 1 else np.linalg.solve(A, b)
            tau = M[k] @ ddq + bias[k] - torque  # of the environment on the joints
            forces[number, k] = np.linalg.solve(normal, body.J @ tau)[:3]
        forces[3, k] = reads[k, 15:]
        for number in range(1, 4):
            now = forces[number, k].copy()
            if k < 20:
                tares[number] = now
            forces[number, k] -= tares[number]
            tares[number] += (now - tares[number]) * CONTROL_PERIOD_S / TARE_S


def evaluate(recorder: Recorder, models: list[ArmModel], seed: int) -> Grab:
    """Compute every signal of a recorded grab. The arms' bases are not turned: their axes are the world's."""
    draws, n = np.random.default_rng([seed, 99]), len(recorder.rows)
    grab = Grab((recorder.contact[0], recorder.contact[1]), [], [])
    sigma = ACCELEROMETER_NOISE / np.sqrt(
        [2.0] * 15 + [1.0] * 3
    )  # two sensors at each joint between two links, one at the last
    for side in range(2):
        arm, own = models[side], slice(7 * side, 7 * side + 7)
        states = np.array([row[0][side] for row in recorder.rows])
        M, bias = np.zeros((n, 7, 7)), np.zeros((n, 7))
        for k in range(n):
            q, dq = states["q"][k], states["dq"][k]
            arm.update(q, dq)
            M[k] = arm.M
            bias[k] = arm.C @ dq + arm.g
        bodies = recorder.cell.sensors.kinematics[side : side + 1].copy()
        truth = [np.ascontiguousarray([row[i][own] for row in recorder.rows]) for i in (1, 2)]
        reads = sense(bodies, *truth, draws.standard_normal((n, 18)), sigma)
        forces, velocity = np.zeros((len(SIGNALS), n, 3)), np.zeros((n, 3))
        estimate(bodies, states, M, bias, reads, sigma, forces, velocity)
        grab.signals.append(list(forces))
        grab.velocity.append(velocity)
    return grab


def run(prepared: PreparedTrial, displacement_mm: float, seed: int, models: list[ArmModel]) -> Grab:
    """Grab once, up to a moment after the impact."""
    specification = replace(prepared.specification, displacement_mm=displacement_mm, seed=seed)
    recorder = Recorder(specification.object, 1e-3 * displacement_mm, seed)
    try:
        run_trial(
            replace(prepared, specification=specification), recorder.cell.as_cell("direct"), RunContext(stop=recorder)
        )
    finally:
        recorder.cell.close()
    assert min(recorder.contact) > SETTLED, recorder.contact
    return evaluate(recorder, models, seed)


def threshold(grabs: list[Grab], number: int) -> float:
    """MARGIN times the largest value in free motion."""
    free = [
        np.linalg.norm(grab.signals[side][number][SETTLED : grab.contact[side]], axis=1).max()
        for grab in grabs
        for side in range(2)
    ]
    return MARGIN * max(free)


def detections(grab: Grab, number: int, parameters: DetectorParameters) -> list[int]:
    """The tick in which each arm's detector fires first; -1: never."""
    found = []
    for side in range(2):
        detector, fired = ImpactDetector(parameters, CONTROL_PERIOD_S), -1
        pairs = zip(grab.signals[side][number], grab.velocity[side], strict=True)
        for k, (force, velocity) in enumerate(pairs):
            if detector.update(np.ascontiguousarray(force), velocity) and k >= SETTLED:
                fired = k
                break
        found.append(fired)
    return found


def judged(grabs: list[Grab], number: int, parameters: DetectorParameters) -> str:
    """The line of a table: false alarms, misses and delays, ms, of arms and of the first of both."""
    alarms, missed, arms, first = 0, 0, [], []
    for grab in grabs:
        found = detections(grab, number, parameters)
        for side in range(2):
            if found[side] < 0:
                missed += 1
            elif found[side] < grab.contact[side]:
                alarms += 1
            else:
                arms.append(found[side] - grab.contact[side])
        valid = [f for f, c in zip(found, grab.contact, strict=True) if f >= c]
        if valid:
            first.append(min(valid) - min(grab.contact))
    p50, p95 = np.percentile(arms, [50, 95]) if arms else (np.nan, np.nan)
    f50, f95 = np.percentile(first, [50, 95]) if first else (np.nan, np.nan)
    mean = np.mean(arms) if arms else np.nan
    return f"{alarms:6d} {missed:6d} {p50:6.1f} {p95:6.1f} {mean:6.2f} {f50:7.1f} {f95:6.1f}"


def main() -> int:
    """Record, tune, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grabs", type=int, default=200)
    parser.add_argument("--tuning", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    description, source = load_description(None)
    models = [ArmModel(mounting, description.pad) for mounting in (description.left, description.right)]
    with TemporaryDirectory() as folder:
        prepared = {}
        for name in OBJECTS:
            for variation in (*TUNING, *JUDGED):
                specification = DemonstrationSpecification(name, variation, variation)
                path = Path(folder) / f"{name}-{variation}.mcap"
                cell = open_cell("direct", name, 0.0, variation, description)
                run_demonstration(
                    specification,
                    description,
                    cell,
                    RunContext(open_log(path, specification, description, "direct", source)),
                )
                cell.close()
                prepared[name, variation] = prepare_trial(TrialSpecification(str(path), object=name), description)
        sets = []
        for count, variations, offset in ((options.tuning, TUNING, 0), (options.grabs, JUDGED, 1)):
            draw, grabs = np.random.default_rng([options.seed, offset]), []
            for k in range(count):
                case = prepared[OBJECTS[k % len(OBJECTS)], variations[k // len(OBJECTS) % len(variations)]]
                seed = 100_000 * (offset + 1) + 1000 * options.seed + k
                grabs.append(run(case, float(draw.uniform(-DISPLACED_MM, DISPLACED_MM)), seed, models))
                print(f"{k + 1} of {count}", end="\r", file=sys.stderr, flush=True)
            sets.append(grabs)
    tuning, held = sets
    print(f"{len(held)} judged grabs ({2 * len(held)} arms), thresholds from {len(tuning)} others; delays in ms")
    print(f"{'signal':34} {'bound':>7} alarms missed    p50    p95   mean  first50  first95")
    paper = DetectorParameters()
    print(f"{'the paper: estimate, 5 N':34} {paper.force_high_n:7.2f} {judged(held, 0, paper)}")
    for number, name in enumerate(SIGNALS):
        bound = threshold(tuning, number)
        parameters = replace(paper, force_low_n=0.8 * bound, force_high_n=bound)
        print(f"{name:34} {bound:7.2f} {judged(held, number, parameters)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
