"""Logs are reached by opaque ids, whatever their names are."""

NASTY = '<img src=x onerror=alert(1)> "quoted".mcap'


def test_a_log_is_listed_and_comes_back_as_it_is(served):
    (served.logs / NASTY).write_bytes(b"not a log" * 100)
    with served.signed_in() as (client, _):
        (row,) = client.get("/api/logs").json()
        assert row["name"] == NASTY
        assert row["outcome"] == "no log of ours"
        assert not row["recording"]
        assert NASTY not in row["id"]
        answer = client.get(f"/api/logs/{row['id']}/download")
        assert answer.status_code == 200
        assert answer.content == b"not a log" * 100
        assert answer.headers["content-disposition"].startswith("attachment")


def test_files_beside_the_logs_are_not_listed(served):
    (served.logs / "notes.txt").write_text("mine")
    with served.signed_in() as (client, _):
        assert client.get("/api/logs").json() == []
        for path in ("/static/../app.py", "/static/%2e%2e/app.py", "/viser/light/%2e%2e/%2e%2e/app.py"):
            assert client.get(path).status_code == 404, path
