"""How a simulator is called: by name, checked, counted, and every completed run kept."""

from aleator.simulators.failure import NoOutcome, RunFailed, working_box
from aleator.simulators.function import FunctionSimulator, Simulator, load_function
from aleator.simulators.kept import Kept, keeping
from aleator.simulators.record import Failures, Runs
from aleator.simulators.runner import MAX_FAILED, Runner, as_runner, as_simulator
from aleator.simulators.store import Identity, Store
from aleator.simulators.workers.pool import ProcessPool

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
