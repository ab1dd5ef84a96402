"""Which logs go, and which never."""

import os
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.log.errors import LogError
from rtstack.log_folder import policy
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry
from rtstack.log_folder.remarks import mark_reviewed, may_go
from rtstack.references.acceptance import Acceptance, AcceptanceState, save_acceptance

NOW_S = 1.7e9
DAY_S = policy.DAY_S


def log(folder: Path, name: str, days_old: float = 0.0, megabytes: float = 1.0) -> Path:
    """Make a file that takes room, of an age: what is in it does not matter here."""
    path = folder / f"{name}.mcap"
    path.write_bytes(b"")
    os.truncate(path, round(megabytes * 1e6))
    os.utime(path, (NOW_S - days_old * DAY_S,) * 2)
    return path


@given(
    st.lists(st.tuples(st.integers(0, 400), st.integers(1, 50), st.booleans())),
    st.integers(0, 400),
    st.integers(0, 500),
)
def test_the_unreviewed_never_go_and_the_reviewed_only_as_far_as_needed(logs, days, budget):
    entries = [
        LogEntry(str(k), Path(f"{'seen' if seen else 'new'}{k}"), "trial", None, None, size, NOW_S - age * DAY_S,
                 LogCondition.COMPLETE)
        for k, (age, size, seen) in enumerate(logs)
    ]  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policy, "may_go", lambda path: path.name.startswith("seen"))
        plan = policy.plan_pruning(entries, NOW_S, days * DAY_S, budget)
    assert all(entry.path.name.startswith("seen") for entry in plan.going)
    stay = [entry for entry in entries if entry not in plan.going]
    assert plan.kept_bytes == sum(entry.size_bytes for entry in stay)
    assert plan.over_bytes == max(0, plan.kept_bytes - budget)
    seen = [entry for entry in stay if entry.path.name.startswith("seen")]
    assert plan.unreviewed_bytes == plan.kept_bytes - sum(entry.size_bytes for entry in seen)
    assert all(NOW_S - entry.modified_s <= days * DAY_S for entry in seen)
    if plan.over_bytes:
        assert seen == []
    young = [entry for entry in plan.going if NOW_S - entry.modified_s <= days * DAY_S]
    if young:  # it went for the room alone, and the room was needed
        assert plan.kept_bytes + young[-1].size_bytes > budget
        assert all(entry.modified_s >= young[-1].modified_s for entry in seen)


def test_who_may_go(tmp_path):
    seen, new, rejected, accepted, unclear = (
        log(tmp_path, name) for name in ("seen", "new", "rejected", "accepted", "unclear")
    )
    for path in (seen, accepted, unclear):
        mark_reviewed(path, "anna")
    save_acceptance(rejected, Acceptance(verdict=AcceptanceState.REJECTED))
    save_acceptance(accepted, Acceptance(verdict=AcceptanceState.ACCEPTED))
    unclear.with_name(unclear.name + ".accepted.json").write_text("{")
    assert [may_go(path) for path in (seen, new, rejected, accepted, unclear)] == [True, False, True, False, False]
    with pytest.raises(LogError, match="no such log"):
        mark_reviewed(tmp_path / "none.mcap", "anna")


def test_the_command_shows_then_removes_and_says_what_is_missing(tmp_path, command_line):
    old, young, unseen = log(tmp_path, "old", 300), log(tmp_path, "young", 10), log(tmp_path, "unseen", 900, 5.0)
    assert command_line("logs", "reviewed", old, young).returncode == 0
    prune = partial(command_line, "logs", "prune", "--logs", tmp_path)
    shown = prune("--budget", "0.0065", "--dry-run")
    assert (shown.returncode, old.exists()) == (0, True)
    assert shown.stdout.splitlines()[-1].startswith("1 logs would go")
    assert prune("--budget", "0.0065").returncode == 0
    assert [path.exists() for path in (old, young, unseen)] == [False, True, True]
    assert not old.with_name(old.name + ".reviewed.json").exists()
    missed = prune("--budget", "0.001")
    assert missed.returncode == 1
    assert [path.exists() for path in (young, unseen)] == [False, True]
    assert "over the budget" in missed.stderr
    assert missed.stderr.count("\n") == 1
    assert prune().returncode == 2


def test_a_log_that_changes_meanwhile_stays(tmp_path):
    path = log(tmp_path, "one", 300)
    mark_reviewed(path, "anna")
    plan = policy.plan_pruning(Catalogue(tmp_path).entries(), NOW_S, DAY_S, None)
    assert len(plan.going) == 1
    path.write_bytes(b"somebody writes")
    assert list(policy.prune(plan)) == []
    assert path.exists()
