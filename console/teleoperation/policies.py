"""The policies that are connected to the console, and which of them leads while the clutch is not held."""

from collections import Counter


class Policies:
    """leads: the policy with the lease; refused: why its answer is not followed, or it ended. Not for two threads."""

    def __init__(self) -> None:
        self.leads: str | None = None
        self.refused: str | None = None
        self._given = 0  # leases since the console began
        self._connected = Counter[str]()  # how many connections each policy has

    @property
    def names(self) -> tuple[str, ...]:
        """Of those that are connected."""
        return tuple(sorted(+self._connected))

    def connected(self, policy: str, by: int = 1) -> None:
        """Note that a policy has one more connection, or with -1 one less."""
        self._connected[policy] += by

    def give(self, policy: str | None) -> int:
        """Give a policy the lease, None for none; return its number, 0 for none."""
        self.leads = policy
        self.refused = None if policy is not None else self.refused
        self._given += policy is not None
        return 0 if policy is None else self._given
