"""A sample of many like cases for every test run; the others are for `make long`."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import pytest

T = TypeVar("T")


def sampled(cases: Iterable[T], keep: Callable[[T], bool]) -> list[Any]:
    """Return cases for pytest.mark.parametrize, of which those that are not kept are `long`."""
    return [case if keep(case) else pytest.param(case, marks=pytest.mark.long) for case in cases]
