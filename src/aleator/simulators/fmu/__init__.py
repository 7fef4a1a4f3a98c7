"""Functional Mock-up Units as simulators: FMI 2.0 and 3.0, co-simulation and model exchange.

Three nouns: a `Course` (`settings`: from when to when, in what steps, with which inputs over time),
a session (`session`: one instance in a process of its own, run after run; `engine` starts and ends
that process), a `Reduction` (`reduction`: from the trajectory of a run to its outcome).
`description` has what the FMU says of itself and which variable each name is.
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
