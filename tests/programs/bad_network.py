"""Commands of teleoperation over a bad network: none that is old or out of order is applied, and STOP comes through.

    python -m tests.programs.bad_network [--commands 10000] [--stops 30] [--cuts 10] [--seed 1] [--json FILE]

Console and operator are two network namespaces, joined by a cable that delays each packet by 0 to 100 ms, loses 5 %,
repeats 2 %, and lets packets overtake each other. The operator's program has eight WebSockets, and sends 200 commands a
second by one after the other; 5 % of them twice, 5 % forged besides (a picture that never was, a time to come, a time
long past, a sequence of before, a foreign sender without a session). Its clock is an hour ahead. Both processes are of
one machine, so that the true age of a command is known: the mailbox is watched from outside, and the time at which a
command is seen in it, less the time at which it was made, is its age. A clutch that went quiet ends the teleoperation,
as it has to; it is begun again.

STOP is sent beside that flood over a WebSocket on the console's side, as {"stop": true}: from before it is sent to the
loop's first stopping tick, so that its arrival is in between. Then the cable is cut: from there to the first stopping
tick, 350 ms are allowed. The operator's signs of life for the lease come from the console's side.

Exit status 1 where one of this does not hold, 3 without network namespaces.
"""

import argparse
import json
import os
import random
import re
import signal
import ssl
import subprocess
import sys
import threading
import time
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np
import psutil
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin

from rtstack.live.standalone import find_rings
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET
from rtstack.samples import Mode
from tests.support.console.operator_scene import Witness
from tests.support.console.stack import COMMAND, SoakFailed
from tests.support.network import relay
from tests.support.network.namespaces import Namespace, NotPermitted, permitted
from tests.support.network.relay import Cable, set_cable

CONSOLE, OPERATOR = "10.78.1.1", "10.78.1.2"
NOT_PERMITTED = 3  # exit status
GOOD, BAD = Cable(), Cable(jitter_ms=100.0, loss=0.05, duplication=0.02, reordering=1.0)
CUT = Cable(after=1, cut="all")
SOCKETS, TRIES = 8, 3
PERIOD_S = 0.005
TWICE = FORGED = 0.05
AHEAD_S = 3600.0
SWAY_M = 0.004
PATIENCE_S = 120.0
ALLOWED_MS, STOP_MS, DEAD_MAN_MS = 100.0, 20.0, 350.0
ENDED = ("done", "stopped", "failed")


def operate(base: str, cookie: str, authority: str, seed: int) -> None:
    """Be the operator's program, until stdin ends: print each command that was made, and what was answered."""
    draw, trusting = random.Random(seed), ssl.create_default_context(cafile=authority)
    address = base.replace("https", "wss") + "/api/teleoperation/hand"
    name = f"far-{os.getpid()}"  # another one in each run: the console remembers how far a sender has counted
    lock = threading.Lock()
    newest = {"picture": 0, "seen_ms": 0.0}
    over = threading.Event()

    def now_ms() -> float:
        return 1e3 * (time.monotonic() + AHEAD_S)

    def open_socket(tries: int = TRIES):
        try:
            return connect(
                address, ssl=trusting, origin=Origin(base), additional_headers={"cookie": cookie}, proxy=None,
                compression=None, open_timeout=PATIENCE_S, ping_interval=None,
            )  # fmt: skip
        except (WebSocketException, OSError):
            if not tries:
                raise
            time.sleep(1.0)  # as the page does
            return open_socket(tries - 1)

    def listen(socket) -> None:
        try:
            for text in socket:
                answer = json.loads(text)
                with lock:
                    if answer["picture"] > newest["picture"]:
                        newest.update(picture=answer["picture"], seen_ms=now_ms())
        except WebSocketException:
            over.set()

    sockets = [open_socket() for _ in range(SOCKETS)]
    for socket in sockets:
        threading.Thread(target=listen, args=(socket,), daemon=True).start()
        socket.send("{}")
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    while not newest["picture"]:
        time.sleep(0.01)
    began_s = time.monotonic()
    due_s = began_s
    for sequence, socket in enumerate(cycle(sockets), start=1):
        if over.is_set():
            break
        due_s += PERIOD_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        up = SWAY_M * np.sin(2.0 * np.pi * 0.5 * (due_s - began_s))
        hand = [0.0, 0.35, 0.26 + up, 1.0, 0.0, 0.0, 0.0]
        with lock:
            saw = dict(newest)
        stamp = {"sender": name, "sequence": sequence, "made_ms": now_ms(), **saw}
        message = {"clutch": True, "hands": {"left": hand}, "stamp": stamp}
        texts = [json.dumps(message)] * (2 if draw.random() < TWICE else 1)
        print(json.dumps([sequence, time.monotonic_ns()]), flush=True)
        if draw.random() < FORGED:
            lie = draw.choice(
                [{"picture": saw["picture"] + 10**6}, {"made_ms": now_ms() + 1e4}, {"made_ms": 0.0}, {"sequence": 0}]
            )
            forged = {"left": [0.0, 0.35, 0.4, 1.0, 0.0, 0.0, 0.0]}
            texts.append(json.dumps({"clutch": True, "hands": forged, "stamp": stamp | lie}))
        try:
            for text in texts:
                socket.send(text)
        except WebSocketException:
            break


class Applied:
    """Watches the mailbox, each half millisecond: which command is in it, and when it was first seen there."""

    def __init__(self, mailbox: Mailbox) -> None:
        self._mailbox = mailbox
        self._began_ns = time.monotonic_ns()  # what was applied before is still in the mailbox
        self.seen: list[tuple[int, int]] = []  # sequence, monotonic ns
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        target = np.zeros(1, TARGET)
        while not self._over.wait(0.0005):
            now_ns = time.monotonic_ns()
            if not self._mailbox.read_target(target):
                continue
            sequence, clutch_ns = int(target["sequence"][0]), int(target["clutch_ns"][0])
            if clutch_ns > self._began_ns and (not self.seen or self.seen[-1][0] != sequence):
                self.seen.append((sequence, now_ns))

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()


class Lab:
    """The stack in one namespace, the operator in another, and the cable."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.console, self.operator = Namespace(), Namespace()
        ends = (self.console.connect(CONSOLE), self.operator.connect(OPERATOR))
        self._relay = subprocess.Popen(
            [sys.executable, relay.__file__, *map(str, ends), str(seed)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=ends,
        )  # fmt: skip
        for end in ends:
            os.close(end)
        self.set(GOOD)
        self._folder = folder
        self._stack = self.console.start(
            COMMAND, "up", "--port", "0", "--https", "--host", CONSOLE, "--logs", folder / "logs",
            stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_CONFIG_HOME": str(folder)},
        )  # fmt: skip
        assert self._stack.stdout is not None
        found = re.search(r"(https://\S+?)/\?token=(\S+)", self._stack.stdout.readline())
        if found is None:
            raise SoakFailed("the stack did not come up: see above")
        self.base, token = found.groups()
        self.authority = folder / "rtstack" / "https" / "authority.pem"
        self.trusting = ssl.create_default_context(cafile=str(self.authority))
        self.console.enter()  # this thread, and those that it starts
        self.client = httpx.Client(base_url=self.base, verify=self.trusting, trust_env=False, timeout=60.0)
        page = self.client.get("/", params={"token": token}, follow_redirects=True).raise_for_status().text
        word = re.search(r'name="csrf-token" content="([^"]+)"', page)
        assert word is not None
        self._headers = {"x-csrf-token": word.group(1), "origin": self.base}
        self.cookie = "; ".join(f"{name}={value}" for name, value in self.client.cookies.items())
        for process in psutil.Process(self._stack.pid).children():
            words = process.cmdline()
            if "--listener" in words:
                self.rings = Rings.attach(find_rings(Path(words[words.index("--run") + 1])))
                self.mailbox = Mailbox.attach(f"{words[words.index('--name') + 1]}-mailbox")
        self.witness = Witness(self.rings)
        self._over = threading.Event()
        self._alive = threading.Thread(target=self._live, daemon=True)
        self._alive.start()

    def _live(self) -> None:
        with self.socket("/live") as live:
            while not self._over.is_set():
                live.recv(timeout=PATIENCE_S)
                live.send("beat")

    def socket(self, path: str):
        """Open a WebSocket from the console's side."""
        return connect(
            self.base.replace("https", "wss") + path, ssl=self.trusting, origin=Origin(self.base), proxy=None,
            additional_headers={"cookie": self.cookie}, ping_interval=None,
        )  # fmt: skip

    def set(self, cable: Cable) -> None:
        """Change the cable."""
        set_cable(self._relay, cable)

    def post(self, path: str, **body: object) -> None:
        """Make a change. Raises SoakFailed."""
        answer = self.client.post(f"/api/{path}", json=body, headers=self._headers)
        if answer.is_error:
            raise SoakFailed(f"{path}: {answer.text}")

    def job(self) -> str:
        """Return the state of the newest job."""
        job = self.client.get("/api/status").raise_for_status().json()["job"]
        return "done" if job is None else job["state"]

    def begin(self) -> None:
        """Begin a teleoperation, and wait until the arms can be led."""
        self.wait(lambda: self.job() in ENDED, "the last job does not end")
        status = self.client.get("/api/status").json()
        if status["holder"] is None:
            self.post("take", operator="far")
        if status["phase"] == "fault":
            self.post("recover")
        self.post("arm")
        self.witness.begin()
        self.post("jobs/teleoperation", object="rice_box", stop_on_release=False)
        told = self.rings.reader("/right/control")
        self.wait(lambda: (r := told.latest()) is not None and r["mode"][0] == Mode.TELEOPERATION, "nothing begins")

    def wait(self, reached, what: str) -> None:
        """Wait until something is so. Raises SoakFailed."""
        until_s = time.monotonic() + PATIENCE_S
        while not reached():
            if time.monotonic() > until_s:
                raise SoakFailed(what)
            time.sleep(0.005)

    def far(self, seed: int) -> subprocess.Popen:
        """Start the operator's program."""
        words = (self.base, self.cookie, self.authority, str(seed))
        return self.operator.start(
            sys.executable, "-m", "tests.programs.bad_network", "--operate", *words,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def close(self) -> list[str]:
        """End all of it."""
        self._over.set()
        self._alive.join()
        self.witness.close()
        self.client.close()
        self._stack.send_signal(signal.SIGINT)
        self._stack.communicate(timeout=60.0)
        self._relay.communicate(timeout=60.0)
        self.mailbox.close()
        self.rings.close()
        self.console.close()
        self.operator.close()
        return [f"exit status {self._stack.returncode}"] if self._stack.returncode else []


class Flood:
    """The operator's program, and what it made."""

    def __init__(self, lab: Lab, seed: int) -> None:
        self._process = lab.far(seed)
        self.made: dict[int, int] = {}
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            sequence, made_ns = json.loads(line)
            self.made[sequence] = made_ns

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait(timeout=60.0)
        self._thread.join()


def commands(lab: Lab, count: int, seed: int, report: dict, trouble: list[str]) -> None:
    """Send commands over the bad cable, and judge those that were applied."""
    made = applied = quiet = 0
    ages: list[float] = []
    unordered, forged = 0, 0
    dropped = np.zeros(4, int)
    while made < count:
        lab.set(GOOD)
        lab.begin()
        flood, seen = Flood(lab, seed + quiet), Applied(lab.mailbox)
        lab.wait(lambda flood=flood: len(flood.made) > 50, "the operator's program does not begin")
        lab.set(BAD)
        lab.wait(lambda flood=flood, left=count - made: len(flood.made) >= left or lab.witness.stopped, "no command")
        quiet += lab.witness.stopped
        dropped += lab.client.get("/api/teleoperation/hand").json()["dropped"]
        flood.close()
        seen.close()
        if not lab.witness.stopped:
            lab.post("teleoperation/finish")
        sequences = np.array([sequence for sequence, _ in seen.seen])
        ages += [(at_ns - flood.made[k]) * 1e-6 for k, at_ns in seen.seen if k in flood.made]
        forged += sum(k not in flood.made for k in sequences.tolist())
        unordered += int((np.diff(sequences) <= 0).sum())
        made += len(flood.made)
        applied += len(sequences)
    oldest = max(ages, default=0.0)
    report["commands"] = {
        "made": made, "applied": applied, "older_than_allowed": int(sum(age > ALLOWED_MS for age in ages)),
        "oldest_ms": round(oldest, 1), "p50_ms": round(float(np.median(ages)), 1), "out_of_order": unordered,
        "forged_applied": forged, "dropped_old_order_picture_other": dropped.tolist(), "clutch_went_quiet": quiet,
    }  # fmt: skip
    if oldest > ALLOWED_MS or unordered or forged:
        trouble.append("a command was applied that must not be")


def stops(lab: Lab, count: int, seed: int, report: dict, trouble: list[str]) -> None:
    """Stop beside the flood, over and over."""
    delays: list[float] = []
    while len(delays) < count:
        lab.set(GOOD)
        lab.begin()
        flood = Flood(lab, seed)
        lab.wait(lambda flood=flood: len(flood.made) > 100, "the operator's program does not begin")
        with lab.socket("/api/teleoperation/hand") as near:
            lab.set(BAD)
            time.sleep(0.3)
            if not lab.witness.stopped:
                began_ns = time.monotonic_ns()
                near.send('{"stop": true}')
                lab.wait(lambda: lab.witness.stopped, "STOP does not come through")
                first_ns, last_ns = lab.witness.seen_ns()
                if first_ns >= began_ns:
                    delays.append((last_ns - began_ns) * 1e-6)
        flood.close()
    report["stop"] = {"stops": len(delays), **percentiles(delays)}
    if report["stop"]["p99_ms"] > STOP_MS:
        trouble.append(f"STOP: p99 {report['stop']['p99_ms']:g} ms, {STOP_MS:g} ms are allowed")


def cuts(lab: Lab, count: int, seed: int, report: dict, trouble: list[str]) -> None:
    """Cut the cable while the arms are led."""
    delays: list[float] = []
    for _ in range(count):
        lab.set(GOOD)
        lab.begin()
        flood = Flood(lab, seed)
        lab.wait(lambda flood=flood: len(flood.made) > 100, "the operator's program does not begin")
        began_ns = time.monotonic_ns()
        lab.set(CUT)
        lab.wait(lambda: lab.witness.stopped, "the arms go on")
        delays.append((lab.witness.seen_ns()[1] - began_ns) * 1e-6)
        flood.close()
    report["network_cut"] = {"cuts": len(delays), **percentiles(delays)}
    if max(delays) > DEAD_MAN_MS:
        trouble.append(f"cut: {max(delays):.0f} ms, {DEAD_MAN_MS:g} ms are allowed")


def percentiles(delays: list[float]) -> dict[str, float]:
    """Return the median, the 99th percentile and the worst, ms."""
    names = ("p50_ms", "p99_ms", "worst_ms")
    return dict(zip(names, np.percentile(delays, (50, 99, 100)).round(1).tolist(), strict=True))


def main() -> int:
    """Measure, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", type=int, default=10_000)
    parser.add_argument("--stops", type=int, default=30)
    parser.add_argument("--cuts", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the report here, too")
    parser.add_argument("--operate", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.operate:
        base, cookie, authority, seed = options.operate
        operate(base, cookie, authority, int(seed))
        return 0
    try:
        permitted()
    except NotPermitted as error:
        print(error, file=sys.stderr)
        return NOT_PERMITTED
    report: dict = {"load": [round(os.getloadavg()[0], 1)]}
    trouble: list[str] = []
    with TemporaryDirectory() as folder:
        lab = None
        try:
            lab = Lab(Path(folder), options.seed)
            for part, count in ((commands, options.commands), (stops, options.stops), (cuts, options.cuts)):
                if count:
                    part(lab, count, options.seed, report, trouble)
        except (SoakFailed, RuntimeError, httpx.HTTPError, WebSocketException) as failed:
            trouble.append(str(failed).splitlines()[0])
        except KeyboardInterrupt:
            trouble.append("ended early: this is what there is so far")
        finally:
            if lab is not None:
                trouble += lab.close()
    report |= {"load": [*report["load"], round(os.getloadavg()[0], 1)], "trouble": trouble}
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if trouble else 0


if __name__ == "__main__":
    sys.exit(main())
