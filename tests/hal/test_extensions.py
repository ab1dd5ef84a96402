"""Extension points, with packages that are installed: a folder on the path with its metadata."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest

from hal.errors import HardwareError
from hal.extensions import ExtensionError, ExtensionPoint, culprit, raised

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


WRONG = """
def fails(argument):
    return int(argument)  # line 3


def nothing(argument):
    return None


def refused(argument):
    from hal.errors import HardwareError
    raise HardwareError("plug it in")
"""


@pytest.fixture
def wrong(install: Install) -> ExtensionPoint[Any]:
    """Install what cannot be opened."""
    install("wrong_things", WRONG, POINT.group, fails="fails", nothing="nothing", refused="refused")
    return ExtensionPoint(POINT.group, "thing", cast(Any, Callable))


def test_what_cannot_be_opened_names_its_package_file_and_line(wrong: ExtensionPoint[Any]) -> None:
    with pytest.raises(ExtensionError) as found:
        wrong.make("fails", "abc", "read")
    assert str(found.value) == (
        "the thing fails cannot be opened with 'abc': ValueError: invalid literal for int() with base 10: 'abc' "
        "(wrong_things 1.2, wrong_things.py:3); mend it there, or uninstall the package"
    )
    with pytest.raises(ExtensionError) as found:
        wrong.make("nothing", "", "read", "close")
    assert str(found.value) == (
        "the thing nothing cannot be opened with '': TypeError: NoneType has no read, no close "
        "(wrong_things 1.2, wrong_things.py:6); mend it there, or uninstall the package"
    )


def test_an_error_of_ours_that_a_plug_in_raises_is_left_as_it_is(wrong: ExtensionPoint[Any]) -> None:
    with pytest.raises(HardwareError, match=r"^plug it in$"):
        wrong.make("refused", "")


def test_an_error_of_ours_is_no_plug_ins_mistake() -> None:
    with pytest.raises(KeyError) as found:
        ExtensionPoint("rtstack.no_such", "thing", int).package("none")
    error = found.value.with_traceback(found.tb.tb_next)  # without the frame of this test
    assert culprit(error) == ""
    assert re.fullmatch(r"KeyError: 'none' \(extensions\.py:\d+\)", raised(error))


def test_a_long_text_leaves_room_for_the_place_in_an_event() -> None:
    with pytest.raises(ValueError, match="x") as found:
        raise ValueError("x" * 500)
    assert len(raised(found.value)) < 200
    assert re.search(r"x\.\.\. \(test_extensions\.py:\d+\); mend it there$", raised(found.value))
