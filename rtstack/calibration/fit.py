"""Bases, pads' faces, markers and the tracker in the world, by least squares from points that were touched or seen.

    touch:  T_world_base(side) T_base_flange(q) face(side) = place                     a gauge in the world
    meet:   T_world_base(left) T_base_flange(q) face(left) = the same of the right one  both pads, face to face
    see:    T_world_base(side) T_base_flange(q) marker(side) = T_world_tracker place   a marker on the flange

Pure numpy and scipy: nothing here knows a robot. Linear algebra of the deletion of a point and of the covariance as in
Seber and Lee, Linear Regression Analysis (2003), chapters 3 and 10, at the last linearisation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy  # loads its statistics when they are used: half a second
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array

SIDES = ("left", "right")  # as in rtstack.samples
SIGMA_M = 5e-4  # ours: how well a hand meets a gauge, each axis. The scale to begin with; the points give their own
FACE_SD_M = 5e-3  # ours: a pad's face is where the cell's file has it, so well
WRONG_SHARE = 0.01  # how often a point is called wrong in a set that has none
MOST_WRONG = 0.25  # of the points; beyond, no fit is believed
CONFIDENCE = 0.95
FEWEST = 6  # of what is measured beyond what is asked for, coordinates: below it no point can be doubted
# of the median residual as recorded: larger, and so many times that with the sides exchanged
SWAPPED_M, SWAPPED_RATIO = 5e-3, 5.0
STOOD_M, WENT_M = 0.01, 0.05  # an arm that stood while its places went so far apart was not the one that was led
_DRAWS = 1000
STEPS, ROBUST_STEPS = 30, 10  # of the iteration, at most
# what may be unknown, and its coordinates: turn rad and place m, or place alone
GROUPS = {
    "left base": 6, "right base": 6, "tracker": 6, "left pad": 3, "right pad": 3, "left marker": 3, "right marker": 3,
}  # fmt: skip


class CalibrationError(Exception):
    """Points that give no calibration. The message is one line: why, and what to do."""


class SidesSwapped(CalibrationError):
    """What was recorded as the left arm's belongs to the right one."""

    def __init__(self, why: str) -> None:
        super().__init__(
            f"the sides are swapped: {why}. See which arm `rtstack wiggle left` moves, exchange the addresses or "
            "cables, and measure again"
        )


@dataclass(frozen=True, slots=True)
class Observation:
    """One point. side: index in Geometry.sides; flanges (arms, 4, 4): T_base_flange of each arm, m; place (3,): in the
    world, or in the tracker's frame, m."""

    name: str
    what: Literal["touch", "meet", "see"]
    side: int
    flanges: Array
    place: Array


@dataclass(frozen=True, slots=True)
class Geometry:
    """bases (arms, 4, 4): T_world_base; tracker (4, 4): T_world_tracker; faces, markers (arms, 3): in the flange, m;
    sides: of the arms that are there, left before right."""

    bases: Array
    tracker: Array
    faces: Array
    markers: Array
    sides: tuple[str, ...] = SIDES

    def pads(self, flanges: Array) -> Array:
        """Return where each pad's face is in the world, (n, arms, 3) m, for flanges (n, arms, 4, 4)."""
        return _placed(self.bases, _placed(flanges, self.faces))


@dataclass(frozen=True, slots=True)
class Fit:
    """What the points give. groups: what they determine, of GROUPS. residuals m, by the points' names; wrong: those
    that were left out, with theirs.

    rms_m: of the distances that are left; rms_interval_m: 95 % of the spread that the points really have. place_m: in
    95 % of such calibrations no pad, and nothing that the tracker sees, is further off at any of the points than this,
    and turn_rad no base.
    """

    geometry: Geometry
    groups: tuple[str, ...]
    residuals: dict[str, float]
    wrong: dict[str, float]
    rms_m: float
    rms_interval_m: tuple[float, float]
    place_m: float
    turn_rad: float


def calibrate(points: Sequence[Observation], nominal: Geometry) -> Fit:
    """Fit the geometry that the points determine; the rest stays as in `nominal`. Raises CalibrationError."""
    if why := _other_arm_was_led(points, nominal.sides):
        raise SidesSwapped(why)
    problem = _Problem(points, nominal)
    problem.solve(robust=True)
    problem.check()
    if why := _fits_exchanged(problem):
        raise SidesSwapped(why)
    wrong: dict[str, float] = {}
    while True:
        problem.solve()
        problem.check()
        index = problem.doubtful()
        if index is None:
            break
        wrong[problem.points[index].name] = float(problem.distances()[index])
        if len(wrong) > MOST_WRONG * len(points):
            raise CalibrationError(
                f"the points contradict each other ({', '.join(wrong)} and more do not fit the rest): were gauges or "
                "sides mixed up? Measure them again"
            )
        problem = problem.without(index)
    geometry = problem.geometry
    if why := _bases_exchanged(geometry, nominal, problem.groups):
        raise SidesSwapped(why)
    s, low, high = problem.spread()
    place_m, turn_rad = problem.errors()
    residuals = dict(zip((p.name for p in problem.points), problem.distances().tolist(), strict=True))
    return Fit(
        geometry, tuple(problem.groups), residuals, wrong,
        np.sqrt(3.0) * s, (np.sqrt(3.0) * low, np.sqrt(3.0) * high), place_m, turn_rad,
    )  # fmt: skip


class _Problem:
    """The points, what of the geometry they determine, and the geometry so far; J: its last linearisation."""

    def __init__(self, points: Sequence[Observation], nominal: Geometry) -> None:
        if not points:
            raise CalibrationError("there is no point")
        self.points, self.nominal, self._arms = list(points), nominal, tuple(enumerate(nominal.sides))
        self._flanges = np.array([p.flanges for p in points])
        self._places = np.array([p.place for p in points])
        self._sides = np.array([p.side for p in points])
        self._kinds = np.array([p.what for p in points])
        self.groups = self._asked_for()
        self._columns = np.array([name for name in self.groups for _ in range(GROUPS[name])])
        self._priors = np.eye(len(self._columns))[np.char.endswith(self._columns, "pad")] / FACE_SD_M
        self.geometry = self._roughly(self._kinds == "touch")
        self._left, self._J = np.zeros((len(points), 3)), np.zeros((len(points), 3, len(self._columns)))

    def _asked_for(self) -> list[str]:
        names: set[str] = set()
        for point in self.points:
            sides = self.nominal.sides
            own = sides if point.what == "meet" else (sides[point.side],)
            names |= {f"{side} base" for side in own}
            names |= {f"{own[0]} marker", "tracker"} if point.what == "see" else {f"{side} pad" for side in own}
        return [name for name in GROUPS if name in names]

    def _roughly(self, touched: NDArray[np.bool_]) -> Geometry:
        """Return the geometry to begin with: in closed form where there are three places, else the nominal one."""
        bases, tracker = self.nominal.bases.copy(), self.nominal.tracker.copy()
        faces = _placed(self._flanges, self.nominal.faces)
        for side, _ in self._arms:
            own = touched & (self._sides == side)
            if np.sum(own) >= 3:
                bases[side] = _superposed(faces[own, side], self._places[own])
        seen = self._kinds == "see"
        if np.sum(seen) >= 3:
            markers = _placed(bases, _placed(self._flanges, self.nominal.markers))
            tracker = _superposed(self._places[seen], markers[seen, self._sides[seen]])
        return replace(self.nominal, bases=bases, tracker=tracker)

    def _linearised(self) -> Array:
        """Return what is left of each point, (n, 3) m, and keep its derivatives (n, 3, columns)."""
        geometry, left = self.geometry, np.zeros((len(self.points), 3))
        self._J[:] = 0.0
        for kind in ("touch", "see", "meet"):
            held = geometry.markers if kind == "see" else geometry.faces
            for side, arm_name in self._arms:
                rows = np.flatnonzero((self._kinds == kind) & ((self._sides == side) | (kind == "meet")))
                sign = -1.0 if kind == "meet" and side == 1 else 1.0
                base, flanges = geometry.bases[side], self._flanges[rows, side]
                arm = _placed(flanges, held[side]) @ base[:3, :3].T
                left[rows] += sign * (arm + base[:3, 3])
                self._differ(rows, f"{arm_name} base", sign * _turning(arm))
                own = f"{arm_name} {'marker' if kind == 'see' else 'pad'}"
                self._differ(rows, own, sign * base[:3, :3] @ flanges[:, :3, :3])
        touched, seen = np.flatnonzero(self._kinds == "touch"), np.flatnonzero(self._kinds == "see")
        left[touched] -= self._places[touched]
        arm = self._places[seen] @ geometry.tracker[:3, :3].T
        left[seen] -= arm + geometry.tracker[:3, 3]
        self._differ(seen, "tracker", -_turning(arm))
        return left

    def _differ(self, rows: NDArray[np.intp], name: str, derivatives: Array) -> None:
        if len(rows):
            self._J[np.ix_(rows, np.arange(3), np.flatnonzero(self._columns == name))] = derivatives

    def solve(self, robust: bool = False) -> None:
        """Fit by Gauss and Newton's method, from the geometry so far. robust: points that are far off count less."""
        for _ in range(ROBUST_STEPS if robust else STEPS):
            left = self._linearised()
            weight = np.ones(len(left))
            if robust:  # Cauchy's
                weight = 1.0 / np.sqrt(1.0 + np.sum(left**2, axis=1) / (3.0 * SIGMA_M) ** 2)
            J = (self._J * weight[:, None, None]).reshape(-1, len(self._columns)) / SIGMA_M
            off = (self.geometry.faces - self.nominal.faces).ravel() / FACE_SD_M
            off = off[[f"{side} pad" in self.groups for _, side in self._arms for _ in range(3)]]
            right = np.concatenate([(left * weight[:, None]).ravel() / SIGMA_M, off])
            step = -np.linalg.lstsq(np.vstack([J, self._priors]), right, rcond=1e-12)[0]
            self.geometry = self._stepped(step)
            if np.abs(step).max() < 1e-10:
                break
        self._left = self._linearised()

    def _stepped(self, step: Array) -> Geometry:
        """Return the geometry after a step of all that is asked for."""
        bases, tracker = self.geometry.bases.copy(), self.geometry.tracker
        faces, markers = self.geometry.faces.copy(), self.geometry.markers.copy()
        for name in self.groups:
            own = step[self._columns == name]
            if name == "tracker":
                tracker = _moved(tracker, own)
                continue
            side = self.nominal.sides.index(name.split()[0])
            if name.endswith("base"):
                bases[side] = _moved(bases[side], own)
            else:
                (faces if name.endswith("pad") else markers)[side] += own
        return replace(self.geometry, bases=bases, tracker=tracker, faces=faces, markers=markers)

    def check(self) -> None:
        """Raise CalibrationError where the points do not determine what they are about."""
        if 3 * len(self.points) - len(self._columns) + len(self._priors) < FEWEST:
            raise CalibrationError(f"{len(self.points)} points are too few for {', '.join(self.groups)}: measure more")
        J = self._J.reshape(-1, len(self._columns)) / SIGMA_M
        _, singular, V = np.linalg.svd(np.vstack([J, self._priors]))
        if singular[-1] < 1e-6 * singular[0]:
            worst = max(self.groups, key=lambda name: float(np.sum(V[-1][self._columns == name] ** 2)))
            raise CalibrationError(
                f"the points do not say where the {worst} is: touch places that are far apart, with the pads turned"
            )

    def distances(self) -> Array:
        """Return how far each point is from where it should be, (n,) m."""
        return np.linalg.norm(self._left, axis=1)

    def _covariance(self, s: float) -> Array:
        """Return the covariance of the solution for points of the spread s, m."""
        J = self._J.reshape(-1, len(self._columns)) / s
        return np.linalg.inv(J.T @ J + self._priors.T @ self._priors)

    def _hat(self, s: float) -> Array:
        """Return each point's own block of the hat matrix, (n, 3, 3): how much it moves the solution to itself."""
        return self._J @ self._covariance(s) @ self._J.transpose(0, 2, 1) / s**2

    def _freedom(self) -> float:
        """Return how many of the points' coordinates the solution has not used up."""
        return 3 * len(self.points) - float(np.trace(self._hat(SIGMA_M), axis1=1, axis2=2).sum())

    def spread(self) -> tuple[float, float, float]:
        """Return the points' standard deviation along each axis and its 95 % interval, m."""
        freedom, total = self._freedom(), float(np.sum(self._left**2))
        low, high = np.sqrt(total / scipy.stats.chi2.ppf(0.5 + np.array([0.5, -0.5]) * CONFIDENCE, freedom))
        return float(np.sqrt(total / freedom)), float(low), float(high)

    def doubtful(self) -> int | None:
        """Return which point the others contradict most, None where they contradict none. The fit without a point
        leaves r' (I - H)^-1 r less of the sum of squares, which is compared with what the others leave, by the F
        distribution (Bonferroni over the points)."""
        count, freedom, total = len(self.points), self._freedom() - 3.0, float(np.sum(self._left**2))
        if freedom < FEWEST:
            return None
        rest = np.eye(3) - self._hat(SIGMA_M)
        gone = np.einsum("ni,nij,nj->n", self._left, np.linalg.pinv(rest, rcond=1e-9), self._left)
        ratio = (gone / 3.0) / (np.maximum(total - gone, 1e-18) / freedom)
        worst = int(np.argmax(ratio))
        return worst if ratio[worst] > scipy.stats.f.isf(WRONG_SHARE / count, 3.0, freedom) else None

    def without(self, index: int) -> "_Problem":
        """Return the problem without a point."""
        return _Problem([p for k, p in enumerate(self.points) if k != index], self.nominal)

    def exchanged(self) -> "_Problem":
        """Return the problem as it were, had each arm's joints been recorded as the other one's."""
        turned = [Observation(p.name, p.what, p.side, p.flanges[::-1].copy(), p.place) for p in self.points]
        return _Problem(turned, self.nominal)

    def errors(self) -> tuple[float, float]:
        """Return 95 % bounds of how far off a pad, or a marker that the tracker sees, is at the worst of the points, m,
        and of a base's turn, rad."""
        freedom, rng, columns = self._freedom(), np.random.default_rng(0), self._columns
        # Student's: the spread is itself an estimate
        spread = self._covariance(self.spread()[0])
        draws = rng.multivariate_normal(np.zeros(len(columns)), spread, _DRAWS, method="svd")
        draws *= np.sqrt(freedom / rng.chisquare(freedom, _DRAWS))[:, None]
        worst, turn = np.zeros(_DRAWS), np.zeros(_DRAWS)
        for side, name in self._arms:
            if f"{name} base" not in self.groups:
                continue
            step, base = draws[:, columns == f"{name} base"], self.geometry.bases[side]
            own = np.flatnonzero((self._sides == side) | (self._kinds == "meet"))
            flanges, face = self._flanges[own, side], draws[:, columns == f"{name} pad"]
            arms = _placed(flanges, self.geometry.faces[side]) @ base[:3, :3].T
            away = np.einsum("nij,dj->dni", _turning(arms), step)
            if face.size:
                away += np.einsum("nij,dj->dni", base[:3, :3] @ flanges[:, :3, :3], face)
            worst = np.maximum(worst, np.linalg.norm(away, axis=2).max(axis=1))
            turn = np.maximum(turn, np.linalg.norm(step[:, :3], axis=1))
        if "tracker" in self.groups:
            arms = self._places[self._kinds == "see"] @ self.geometry.tracker[:3, :3].T
            away = np.einsum("nij,dj->dni", _turning(arms), draws[:, columns == "tracker"])
            worst = np.maximum(worst, np.linalg.norm(away, axis=2).max(axis=1))
        return float(np.quantile(worst, CONFIDENCE)), float(np.quantile(turn, CONFIDENCE))


def _fits_exchanged(problem: _Problem) -> str:
    """Return why the sides are swapped, where the points fit far better so."""
    recorded = float(np.median(problem.distances()))
    if recorded < SWAPPED_M or len(problem.nominal.sides) == 1:
        return ""
    other = problem.exchanged()
    other.solve(robust=True)
    exchanged = float(np.median(other.distances()))
    if exchanged * SWAPPED_RATIO >= recorded:
        return ""
    return (
        f"the points fit within {1e3 * exchanged:.1f} mm with the arms exchanged, {1e3 * recorded:.1f} mm as recorded"
    )


def _other_arm_was_led(points: Sequence[Observation], sides: Sequence[str]) -> str:
    for side, name in enumerate(sides if len(sides) == 2 else ()):
        own = [p for p in points if p.what == "touch" and p.side == side]
        if len(own) < 3:
            continue
        stood = [np.ptp(np.array([p.flanges[k][:3, 3] for p in own]), axis=0).max() for k in (side, 1 - side)]
        if stood[0] < STOOD_M and np.ptp(np.array([p.place for p in own]), axis=0).max() > WENT_M < stood[1]:
            return f"the {name} arm stood while its pad touched places that are far apart, and the other one moved"
    return ""


def _bases_exchanged(found: Geometry, nominal: Geometry, groups: list[str]) -> str:
    if not {"left base", "right base"} <= set(groups):
        return ""
    at, should = found.bases[:, :3, 3], nominal.bases[:, :3, 3]
    if np.linalg.norm(at - should) <= np.linalg.norm(at - should[::-1]):
        return ""
    return "the left base is found where the right one should be, and the right one at the left one's place"


def _placed(T: Array, p: Array) -> Array:
    """Return the points p (..., 3) of frames T (..., 4, 4) in the frames' parent."""
    return np.einsum("...ij,...j->...i", T[..., :3, :3], p) + T[..., :3, 3]


def _moved(T: Array, step: Array) -> Array:
    """Return T (4, 4), turned by exp(step[:3]) from the left and displaced by step[3:]."""
    moved = T.copy()
    moved[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ T[:3, :3]
    moved[:3, 3] += step[3:]
    return moved


def _turning(arms: Array) -> Array:
    """Return the derivatives (n, 3, 6) of points by a turn and a displacement; arms (n, 3): from the turn's centre."""
    x, y, z = arms.T
    o = np.zeros_like(x)
    turn = np.array([[o, z, -y], [-z, o, x], [y, -x, o]]).transpose(2, 0, 1)
    return np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape)], axis=2)


def _superposed(points: Array, places: Array) -> Array:
    """Return the T (4, 4) that moves points (n, 3) nearest to places (n, 3) (Kabsch 1976)."""
    T = np.eye(4)
    middle, there = points.mean(axis=0), places.mean(axis=0)
    U, _, V = np.linalg.svd((points - middle).T @ (places - there))
    T[:3, :3] = V.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(V.T @ U.T)) or 1.0]) @ U.T
    T[:3, 3] = there - T[:3, :3] @ middle
    return T
