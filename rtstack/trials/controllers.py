"""The controllers and impact detectors of a trial: names that installed packages offer, or Python objects."""

from collections.abc import Callable
from functools import partial
from importlib.metadata import packages_distributions, version
from typing import TYPE_CHECKING, Annotated, Any, Self, cast

from hal.extensions import ExtensionError, ExtensionPoint
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:  # the command line lists names, and loads neither the tick nor pydantic for that
    from rtstack.trials.assembly import ControllerFactory, DetectorFactory

Point = ExtensionPoint[Callable[..., Any]]
DEFAULT, DEFAULT_DETECTOR = "proposed", "appendix_b"
CONTROLLERS: Point = ExtensionPoint("rtstack.controllers", "controller", cast(Any, Callable))
DETECTORS: Point = ExtensionPoint("rtstack.detectors", "impact detector", cast(Any, Callable))


class OwnFactory(str):
    """What makes a controller or impact detector that no package offers: `factory`, under the name that its code has.

    Logs, results and specifications have the name in the place of an installed controller's, for example
    `__main__.softer` or, of a partial, `__main__.with_gain(gain=0.5)`.
    """

    factory: Callable[..., Any]

    def __new__(cls, factory: Callable[..., Any]) -> Self:
        made = super().__new__(cls, _name(factory))
        made.factory = factory
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return OwnFactory, (self.factory,)

    def __deepcopy__(self, _memo: Any) -> Self:
        return self


def _name(factory: Any) -> str:
    if isinstance(factory, partial):
        given = [*map(repr, factory.args), *(f"{name}={value!r}" for name, value in factory.keywords.items())]
        return f"{_name(factory.func)}({', '.join(given)})"
    named = factory if hasattr(factory, "__qualname__") else type(factory)
    return f"{named.__module__}.{named.__qualname__}"


def controller_names() -> list[str]:
    """Return the controllers that there are, the default first."""
    return _names(CONTROLLERS, DEFAULT)


def detector_names() -> list[str]:
    """Return the impact detectors that there are, the default first."""
    return _names(DETECTORS, DEFAULT_DETECTOR)


def _names(point: Point, default: str) -> list[str]:
    return sorted(point.names(), key=lambda name: (name != default, name))


def known(point: Point, name: str) -> str:
    """Return a name that is offered. Raises ValueError with one line."""
    try:
        return point.check(name)
    except ExtensionError as error:
        hint = "; a name with a dot is a Python object's: pass the object" if "." in name else ""
        raise ValueError(f"{error}{hint}") from None


def controller_factory(name: str) -> "ControllerFactory":
    """Return what makes a controller. Raises TrialError with one line."""
    return _factory(CONTROLLERS, name)


def detector_factory(name: str) -> "DetectorFactory":
    """Return what makes the impact detector of an arm. Raises TrialError with one line."""
    return _factory(DETECTORS, name)


def _factory(point: Point, name: str) -> Callable[..., Any]:
    if isinstance(name, OwnFactory):
        return name.factory
    try:
        return point.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None


def package_of_choice(point: Point, name: str) -> tuple[str, str]:
    """Return name and version of the package that a name is of; a Python object's own name where it is of none."""
    if not isinstance(name, OwnFactory):
        return point.package(name)
    for package in packages_distributions().get(name.partition(".")[0], ()):
        return package, version(package)
    return name, "not from a package"


class _Known:
    """How pydantic checks and describes a name. In Python a callable is taken, too."""

    def __init__(self, point: Point, names: Callable[[], list[str]]) -> None:
        self._point, self._names = point, names

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core.core_schema import no_info_wrap_validator_function

        def check(value: Any, text: Callable[[Any], str]) -> str:
            if callable(value):
                return OwnFactory(cast(Any, value))
            return value if isinstance(value, OwnFactory) else known(self._point, text(value))

        return no_info_wrap_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return handler(schema) | {"enum": self._names()}


ControllerName = Annotated[str, _Known(CONTROLLERS, controller_names)]
"""The name of an installed controller, as a field of a plan: an unknown one is refused."""
DetectorName = Annotated[str, _Known(DETECTORS, detector_names)]
"""The name of an installed impact detector, as a field of a plan: an unknown one is refused."""
