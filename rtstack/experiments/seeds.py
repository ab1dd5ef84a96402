"""Seeds that depend on what they are for, and not on when or where it is run."""

import hashlib


def seed_of(plan: int, *what: object) -> int:
    """Return a seed (32 bits) that depends on the plan's seed and on what it is for, and on nothing else."""
    return int.from_bytes(hashlib.blake2b(repr((plan, *map(str, what))).encode(), digest_size=4).digest(), "little")
