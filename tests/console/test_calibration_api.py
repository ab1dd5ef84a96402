"""The calibration over HTTP: points that are taken from the live states, the fit of the terminal, the cell's file."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rtstack.calibration.points import load_points, save_points
from rtstack.cells import default_cell_file, load_description
from rtstack.live.jobs import Jobs
from rtstack.live.protocol import RunRequest
from rtstack.live.source import live_source
from rtstack.model.cell_description import load_cell_description
from rtstack.samples import ARM_SAMPLE, SIDES
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import DemonstrationSpecification
from tests.support.console.client import wait_for
from tests.support.wrong_cell import Wrongness, built, touched_points

CELL = load_description(None)[0]


class Standing:
    """Arms that stand: their states, shown until the end."""

    def __init__(self, rings, q, dq=0.0):
        self.pushers = [rings.pusher(f"/{side}/arm") for side in SIDES]
        self.samples = np.zeros((2, 1), ARM_SAMPLE)
        self.samples["q"][:, 0], self.samples["dq"] = q, dq
        self.samples["O_T_EE"][:] = np.eye(4)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._over.wait(1e-3):
            self.samples["t_ns"] += 1_000_000
            for pusher, sample in zip(self.pushers, self.samples, strict=True):
                pusher.push(sample)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()


@pytest.fixture
def page(served):
    """A console, and a signed-in client that has control."""
    with served.signed_in() as (client, headers):
        assert client.post("/api/take", json={}, headers=headers).status_code == 200
        yield served, client, headers


def found(client):
    wait_for(lambda: not client.get("/api/calibration").json()["looking"])
    return client.get("/api/calibration").json()


def test_a_point_is_added_taken_from_the_states_and_removed(page):
    served, client, headers = page
    body = {"what": "touch", "side": "left", "place": [0.1, 0.2, 0.3]}
    assert client.get("/api/calibration").json()["points"] == []
    added = client.post("/api/calibration/points/a", json=body, headers=headers)
    assert added.status_code == 200, added.text
    (point,) = added.json()["points"]
    assert (point["measured"], point["asked"]) == (
        False, "touch x 0.1000, y 0.2000, z 0.3000 m with the middle of the left pad's face",
    )  # fmt: skip
    q = np.array([CELL.left.home, CELL.right.home])
    silent = client.post("/api/calibration/points/a/take", json={}, headers=headers)
    assert (silent.status_code, silent.json()["error"][:21]) == (409, "the arms say nothing:")
    with Standing(served.rings, q):
        wait_for(lambda: max(served.parts.watch.view.left.age_s, served.parts.watch.view.right.age_s) < 0.5)
        taken = client.post("/api/calibration/points/a/take", json={}, headers=headers)
    assert taken.json()["points"][0]["measured"], taken.text
    kept = load_points(served.logs / "calibration.toml")["a"]
    np.testing.assert_allclose(np.array([kept.q_left, kept.q_right], dtype=float), q, atol=1e-6)
    assert "1 points are too few" in found(client)["why"]
    assert client.delete("/api/calibration/points/a", headers=headers).json()["points"] == []
    assert not (served.logs / "calibration.toml").exists()


def test_what_cannot_be_taken_is_refused_with_one_line(page):
    served, client, headers = page
    place = {"what": "touch", "side": "right", "place": [0.1, 0.2, 0.3]}
    refused = client.post("/api/calibration/points/a", json={"what": "touch", "side": "left"}, headers=headers)
    assert refused.status_code == 422
    assert "place: Field required" in refused.json()["error"]
    assert client.post("/api/calibration/points/a", json=place, headers=headers).status_code == 200
    again = client.post("/api/calibration/points/a", json=place, headers=headers)
    assert (again.status_code, again.json()["error"]) == (409, "there is a point a already: remove it first")
    with Standing(served.rings, np.zeros((2, 7)), dq=0.1):
        wait_for(lambda: max(served.parts.watch.view.left.age_s, served.parts.watch.view.right.age_s) < 0.5)
        moving = client.post("/api/calibration/points/a/take", json={}, headers=headers)
    assert (moving.status_code, moving.json()["error"][:14]) == (409, "the arms move:")
    assert client.post("/api/calibration/points/b/take", json={}, headers=headers).status_code == 404
    assert client.delete("/api/calibration/points/b", headers=headers).status_code == 404
    assert "no point" in client.post("/api/calibration/write", json={}, headers=headers).json()["error"]
    assert client.post("/api/release", json={}, headers=headers).status_code == 200
    without = client.post("/api/calibration/points/a/take", json={}, headers=headers)
    assert (without.status_code, without.json()["error"]) == (409, "no operator has control; take control first")


def test_the_fit_is_shown_with_the_wrong_point_and_written_into_the_cells_file(page):
    served, client, headers = page
    real = built(CELL, np.random.default_rng(0), Wrongness(pad_m=0.0))
    points = touched_points(CELL, real, 3e-4)
    bad = next(name for name, point in points.items() if point.what == "touch")
    x, y, z = points[bad].place or (0.0, 0.0, 0.0)
    points[bad] = replace(points[bad], place=(x, y + 0.03, z))
    save_points(served.logs / "calibration.toml", points)
    view = found(client)
    assert view["why"] is None
    assert [point["name"] for point in view["points"] if point["wrong"]] == [bad]
    assert view["lines"][0].startswith("rms 0.")
    assert view["date"] is None
    written = client.post("/api/calibration/write", json={}, headers=headers)
    assert written.status_code == 200, written.text
    description = load_cell_description(served.parts.calibration._file)
    assert description.calibration is not None
    assert written.json()["date"] == description.calibration.date.isoformat()
    assert np.abs(np.array(description.right.base_position) - real.bases[1][:3, 3]).max() < 2e-3


def test_fits_of_points_that_were_overtaken_are_not_made(page):
    served, _, _ = page
    path = served.logs / "calibration.toml"
    asked = []
    for seed in range(8):
        real = built(CELL, np.random.default_rng(seed), Wrongness(pad_m=0.0))
        save_points(path, touched_points(CELL, real, 3e-4))
        asked.append(served.parts.questions.ask("calibration", path, "2026-01-01"))
    assert sum(question.done() for question in asked) >= 4  # two are begun, another one where these have not yet
    assert not asked[-1].done()


def test_what_is_too_coarse_is_not_written(page):
    served, client, headers = page
    real = built(CELL, np.random.default_rng(1), Wrongness(pad_m=0.0))
    save_points(served.logs / "calibration.toml", touched_points(CELL, real, 4e-3))
    assert "above 3 mm, not used" in found(client)["why"]
    before = served.parts.calibration._file.read_bytes()
    refused = client.post("/api/calibration/write", json={}, headers=headers)
    assert refused.status_code == 409
    assert served.parts.calibration._file.read_bytes() == before


def test_no_job_is_begun_where_the_cells_file_was_changed_since_the_start(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_bytes(default_cell_file().read_bytes())
    source = live_source(path)
    nothing: Any = None
    jobs = Jobs(source, nothing, nothing, nothing, nothing, (), nothing)
    source.check()
    path.write_text(path.read_text(encoding="utf-8").replace("[-0.4, 0.5, 0.0]", "[-0.41, 0.5, 0.0]"), encoding="utf-8")
    with pytest.raises(TrialError, match="was changed since the stack was started: end it and start it again"):
        jobs.run(RunRequest(DemonstrationSpecification(), "anna"), tmp_path / "log.mcap")
