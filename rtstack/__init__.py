"""Impact-aware dual-arm control: from the demonstration to the trial to the log."""

from importlib import import_module
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
