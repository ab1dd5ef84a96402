"""Workers of other machines: which of them get trials, where logs go, and what a campaign makes of losing some."""

import contextlib
import logging
import subprocess
import sys
import threading
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from rtstack.experiments.archive import Archive
from rtstack.experiments.version import present
from rtstack.experiments.workers import Admission
from rtstack.trials.errors import TrialError

NOT_PERMITTED = 3  # exit status of the script where there can be no namespaces
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.timeout(600)
@pytest.mark.long
def test_one_worker_killed_one_cut_off_and_one_of_another_version(command, finished, tmp_path):
    """In four network namespaces, with logs in an S3-compatible store: the table of the undisturbed campaign."""
    arguments = [tmp_path / "work", "--plan", command.plan, "--undisturbed", finished.out]
    command = [sys.executable, "-m", "tests.programs.cluster", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    if done.returncode == NOT_PERMITTED:
        pytest.skip(f"metal: a machine that permits network namespaces; here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stdout + done.stderr
    *_, refusal, same = done.stdout.splitlines()
    assert refusal.endswith(f"has rtstack 0.0.9 instead of {version('rtstack')}: it gets no trials")
    assert same == "the same 5 rows and report, 5 logs at s3://campaigns"


def test_who_was_looked_at_is_known_whatever_the_client_asks_for_itself():
    """The client's own looks at the scheduler, every two seconds, leave the workers out; here they never end."""
    quiet = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
    with (
        LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, silence_logs=logging.CRITICAL, scheduler_kwargs=quiet
        ) as cluster,
        Client(cluster) as client,
    ):
        ending = threading.Event()

        def ask():
            while not ending.is_set():
                client.sync(client._update_scheduler_info)

        asking = threading.Thread(target=ask)
        admission = Admission(client)
        asking.start()
        try:
            for _ in range(100):
                assert admission._look() == []
                assert admission._known
        finally:
            ending.set()
            asking.join()
        assert admission.slots == 1


def test_a_version_says_what_is_other():
    ours = present()
    assert ours.difference(ours) is None
    packages = tuple((name, "0" if name == "mujoco" else version) for name, version in ours.packages)
    assert str(ours.difference(replace(ours, packages=packages))).startswith("mujoco 0 instead of ")
    assert "of commit feed instead of" in str(ours.difference(replace(ours, commit="feed")))
    assert "other sources" in str(ours.difference(replace(ours, sources="0")))
    assert replace(ours, sources="0").digest != ours.digest


def test_a_place_that_cannot_be_used_is_one_line():
    for place, said in (("nowhere://x", "cannot be used"), ("ftp://127.73.5.2:9/x", "cannot be used")):
        with pytest.raises(TrialError, match=said) as refused:
            Archive(place).check()
        assert "\n" not in str(refused.value)


def test_what_is_elsewhere_is_brought_once_and_nothing_is_left_here(tmp_path):
    archive = Archive(f"file://{tmp_path}/store")
    with archive.new("logs/a.mcap") as path:
        path.write_bytes(b"a")
    assert not path.exists()
    assert archive.names("logs") == {"a.mcap"}
    assert archive.file("logs/a.mcap").read_bytes() == b"a"
    with contextlib.suppress(OSError), archive.new("logs/b.mcap") as path:
        path.write_bytes(b"b")
        raise OSError
    assert archive.names("logs") == {"a.mcap"}
    archive.remove("logs/a.mcap")
    assert archive.names("logs") == set()
