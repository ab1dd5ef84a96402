"""A module of the example package, without its installation."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

PACKAGE = Path(__file__).parents[2] / "examples" / "plugin" / "joint_tracking"


def example(name: str) -> ModuleType:
    """Return a module of examples/plugin/joint_tracking."""
    spec = spec_from_file_location(f"example_{name}", PACKAGE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # kept machine code is loaded by the name of its function's module
    spec.loader.exec_module(module)
    return module
