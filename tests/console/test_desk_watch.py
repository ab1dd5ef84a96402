"""The page's panel about Desk: what both boxes say, without a password, and what a person has to do."""

import contextlib

from console.live.watch import DeskWatch
from hal.desk import Trust
from hal.desk.power import start, stop
from tests.support.console.client import wait_for
from tests.support.desk import desk_address, desk_of
from tests.support.fci.server import serve


def test_the_panel_follows_both_boxes(tmp_path):
    trust = Trust(tmp_path)
    with serve("--lockstep", "--desk") as served:
        left, right = map(desk_address, (served.left, served.right))
        watch = DeskWatch({"left": left, "right": right}, trust)
        wait_for(lambda: "was not used before: run `rtstack desk status`" in watch.views[0].line)
        with contextlib.closing(desk_of(served.left, trust)) as desk:
            wait_for(
                lambda: watch.views[0].line.startswith("brakes locked, FCI inactive, Execution, self-test in 24.0 h")
            )
            list(start(desk, trust, left))
            wait_for(lambda: watch.views[0].ready)
            assert watch.views[0].todo == ()
            assert not watch.views[1].ready
            list(stop(desk, trust, left))
            wait_for(lambda: not watch.views[0].ready)
        watch.close()


def test_a_cell_without_desk_asks_for_nothing():
    watch = DeskWatch({"left": "", "right": ""})
    watch.close()
    assert watch.views == ()
