"""A person leads a real Panda by its hand: what the impact detector takes for an impact, though nothing was hit."""

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from hal.limits import CollisionBehaviour
from reality.comparison import Finding
from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters

PERIOD_S = 1e-3  # load_example.py of the set


def compare(folder: Path) -> Finding:
    """Count the detector's alarms, with each sign of the force; largest force, beside what stops the robot."""
    recordings = [each for path in sorted(folder.glob("**/symbol_data.mat")) for each in _recordings(path)]
    minutes = sum(len(force) for force, _ in recordings) * PERIOD_S / 60.0
    largest = np.array([np.linalg.norm(force, axis=1).max() for force, _ in recordings])
    lines = {}
    for name, parameters in {
        "detector, from the tare": DetectorParameters(),
        "detector, the paper's law": DetectorParameters(tare_n=np.inf),
    }.items():
        alarms = [sum(_alarms(sign * force, velocity, parameters) for force, velocity in recordings)
                  for sign in (1.0, -1.0)]  # fmt: skip
        lines[name] = [alarms[0] / minutes, alarms[1] / minutes, None, None]
    stop = CollisionBehaviour().collision_forces[0]
    lines["force, N"] = [None, None, float(largest.max()), stop]
    return Finding(
        len(recordings), len(recordings), "alarms a minute; N",
        ["force on the hand", "force of the hand", "largest force", "stops the robot"], lines,
        fitted=f"nothing; {60.0 * minutes:.0f} s of recordings",
    )  # fmt: skip


def _recordings(path: Path):
    """Yield the force (n, 3) N and the velocity (n, 3) m/s of each recording of a file."""
    for each in np.atleast_1d(loadmat(path, squeeze_me=True)["symbol_data"]):
        yield np.ascontiguousarray(each["F"].T), np.ascontiguousarray(each["vel"].T)


def _alarms(force, velocity, parameters: DetectorParameters) -> int:
    """Return how often the detector fires; after an alarm it begins anew."""
    detector = ImpactDetector(parameters, PERIOD_S)
    alarms = 0
    for f, v in zip(force, velocity, strict=True):
        if detector.update(f, v):
            alarms += 1
            detector = ImpactDetector(parameters, PERIOD_S)
    return alarms
