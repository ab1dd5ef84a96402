"""The gate of teleoperation, with a network that delays, loses, repeats and reorders: in simulated time, exact."""

from dataclasses import replace
from random import Random

import pytest

from console.teleoperation.gate import OLDEST_COMMAND_S, OLDEST_PICTURE_S, Drop, Gate
from rtstack.teleoperation.stamp import Stamp

MS = 1_000_000
COMMANDS, PERIOD_MS, PICTURE_MS = 10_000, 20, 50
JITTER_MS, LOSS, REPEATED, FORGED = 100.0, 0.05, 0.05, 0.05


def stamp(sequence=1, made_ms=0.0, picture=1, seen_ms=0.0, sender="a"):
    return Stamp(sender, sequence, made_ms, picture, seen_ms)


@pytest.mark.parametrize("ahead_ms", [0.0, 4e6])
def test_no_old_command_and_none_out_of_order_is_applied_by_a_bad_network(ahead_ms):
    """Each picture and each command is delayed by 0 to 100 ms; the sender's clock is ahead of ours, and drifts."""
    draw = Random(1)

    def own_ms(at_ms):
        return ahead_ms + at_ms * (1.0 + 50e-6)

    pictures = [k * PICTURE_MS for k in range(COMMANDS * PERIOD_MS // PICTURE_MS)]  # when each is made
    seen_at = [made_ms + JITTER_MS * draw.random() for made_ms in pictures]
    sent = []  # comes at, made at, stamp, forged
    for k in range(1, COMMANDS):
        made_ms = k * PERIOD_MS + JITTER_MS
        shown = [n for n in range(max(0, int(made_ms) // PICTURE_MS - 4), len(pictures)) if seen_at[n] <= made_ms]
        if not shown or draw.random() < LOSS:
            continue
        newest = max(shown)
        said = stamp(k, own_ms(made_ms), newest, own_ms(seen_at[newest]))
        for _ in range(1 + (draw.random() < REPEATED)):
            sent.append((made_ms + JITTER_MS * 1.3 * draw.random(), made_ms, said, False))
        if draw.random() < FORGED:
            invented = draw.choice(
                [{"picture": 10**9}, {"made_ms": 0.0}, {"made_ms": said.made_ms + 1e4}, {"sequence": 0}]
            )
            sent.append((made_ms + JITTER_MS * draw.random(), made_ms, replace(said, **invented), True))
    gate, applied, last = Gate(), 0, -1
    for came_ms, made_ms, said, forged in sorted(sent, key=lambda one: one[0]):
        picture_ms = pictures[said.picture] if said.picture < len(pictures) else None
        picture_ns = None if picture_ms is None else round(picture_ms * MS)
        admission = gate.admit("anna", said, picture_ns, round(came_ms * MS))
        if admission.drop is None:
            assert not forged
            assert came_ms - made_ms <= 1e3 * OLDEST_COMMAND_S + 1e-3
            assert said.sequence > last
            assert -1e-3 < admission.latest_ns / MS - made_ms < came_ms - made_ms + 2.001  # ms: two clocks drift
            assert made_ms - picture_ms <= 1e3 * OLDEST_PICTURE_S
            applied += 1
            last = said.sequence
    assert applied > 0.2 * COMMANDS  # what such a jitter leaves in order
    assert gate.dropped[Drop.OLD] > 0
    assert gate.dropped[Drop.ORDER] > 0
    assert gate.dropped[Drop.OTHER] > 0
    assert sum(gate.dropped) == len(sent) - applied


def test_each_reason_is_counted_and_only_an_old_picture_leaves_a_sign_of_life():
    gate = Gate()
    cases = [
        (stamp(1, 10.0), 0, 20 * MS, None),
        (stamp(1, 10.0), 0, 21 * MS, Drop.ORDER),
        (stamp(2, 30.0), 0, 141 * MS, Drop.OLD),
        (stamp(3, 300.0), 0, 310 * MS, Drop.PICTURE),
        (stamp(4, 320.0), None, 330 * MS, Drop.OTHER),
        (None, 0, 330 * MS, Drop.OTHER),
        (stamp(5, 9_000.0), 0, 340 * MS, Drop.OTHER),  # made in nine seconds
        (stamp(1, 340.0, 2, 335.0, sender="b"), 330 * MS, 345 * MS, None),
    ]
    for said, picture_ns, now_ns, drop in cases:
        admission = gate.admit("anna", said, picture_ns, now_ns)
        assert admission.drop is drop, said
        assert admission.alive is (drop in (None, Drop.PICTURE))
        assert (admission.text == "") is (drop is None)
    assert gate.dropped == [1, 1, 1, 3]


def test_a_clock_that_was_set_costs_one_command():
    gate = Gate()
    for k, ahead_ms, drop in ((1, 0.0, None), (2, 5_000.0, Drop.OTHER), (3, 5_000.0, None), (4, 5_000.0, None)):
        at_ms = 20.0 * k
        said = stamp(k, ahead_ms + at_ms, k, ahead_ms + at_ms - 1.0)
        assert gate.admit("anna", said, round((at_ms - 5.0) * MS), round((at_ms + 2.0) * MS)).drop is drop


def test_another_operators_sender_of_the_same_name_is_another_one():
    gate = Gate()
    assert gate.admit("anna", stamp(5, 10.0), 0, 20 * MS).drop is None
    assert gate.admit("ben", stamp(1, 10.0), 0, 20 * MS).drop is None
