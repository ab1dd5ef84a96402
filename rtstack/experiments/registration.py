"""What a plan fixes before its cases are run: claims, what is left out, and on what its parameters were chosen.

The digest of a campaign's rows does not depend on it: the report says where it was changed after they existed.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, ConfigurationError
from rtstack.experiments.claims import Claim, ClaimStatus

# what a store calls the digest of the plan's file when its first result was about to be made
PLAN_DIGEST = "plan_digest"
UNDIGESTED = ("claims", "registration", "on_cell")  # keys of a plan on which no row depends


@checked(frozen=True, slots=True, config=STRICT)
class PlannedClaim:
    """A claim as a plan fixes it. judge: which function of the experiment decides it; where: the place in the paper;
    says: what the paper claims, with its number, empty where only the mark is judged; mark: this project's own
    criterion, where the paper gives none; at: which of several cases the judge is asked about.
    """

    judge: str
    where: str
    says: str = ""
    mark: str = ""
    at: float | str | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Registration:
    """excluded: rules by which cases are left out of a claim, in words; chosen_on: which references, seeds or cases
    parameters were chosen on, which the report therefore leaves out; deviations: what was changed after the plan's
    first version was committed, and why.
    """

    excluded: tuple[str, ...] = ()
    chosen_on: tuple[str, ...] = ()
    deviations: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Finding:
    """What a judge says: see Claim."""

    ours: str
    verdict: ClaimStatus
    why: str = ""


Judge = Callable[[Any, Any], Finding]  # (evaluation, at) -> finding


def check_claims(path: Path, claims: Iterable[PlannedClaim], judges: Mapping[str, Judge]) -> None:
    """Raise ConfigurationError for a claim of a plan that no judge knows."""
    for index, claim in enumerate(claims):
        key = f"{path}: key claims.{index}"
        if claim.judge not in judges:
            known = ", ".join(sorted(judges))
            raise ConfigurationError(f"{key}.judge: unknown {claim.judge!r}: choose one of {known}")
        if not claim.says and not claim.mark:
            raise ConfigurationError(f"{key}: give says (the paper's claim), mark (our own) or both")


def judged(claims: Iterable[PlannedClaim], judges: Mapping[str, Judge], evaluation: Any) -> list[Claim]:
    """Return each claim of a plan with its verdict on the results in `evaluation`."""
    found = []
    for claim in claims:
        finding = judges[claim.judge](evaluation, claim.at)
        found.append(Claim(claim.where, claim.says, finding.ours, finding.verdict, finding.why, claim.mark))
    return found


def file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
