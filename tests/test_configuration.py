"""What is written as TOML is read again as it was."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.base.configuration import toml_text

WORDS = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=8)
VALUES = WORDS | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
DOCUMENTS = st.recursive(
    st.dictionaries(WORDS, VALUES | st.lists(VALUES, max_size=4), max_size=4),
    lambda tables: st.dictionaries(WORDS, tables | VALUES, max_size=3),
    max_leaves=8,
)


@given(DOCUMENTS)
def test_a_document_comes_back_as_it_was(document) -> None:
    assert tomllib.loads(toml_text(document, "by hand: no = [")) == document


def test_each_value_has_a_line() -> None:
    text = toml_text({"table": {"values": [0.5, 1e-7]}, "of": None, "seed": 3}, "a comment")
    assert text == "# a comment\nseed = 3\n\n[table]\nvalues = [0.5, 1e-07]\n"
    with pytest.raises(ValueError, match="not JSON compliant"):
        toml_text({"speed": float("inf")})
