"""Extension points, with packages that are installed: a folder on the path with its metadata."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hal import extensions
from hal.extensions import ExtensionError, ExtensionPoint

Install = Callable[..., None]
POINT = ExtensionPoint("rtstack.test_things", "thing", int)


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Put a package on the path: its module's source, and what it offers as NAME -> ATTRIBUTE."""

    def put(package: str, source: str, **offers: str) -> None:
        place = tmp_path / package
        metadata = place / f"{package}-1.2.dist-info"
        metadata.mkdir(parents=True)
        (place / f"{package}.py").write_text(source)
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
        lines = [f"{name} = {package}:{attribute}" for name, attribute in offers.items()]
        (metadata / "entry_points.txt").write_text("\n".join([f"[{POINT.group}]", *lines, ""]))
        monkeypatch.syspath_prepend(str(place))
        extensions._offered.cache_clear()

    yield put
    extensions._offered.cache_clear()
    for package in ("one", "other"):
        sys.modules.pop(package, None)


def test_names_are_known_without_an_import(install: Install) -> None:
    install("one", "raise RuntimeError('imported')", second="B", first="A")
    assert POINT.names() == ("first", "second")


def test_a_thing_is_loaded_by_its_name(install: Install) -> None:
    install("one", "A = 5", first="A")
    assert POINT.load("first") == 5


def test_an_unknown_name_is_refused_with_those_that_there_are(install: Install) -> None:
    install("one", "A = 5", first="A", second="A")
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
    install("one", "A = 5", good="A")
    install("other", source, bad="A")
    found, refused = POINT.loadable()
    assert found == {"good": 5}
    assert refused == (f"thing 'bad': other:A of other 1.2 {reason}; repair or uninstall that package",)


def test_a_name_that_two_packages_offer_is_refused_and_no_other(install: Install) -> None:
    install("one", "A = 5", same="A", good="A")
    install("other", "A = 6", same="A")
    assert POINT.names() == ("good", "same")
    assert POINT.load("good") == 5
    with pytest.raises(ExtensionError, match=r"'same' is offered more than once: .* one 1\.2, other 1\.2"):
        POINT.load("same")
