"""Two campaigns beside each other: what is equal, what differs and by how much, which claims came out otherwise."""

import json

import pytest

from rtstack.experiments.comparison import compare
from rtstack.experiments.store import Store
from rtstack.trials.errors import TrialError

COLUMNS = {"controller": str, "lift_mm": float | None, "success": bool, "log": str}


@pytest.fixture
def campaigns(tmp_path):
    """Return a function that writes a campaign's folder: rows id -> (lift_mm, success), and what its claim came to."""

    def write(name, rows, verdict):
        out = tmp_path / name
        out.mkdir()
        with Store(out, COLUMNS) as store:
            for key, (lift_mm, success) in rows.items():
                made = {"git_commit": name, "digest": name, "wall_s": 1.0, "worker": name}
                measured = {"controller": "proposed", "lift_mm": lift_mm, "success": success, "log": f"logs/{key}.mcap"}
                store.add({"id": key, **measured, **made})
        claim = {"where": "Table II", "claim": "lifts", "mark": "", "verdict": verdict, "figures": "1 mm", "why": ""}
        report = {"conditions": [{"name": "nominal", "claims": [claim]}]}
        (out / "report.json").write_text(json.dumps(report))
        return out

    return write


def test_a_campaign_is_equal_to_itself_wherever_it_ran(campaigns, command_line):
    rows = {"a": (1.0, True), "b": (None, False)}
    folders = [campaigns(name, rows, "holds") for name in ("here", "there")]
    found = compare(*folders)
    assert found.same
    assert found.equal == len(COLUMNS)
    done = command_line("campaign", "compare", *map(str, folders))
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 common rows; of 4 columns 4 are equal in all of them" in done.stdout


def test_what_differs_is_paired_by_row(campaigns, command_line):
    simulated = campaigns("simulated", {"a": (1.0, True), "b": (2.0, True), "c": (None, True)}, "holds")
    arms = campaigns("arms", {"a": (1.5, True), "b": (3.5, False), "c": (4.0, True), "d": (0.0, True)}, "differs")
    found = compare(simulated, arms)
    assert (found.common, found.only, found.equal) == (["a", "b", "c"], (0, 1), 2)
    lift, success = found.columns
    assert (lift.differing, lift.one_sided, lift.means, lift.largest) == (3, 1, (1.5, 2.5), 1.5)
    assert lift.difference.mean == 1.0
    # the t interval of the differences 0.5 and 1.5, by hand: 1 +- 12.706 x 0.7071 / sqrt(2)
    assert lift.difference.high == pytest.approx(1.0 + 12.706 * 0.5, abs=1e-3)
    assert success.difference.mean == pytest.approx(-1.0 / 3.0)
    (claim,) = found.claims
    assert (claim.first, claim.second) == ("holds: 1 mm", "differs: 1 mm")
    done = command_line("campaign", "compare", str(simulated), str(arms))
    assert done.returncode == 1
    assert "lift_mm" in done.stdout
    assert "controller" not in done.stdout
    found = json.loads(command_line("campaign", "compare", str(simulated), str(arms), "--json").stdout)
    assert [each["name"] for each in found["columns"]] == ["lift_mm", "success"]


def test_campaigns_without_a_common_case_are_not_compared(campaigns):
    with pytest.raises(TrialError, match="no case in common"):
        compare(campaigns("one", {"a": (1.0, True)}, "holds"), campaigns("other", {"b": (1.0, True)}, "holds"))
