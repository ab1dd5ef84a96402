"""Panels of another package: each in a process of its own, answered in time or by one line; tokens for one of them."""

import os
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import httpx
import psutil
import pytest

from console.panels import Panels
from tests.support.console.client import wait_for
from tests.support.console.served_console import ServedConsole
from tests.support.plugin import installed

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"
NAMES = (
    "shows",
    "raises",
    "sleeps",
    "spins",
    "holds",
    "dies",
    "sends",
    "fills",
    "counts",
    "text",
    "absent",
    "quits",
    "typed",
)
OFFERS = "[rtstack.panels]\n" + "".join(f"{name} = panels_of_lab:{name.upper()}\n" for name in NAMES)
MODULE = """
import os, time
from rtstack.live.panel import Panel, PanelView


def shows(view: PanelView) -> dict:
    view.live["state"]["word"] += "!"
    print("what a panel prints goes nowhere")
    return {"word": view.live["state"]["word"], "logs": sorted(path.name for path in view.logs.glob("*.json*"))}


def raises(view):
    return {}["force"]


def sleeps(view):
    time.sleep(100.0)


def spins(view):
    while True:
        pass


def holds(view):
    return sum(range(10**12))  # comes back to no signal, and keeps the lock of the interpreter


def dies(view):
    os._exit(7)


def sends(view):
    return {1, 2}


def fills(view):
    return "x" * 3_000_000


def counts(view):
    return float("nan")


SHOWS, RAISES, SLEEPS, SPINS, HOLDS, DIES, SENDS, FILLS, COUNTS = (
    Panel(function.__name__.title(), "<p>shown</p>", function, 0.2)
    for function in (shows, raises, sleeps, spins, holds, dies, sends, fills, counts)
)
TEXT = "no panel"


def __getattr__(name):
    if name == "TYPED":
        return Panel("Typed", None, shows)
    if name == "QUITS":
        raise SystemExit("not today")
    raise AttributeError(f"no {name}")
"""
WHERE = "lab-tools 1.2, panels_of_lab.py"
LINES = {
    "raises": f"panel 'raises': KeyError: 'force' ({WHERE}:13); mend it there, or uninstall the package",
    "sleeps": f"panel 'sleeps': TimeoutError: takes longer than 2 s ({WHERE}:17)",
    "spins": f"panel 'spins': TimeoutError: takes longer than 2 s ({WHERE}:",
    "holds": "panel 'holds' of lab-tools 1.2: its process has ended, or did not answer within 5 s; it is started again",
    "dies": "panel 'dies' of lab-tools 1.2: its process has ended, or did not answer within 5 s; it is started again",
    "sends": f"panel 'sends': TypeError: Object of type set is not JSON serializable ({WHERE}:33)",
    "fills": f"panel 'fills': TypeError: data: 2929 KiB are too many, at most 1024 ({WHERE}:37)",
    "counts": f"panel 'counts': TypeError: data: Out of range float values are not JSON compliant ({WHERE}:41)",
    "text": "panel 'text': panels_of_lab:TEXT of lab-tools 1.2 is str, not Panel",
    "absent": "panel 'absent': panels_of_lab:ABSENT of lab-tools 1.2 cannot be loaded: AttributeError: no ABSENT",
    "quits": "panel 'quits': panels_of_lab:QUITS of lab-tools 1.2 cannot be loaded: SystemExit: not today",
    "typed": "panel 'typed': panels_of_lab:TYPED of lab-tools 1.2 cannot be loaded: TypeError: a Panel takes a title",
}


@pytest.fixture
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Install the package."""
    with installed(tmp_path_factory.mktemp("package"), OFFERS, {"panels_of_lab": MODULE}) as folder:
        yield folder


@pytest.fixture
def beside(package: Path, served: ServedConsole) -> ServedConsole:
    """Serve a console beside which the package is installed: that comes first."""
    return served


def processes() -> list[psutil.Process]:
    """Return the panels' processes."""
    return [one for one in psutil.Process(os.getpid()).children() if "console.panels" in one.cmdline()]


def test_a_panel_answers_to_the_live_state_and_changes_nothing(beside: ServedConsole) -> None:
    wait_for(lambda: beside.parts.watch.view.state.word == "disarmed")
    with beside.signed_in() as (client, _):
        assert beside.parts.panels.packages()["shows"] == "lab-tools 1.2"
        answer = client.get("/api/panels/shows").json()
        assert answer == {
            "title": "Shows", "package": "lab-tools 1.2", "period_s": 0.2, "error": None,
            "data": {"word": "disarmed!", "logs": ["audit.jsonl", "sessions.json"]},
        }  # fmt: skip
        frame = client.get("/panels/shows?theme=light")
        assert "<p>shown</p>" in frame.text
        assert frame.headers["content-security-policy"].startswith("sandbox allow-scripts; default-src 'none'")
        page = client.get("/panels")
        policy = page.headers["content-security-policy"]
        assert f"frame-src {beside.base}/panels/;" in policy
        assert "script-src 'self'" in policy
        none = client.get("/api/panels/nope")
        assert (none.status_code, none.json()) == (404, {"error": "no installed package offers a panel 'nope'"})
    assert beside.parts.watch.view.state.word == "disarmed"
    assert len(processes()) == 1
    beside.parts.panels.close()
    assert processes() == []


def test_the_panel_of_the_example_shows_forces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE))
    offered = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]["rtstack.panels"]
    lines = "".join(f"{name} = {value}\n" for name, value in offered.items())
    with installed(tmp_path, f"[rtstack.panels]\n{lines}", {}, name="joint-tracking"):
        from joint_tracking.panel import panel  # pyright: ignore[reportMissingImports]

        watch = SimpleNamespace(document=b'{"left": {"peak_force_n": 12.5}, "right": {"peak_force_n": null}}')
        with closing(Panels(tmp_path, watch)) as panels:  # pyright: ignore[reportArgumentType]
            answer = panels.answer("forces")
            assert (answer.title, answer.data, answer.error) == ("Forces on the pads", {"left": 12.5}, None)
            assert panels.html("forces") == panel.html


@pytest.mark.parametrize("name", LINES)
def test_what_is_wrong_with_a_panel_is_one_line_in_time(beside: ServedConsole, name: str) -> None:
    began_s = time.monotonic()
    answer = beside.parts.panels.answer(name)
    assert time.monotonic() - began_s < 20.0  # with the start of its process, on a busy machine
    assert answer.data is None
    assert answer.error is not None
    assert "\n" not in answer.error
    assert answer.error.startswith(LINES[name])
    assert answer.package == "lab-tools 1.2"
    assert beside.parts.panels.answer(name) == answer  # without a second process at once
    alive = name in ("raises", "sleeps", "spins", "sends", "fills", "counts")
    assert len(processes()) == alive


def test_stop_and_the_page_wait_for_no_panel(beside: ServedConsole) -> None:
    with beside.signed_in() as (client, headers):
        cookies = dict(client.cookies)
        with httpx.Client(base_url=beside.base, cookies=cookies, trust_env=False, timeout=60.0) as other:
            waiting = [
                threading.Thread(target=other.get, args=(f"/api/panels/{name}",))
                for name in ("sleeps", "spins", "holds") * 20
            ]
            for one in waiting:
                one.start()
            time.sleep(0.5)
            began_s = time.monotonic()
            assert client.get("/panels").status_code == 200
            assert client.post("/api/stop", json={}, headers=headers).status_code == 200
            took_s = time.monotonic() - began_s
            for one in waiting:
                one.join()
    assert beside.mailbox.stop_requested
    assert took_s < 10.0, f"{took_s:.2f} s"  # one after the other these panels would take 40 s


def test_a_process_that_has_died_is_started_again(beside: ServedConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    panels = beside.parts.panels
    assert panels.answer("shows").error is None
    (process,) = processes()
    process.kill()
    process.wait()
    time.sleep(0.2)
    answer = panels.answer("shows")
    assert answer.error is not None
    assert "its process has ended" in answer.error
    monkeypatch.setattr(panels._of["shows"], "_due_s", 0.0)
    assert panels.answer("shows").error is None


def test_a_token_for_a_panel_reaches_its_route_and_stop_alone(beside: ServedConsole) -> None:
    with beside.signed_in() as (client, headers):
        order = {"name": "screen", "panel": "shows"}
        made = client.post("/api/tokens", json=order, headers=headers).json()
        assert made["row"]["panel"] == client.get("/api/tokens").json()[0]["panel"] == "shows"
        for wrong, status, line in (
            ({"name": "a", "panel": "nope"}, 422, "panel: no installed package offers a panel 'nope'"),
            ({"name": "a", "panel": "shows", "scope": "operate"}, 409, "a token for one panel may look"),
        ):
            refused = client.post("/api/tokens", json=wrong, headers=headers)
            assert refused.status_code == status
            assert line in refused.json()["error"]
    bearer = {"authorization": f"Bearer {made['word']}"}
    with httpx.Client(base_url=beside.base, headers=bearer, trust_env=False, timeout=60.0) as program:
        assert program.get("/api/panels/shows").json()["title"] == "Shows"
        for path in ("/api/panels/raises", "/api/status", "/api/logs", "/", "/panels/shows", "/api/foxglove"):
            refused = program.get(path)
            assert refused.status_code == 403, path
            assert refused.json() == {"error": "this token is for /api/panels/shows alone"}
        assert program.post("/api/take", json={}).status_code == 403
        assert program.post("/api/stop", json={}).status_code == 200
    beside.mailbox.clear_stop()


def test_a_token_for_a_panel_is_made_and_listed_in_a_terminal(package: Path, tmp_path: Path) -> None:
    def rtstack(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "rtstack", "token", *words, "--logs", str(tmp_path)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    plain = rtstack("create", "--name", "plain")
    assert plain.returncode == 0
    assert "panel" not in (tmp_path / "tokens.json").read_text()  # as versions before can read it
    assert rtstack("create", "--name", "screen", "--panel", "shows").returncode == 0
    rows = rtstack("list").stdout
    assert "screen" in rows
    assert "shows" in rows
    wrong = rtstack("create", "--name", "other", "--panel", "nope")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert "unknown panel 'nope': choose one of absent" in wrong.stderr
    both = rtstack("create", "--name", "other", "--panel", "shows", "--scope", "operate")
    assert both.returncode == 2
    assert "its scope is `view`" in both.stderr


def test_without_panels_the_navigation_has_none(served: ServedConsole) -> None:
    with served.signed_in() as (client, _):
        assert served.parts.panels.packages() == {}
        assert "No panel yet. Install a package that offers one" in client.get("/panels").text
        assert 'href="/panels"' not in client.get("/logs").text
