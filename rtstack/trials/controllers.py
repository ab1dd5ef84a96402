"""The controllers that a trial may choose by name: those of this package, and of any other that is installed."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, cast

from hal.extensions import ExtensionError, ExtensionPoint
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:  # the command line lists names, and loads neither the tick nor pydantic for that
    from rtstack.trials.assembly import ControllerFactory

DEFAULT = "proposed"
CONTROLLERS: ExtensionPoint[Callable[..., Any]] = ExtensionPoint(
    "rtstack.controllers", "controller", cast(Any, Callable)
)


def controller_names() -> list[str]:
    """Return the names that there are, the default first."""
    return sorted(CONTROLLERS.names(), key=lambda name: (name != DEFAULT, name))


def known_controller(name: str) -> str:
    """Return the name of a controller that there is. Raises ValueError with one line."""
    try:
        return CONTROLLERS.check(name)
    except ExtensionError as error:
        raise ValueError(str(error)) from None


def controller_factory(name: str) -> "ControllerFactory":
    """Return what makes a controller. Raises TrialError with one line."""
    try:
        return CONTROLLERS.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None


class _Known:
    """How pydantic checks and describes a name."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core.core_schema import no_info_after_validator_function

        return no_info_after_validator_function(known_controller, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return handler(schema) | {"enum": controller_names()}


ControllerName = Annotated[str, _Known()]
