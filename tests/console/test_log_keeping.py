"""What people do with logs over HTTP: find by ranges, star, tag, note, delete, and bring back."""

import json
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from console.orders import TrialOrder
from console.queue.entry import Entry
from rtstack.access.tokens import Scope
from rtstack.log_folder.remarks import mark_reviewed, may_go
from rtstack.log_folder.trash import FOLDER
from tests.support.console.review_log import read, write_log

COMMAND = Path(sys.executable).with_name("rtstack")


@pytest.fixture
def keeper(served):
    """Three trials with forces of 10, 40 and 70, a client, and what it does."""
    for number in range(3):
        write_log(
            served.logs / f"log{number}.mcap",
            {"kind": "trial", "object": "rice_box", "seed": str(number)},
            {"success": "true", "average_force_norm": str(10.0 + 30.0 * number)},
        )
    with served.signed_in() as (client, headers):
        yield Keeper(served, client, headers)


class Keeper:
    def __init__(self, served, client, headers):
        self.served, self.client, self.headers = served, client, headers

    def names(self, **query):
        return {row["name"][:-5] for row in self.client.get("/api/logs", params=query).raise_for_status().json()}

    def id_of(self, name):
        return next(row["id"] for row in self.client.get("/api/logs").json() if row["name"] == f"{name}.mcap")

    def post(self, path, **body):
        return self.client.post(f"/api/{path}", json=body, headers=self.headers)


def test_ranges_of_numbers_are_found_and_what_means_nothing_is_refused_in_a_line(keeper):
    assert keeper.names(q="force>30") == {"log1", "log2"}
    assert keeper.names(q="force>30 force<=40 rice") == {"log1"}
    assert keeper.names(q="seed<1") == {"log0"}
    assert keeper.names(q="size>1000") == set()  # MB
    for wrong, says in (
        ("force>much", "q: force>much: a range is a name, a sign and a number without spaces, such as force>30"),
        ("force>", "q: force>: a range"), (">30", "q: >30: a range"), ("force>nan", "q: force>nan: a range"),
        ("colour>3", "q: colour>3: no log has a number colour"),
    ):  # fmt: skip
        answer = keeper.client.get("/api/logs", params={"q": wrong})
        assert (answer.status_code, answer.json()["error"].startswith(says)) == (422, True), answer.json()


def test_a_star_tags_and_a_note_stand_beside_the_log_and_are_found(keeper):
    log_id = keeper.id_of("log1")
    said = {"starred": True, "tags": ["figure-5", "slow"], "note": "the box \u201cslipped\u201d a little"}
    row = keeper.post(f"logs/{log_id}/remarks", **said).json()
    assert {key: row[key] for key in said} == said
    beside = keeper.served.logs / "log1.mcap.remarks.json"
    assert json.loads(beside.read_text()) == said
    assert keeper.names(q="figure-5") == keeper.names(q="slipped") == keeper.names(q="starred:true") == {"log1"}
    row = keeper.post(f"logs/{log_id}/remarks", **said, verdict="discard").json()
    assert (row["episode_verdict"], row["verdict"]) == ("discard", None)  # a person's, and the monitor's
    assert json.loads(beside.read_text()) == {**said, "verdict": "discard"}
    assert keeper.names(q="verdict:discard") == {"log1"}
    log = keeper.served.logs / "log1.mcap"
    mark_reviewed(log, "anna")
    assert not may_go(log)  # a star keeps it
    for wrong in ({"tags": ["two words"]}, {"tags": ["x"] * 17}, {"note": "n" * 2001}, {"stars": 3}, {"starred": 0},
                  {"verdict": "good"}, {"verdict": ""}):  # fmt: skip
        assert keeper.post(f"logs/{log_id}/remarks", **wrong).status_code == 422, wrong
    assert keeper.post(f"logs/{log_id}/remarks").json()["starred"] is False
    assert not beside.exists()  # nothing to say is no file
    assert keeper.post("logs/..%2Fetc/remarks").status_code == 404
    beside.write_text("broken")
    assert keeper.names() == {"log0", "log1", "log2"}


def test_a_deleted_log_comes_back_whole_or_is_removed_for_good(keeper):
    served, log_id = keeper.served, keeper.id_of("log2")
    content = (served.logs / "log2.mcap").read_bytes()
    keeper.post(f"logs/{log_id}/remarks", tags=["keep"])
    read(keeper.client, log_id)
    assert list((served.logs / ".review").glob(f"{log_id}-*"))
    trashed = keeper.post(f"logs/{log_id}/delete").raise_for_status().json()
    assert keeper.names() == {"log0", "log1"}
    assert not list((served.logs / ".review").glob(f"{log_id}-*"))
    assert not list(served.logs.glob("log2*"))
    held = keeper.client.get("/api/trash").json()
    assert ([each["name"] for each in held["logs"]], held["size_bytes"]) == (["log2.mcap"], len(content))

    (served.logs / "log2.mcap").write_bytes(b"another one")
    assert keeper.post(f"trash/{trashed['id']}/restore").status_code == 409
    (served.logs / "log2.mcap").unlink()
    row = keeper.post(f"trash/{trashed['id']}/restore").raise_for_status().json()
    assert (row["id"], row["tags"]) == (log_id, ["keep"])
    assert (served.logs / "log2.mcap").read_bytes() == content
    assert keeper.post(f"trash/{trashed['id']}/restore").status_code == 404
    assert keeper.post("trash/..%2F..%2Fetc/restore").status_code in (404, 422)

    keeper.post(f"logs/{log_id}/delete")
    young = subprocess.run(
        [COMMAND, "logs", "prune", "--logs", served.logs, "--budget", "1"], capture_output=True, check=True
    )
    assert b"log2" not in young.stdout  # it was deleted less than a week ago
    assert keeper.post("trash/empty").json()["logs"] == []
    assert list((served.logs / FOLDER).iterdir()) == []


def test_what_is_in_use_is_not_deleted_nor_by_who_may_only_look(keeper, demonstration):
    served = keeper.served
    write_log(served.logs / "growing.mcap", {"kind": "trial"}, complete=False)
    (served.logs / "ref.mcap").write_bytes(demonstration.path.read_bytes())
    growing, reference, plain = (keeper.id_of(name) for name in ("growing", "ref", "log0"))
    served.parts.queue._entries = [Entry("0" * 16, TrialOrder(reference, object="rice_box"), "ref")]
    for log_id, why in ((growing, "it is being written"), (reference, "trials in the queue follow it")):
        answer = keeper.post(f"logs/{log_id}/delete")
        assert (answer.status_code, answer.json()["error"].startswith(why)) == (409, True), answer.json()
    served.parts.queue._entries = []
    assert keeper.post(f"recordings/{reference}", verdict="accepted").status_code == 200
    assert "reject it first" in keeper.post(f"logs/{reference}/delete").json()["error"]
    cookies, headers = served.second_session(Scope.VIEW)
    with httpx.Client(base_url=served.base, cookies=cookies, headers=headers, trust_env=False) as viewer:
        for path in (f"logs/{plain}/delete", f"logs/{plain}/remarks", "trash/empty"):
            assert viewer.post(f"/api/{path}", json={}).status_code == 403
    assert keeper.names() == {"log0", "log1", "log2", "growing", "ref"}
