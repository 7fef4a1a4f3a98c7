"""Functional Mock-up Units as simulators: FMI 2.0 and 3.0, co-simulation and model exchange."""

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
