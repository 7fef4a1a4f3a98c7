"""Functional Mock-up Units as simulators: FMI 2.0 and 3.0, co-simulation and model exchange."""

from aleator.simulate.fmu.reduction import Crossing, Extreme, Final, Hook, Reduction
from aleator.simulate.fmu.settings import Course, Operation
from aleator.simulate.fmu.signals import Signal, read_signal
from aleator.simulate.fmu.simulator import FMUSimulator

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
