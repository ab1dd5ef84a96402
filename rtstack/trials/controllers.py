"""The controllers of a trial: by name, those of this package and of any other that is installed; or a Python object."""

from collections.abc import Callable
from functools import partial
from importlib.metadata import packages_distributions, version
from typing import TYPE_CHECKING, Annotated, Any, Self, cast

from hal.extensions import ExtensionError, ExtensionPoint
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:  # the command line lists names, and loads neither the tick nor pydantic for that
    from rtstack.trials.assembly import ControllerFactory

DEFAULT = "proposed"
CONTROLLERS: ExtensionPoint[Callable[..., Any]] = ExtensionPoint(
    "rtstack.controllers", "controller", cast(Any, Callable)
)


class OwnController(str):
    """A controller that no package offers under a name: `factory`, under the name that its code gives it.

    Logs, results and specifications have the name in the place of an installed controller's, for example
    `__main__.softer` or, of a partial, `__main__.with_gain(gain=0.5)`.
    """

    factory: "ControllerFactory"

    def __new__(cls, factory: "ControllerFactory") -> Self:
        made = super().__new__(cls, _name(factory))
        made.factory = factory
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return OwnController, (self.factory,)

    def __deepcopy__(self, _memo: Any) -> Self:
        return self


def _name(factory: Any) -> str:
    if isinstance(factory, partial):
        given = [*map(repr, factory.args), *(f"{name}={value!r}" for name, value in factory.keywords.items())]
        return f"{_name(factory.func)}({', '.join(given)})"
    named = factory if hasattr(factory, "__qualname__") else type(factory)
    return f"{named.__module__}.{named.__qualname__}"


def controller_names() -> list[str]:
    """Return the names that there are, the default first."""
    return sorted(CONTROLLERS.names(), key=lambda name: (name != DEFAULT, name))


def known_controller(name: str) -> str:
    """Return the name of a controller that there is. Raises ValueError with one line."""
    try:
        return CONTROLLERS.check(name)
    except ExtensionError as error:
        hint = "; a name with a dot is a Python object's: pass the object" if "." in name else ""
        raise ValueError(f"{error}{hint}") from None


def controller_factory(name: str) -> "ControllerFactory":
    """Return what makes a controller. Raises TrialError with one line."""
    if isinstance(name, OwnController):
        return name.factory
    try:
        return CONTROLLERS.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None


def controller_package(name: str) -> tuple[str, str]:
    """Return name and version of a controller's package; a Python object's own name where it is of none."""
    if not isinstance(name, OwnController):
        return CONTROLLERS.package(name)
    for package in packages_distributions().get(name.partition(".")[0], ()):
        return package, version(package)
    return name, "not from a package"


class _Known:
    """How pydantic checks and describes a name. In Python a callable is taken, too."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core.core_schema import no_info_wrap_validator_function

        def check(value: Any, text: Callable[[Any], str]) -> str:
            if callable(value):
                return OwnController(cast(Any, value))
            return value if isinstance(value, OwnController) else known_controller(text(value))

        return no_info_wrap_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return handler(schema) | {"enum": controller_names()}


ControllerName = Annotated[str, _Known()]
"""The name of an installed controller, as a field of a plan: an unknown one is refused."""
