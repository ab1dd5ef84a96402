"""The monitor's tick, compiled: equations and Algorithm 1 of the collision-monitoring paper.

Where the paper leaves a choice: (10)-(12) count for all impacts so far, an unexpected verdict stays, and an envelope's
window never reaches behind the last impact (read to the letter, (15) with the algorithm's m_k would reach one tick
behind it, into the phase that the reset is there to leave out). Times are whole ns, so that ticks can be counted.
"""

import math

from hal.compilation import compiled
from rtstack.monitor.records import LONGEST_WINDOW, Reason, Verdict

_NONE, _EXPECTED, _UNEXPECTED = int(Verdict.NONE), int(Verdict.EXPECTED), int(Verdict.UNEXPECTED)
_TIME, _CONFIGURATION, _SPACING = int(Reason.TIME), int(Reason.CONFIGURATION), int(Reason.SPACING)
_ENVELOPE, _NO_IMPACT, _NO_REASON = int(Reason.ENVELOPE), int(Reason.NO_IMPACT), int(Reason.NONE)
_ROWS = LONGEST_WINDOW + 1


@compiled
def monitor_expect(states, t_d_ns, q_d):
    """Forget everything and expect one (simultaneous) impact at t_d_ns in the configuration q_d (n,) rad."""
    state = states[0]
    state.expecting = 1
    state.t_d_ns = t_d_ns
    state.verdict = _NONE
    state.reason = _NO_REASON
    state.joint = -1
    state.margin = 1.0
    state.instantaneous = _NONE
    state.post_impact = _NONE
    state.impact = 0
    state.impacts = 0
    state.t_first_ns = 0
    state.t_impact_ns = 0
    state.since_impact = 0
    state.ticks = 0
    state.head = 0
    state.instantaneous_margin = 1.0
    state.window_margin = math.inf
    for i in range(q_d.shape[0]):
        state.q_d[i] = q_d[i]
        state.rate[i] = state.error[i] = state.lower[i] = state.upper[i] = 0.0


@compiled
def monitor_step(states, parameters, t_ns, residual, q, dq, dq_ref):
    """Take a tick into states[0], (1,) of monitor_dtype, with the tuning parameters[0], (1,) of parameters_dtype.

    residual (n,) Nm of either sign; q, dq (n,) measured; dq_ref (n,) the post-impact reference (14). t_ns increases.
    Nothing is judged before `monitor_expect`.
    """
    state = states[0]
    p = parameters[0]
    period_ns = t_ns - state.t_ns
    state.impact = 0
    if _rises(state, p, period_ns, residual):
        state.impact = 1
    for i in range(dq.shape[0]):
        state.error[i] = dq[i] - dq_ref[i]
    gap_ns = t_ns - state.t_impact_ns
    if state.impact != 0:
        _restart(state, t_ns)
    elif state.impacts > 0:
        _envelope(state, p, period_ns)
    state.ticks += 1
    state.t_ns = t_ns
    if state.expecting != 0 and state.verdict != _UNEXPECTED:
        _judge(state, p, t_ns, gap_ns, q)


@compiled
def _rises(state, p, period_ns, residual):
    """(8), (9): the rate of a joint's residual reaches its bound, and had not in the tick before."""
    rises = False
    for i in range(residual.shape[0]):
        before = abs(state.rate[i])
        rate = (residual[i] - state.residual[i]) / (period_ns * 1e-9) if state.ticks > 0 else 0.0
        if abs(rate) >= p.residual_rate[i] and before < p.residual_rate[i]:
            rises = True
        state.rate[i] = rate
        state.residual[i] = residual[i]
    return rises


@compiled
def _restart(state, t_ns):
    """An impact: envelopes and window begin anew."""
    if state.impacts == 0:
        state.t_first_ns = t_ns
    state.impacts += 1
    state.t_impact_ns = t_ns
    state.since_impact = 0
    state.head = 0
    for i in range(state.error.shape[0]):
        state.history[0, i] = state.lower[i] = state.upper[i] = state.error[i]


@compiled
def _envelope(state, p, period_ns):
    """(15), (16) over the ticks since the last impact, m_max + 1 at most."""
    state.since_impact += 1
    state.head = (state.head + 1) % _ROWS
    back = min(state.since_impact, p.window)
    fade = min(p.decay * period_ns * 1e-9, 1.0)  # a gap in the ticks fades the old envelope out, and no further
    for i in range(state.error.shape[0]):
        low = high = state.error[i]
        for k in range(1, back + 1):
            x = state.history[(state.head - k + _ROWS) % _ROWS, i]
            low = min(low, x)
            high = max(high, x)
        state.history[state.head, i] = state.error[i]
        state.lower[i] = min(low, (1.0 - fade) * state.lower[i] + fade * low)
        state.upper[i] = max(high, (1.0 - fade) * state.upper[i] + fade * high)


@compiled
def _judge(state, p, t_ns, gap_ns, q):
    """Algorithm 1."""
    if state.impact != 0:
        _instantaneous(state, p, t_ns, gap_ns, q)
    if state.impacts == 0:
        missing = 1.0 - (t_ns - state.t_d_ns) / p.time_ns
        if missing < 0.0:
            state.verdict = state.instantaneous = _UNEXPECTED
            state.reason = _NO_IMPACT
            state.margin = missing
        return
    since_ns = t_ns - state.t_impact_ns
    if state.post_impact == _NONE:
        if since_ns >= p.delay_ns:
            _time_window(state, p)
        if state.post_impact == _NONE and since_ns > p.horizon_ns:
            state.post_impact = _EXPECTED
    state.margin = min(state.instantaneous_margin, state.window_margin)
    if since_ns > p.horizon_ns and state.post_impact != _NONE:
        state.verdict = max(state.instantaneous, state.post_impact)


@compiled
def _instantaneous(state, p, t_ns, gap_ns, q):
    """(10)-(12) for this impact; what an earlier one has not met stays so."""
    square = 0.0
    for i in range(q.shape[0]):
        square += (q[i] - state.q_d[i]) ** 2
    time = 1.0 - abs(t_ns - state.t_d_ns) / p.time_ns
    configuration = 1.0 - math.sqrt(square) / p.configuration
    spacing = 1.0 - gap_ns / p.spacing_ns if state.impacts > 1 else 1.0
    state.instantaneous_margin = min(state.instantaneous_margin, time, configuration, spacing)
    state.window_margin = math.inf
    if state.instantaneous != _UNEXPECTED:
        state.instantaneous = _UNEXPECTED
        state.joint = -1
        # asked this way round, so that a configuration that is no number is none that was meant
        if not time >= 0.0:
            state.reason = _TIME
        elif not configuration >= 0.0:
            state.reason = _CONFIGURATION
        elif not spacing >= 0.0:
            state.reason = _SPACING
        else:
            state.instantaneous = _EXPECTED
            state.reason = _NO_REASON
    state.post_impact = _NONE if state.instantaneous == _EXPECTED else _UNEXPECTED


@compiled
def _time_window(state, p):
    """(17): zero lies within every joint's envelope, widened by e_m."""
    for i in range(state.error.shape[0]):
        margin = 1.0 + min(state.upper[i], -state.lower[i]) / p.velocity
        state.window_margin = min(state.window_margin, margin)
        if not margin >= 0.0 and state.post_impact == _NONE:
            state.post_impact = _UNEXPECTED
            state.reason = _ENVELOPE
            state.joint = i
