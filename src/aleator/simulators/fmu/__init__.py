"""Functional Mock-up Units (FMUs) as simulators: FMI 2.0 and 3.0, co-simulation and model exchange.

Three nouns. A `Course` (`settings`) says from when to when an FMU is simulated, in what steps, with
which inputs over time. A session (`session`) is one instance of the FMU in a process of its own,
which makes run after run; `engine` starts and ends that process. A `Reduction` (`reduction`)
computes the outcome from the trajectory of a run. `description` reads the model description of the
FMU, and finds the variable for each name.
"""

from aleator.simulators.fmu.reduction import Crossing, Extreme, Final, Hook, Reduction
from aleator.simulators.fmu.settings import Course, Operation, Signal, read_signal
from aleator.simulators.fmu.simulator import FMUSimulator

__all__ = [
    "Course",
    "Crossing",
    "Extreme",
    "FMUSimulator",
    "Final",
    "Hook",
    "Operation",
    "Reduction",
    "Signal",
    "read_signal",
]
