"""How a simulator is called: by names, checked, counted, and every completed run stored.

Three nouns. A `Simulator` computes an outcome from conditions and parameters. A `Runner` is the
only way to call one, for the rows of a table: it checks, counts and remembers runs. A `Store` is
the file that keeps every run, by the simulator's fingerprint, the conditions and the parameters.

Simulators are functions (`function`), programs (`command`), FMUs (`fmu`), models of a server
(`umbridge`), and any of them with parameters that are computed from others (`derived`). Runs are
made in batches (`dispatch`), in this process, by worker processes (`pool`) or by a cluster
(`clusters`). `surroundings` distinguishes a fault of the machine from a failure of the simulator.
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
