"""The workers of a local campaign: whoever has not its key runs nothing by them, and they leave nothing behind."""

import os
import subprocess
import sys
import tempfile

from rtstack.experiments.workers import local_workers

# another program of the machine: it knows the address, which any user can see
STRANGER = """
import sys, logging
logging.disable(logging.CRITICAL)
from distributed import Client
from distributed.security import Security
address = sys.argv[1]
for url, security in (
    (address, Security.temporary()),
    (address, Security(require_encryption=False)),
    (address.replace("tls://", "tcp://"), None),
):
    try:
        with Client(url, timeout=3, security=security) as client:
            print("in", client.submit(id, 1).result(3))
    except Exception as error:
        print("out")
"""


def double(number: int) -> int:
    return 2 * number


def test_a_program_without_the_key_runs_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with local_workers(1) as client:
        address = client.scheduler_info()["address"]
        assert address.startswith("tls://127.0.0.1:")
        folders = list(tmp_path.iterdir())
        assert [folder.name.split("-")[:2] for folder in folders] == [["rtstack", "campaign"]]
        assert folders[0].stat().st_mode & 0o077 == 0
        stranger = subprocess.run(
            [sys.executable, "-c", STRANGER, address], capture_output=True, text=True, timeout=120, check=True,
            env=os.environ | {"DASK_DISTRIBUTED__COMM__RETRY__COUNT": "0"},
        )  # fmt: skip
        assert stranger.stdout.split() == ["out", "out", "out"], stranger
        assert client.submit(double, 21).result(60) == 42
    assert not list(tmp_path.iterdir())
