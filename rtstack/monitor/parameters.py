"""What the monitor is tuned with, in the symbols of the collision-monitoring paper (Tables 1 and 2)."""

import math
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rtstack.monitor.records import LONGEST_WINDOW, parameters_dtype


@dataclass(frozen=True, slots=True)
class MonitorParameters:
    """One tuning. residual_rate_nm_s, one a joint, is r_b of (9), which the paper does not give.

    Raises ValueError, with the parameter's name, for one that makes no sense.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}  # where a tuning comes from a TOML file

    residual_rate_nm_s: tuple[float, ...]  # r_b
    window: int  # m_max, ticks
    delay: int  # m_c, ticks
    decay_1_s: float  # a
    configuration_rad: float  # epsilon
    time_s: float  # zeta
    horizon_s: float  # xi
    velocity_rad_s: float  # e_m; the tables print rad, (17) compares it with velocities
    spacing_s: float  # iota
    period_s: float = 1e-3  # Delta t of (18)

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if not (math.isfinite(number) and (number > 0.0 or (name == "delay" and number == 0))):
                    raise ValueError(f"{name} has to be a positive number, not {number}")
        if not self.residual_rate_nm_s:
            raise ValueError("residual_rate_nm_s needs a bound for each joint")
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
