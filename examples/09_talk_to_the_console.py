"""A program in the place of the page: take control, arm, record a demonstration, follow it, fetch the log.

rtstack up                                       # in a terminal of its own: prints an address
rtstack token create --name example --scope operate
python 09_talk_to_the_console.py http://127.0.0.1:8080 TOKEN
"""

import sys
import time
from contextlib import closing
from pathlib import Path

import httpx

BEAT_S = 0.5  # control is lost after 2 s without a sign of life
ACTIVE = ("starting", "running", "stopping")
BUSY = 503


class Console:
    """A signed-in program. It has control while it gives signs of life."""

    def __init__(self, address: str, token: str) -> None:
        headers = {"authorization": f"Bearer {token}"}
        self._http = httpx.Client(base_url=address, headers=headers, timeout=30.0, trust_env=False)

    def post(self, path: str, **body: object) -> dict:
        """Ask for something. A refusal is one line that says why."""
        answer = self._http.post(f"/api/{path}", json=body)
        while answer.status_code == BUSY and path == "beat":  # the robot process answers late: nothing was lost yet
            time.sleep(BEAT_S / 10)
            answer = self._http.post(f"/api/{path}", json=body)
        if answer.is_error:
            sys.exit(f"{path}: {answer.json()['error']}")
        return answer.json()

    def get(self, path: str) -> dict | list:
        """Ask how something is."""
        return self._http.get(f"/api/{path}").raise_for_status().json()

    def run(self, job: str, **body: object) -> dict:
        """Start a job and wait until it is over. Returns the job as the status has it."""
        while "compiling" in (self.post("beat")["refusal"] or ""):  # a first start: runs are refused meanwhile
            time.sleep(BEAT_S)
        status = self.post(f"jobs/{job}", **body)
        while status["job"]["state"] in ACTIVE:
            time.sleep(BEAT_S)
            status = self.post("beat")
        return status["job"]

    def logs(self) -> list[dict]:
        """Return the rows of the list of logs, the newest first."""
        return list(self.get("logs"))

    def download(self, log_id: str, path: Path) -> None:
        """Write a log to a file."""
        path.write_bytes(self._http.get(f"/api/logs/{log_id}/download").content)

    def close(self) -> None:
        """Give nothing back: without signs of life the arms are disarmed by themselves."""
        self._http.close()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python 09_talk_to_the_console.py ADDRESS TOKEN")
    with closing(Console(*sys.argv[1:])) as console:
        console.post("take")
        console.post("arm")
        job = console.run("demonstration", object="rice_box")
        print("demonstration:", job["state"], job["reason"] or "")
        recording = console.logs()[0]["id"]
        job = console.run("trial", reference=recording, object="rice_box", displacement_mm=15.0)
        print("trial:", job["state"], job["reason"] or "")
        console.download(console.logs()[0]["id"], Path("console.mcap"))
        console.post("release")
    print("wrote console.mcap")
