"""How a simulator is called: by name, checked, counted, and every completed run kept."""

from aleator.simulators.budget import Account, Budget
from aleator.simulators.cases import Cases
from aleator.simulators.failure import NoOutcome, RunFailed, working_box
from aleator.simulators.function import FunctionSimulator, as_simulator
from aleator.simulators.identity import Identity
from aleator.simulators.loading import load_function
from aleator.simulators.notes import notified
from aleator.simulators.protocol import Simulator
from aleator.simulators.runner import MAX_FAILED, Runner, as_runner
from aleator.simulators.runs import Failure, Runs
from aleator.simulators.store import Store
from aleator.simulators.workers.pool import ProcessPool

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
