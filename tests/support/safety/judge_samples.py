"""Samples for the judge's tests: an arm in the middle of its range, whose clock runs and whose sensors are alive."""

import numpy as np

from rtstack.samples import ARM_SAMPLE

HOME = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 2.0, 0.0])


def arm_sample(t_ms: int = 0, **fields) -> np.ndarray:
    """Return a sample (1,) at HOME with these fields instead; tau_J says the time, so that no two states are equal."""
    sample = np.zeros(1, ARM_SAMPLE)
    sample["q"], sample["O_T_EE"], sample["t_ns"] = HOME, np.eye(4), t_ms * 1_000_000
    sample["tau_J"][0, 6] = 1e-9 * t_ms
    for name, value in fields.items():
        sample[name][0] = value
    return sample
