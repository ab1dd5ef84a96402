"""Impact-aware dual-arm control: from the demonstration to the trial to the log."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtstack.notebook.campaign import run_campaign
    from rtstack.notebook.figure import plot
    from rtstack.notebook.simulation import Simulation
    from rtstack.notebook.table import TrialTable

    __version__: str
    demonstrate, run_trial = Simulation().demonstrate, Simulation().run_trial
    run_trials, run_policy = Simulation().run_trials, Simulation().run_policy

_PLACES = {"Simulation": "simulation", "TrialTable": "table", "plot": "figure", "run_campaign": "campaign"}
_OF_SIMULATION = ("demonstrate", "run_policy", "run_trial", "run_trials")
__all__ = ["Simulation", "TrialTable", "__version__", "demonstrate", "plot", "run_campaign", "run_policy", "run_trial",
           "run_trials"]  # fmt: skip


def refuse_shadows(*names: str) -> None:
    """Raise ImportError where a file of the user's hides one of our packages: hal, sim_robot, console, deploy.

    `python -m rtstack` ends with the same line.
    """
    for name in names:
        spec, ours = find_spec(name), Path(__file__).parents[1] / name / "__init__.py"
        if spec is None or (spec.origin and Path(spec.origin).resolve() == ours.resolve()):
            continue
        found = spec.origin or ", ".join(spec.submodule_search_locations or ())
        line = f"Python finds {found} in the place of rtstack's package {name!r}: rename it, or move the program away"
        if sys.argv[:1] == ["-m"]:  # so it is while Python looks for the module of `python -m`
            sys.stderr.write(f"rtstack: {line}\n")
            raise SystemExit(2)
        raise ImportError(line, name=name, path=found)


refuse_shadows("hal")


def __getattr__(name: str) -> Any:
    """Import what is asked for: a plain `import rtstack` loads nothing."""
    if name == "__version__":
        return import_module("importlib.metadata").version("rtstack")
    if name in _OF_SIMULATION:
        return getattr(__getattr__("Simulation")(), name)
    if name in _PLACES:
        return getattr(import_module(f"rtstack.notebook.{_PLACES[name]}"), name)
    raise AttributeError(f"module 'rtstack' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
