"""Analyses of another package in the review: read once, kept with the columns, one line for what is wrong."""

import csv
import os
import time
from pathlib import Path

import numpy as np

import console.review.conversion
from console.review.cache import FOLDER
from console.review.columns import INDEX
from rtstack.log.reader import read_log
from tests.support.console.review_log import read, unpacked, write_log
from tests.support.console.served_console import ServedConsole
from tests.support.plugin import installed

OFFERS = """[rtstack.analyses]
raises = lab_analyses:raises
thinned = lab_analyses:thinned
z_dies = lab_analyses:dies
"""
MODULE = """
import os, time
import numpy as np
from rtstack.log.analysis.offered import Analysis, Curve, Number
FACTOR = 1.0


def thinned(log):
    with open(os.environ["LAB_CALLS"], "a") as calls:
        calls.write("called\\n")
    arm = log.topic("/left/arm")[::7]
    peak = Curve("peak", "Nm", arm["t_ns"], FACTOR * np.abs(arm["tau_J"]).max(axis=1))
    nothing = Curve("nothing", "", np.zeros(0, np.int64), np.zeros(0))
    most = FACTOR * float(np.abs(log.topic("/left/arm")["tau_J"]).max())
    return Analysis((peak, nothing), (Number("most", "Nm", most),))


def raises(log):
    return log["no such key"]


def sleeps(log):
    time.sleep(600.0)


def dies(log):
    os._exit(9)
"""


def test_curves_and_numbers_stand_in_the_review_and_are_kept(
    served: ServedConsole, tmp_path: Path, monkeypatch
) -> None:
    calls = tmp_path / "calls"
    monkeypatch.setenv("LAB_CALLS", str(calls))
    package = tmp_path / "package"
    package.mkdir()
    for name in ("one", "two"):
        write_log(served.logs / f"{name}.mcap", {"kind": "trial"}, spike=80.0 if name == "one" else 60.0)
    offers = "[rtstack.analyses]\nthinned = lab_analyses:thinned\n"
    with installed(package, offers, {"lab_analyses": MODULE}), served.signed_in() as (client, _):
        ids = {row["name"]: row["id"] for row in client.get("/api/logs").json()}
        one, two = ids["one.mcap"], ids["two.mcap"]
        document = read(client, one)
        (said,) = document["analyses"]
        assert (said["name"], said["package"], said["error"]) == ("thinned", "lab-tools 1.2", None)
        assert said["numbers"] == [{"name": "most", "unit": "Nm", "value": 80.0}]
        assert [signal["name"] for signal in said["signals"]] == ["thinned.peak", "thinned.nothing"]
        assert document["topics"]["/analysis/thinned/peak"] == 286
        window = {"start": 0.0, "end": 2.0}
        asked = {"signals": "thinned.peak,thinned.nothing,left.tau_J.4", **window, "width": 4000}
        found = unpacked(client.get(f"/api/logs/{one}/series", params=asked).raise_for_status().content)
        t_s, values = found["thinned.peak"][0], found["thinned.peak"][1]
        np.testing.assert_allclose(t_s, 0.007 * np.arange(286), atol=1e-9)
        assert len(found["thinned.nothing"][0]) == 0
        assert len(found["left.tau_J.4"][0]) == 2000
        assert set(np.unique(values)) <= {0.0, 80.0}
        at = client.get(f"/api/logs/{one}/values", params={"t": 1.0, "signals": "thinned.peak"}).json()
        assert at["values"] == {"thinned.peak": 0.0}
        read(client, two)
        less = {"signals": "thinned.peak", **window, "other": two}
        assert client.get(f"/api/logs/{one}/series", params=less).status_code == 200
        lines = client.get(f"/api/logs/{one}/csv", params=less).text.splitlines()
        assert next(csv.reader(lines)) == ["t_s", "utc", "thinned.peak", "other.thinned.peak"]
        assert len(lines) == 287
        figure = client.get(f"/api/logs/{one}/figure", params={"signals": "thinned.peak", **window, "form": "svg"})
        assert figure.status_code == 200
        unknown = client.get(f"/api/logs/{one}/series", params={"signals": "thinned.no", **window})
        assert unknown.json() == {"error": "signals: there is no signal thinned.no"}
        assert calls.read_text() == "called\n" * 2  # once for each log
        read(client, one)
        assert calls.read_text() == "called\n" * 2

        source = package / "lab_analyses.py"
        source.write_text(MODULE.replace("FACTOR = 1.0", "FACTOR = 2.0").replace("[::7]", "[::9]"))
        os.utime(source, (time.time() + 5.0, time.time() + 5.0))
        document = read(client, one)
        assert document["analyses"][0]["numbers"][0]["value"] == 160.0
        assert document["topics"]["/analysis/thinned/peak"] == 223
        found = unpacked(client.get(f"/api/logs/{one}/series", params=asked).content)
        assert len(found["thinned.peak"][0]) == 223
        assert calls.read_text() == "called\n" * 3


def test_a_broken_analysis_breaks_no_review(served: ServedConsole, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("LAB_CALLS", str(tmp_path / "calls"))
    write_log(served.logs / "one.mcap", {"kind": "trial"})
    with installed(tmp_path, OFFERS, {"lab_analyses": MODULE}), served.signed_in() as (client, _):
        (row,) = client.get("/api/logs").json()
        document = read(client, row["id"])
        errors = {said["name"]: said["error"] for said in document["analyses"]}
        assert errors["raises"].startswith(
            "analysis 'raises': TypeError: 'Log' object is not subscriptable (lab-tools 1.2, "
        )
        assert errors["thinned"] is None
        assert errors["z_dies"] == "analysis 'z_dies' of lab-tools 1.2: it has ended the process that it ran in"
        asked = {"signals": "thinned.peak,left.tau_J.4", "start": 0.0, "end": 2.0, "width": 4000}
        found = unpacked(client.get(f"/api/logs/{row['id']}/series", params=asked).raise_for_status().content)
        assert found["left.tau_J.4"][1].max() == 80.0
        assert found["thinned.peak"][1].max() in (0.0, 80.0)
        (folder,) = [path for path in (served.logs / FOLDER).iterdir() if path.is_dir()]
        changed_ns = (folder / INDEX).stat().st_mtime_ns
        assert read(client, row["id"])["analyses"] == document["analyses"]
        assert (folder / INDEX).stat().st_mtime_ns == changed_ns  # it is not tried again


def test_an_analysis_that_takes_too_long_is_given_up(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(console.review.conversion, "_ANALYSIS_S", 0.3)
    write_log(tmp_path / "one.mcap", {"kind": "trial"})
    columns = tmp_path / "columns"
    columns.mkdir()
    with installed(tmp_path, "[rtstack.analyses]\nsleeps = lab_analyses:sleeps\n", {"lab_analyses": MODULE}):
        began_s = time.monotonic()
        index = console.review.conversion.convert(read_log(tmp_path / "one.mcap"), columns)
    assert time.monotonic() - began_s < 30.0
    assert index.done
    assert index.analyses[0].error == (
        "analysis 'sleeps': TimeoutError: takes longer than 0.3 s (lab-tools 1.2, lab_analyses.py:23); "
        "mend it there, or uninstall the package"
    )
