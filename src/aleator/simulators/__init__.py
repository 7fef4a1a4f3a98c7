"""How a simulator is called: by name, checked, counted, and every completed run kept."""

from aleator.simulators.function import FunctionSimulator, as_simulator, load_function
from aleator.simulators.messages import notified
from aleator.simulators.pool import ProcessPool
from aleator.simulators.protocol import NoOutcome, RunFailed, Simulator, working_box
from aleator.simulators.runner import MAX_FAILED, Account, Budget, Runner, as_runner
from aleator.simulators.runs import Failure, Runs
from aleator.simulators.store import Identity, Store
from aleator.simulators.units import Cases

__all__ = [
    "MAX_FAILED",
    "Account",
    "Budget",
    "Cases",
    "Failure",
    "FunctionSimulator",
    "Identity",
    "NoOutcome",
    "ProcessPool",
    "RunFailed",
    "Runner",
    "Runs",
    "Simulator",
    "Store",
    "as_runner",
    "as_simulator",
    "load_function",
    "notified",
    "working_box",
]
