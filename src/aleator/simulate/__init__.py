"""How a simulator is called: by name, checked, counted, and every completed run kept."""

from aleator.simulate.failure import NoOutcome, RunFailed, working_box
from aleator.simulate.function import FunctionSimulator, Simulator, load_function
from aleator.simulate.kept import keeping
from aleator.simulate.record import Runs
from aleator.simulate.runner import Runner, as_runner, as_simulator

__all__ = [
    "NoOutcome",
    "FunctionSimulator",
    "RunFailed",
    "Runner",
    "Runs",
    "Simulator",
    "as_runner",
    "as_simulator",
    "keeping",
    "load_function",
    "working_box",
]
