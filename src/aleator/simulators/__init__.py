"""How a simulator is called: by name, checked, counted, and every completed run kept.

Three nouns: a `Simulator` (conditions and parameters in, an outcome out), a `Runner` (the only way
to one, for the units of a table: it checks, counts and remembers), a `Store` (the file that keeps
every run by the simulator's fingerprint, its conditions and its parameters).

Simulators are functions (`function`), programs (`command`), FMUs (`fmu`), and any of them with
parameters that follow from others (`derived`). Runs are made in batches (`dispatch`) in this
process, by worker processes (`pool`) or by a cluster (`clusters`); `surroundings` tells what the
machine did to a run from what the simulator answered.
"""

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
