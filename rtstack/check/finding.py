"""One fact about the machine, judged."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """verdict: pass; warn: it works, at a cost; fail: something that is required is missing.

    cost: what a warning or failure leads to; advice: what to do. Both are empty on pass.
    """

    name: str
    value: str
    verdict: str
    advice: str = ""
    cost: str = ""


def finding(name: str, value: str, good: bool, cost: str, advice: str, *, required: bool = False) -> Finding:
    """Return a fact with its cost and advice where it is not good."""
    if good:
        return Finding(name, value, "pass")
    return Finding(name, value, "fail" if required else "warn", advice, cost)
