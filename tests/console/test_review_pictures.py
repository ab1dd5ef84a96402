"""The pictures of a log's cameras in the review: when there are some, and the one at the cursor."""

import pytest

from tests.support.console.review_log import MS, read, stamped_pictures, time_in, write_log

TRIAL = {"kind": "trial", "object": "rice_box", "seed": "1", "specification": "{}"}


@pytest.fixture
def log_id(served):
    """Of a log of two seconds with two cameras."""
    write_log(served.logs / "seen.mcap", TRIAL, pictures=stamped_pictures({"front": 33, "side": 100}))
    write_log(served.logs / "unseen.mcap", TRIAL)
    with served.signed_in() as (client, _):
        rows = {row["name"]: row["id"] for row in client.get("/api/logs").json()}
        read(client, rows["seen.mcap"])
        read(client, rows["unseen.mcap"])
        yield client, rows["seen.mcap"], rows["unseen.mcap"]


def test_the_picture_at_a_moment_is_the_newest_one_of_its_camera(log_id):
    client, seen, unseen = log_id
    times = client.get(f"/api/logs/{seen}/cameras").raise_for_status().json()["cameras"]
    assert {name: len(each) for name, each in times.items()} == {"front": 61, "side": 20}
    assert times["front"][:2] == pytest.approx([0.0, 0.033])
    for name, t, at_ms in (("front", 0.0659, 33), ("front", 0.066, 66), ("side", 1.999, 1900), ("side", -1.0, 0)):
        answer = client.get(f"/api/logs/{seen}/cameras/{name}", params={"t": t}).raise_for_status()
        assert (answer.headers["content-type"], time_in(answer.content)) == ("image/jpeg", at_ms * MS)
    assert client.get(f"/api/logs/{unseen}/cameras").json() == {"cameras": {}}
    for log, name in ((seen, "roof"), (unseen, "front")):
        assert client.get(f"/api/logs/{log}/cameras/{name}", params={"t": 0.0}).status_code == 404
