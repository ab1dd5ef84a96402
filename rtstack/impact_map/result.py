"""What an impact map says, and how sure it is."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from hal.base.arrays import Array
from rtstack.impact_map.coulomb import ContactState, LawResiduals
from rtstack.impact_map.problem import JOINTS, Problem


class MapKind(StrEnum):
    """single_step: the velocity jump of one time step, the procedure of the impact-map paper (III); converged: the end
    of the sequence of impacts while pads and object are pressed together (rtstack.impact_map.map)."""

    SINGLE_STEP = "single_step"
    CONVERGED = "converged"


class Status(StrEnum):
    """solved: the law holds to 1e-9, and both solvers say the same where both were asked. not unique: they found
    different velocities, which both obey the law; `detail` says of which kind. infeasible: no velocity does what is
    asked. unsolved: no solver came to 1e-9; the figures are the best attempt."""

    SOLVED = "solved"
    NOT_UNIQUE = "not unique"
    INFEASIBLE = "infeasible"
    UNSOLVED = "unsolved"


@dataclass(frozen=True, slots=True)
class Impact:
    """The end of an impact, in one sense of the word (rtstack.impact_map.map).

    status, detail: how good this is, and why, in one line. velocity (nv,): of all bodies, generalised; body_velocity
    and twist take it apart. impulses (n, 3) N s on the first body, velocities (n, 3) m/s after the impact, in the
    contacts' frames (two tangents, normal), states (n,). impulses_unique: whether another distribution of impulses over
    the contacts would give the same velocity (with four corners on a face there is one nearly always).
    kinetic energy J. law: residuals of Coulomb's law. momentum_ns: largest error of M (v+ - v-) = J^T lambda, N s and
    N m s. pressing_ns (contacts of the scene,): N s that suffice where each patch is pressed together during the
    sequence for this to be what happens; 0 where the impact does it by itself. iterations of ADMM.
    second_opinion_m_s: largest difference of velocity to PGS, m/s and rad/s; None where it was not asked, or did not
    come to 1e-9 itself. spread_m_s: the same before loads that the law leaves open were made even.
    """

    status: Status
    detail: str
    velocity: Array
    impulses: Array
    velocities: Array
    states: tuple[ContactState, ...]
    impulses_unique: bool
    kinetic_energy_before_j: float
    kinetic_energy_after_j: float
    law: LawResiduals
    momentum_ns: float
    pressing_ns: Array
    iterations: int
    second_opinion_m_s: float | None
    spread_m_s: float | None


@dataclass(frozen=True, slots=True)
class ImpactMap:
    """Both maps of a scene. problem: what they were computed from, with points, frames and velocities before."""

    problem: Problem
    single_step: Impact
    converged: Impact

    def of(self, kind: MapKind) -> Impact:
        """Return one of both maps."""
        return self.single_step if kind is MapKind.SINGLE_STEP else self.converged

    def velocity(self, body: str, impact: Impact | None = None) -> Array:
        """Return a body's generalised velocity after `impact` (by default the converged one): an arm's joint velocities
        (7,) rad/s, a box's linear and angular velocity (6,). KeyError for a name that is not there."""
        return (impact or self.converged).velocity[self.problem.slices[self._index(body)]]

    def twist(self, body: str, impact: Impact | None = None) -> Array:
        """Return the twist (6,) of a pad's face or box's centre after `impact`, world's axes, linear first."""
        return self.problem.bodies[self._index(body)].twist(self.velocity(body, impact))

    def twist_before(self, body: str) -> Array:
        """Return the same before the impact."""
        moving = self.problem.bodies[self._index(body)]
        return moving.twist(moving.velocity)

    def _index(self, body: str) -> int:
        if body not in self.problem.names:
            raise KeyError(f"no moving body is called {body!r}; there are {', '.join(self.problem.names)}")
        return self.problem.names.index(body)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-ready values."""
        before = {name: self.twist_before(name).tolist() for name in self.problem.names}
        return {"twist_before": before, **{kind.value: self._impact_dict(self.of(kind)) for kind in MapKind}}

    def _impact_dict(self, impact: Impact) -> dict[str, Any]:
        bodies = {}
        for name, body in zip(self.problem.names, self.problem.bodies, strict=True):
            bodies[name] = {"twist": self.twist(name, impact).tolist()}
            if len(body.velocity) == JOINTS:
                bodies[name]["dq"] = self.velocity(name, impact).tolist()
        contacts = []
        problem = self.problem
        for k, contact in enumerate(problem.contacts):
            patch, rows = problem.patches[k], problem.points[k]
            points = [
                {
                    "point": patch.points[i - rows.start].tolist(),
                    "state": impact.states[i].value,
                    "impulse_ns": (patch.frame @ impact.impulses[i]).tolist(),
                    "normal_impulse_ns": float(impact.impulses[i, 2]),
                    "normal_velocity_m_s": float(impact.velocities[i, 2]),
                    "slip_m_s": float(np.hypot(*impact.velocities[i, :2])),
                }
                for i in range(rows.start, rows.stop)
            ]
            contacts.append(
                {"between": list(contact.between), "pressing_ns": float(impact.pressing_ns[k]), "points": points}
            )
        return {
            "status": impact.status.value, "detail": impact.detail, "bodies": bodies, "contacts": contacts,
            "impulses_unique": impact.impulses_unique,
            "kinetic_energy_before_j": impact.kinetic_energy_before_j,
            "kinetic_energy_after_j": impact.kinetic_energy_after_j,
            "law_residuals": asdict(impact.law), "momentum_residual_ns": impact.momentum_ns,
            "admm_iterations": impact.iterations,
            "second_opinion_m_s": impact.second_opinion_m_s, "spread_m_s": impact.spread_m_s,
        }  # fmt: skip
