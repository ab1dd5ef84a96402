"""A small campaign, shared."""

from tests.support.campaigns import command, finished, results  # noqa: F401 (fixtures)
