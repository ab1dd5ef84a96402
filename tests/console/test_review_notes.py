"""Notes at times of a log over HTTP: they stand beside it, not in it."""

import json

from rtstack.log_folder.remarks import sidecars
from tests.support.console.review_log import write_log

SAID = [{"t_s": 1.234, "text": "the right pad \u201cslips\u201d"}, {"t_s": 0.5, "text": "quiet"}]


def test_notes_stand_beside_the_log_until_there_are_none(served):
    log = served.logs / "noted.mcap"
    write_log(log, {"kind": "trial", "object": "rice_box", "seed": "1"})
    before = log.read_bytes()
    with served.signed_in() as (client, headers):
        (row,) = client.get("/api/logs").json()
        path = f"/api/logs/{row['id']}/notes"
        assert client.get(path).json() == []
        assert client.post(path, json=SAID, headers=headers).json() == SAID
        assert client.get(path).json() == SAID
        assert [beside.name for beside in sidecars(log)] == ["noted.mcap.notes.json"]  # goes to the trash with the log
        assert json.loads(sidecars(log)[0].read_text()) == SAID
        for wrong in (
            {"t_s": -1.0, "text": "x"},
            {"t_s": 1.0, "text": ""},
            {"t_s": 1.0, "text": "x" * 401},
            {"t_s": 1.0},
        ):
            refused = client.post(path, json=[wrong], headers=headers)
            assert refused.status_code == 422, wrong
        assert client.post(path, json=[]).status_code == 403  # without the session's word
        assert client.post(path, json=[], headers=headers).json() == []
        assert sidecars(log) == []
        assert client.get("/api/logs/none/notes").status_code == 404
    assert log.read_bytes() == before
