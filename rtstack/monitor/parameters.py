"""What the monitor is tuned with: Tables 1 and 2 of the collision-monitoring paper."""

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import numbers
from rtstack.monitor.records import LONGEST_WINDOW, parameters_dtype

MOST_JOINTS = 1000
LARGEST = 1e9  # of any number: 30 years in ns fit into 64 bits


@dataclass(frozen=True, slots=True)
class MonitorParameters:
    """One tuning. `tune_monitor` of rtstack.monitor.tuning makes one from recorded motions.

    Raises ValueError, with the parameter's name, for one that makes no sense.

    Attributes:
        residual_rate_nm_s: r_b of (9), Nm/s, one a joint: the rate of the residual from which on it is an impact. The
            paper does not give it.
        window: m_max, ticks: how far the envelopes of the velocity error look back, a period of what vibrates after an
            impact or more, so that they enclose the vibration.
        delay: m_c, ticks after an impact: from then on zero has to lie within the envelopes.
        decay_1_s: a, 1/s: how fast the envelopes forget what has left the window; their time constant is 1 / a.
        configuration_rad: epsilon, rad: how far from the meant configuration an impact may be, as a norm over joints.
        time_s: zeta, s: how much earlier or later than meant it may be.
        horizon_s: xi, s after an impact: how long the envelopes are looked at; the verdict comes at its end.
        velocity_rad_s: e_m, rad/s: how far zero may lie outside the envelopes. The tables print rad, (17) compares it
            with velocities.
        spacing_s: iota, s: the longest time from one impact to the next that belongs to it.
        period_s: Delta t of (18), s a tick.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}  # where a tuning comes from a TOML file

    residual_rate_nm_s: tuple[float, ...]
    window: int
    delay: int
    decay_1_s: float
    configuration_rad: float
    time_s: float
    horizon_s: float
    velocity_rad_s: float
    spacing_s: float
    period_s: float = 1e-3

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            shape, kind = (None,) * (name == "residual_rate_nm_s"), np.int64 if name in ("window", "delay") else float
            value = numbers(getattr(self, name), name, shape, kind)
            if not (value > 0.0).all() and (name != "delay" or value < 0):
                raise ValueError(f"{name} has to be a positive number, not {value.min()}")
            if (value > LARGEST).any():
                raise ValueError(f"{name} has to be at most {LARGEST:g}, not {value.max()}")
        if not 0 < self.joints <= MOST_JOINTS:
            raise ValueError(f"residual_rate_nm_s needs a bound for each of 1 to {MOST_JOINTS} joints")
        if self.window > LONGEST_WINDOW:
            raise ValueError(f"window has to be at most {LONGEST_WINDOW} ticks, not {self.window}")
        if self.delay * self.period_s > self.horizon_s:
            raise ValueError("delay has to end before horizon_s: nothing would be looked at")

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.residual_rate_nm_s)

    def record(self) -> NDArray[np.void]:
        """Return (1,) of parameters_dtype, as compiled code takes it. Times become ns, so that ticks are whole."""
        record = np.zeros(1, parameters_dtype(self.joints))
        record["residual_rate"][0] = self.residual_rate_nm_s
        record["window"], record["decay"] = self.window, self.decay_1_s
        record["configuration"], record["velocity"] = self.configuration_rad, self.velocity_rad_s
        for name, time_s in (
            ("delay_ns", self.delay * self.period_s),
            ("time_ns", self.time_s),
            ("horizon_ns", self.horizon_s),
            ("spacing_ns", self.spacing_s),
        ):
            record[name] = round(time_s * 1e9)
        return record
