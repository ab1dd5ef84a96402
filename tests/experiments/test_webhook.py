"""Who is elsewhere is told what a campaign waits for and how it ended; nothing depends on whether it arrives."""

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import pytest

from rtstack.experiments.progress import campaign_progress
from rtstack.experiments.webhook import Webhook


@pytest.fixture
def listener() -> Iterator[tuple[str, list[dict[str, str]]]]:
    """An address on this machine, and what was sent there."""
    heard: list[dict[str, str]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            heard.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/hook", heard
        server.shutdown()


def test_a_wait_is_told_once_and_again_when_there_is_another(listener, tmp_path):
    url, heard = listener
    notify = Webhook(url, "grabs")
    with campaign_progress(tmp_path, lambda text: notify("waiting", text)) as progress:
        progress.begin("trials", 0, 2)
        for text in ("box: move it 12 mm", "box: move it 3 mm", "", "the arms rest for 60 s more", ""):
            progress.tell(text)
            said = json.loads((tmp_path / "progress.json").read_text()).get("says", "")
            assert said == text
    assert [each["text"] for each in heard] == ["grabs: box: move it 12 mm", "grabs: the arms rest for 60 s more"]


@pytest.mark.long
def test_the_end_of_a_campaign_is_told(listener, command, tmp_path):
    url, heard = listener
    done = command.run(tmp_path / "out", "--workers", "1", "--webhook", url)
    assert done.returncode in (0, 1), done.stderr
    assert [each["event"] for each in heard] == ["ended"]
    assert str(tmp_path / "out" / "report.html") in heard[0]["text"]


def test_an_address_where_nobody_listens_is_said_once_and_one_that_is_none_before_anything(capsys, tmp_path, command):
    notify = Webhook("http://127.0.0.1:9/hook", "grabs")
    notify("waiting", "something")
    notify("ended", "something")
    assert capsys.readouterr().err.count("--webhook http://127.0.0.1:9/hook") == 1
    done = command.run(tmp_path / "out", "--webhook", "nowhere")
    assert done.returncode == 2
    assert "--webhook nowhere: give an address such as" in done.stderr
    assert not (tmp_path / "out").exists()
