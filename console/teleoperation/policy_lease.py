"""Which policy leads while the clutch is not held, and which ones are connected."""

from collections import Counter


class PolicyLease:
    """The lease that an operator gives a policy. Not for two threads at a time."""

    def __init__(self) -> None:
        self.policy: str | None = None  # who leads
        self._given = 0  # since the console began
        self._connected = Counter[str]()  # how many connections each policy has

    @property
    def policies(self) -> tuple[str, ...]:
        """The names of those that are connected."""
        return tuple(sorted(+self._connected))

    def give(self, policy: str | None) -> int:
        """Give a lease, None for none; return its number, 0 for none."""
        self.policy = policy
        self._given += policy is not None
        return 0 if policy is None else self._given

    def connected(self, policy: str, by: int) -> None:
        """Note that a policy has one more connection, or with -1 one less."""
        self._connected[policy] += by
