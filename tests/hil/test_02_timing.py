"""02 timing: what of the answers comes in time. Figures everywhere; marks against metal, with --marks."""

from dataclasses import replace

from rtstack.bench.link import GOOD_SUCCESS, bench_link
from rtstack.model.cell_description import CellDescription

TICKS = 2000
MARK_TICKS = 10_000
LATEST_ANSWER_US = 300.0  # from a state to its answer at p99: the rest of the millisecond is for network and robot


def test_answers_come_in_time(robot, open_arms, cell: CellDescription, record_property) -> None:
    with open_arms("") as arms:
        ticks = TICKS if robot.simulated else MARK_TICKS
        # each arm answered by itself, as two control boxes have to be
        figures = bench_link(arms if robot.simulated else replace(arms, own_clocks=True), ticks, cell)
    for name, value in figures.as_dict().items():
        if name not in ("cell",):
            record_property(name, value)
    if robot.simulated:  # a robot that waits loses nothing, however slow this machine is
        assert figures.success_rate_min == (1.0, 1.0)
        assert figures.missed_states == (0, 0)
        assert figures.verdict == "pass"
    elif robot.marks:
        assert min(figures.success_rate_mean) >= GOOD_SUCCESS
        assert max(figures.answer_us_p99) <= LATEST_ANSWER_US
