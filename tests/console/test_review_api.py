"""The review as a program uses it: search, reading, curves, cursor, comparison. With the guard in front."""

import csv
import json
import os
import time
from datetime import datetime

import httpx
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from console.review.cache import FOLDER, ReviewCache
from console.scene.scenes import Detail
from rtstack.log_folder.catalogue import Catalogue
from tests.support.console.client import socket
from tests.support.console.review_log import SPIKE_S, read, unpacked, write_log
from tests.support.console.served_console import serve_console


def write_logs(served):
    """Write the logs; return their ids by name."""
    for number, (controller, success) in enumerate(
        [("proposed", "true"), ("no_interim", "false"), ("proposed", "false")]
    ):
        trial = {"object": "rice_box", "specification": json.dumps({"controller": controller, "gains": {"k": number}})}
        result = {
            "success": success,
            "failure_reason": "it slipped",
            "seed": str(number + 3),
            "note": "felt <b>soft</b>",
        }
        write_log(served.logs / f"log{number}.mcap", {**trial, "seed": str(number + 3)}, result)
    (served.logs / "none.mcap").write_bytes(b"no log")
    return {entry.path.name: entry.id for entry in Catalogue(served.logs).entries()}


@pytest.fixture
def logs(served):
    """Three logs and a file that is none."""
    return write_logs(served)


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """A client of a console with these logs, and their ids, for tests that only ask; the first log has been read."""
    with serve_console(tmp_path_factory.mktemp("asked")) as served:
        logs = write_logs(served)
        with served.signed_in() as (client, _):
            read(client, logs["log0.mcap"])
            yield client, logs


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ({}, {"log0", "log1", "log2", "none"}),
        ({"q": "no interim"}, {"log1"}),
        ({"q": "no_interim"}, {"log1"}),
        ({"q": "seed:4"}, {"log1"}),
        ({"q": "rice proposed"}, {"log0", "log2"}),
        ({"q": "slipped soft"}, {"log0", "log1", "log2"}),
        ({"q": "proposed", "outcome": "failure"}, {"log2"}),
        ({"outcome": "none"}, {"none"}),
        ({"q": time.strftime("%Y-")}, {"log0", "log1", "log2", "none"}),
        ({"q": "seed:nothing"}, set()),
    ],
)
def test_the_search_is_over_everything_in_the_metadata(asked, query, expected):
    client, _ = asked
    rows = client.get("/api/logs", params=query).raise_for_status().json()
    assert {row["name"].removesuffix(".mcap") for row in rows} == expected


def test_the_list_is_sorted_and_what_has_no_value_comes_last(asked):
    client, _ = asked
    for descending, seeds in ((False, [3, 4, 5, None]), (True, [5, 4, 3, None])):
        rows = client.get("/api/logs", params={"sort": "seed", "descending": descending}).json()
        assert [row["seed"] for row in rows] == seeds
    assert client.get("/api/logs", params={"sort": "path"}).status_code == 422


def test_a_log_is_read_and_its_spike_comes_down(served, logs):
    with served.signed_in() as (client, _):
        log_id = logs["log0.mcap"]
        document = read(client, log_id)
        assert document["duration_s"] == pytest.approx(1.999)
        assert document["trial"]["object"] == "rice_box"
        assert [event["name"] for event in document["events"]] == ["impact"]
        window = {"signals": "left.tau_J.4,timing.period_us", "start": -1, "end": 10, "width": 16}
        found = unpacked(client.get(f"/api/logs/{log_id}/series", params=window).raise_for_status().content)
        assert found["left.tau_J.4"][2].max() == 80.0
        values = client.get(f"/api/logs/{log_id}/values", params={"t": SPIKE_S, "signals": "left.tau_J.4"}).json()
        assert values["values"] == {"left.tau_J.4": 80.0}
        assert np.shape(values["q"]) == (2, 7)
        table = client.get(f"/api/logs/{log_id}/csv", params={"signals": "left.tau_J.4", "start": 1.2, "end": 1.3})
        rows = list(csv.DictReader(table.text.splitlines()))
        (spike,) = (row for row in rows if row["left.tau_J.4"] == "80")
        assert spike["t_s"] == "1.234000"
        times = [datetime.fromisoformat(row["utc"]) for row in rows]  # of a log with samples of /clock
        assert (times[-1] - times[0]).total_seconds() == pytest.approx(0.099, abs=2e-6)
        assert table.headers["content-disposition"] == 'attachment; filename="log0.csv"'
        other_id = logs["log1.mcap"]
        read(client, other_id)
        both = {"signals": "left.tau_J.4", "start": 1.2, "end": 1.3, "other": other_id, "offset": 0.01}
        lines = client.get(f"/api/logs/{log_id}/csv", params=both).text.splitlines()
        assert lines[0] == "t_s,utc,left.tau_J.4,other.left.tau_J.4"
        cells = {(row[0], *row[2:]) for row in csv.reader(lines)}
        assert {
            ("1.234000", "80", "0"),
            ("1.244000", "0", "80"),
        } <= cells  # the other one's spike is as late as it was moved
        assert len(client.get(f"/api/logs/{log_id}/events", params={"level": "INFO"}).json()) == 1
        assert client.get(f"/api/logs/{log_id}/events", params={"level": "ERROR"}).json() == []


@pytest.mark.parametrize(
    ("path", "status", "words"),
    [
        ("series?signals=left.nothing&start=0&end=1", 422, "there is no signal left.nothing"),
        ("series?signals=left.q.1&start=2&end=1", 422, "before `end`"),
        ("series?signals=left.q.1&start=nan&end=1", 422, "start"),
        ("series?signals=left.q.1&start=0&end=1&width=100000", 422, "width"),
        ("values?t=inf", 422, "t:"),
        ("events?level=LOUD", 422, "level: Input should be 'DEBUG'"),
        ("csv?start=0&end=1", 422, "signals"),
        ("difference?other=..%2f..%2fetc", 404, "does not exist"),
    ],
)
def test_bad_questions_get_one_line(asked, path, status, words):
    client, logs = asked
    answer = client.get(f"/api/logs/{logs['log0.mcap']}/{path}")
    assert answer.status_code == status
    assert words in answer.json()["error"]


def test_what_is_no_log_says_so_and_a_log_without_an_end_is_shown(served, logs):
    write_log(served.logs / "cut.mcap", {"object": "rice_box"}, complete=False)
    cut = next(entry.id for entry in Catalogue(served.logs).entries() if entry.path.name == "cut.mcap")
    with served.signed_in() as (client, _):
        assert "being written" in client.get(f"/api/logs/{cut}").json()["error"]
        os.utime(served.logs / "cut.mcap", (0.0, 1e9))
        answer = client.get(f"/api/logs/{logs['none.mcap']}")
        assert answer.status_code == 422
        assert "not a log of rtstack" in answer.json()["error"]
        assert client.get(f"/logs/{'0' * 32}").status_code == 404
        document = read(client, cut)
        assert document["condition"] == "truncated"
        assert document["topics"]["/left/arm"] > 0


def test_two_logs_differ_in_what_was_set(served, logs):
    with served.signed_in() as (client, _):
        path = f"/api/logs/{logs['log0.mcap']}/difference"
        rows = client.get(path, params={"other": logs["log1.mcap"]}).raise_for_status().json()
        assert {(row["key"], row["this"], row["other"]) for row in rows} == {
            ("trial.specification.controller", "proposed", "no_interim"),
            ("trial.specification.gains.k", "0", "1"),
            ("trial.seed", "3", "4"),
            ("cell.pad.size", "3", "4"),
        }
        assert client.get(path, params={"other": logs["log0.mcap"]}).json() == []


def test_the_cursor_answers_with_the_newest_question(served, logs):
    with served.signed_in() as (client, _):
        log_id = logs["log0.mcap"]
        read(client, log_id)
        address = f"/api/logs/{log_id}/scrub?view=a-page-of-mine"
        with socket(served, address, client) as cursor:
            cursor.send(json.dumps({"t": SPIKE_S, "signals": "left.tau_J.4"}))
            answer = json.loads(cursor.recv(timeout=60))
            assert answer["values"] == {"left.tau_J.4": 80.0}
            assert answer["scenes"] == 0
            for t in np.linspace(0.0, 1.5, 200):
                cursor.send(json.dumps({"t": float(t)}))
            while json.loads(cursor.recv(timeout=60))["t"] != 1.5:
                pass
            for bad in ("{", '{"t": "x"}', '{"t": 1, "evil": 1}', '{"t": 1, "signals": "no.such"}'):
                cursor.send(bad)
                assert "error" in json.loads(cursor.recv(timeout=60))
        with pytest.raises(InvalidStatus), socket(served, address):
            pass


def test_the_cache_makes_room_for_the_newest_and_reads_a_changed_log_anew(served, logs):
    cache = ReviewCache(served.logs, limit_bytes=1)
    entries = {entry.path.name: entry for entry in Catalogue(served.logs).entries()}

    def opened(name):
        deadline_s = time.monotonic() + 60.0
        while True:
            found = cache.open(entries[name])
            if found is not None and found.index.done:
                return found
            assert time.monotonic() < deadline_s
            time.sleep(0.05)

    try:
        first = opened("log0.mcap")
        assert cache.open(entries["log0.mcap"]) == first
        opened("log1.mcap")
        assert not first.folder.exists()  # made room
        assert cache.reopened(entries["log0.mcap"].id) is None
        assert cache.reopened(entries["log1.mcap"].id) is not None
        write_log(served.logs / "log1.mcap", {"object": "rice_box"}, spike=-5.0)
        assert cache.reopened(entries["log1.mcap"].id) is None  # it has changed
        entries = {entry.path.name: entry for entry in Catalogue(served.logs).entries()}
        assert opened("log1.mcap").folder.name != first.folder.name
    finally:
        cache.close()
    assert sum(folder.is_dir() for folder in (served.logs / FOLDER).iterdir()) == 1


def test_the_scene_of_a_review_is_not_the_live_one(served, logs):
    with served.signed_in() as (client, _):
        page = client.get("/viser/review/light/a-page-of-mine/")
        assert page.status_code == 200
        assert "<title>Viser</title>" in page.text
        assert client.get("/viser/review/light/short/").status_code == 404
        assert client.get("/viser/review/light/with%20a%20space%20in%20it/").status_code == 404
    assert served.parts.scenes._made == {}
    server = served.parts.review_scenes.server(Detail.LIGHT)
    assert httpx.get(f"http://127.0.0.1:{server.port}/", trust_env=False, timeout=60.0).status_code == 403


def test_who_was_late_is_what_the_review_says(asked):
    client, logs = asked
    found = client.get(f"/api/logs/{logs['log0.mcap']}/lateness").raise_for_status().json()["lateness"]
    assert found["cycles"] == 4000  # of both arms
    assert found["late"] == len(found["worst"]) == 0
    assert found["line"] == "none of 4000 cycles was late"
    assert client.get("/api/logs/none/lateness").status_code == 404
