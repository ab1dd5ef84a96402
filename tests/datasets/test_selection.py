"""Which logs become episodes: one language for the list and for data sets, and a reason for each that is left out."""

import itertools
import json
from pathlib import Path

import h5py
import pytest
import zarr
from mcap.reader import make_reader

from rtstack.datasets.episode import select
from rtstack.datasets.export import NothingToExport, export
from rtstack.datasets.hdf5 import Hdf5
from rtstack.datasets.lerobot import LeRobot
from rtstack.datasets.lerobot_import import import_episode
from rtstack.datasets.zarr import Zarr
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log_folder.remarks import EpisodeVerdict, Remarks, save_remarks

OBJECTS, OPERATORS, VERDICTS = ("rice_box", "box_060"), ("anna", "Anna B"), (None, "kept", "failed", "discard")
SUCCESS = ("true", "false", None)


@pytest.fixture
def folder(write_short, tmp_path: Path) -> Path:
    """Logs of all combinations."""
    for number, (thing, operator, verdict, success) in enumerate(
        itertools.product(OBJECTS, OPERATORS, VERDICTS, SUCCESS)
    ):
        trial = {"kind": "trial", "object": thing, "specification": json.dumps({"operator": operator})}
        result = {} if success is None else {"success": success, "failure_reason": "null", "impact_verdict": "expected"}
        utc = None if number % 7 == 3 else f"2026-11-{20 + number % 5}T{number % 24:02d}:30:00.000000Z"
        path = write_short(f"{number:02d}.mcap", trial, result, utc)
        tags = ("figure-5",) if number % 3 == 0 else ("figure-50",)
        save_remarks(path, Remarks(tags=tags, verdict=None if verdict is None else EpisodeVerdict(verdict)))
    return tmp_path / "logs"


def _facts(path: Path) -> dict[str, str | None]:
    """What a log says, by the library alone, and what stands beside it."""
    with open(path, "rb") as file:
        metadata = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    remarks = json.loads(path.with_name(path.name + ".remarks.json").read_text())
    return {
        "object": metadata["trial"]["object"], "utc": metadata.get("time", {}).get("utc"), "tag": remarks["tags"][0],
        "operator": json.loads(metadata["trial"]["specification"])["operator"],
        "success": metadata.get("result", {}).get("success"), "verdict": remarks.get("verdict"),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("query", "failed", "holds"),
    [
        ("object=rice_box", True, lambda f: f["object"] == "rice_box"),
        ("object=rice", True, lambda f: False),
        ("tag=figure-5", True, lambda f: f["tag"] == "figure-5"),
        ("operator=anna", True, lambda f: f["operator"] == "anna"),
        ('operator="anna b" object=box_060', True, lambda f: (f["operator"], f["object"]) == ("Anna B", "box_060")),
        ("date>=2026-11-22", True, lambda f: f["utc"] and f["utc"] >= "2026-11-22"),
        ("date<=2026-11-22", True, lambda f: f["utc"] and f["utc"][:10] <= "2026-11-22"),
        ("date>2026-11-22", True, lambda f: f["utc"] and f["utc"][:10] > "2026-11-22"),
        ("date<2026-11-22T12:00", True, lambda f: f["utc"] and f["utc"] < "2026-11-22T12:00"),
        ("date<2026-11-22T12:00+02:00", True, lambda f: f["utc"] and f["utc"] < "2026-11-22T10:00"),
        ("success=false", False, lambda f: f["verdict"] == "failed" or f["success"] == "false"),
        ("success=true", False, lambda f: f["verdict"] != "failed" and f["success"] == "true"),
        ("", False, lambda f: f["verdict"] == "kept" or (f["verdict"] is None and f["success"] == "true")),
    ],
)
def test_a_query_takes_what_the_logs_themselves_say(folder: Path, query: str, failed: bool, holds) -> None:
    paths = sorted(folder.glob("*.mcap"))
    wanted = [path for path in paths if (facts := _facts(path))["verdict"] != "discard" and holds(facts)]
    found = select([folder], query, failed)
    assert [each.path for each in found] == paths
    assert [each.path for each in found if not each.why] == wanted


def test_a_verdict_is_taken_where_it_is_asked_for(folder: Path) -> None:
    for verdict in VERDICTS[1:]:
        wanted = [path for path in sorted(folder.glob("*.mcap")) if _facts(path)["verdict"] == verdict]
        assert [each.path for each in select([folder], f"verdict={verdict}") if not each.why] == wanted


def test_each_log_that_is_left_out_has_its_reason(write_short, tmp_path: Path) -> None:
    good, trial = {"success": "true"}, {"kind": "trial", "object": "rice_box"}
    paths = [write_short(f"good{k}.mcap", trial, good, "2026-11-26T10:00:00.000000Z") for k in range(2)]
    save_remarks(write_short("discarded.mcap", trial, good), Remarks(verdict=EpisodeVerdict.DISCARD))
    write_short("failed.mcap", trial, {"success": "false", "failure_reason": "the object was dropped"})
    save_remarks(write_short("judged.mcap", trial, good), Remarks(verdict=EpisodeVerdict.FAILED))
    write_short("open.mcap", trial, {})
    write_short("recovered.mcap", trial, good, more=[("recovery", {"source": "x", "messages": "3"})])
    write_short("one_arm.mcap", trial, good, without=("/right/arm", "/right/control"))
    write_short("unclear.mcap", trial, good).with_name("unclear.mcap.remarks.json").write_text("{")
    folder = tmp_path / "logs"
    (folder / "copy.mcap").write_bytes(paths[0].read_bytes())
    (folder / "cut.mcap").write_bytes(paths[0].read_bytes()[:-500])
    (folder / "foreign.mcap").write_bytes(b"not a log")
    (tmp_path / "empty").mkdir()
    reasons = {each.path.name: each.why for each in select([folder, tmp_path / "empty", tmp_path / "none.mcap"])}
    expected = {
        "good0.mcap": "it is the same log as", "good1.mcap": "", "copy.mcap": "",
        "discarded.mcap": "verdict is discard", "failed.mcap": "success is false: the object was dropped",
        "judged.mcap": "success is false: verdict is failed", "open.mcap": "no success",
        "recovered.mcap": "recovered log", "one_arm.mcap": "another shape", "empty": "no log in",
        "cut.mcap": "cut off", "foreign.mcap": "cannot be read", "none.mcap": "No such file",
        "unclear.mcap": "remarks.json",
    }  # fmt: skip
    assert reasons.keys() == expected.keys()
    for name, words in expected.items():
        assert words in reasons[name] if words else not reasons[name], (name, reasons[name])
        assert "\n" not in reasons[name]


def test_what_is_left_out_is_in_the_data_set_and_nothing_is_written_on_a_dry_run(write_short, tmp_path: Path) -> None:
    trial = {"kind": "trial", "object": "rice_box"}
    write_short("a.mcap", trial, {"success": "true"})
    write_short("b.mcap", trial, {"success": "false", "failure_reason": "dropped"})
    damaged = write_short("c.mcap", trial, {"success": "true"})
    with open(damaged, "rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        chunk = max(summary.chunk_indexes, key=lambda each: each.chunk_length)
    content = bytearray(damaged.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 8
    damaged.write_bytes(content)
    told = {}
    for name, form in (("h5", Hdf5()), ("zarr", Zarr()), ("lerobot", LeRobot())):
        out = tmp_path / f"data.{name}"
        dry = export([tmp_path / "logs"], out, form, dry_run=True, query="object=rice_box")
        assert not out.exists()
        assert not out.with_name(out.name + ".partial").exists()
        done = export([tmp_path / "logs"], out, form, query="object=rice_box")
        assert [(each.path, each.why) for each in dry.candidates] == [(each.path, each.why) for each in done.candidates]
        told[name] = [{"log": each.path.name, "why": each.why} for each in done.candidates if each.why]
        assert [each["log"] for each in told[name]] == ["b.mcap", "c.mcap"]
    with h5py.File(tmp_path / "data.h5") as file:
        assert json.loads(str(file.attrs["left_out"])) == told["h5"]
        assert (file.attrs["selection"], file.attrs["failed"]) == ("object=rice_box", False)
    assert zarr.open_group(str(tmp_path / "data.zarr"), mode="r")["meta"].attrs["left_out"] == told["zarr"]
    kept = json.loads((tmp_path / "data.lerobot" / "meta" / "left_out.json").read_text())
    assert kept == {"selection": "object=rice_box", "failed": False, "left_out": told["lerobot"]}


def test_failed_runs_are_taken_where_they_are_asked_for_and_say_so(write_short, tmp_path: Path) -> None:
    trial = {"kind": "trial", "object": "rice_box"}
    write_short("a.mcap", trial, {"success": "true"})
    fault = ("fault", {"end": "safety", "detail": "a pad pushed with 260 N"})
    write_short("b.mcap", trial, {"success": "false", "failure_reason": "safety: 260 N"}, more=[fault])
    save_remarks(tmp_path / "logs" / "a.mcap", Remarks(verdict=EpisodeVerdict.FAILED, tags=("slow",)))
    export([tmp_path / "logs"], tmp_path / "data.h5", Hdf5(), failed=True)
    export([tmp_path / "logs"], tmp_path / "set", LeRobot(), failed=True)
    import_episode(tmp_path / "set", 1, tmp_path / "back.mcap")
    assert read_log(tmp_path / "back.mcap").attachment("last_second.npz") == bytes(range(256)) * 2
    with h5py.File(tmp_path / "data.h5") as file:
        assert all(
            group["ENVIRONMENT/last_second.npz"][()].tobytes()[:256] == bytes(range(256)) for group in file.values()
        )
        first, second = (dict(group.attrs) for group in file.values())
    assert (first["success"], first["episode_verdict"], first["tags"]) == ("false", "failed", "slow")
    assert (second["success"], second["fault"]) == ("false", "safety: a pad pushed with 260 N")
    assert (second["failure_reason"], second["episode_verdict"]) == ("safety: 260 N", "none")


def test_where_nothing_is_left_it_is_one_line(write_short, tmp_path: Path, command_line) -> None:
    write_short("a.mcap", {"kind": "trial"}, {"success": "false", "failure_reason": "dropped"})
    with pytest.raises(NothingToExport, match=r"a\.mcap: success is false: dropped$"):
        export([tmp_path / "logs"], tmp_path / "data.h5", Hdf5())
    with pytest.raises(LogError, match="q: date>=yesterday: a range is"):
        select([tmp_path / "logs"], "date>=yesterday")
    done = command_line("export", "--to", "hdf5", "logs", "data.h5", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1].startswith("rtstack: there is nothing to export: logs/a.mcap: success is false")
    write_short("b.mcap", {"kind": "trial", "object": "x"}, {"success": "true"}, "2026-11-26T10:00:00.000000Z")
    asked = "date>=2026-11-26 date<=2026-11-26 object=x kind=trial"
    done = command_line("export", "--to", "zarr", "logs", "data", "--filter", asked, "--dry-run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "no: it has no time of day" in done.stdout
    assert "would write data: 1 episode, 1 left out" in done.stdout
    assert not (tmp_path / "data").exists()
