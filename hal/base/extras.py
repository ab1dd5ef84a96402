"""What of the package's extras, or of what not every Python has, is not installed, and how to install it."""

import re
from importlib.metadata import requires
from importlib.util import find_spec

from hal.base.configuration import ConfigurationError


def require(extra: str) -> None:
    """Raise ConfigurationError where a package of the extra is not installed."""
    for module, of in _modules():
        if of == extra and find_spec(module) is None:
            raise ConfigurationError(_advice(module, extra))


def advice(module: str | None) -> str | None:
    """Return what to install for a module that could not be imported, None where that is not known."""
    if extras := [extra for name, extra in _modules() if name == module]:
        return _advice(str(module), extras[0])
    pythons = published_for(module)
    return f"{module} is not installed: that needs a Python for which it is published ({pythons})" if pythons else None


def published_for(module: str | None) -> str | None:
    """Return for which versions of Python rtstack brings a module, as pip spells it; None for one that all have."""
    found = [re.match(r"([\w.-]+)[^;]*;\s*(python_version[^;]*)$", line) for line in requires("rtstack") or ()]
    return next((match[2] for match in found if match and match[1].replace("-", "_") == module), None)


def _advice(module: str, extra: str) -> str:
    return f"{module} is not installed: pip install 'rtstack[{extra}]'"


def _modules() -> list[tuple[str, str]]:
    """Return the modules of each extra, in its order; a package and its module have the same name, but for hyphens."""
    found = [re.match(r"([\w.-]+).*;.*\bextra == ['\"]([\w-]+)['\"]", line) for line in requires("rtstack") or ()]
    return [(match[1].replace("-", "_"), match[2]) for match in found if match]
