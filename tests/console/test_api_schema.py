"""The HTTP interface against its own description: schemathesis asks a console that really serves, with arms that do
each order at once. `make program NAME=deeper ARGS=fuzz-api` asks for longer (RTSTACK_FUZZ_SECONDS).
"""

import json
import os
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager

import httpx
import pytest

from console.routes.description import OPENAPI_PATH
from rtstack.access.tokens import Scope
from rtstack.live.protocol import JobState
from tests.support.console.review_log import read, write_log

SECONDS = int(os.environ.get("RTSTACK_FUZZ_SECONDS", "0"))  # for each way of asking; 0: a number of examples instead,
FEW = ("--generation-deterministic", "--max-examples", "2")  # so that every machine asks the same
REVOKE = "/api/tokens/{token_id}"
COMPUTES = ("campaigns_start", "campaigns_resume", "jobs_begin_preview")  # for hours, or a trial's time

# what a schema cannot say: a window that ends before it begins, a signal or a range that is none, lines of 422; and
# where schemathesis reads a pattern too loosely: its \p{C} is control characters, not what is unassigned or private
SETTINGS = """
[dictionaries.logs]
values = {logs}
[dictionaries.signals]
values = ["left.tau_J.4", "timing.period_us,right.q.1", "left.force_norm"]
[dictionaries.objects]
values = ["rice_box", "parcel"]
[parameters]
log_id = {{ dictionary = "logs", probability = 0.7 }}
other = {{ dictionary = "logs", probability = 0.7 }}
reference = {{ dictionary = "logs", probability = 0.7 }}
signals = {{ dictionary = "signals", probability = 0.7 }}
object = {{ dictionary = "objects", probability = 0.7 }}
[[operations]]
include-path-regex = "/api/(logs/.*|layouts/.*|queue/sweep.*|plans)"
[operations.checks]
positive_data_acceptance.expected-statuses = ["2xx", 401, 403, 404, 409, 422]
[[operations]]
include-path-regex = "/api/(take|tokens|policy/lease|recordings/.*)$"
[operations.checks]
positive_data_acceptance.expected-statuses = ["2xx", 401, 403, 404, 409, 422, 503]
"""


@contextmanager
def obliging_arms(job_manager):
    """Carry every order out at once."""
    ending = threading.Event()

    def work():
        while not ending.wait(0.02):
            order, _ = job_manager.collect()
            if order is not None:
                job_manager.started("x.mcap")
                job_manager.finished(JobState.DONE, None, True, "x.mcap")

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


@pytest.mark.long
@pytest.mark.timeout(4 * SECONDS + 400)
def test_no_request_breaks_the_console_and_every_answer_is_as_described(served, demonstration, tmp_path):
    for number in range(2):
        write_log(served.logs / f"log{number}.mcap", {"object": "rice_box", "seed": str(number)}, {"success": "true"})
    shutil.copy(demonstration.path, served.logs / "recording.mcap")
    (served.logs / "none.mcap").write_bytes(b"no log")
    _, word = served.parts.sign_in.tokens.create("fuzzer", Scope.OPERATE)
    headers = {"authorization": f"Bearer {word}"}
    settings = tmp_path / "schemathesis.toml"
    with (
        httpx.Client(base_url=served.base, headers=headers, trust_env=False, timeout=60.0) as client,
        obliging_arms(served.job_manager),
    ):
        rows = client.get("/api/logs").raise_for_status().json()
        for row in rows:
            if row["name"].startswith("log"):
                read(client, row["id"])
        settings.write_text(SETTINGS.format(logs=json.dumps([row["id"] for row in rows])))

        def ask(*options):
            command = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(settings), "--no-color", "run"]
            command += [served.base + OPENAPI_PATH, "--header", f"Authorization: Bearer {word}", "--checks", "all"]
            command += ["--continue-on-failure", "--warnings", "off", *options]
            command += [] if SECONDS else FEW
            return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

        # without the request by which it might take its own token away; that one comes last, by itself
        left_out = [word for name in COMPUTES for word in ("--exclude-operation-id", name)]
        left_out += ["--exclude-path", REVOKE]
        limit = ("--max-time", str(SECONDS)) if SECONDS else ()
        answers = [ask(*left_out, "--phases", "fuzzing", *limit)]
        if SECONDS:
            answers.append(ask(*left_out, "--phases", "coverage", *limit))
            # its links are guesses by name, a token's id for a row's: what is refused then says nothing
            guessed = ("--exclude-checks", "positive_data_acceptance")
            answers.append(ask(*left_out, *guessed, "--phases", "stateful", *limit))
        assert client.get("/api/me").status_code == 200  # or all that it asked was refused
        answers.append(ask("--include-path", REVOKE, "--phases", "coverage"))
        for asked in answers:
            print(asked.stdout)
        for asked in answers:
            assert (asked.returncode, "No issues found" in asked.stdout) == (0, True), asked.stdout[-6000:]
