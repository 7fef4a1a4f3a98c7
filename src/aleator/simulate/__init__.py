"""How a simulator is called: by name, checked, counted, and every completed run kept."""

from aleator.simulate.failure import NoOutcome, RunFailed, working_box
from aleator.simulate.function import FunctionSimulator, Simulator, load_function
from aleator.simulate.kept import Kept, keeping
from aleator.simulate.record import Failures, Runs
from aleator.simulate.runner import MAX_FAILED, Runner, as_runner, as_simulator
from aleator.simulate.store import Identity, Store
from aleator.simulate.workers.pool import ProcessPool

__all__ = [
    "MAX_FAILED",
    "NoOutcome",
    "Failures",
    "FunctionSimulator",
    "Identity",
    "Kept",
    "ProcessPool",
    "RunFailed",
    "Runner",
    "Runs",
    "Simulator",
    "Store",
    "as_runner",
    "as_simulator",
    "keeping",
    "load_function",
    "working_box",
]
