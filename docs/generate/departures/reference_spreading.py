"""Where this code departs from the reference-spreading paper."""

from departures.record import Departure
from rtstack.control.parameters import ControlParameters, DetectorParameters
from rtstack.model.cell_description import Gains
from rtstack.safety.limits import (
    APPROACH_S,
    CONTROL_MEASURED_FRACTION,
    CONTROL_TORQUE_FRACTION,
    FORCES_BY_PHASE,
    HARDWARE,
    control_limits,
)
from rtstack.trials.scoring import SuccessCriterion

_PAPER = "Reference spreading"
_LIMITS, _CONTROL, _DETECTOR = control_limits(HARDWARE)[0], ControlParameters(), DetectorParameters()
_CAMPAIGN = "`rtstack campaign reference-spreading`"

DEPARTURES = (
    Departure(
        _PAPER, "(4), (8), (14)", "the law's inertia is M, that of the links",
        f"a setting, `law_inertia`: by default {Gains().law_inertia}, as in the impact-map paper; the campaigns of "
        "this paper run M, and `with_B_theta` beside it",
        "the motors' inertia as the torque loop leaves it is part of what the torques accelerate",
        f"Table II of both, {_CAMPAIGN}, conditions `nominal` and `with_B_theta`",
    ),
    Departure(
        _PAPER, "(12), (13)", "position and velocity after one tick are within their limits",
        "the distance to a velocity limit that falls to zero before the position limit shrinks with a time constant "
        f"of {1e3 * APPROACH_S:.0f} ms at least, and external torques that drive a joint towards it are braked",
        "the robot's own limit depends on the position, and the torque's rate is limited: after one tick it is too "
        "late to brake ([Limits](limits.md))",
        f"ticks in which a limit of the QP was active: a table of {_CAMPAIGN}",
    ),
    Departure(
        _PAPER, "(14)", "the torque is within tau_max",
        f"within {CONTROL_TORQUE_FRACTION:g} tau_max without gravity, and with it within {CONTROL_MEASURED_FRACTION:g} "
        "of the limit of the measured torque",
        "the measured torque swings about the commanded one",
        "the same table: both kinds of limits are counted together",
    ),
    Departure(
        _PAPER, "(15), (26)", "no limit of the torque's rate",
        f"after the QP the torque changes by {float(_LIMITS['tau_step']):.4f} Nm a tick at most",
        "the robot refuses faster changes (mc_franka limits them in the same place)",
        f"ticks in which it acted: table of {_CAMPAIGN}",
    ),
    Departure(
        _PAPER, "(15), (26)", "least squares of the task errors",
        f"{_CONTROL.regularisation:g} |ddq|^2 is added",
        "keeps the problem definite in a singular posture",
        "below the solver's tolerance (tests/control/test_program.py)",
    ),
    Departure(
        _PAPER, "(19), (20)", "R(T) exp(hat(omega) (t - T_a)), and (T_p - t) in (20)",
        "exp(hat(omega) (t - T)) R(T), with (t - T_p) in (20)",
        "omega is along the inertial axes, so its rotation multiplies from the left; the printed sign turns away from "
        "the recording",
        "on a motion of constant twist, at 0.65 and 0.37 rad/s, the printed forms are 0.064 and 0.075 rad off at the "
        "impact, 0.1 s away; these are exact (tests/references/test_spreading.py)",
    ),
    Departure(
        _PAPER, "Appendix B", "the estimated force as it is",
        f"counted from its mean over the window, where that is {_DETECTOR.tare_n:g} to {_DETECTOR.largest_tare_n:g} N",
        "payload, gravity and friction are never known exactly, and an offset of 4 N blinds the law",
        "an offset of 4 N that blinds the letter changes no detection, and without an offset nothing changes "
        "(tests/control/test_detector.py, decision 59)",
    ),
    Departure(
        _PAPER, "IV-A", "the ante-impact mode lasts until an impact is detected",
        f"until {_CONTROL.impact_patience_s:g} s after the nominal impact at most",
        "an impact that is so late does not come, and a pad must not go on for ever",
        "a trial that waits so long ends with its reason in the table of failures",
    ),
    Departure(
        _PAPER, "V", "a grab succeeds that keeps contact until the release without a safety limit of the robot",
        "besides, no torque was changed by the judge, and from a rise of "
        f"{1e3 * SuccessCriterion().lifted_m:g} mm on the object lags behind the pads by "
        f"{1e3 * SuccessCriterion().slip_m:g} mm at most",
        "a log has to tell what an observer sees",
        "failures by reason: table of each campaign",
    ),
    Departure(
        _PAPER, "V", "the robot's own limits stop a trial",
        "the judge's stop it before: a pad may push with "
        f"{FORCES_BY_PHASE['force_approach_max']:g} N on its way, {FORCES_BY_PHASE['force_contact_max']:g} N before "
        f"and {HARDWARE.force_max:g} N after the impact; in `reference-spreading-panda` with the last one throughout",
        "nothing may hurt a person or a robot",
        "failures by reason: tables of `reference-spreading` and `reference-spreading-panda`",
    ),
    Departure(
        _PAPER, "III-A", "a person with two hand-held controllers",
        "a scripted operator, with scatter of speed, path and time; where its hands come to rest follows from a rule "
        "in the plan (twice the least friction grip, an even stop)",
        "campaigns have to be repeatable; the paper does not say how far the hands go on",
        "the map over hands, `rtstack campaign reference-spreading-hands`",
    ),
    Departure(
        _PAPER, "V", "two Pandas, silicone pads, one trial of ten references",
        "simulated FR3, pads of an assumed stiffness, two trials of 20 references; Pandas in "
        "`reference-spreading-panda`",
        "the wire of a Panda is not spoken here; 20 trials a controller decide little",
        "tables of both campaigns",
    ),
)  # fmt: skip
