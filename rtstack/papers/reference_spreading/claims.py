"""The paper's claims, one by one, with what this campaign says about each."""

from rtstack.experiments.claims import Claim, ClaimStatus, order, shown
from rtstack.experiments.statistics import Interval
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.evaluation import BASELINES, FIGURE11, TABLE2, Evaluation, Table2Line
from rtstack.papers.reference_spreading.names import NAMES, millimetres

PROPOSED = Controller.PROPOSED
NO_RS, NO_VELOCITY, NO_INTERIM = BASELINES


MUCH = 0.5  # of the other one at most: much lower
MINOR = 0.1  # of the highest force norm at most: a minor peak


def judge_claims(evaluation: Evaluation) -> list[Claim]:
    """Return every claim that this campaign can say something about."""
    claims: list[Claim] = []
    if evaluation.of(FIGURE11):
        claims += _figure11(evaluation)
    if evaluation.of(TABLE2):
        claims += _table2(evaluation)
    if evaluation.rows:
        claims += _peaks(evaluation)
    return claims


def _figure11(evaluation: Evaluation) -> list[Claim]:
    claims = []
    for d in evaluation.displacements():
        force = {controller: evaluation.mean_force(controller, d) for controller in NAMES}
        claims.append(
            Claim(
                "Figure 11",
                f"at {millimetres(d)} the proposed controller has the lowest mean force norm",
                _each(force),
                order((force[PROPOSED], force[baseline]) for baseline in BASELINES),
            )
        )
    for baseline in (NO_RS, NO_INTERIM):
        forces = [(evaluation.mean_force(PROPOSED, d), evaluation.mean_force(baseline, d)) for d in (-30.0, 30.0)]
        gain = [
            f"{100.0 * (1.0 - p.mean / b.mean):.0f} % at {d:+d} mm"
            for d, (p, b) in zip((-30, 30), forces, strict=True)
            if p and b
        ]
        verdict = order(forces)
        claims.append(
            Claim(
                "issue",
                f"its 95 % intervals at -30 and 30 mm lie apart from those of “{NAMES[baseline].lower()}”",
                f"lower by {' and '.join(gain)}; intervals {'apart' if verdict is ClaimStatus.HOLDS else 'not apart'}",
                verdict,
            )
        )
    at_zero = {controller: evaluation.mean_force(controller, 0.0) for controller in NAMES}
    if at_zero[PROPOSED] is not None:
        claims.append(
            Claim(
                "V, p. 11",
                "even at 0 mm the force norms without reference spreading and without interim mode are high",
                _each(at_zero),
                order((at_zero[PROPOSED], at_zero[baseline]) for baseline in (NO_RS, NO_INTERIM)),
            )
        )
    return claims


def _each(intervals: dict[Controller, Interval | None]) -> str:
    return "; ".join(f"{NAMES[controller].lower()} {shown(interval)}" for controller, interval in intervals.items())


def _table2(evaluation: Evaluation) -> list[Claim]:
    lines = {line.controller: line for line in evaluation.table2()}
    success = {c: line.success for c, line in lines.items()}
    lift = {c: line.lift_mm for c, line in lines.items()}
    shares = {c: interval.mean for c, interval in success.items() if interval is not None}
    # a share of 100 % for all tells nothing about an order
    alike = len(set(shares.values())) < 2
    fewest = (
        ClaimStatus.UNDECIDED if alike else order((success[NO_VELOCITY], success[c]) for c in lines if c != NO_VELOCITY)
    )
    best = max(shares.values(), default=0.0)
    highest = max((row["peak_torque_ratio"] or 0.0 for row in evaluation.of(TABLE2)), default=0.0)
    why = (
        f"The highest joint torque of these trials was {100.0 * highest:.0f} % of its limit: simulated arms and pads "
        "leave more room than the paper's. The campaign reference-spreading-sensitivity looks for where grabs fail."
    )
    lift_why = (
        "The object rises with the pads as soon as both hold it, at their 0.12 to 0.16 m/s: ten milliseconds between "
        "two controllers are 1.5 mm. The paper's differences need a contact that slips for a tenth of a second."
    )
    percent = "; ".join(f"{NAMES[c].lower()} {shown(i, ' %', 0, 100.0)}" for c, i in success.items())
    return [
        Claim("Table II", "no velocity feedback has the fewest successful grabs", percent, fewest, why),
        Claim(
            "Table II",
            "the proposed controller's success is not below any baseline's",
            percent,
            ClaimStatus.WITHIN
            if alike
            else ClaimStatus.HOLDS
            if shares.get(PROPOSED, 0.0) >= best
            else ClaimStatus.DIFFERS,
        ),
        Claim(
            "Table II",
            "no velocity feedback has the lowest lift",
            _lifts(lines),
            order((lift[NO_VELOCITY], lift[c]) for c in lines if c != NO_VELOCITY),
            lift_why,
        ),
        Claim(
            "Table II",
            "lift: no reference spreading > proposed > no interim mode",
            _lifts(lines),
            order([(lift[PROPOSED], lift[NO_RS]), (lift[NO_INTERIM], lift[PROPOSED])]),
            lift_why,
        ),
    ]


def _lifts(lines: dict[Controller, Table2Line]) -> str:
    return "; ".join(f"{NAMES[c].lower()} {shown(line.lift_mm, ' mm', 2)}" for c, line in lines.items())


def _share_at_most(share: float, part: Interval | None, whole: Interval | None) -> ClaimStatus:
    """The status of "the part is at most this share of the whole"."""
    if part is None or whole is None:
        return ClaimStatus.UNDECIDED
    return ClaimStatus.HOLDS if part.mean <= share * whole.mean else ClaimStatus.DIFFERS


def _at(when: Interval | None) -> str:
    return f" at {when.mean:+.0f} ms" if when is not None else ""


def _peaks(evaluation: Evaluation) -> list[Claim]:
    mean = evaluation.mean
    step = {c: mean(c, "largest_step") for c in NAMES}
    when = {c: mean(c, "largest_step_ms") for c in NAMES}
    to_interim, to_post = mean(PROPOSED, "step_to_interim"), mean(PROPOSED, "step_to_post")
    at_switch = {c: mean(c, "step_to_post") for c in NAMES}
    peak = {c: mean(c, "delay_peak") for c in NAMES}
    delay, share = mean(PROPOSED, "detection_delay_ms"), mean(PROPOSED, "delay_peak_velocity_share")
    swing = {c: mean(c, "swing_m_s") for c in NAMES}
    settled = {c: mean(c, "settled_ms") for c in NAMES}
    window = {c: mean(c, "peak_in_window") for c in NAMES}
    steps = "; ".join(f"{NAMES[c].lower()} {shown(step[c])}{_at(when[c])}" for c in NAMES)
    return [
        Claim(
            "Figures 8, 10",
            "the desired force jumps without reference spreading (at T_r) and without interim mode (at the detection), "
            "not with the proposed controller",
            f"largest change of the desired wrenches from one tick to the next, N: {steps}",
            order((step[PROPOSED], step[c]) for c in (NO_RS, NO_INTERIM)),
        ),
        Claim(
            "IV-B",
            "both switches of the proposed controller are continuous",
            f"ante-impact to interim {shown(to_interim)}, interim to post-impact {shown(to_post)} N from one tick to "
            f"the next; no interim mode {shown(at_switch[NO_INTERIM])}",
            order((own, at_switch[NO_INTERIM]) for own in (to_interim, to_post)),
        ),
        Claim(
            "V, p. 8",
            "the proposed controller's only peak is a minor one, from the delay of the detection",
            f"from contact to detection {shown(delay, ' ms')}; meanwhile the force norm rises by "
            f"{shown(peak[PROPOSED])}, {shown(share, ' %', 0, 100.0)} of it velocity feedback, as it does without "
            f"reference spreading ({shown(peak[NO_RS])}) and without interim mode ({shown(peak[NO_INTERIM])}): until "
            "the detection all three are one controller, and nothing is gained or lost",
            _share_at_most(MINOR, peak[PROPOSED], window[PROPOSED]),
        ),
        Claim(
            "Figure 10",
            "without velocity feedback the force peak is much lower than without reference spreading",
            f"largest change at the switch: {shown(at_switch[NO_VELOCITY])} against "
            f"{shown(at_switch[NO_RS])}; highest force norm {shown(window[NO_VELOCITY])} against "
            f"{shown(window[NO_RS])}",
            _share_at_most(MUCH, at_switch[NO_VELOCITY], at_switch[NO_RS]),
            "The jump is that of the feedforward: ante-impact references ask for no force, post-impact ones for the "
            "demonstration's grip of some 40 N a pad. Without reference spreading the same grip offsets half of the "
            "velocity error's jump.",
        ),
        Claim(
            "VI",
            "the highest desired force around the impact is lower than without reference spreading or interim mode",
            "highest force norm in the 200 ms: " + "; ".join(f"{NAMES[c].lower()} {shown(window[c])}" for c in NAMES),
            order((window[PROPOSED], window[c]) for c in (NO_RS, NO_INTERIM)),
            "With both it is highest in the post-impact mode, a tenth of a second or more after the detection: the "
            "demonstration's grip, and how far the pads are from their places by then. It tells little of the impact.",
        ),
        Claim(
            "Figure 8",
            "without velocity feedback the pad vibrates most after the impact",
            "peak to peak, m/s: " + "; ".join(f"{NAMES[c].lower()} {shown(swing[c], digits=3)}" for c in NAMES),
            order((swing[c], swing[NO_VELOCITY]) for c in NAMES if c is not NO_VELOCITY),
        ),
        Claim(
            "V, p. 10",
            "contact is established latest without velocity feedback, soonest without reference spreading",
            "from first contact to lasting contact of both pads, ms: "
            + "; ".join(f"{NAMES[c].lower()} {shown(settled[c], digits=0)}" for c in NAMES),
            order(
                [*((settled[c], settled[NO_VELOCITY]) for c in NAMES if c is not NO_VELOCITY),
                 *((settled[NO_RS], settled[c]) for c in NAMES if c is not NO_RS)]
            ),
            "Mean over all displacements: the pads vibrate (Figure 8), and do not leave the object for it.",
        ),
    ]  # fmt: skip
