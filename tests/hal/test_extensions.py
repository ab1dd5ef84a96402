"""Extension points, with packages that are installed: a folder on the path with its metadata."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from hal.extensions import ExtensionError, ExtensionPoint

Install = Callable[..., None]
POINT = ExtensionPoint("rtstack.test_things", "thing", int)


def test_names_are_known_without_an_import(install: Install) -> None:
    install("one", "raise RuntimeError('imported')", POINT.group, second="B", first="A")
    assert POINT.names() == ("first", "second")


def test_a_thing_is_loaded_by_its_name(install: Install) -> None:
    install("one", "A = 5", POINT.group, first="A")
    assert POINT.load("first") == 5


def test_an_unknown_name_is_refused_with_those_that_there_are(install: Install) -> None:
    install("one", "A = 5", POINT.group, first="A", second="A")
    with pytest.raises(ExtensionError, match="unknown thing 'third': choose one of first, second"):
        POINT.load("third")


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import no_such_module", "cannot be loaded: ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise RuntimeError('two\\nlines')", "cannot be loaded: RuntimeError: two lines"),
        ("B = 5", "cannot be loaded: AttributeError: module 'other' has no attribute 'A'"),
        ("A = 'five'", "is str, not int"),
    ],
)
def test_what_cannot_be_loaded_names_its_package_and_spoils_no_other(
    install: Install, source: str, reason: str
) -> None:
    install("one", "A = 5", POINT.group, good="A")
    install("other", source, POINT.group, bad="A")
    found, refused = POINT.loadable()
    assert found == {"good": 5}
    assert refused == (f"thing 'bad': other:A of other 1.2 {reason}; repair or uninstall that package",)


def test_an_installation_without_any_says_what_to_do() -> None:
    with pytest.raises(ExtensionError, match=r"no thing is installed: .*: make setup"):
        POINT.load("first")
    with pytest.raises(ExtensionError, match="unknown thing 'first': no installed package offers one"):
        replace(POINT, ours=False).load("first")


def test_a_name_that_two_packages_offer_is_refused_and_no_other(install: Install) -> None:
    install("one", "A = 5", POINT.group, same="A", good="A")
    install("other", "A = 6", POINT.group, same="A")
    assert POINT.names() == ("good", "same")
    assert POINT.load("good") == 5
    with pytest.raises(ExtensionError, match=r"'same' is offered more than once: .* one 1\.2, other 1\.2"):
        POINT.load("same")
