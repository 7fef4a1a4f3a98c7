"""The wet clutch: simulator, experiments and virtual test bench of Aleator's benchmark."""

from aleator.clutch.simulator import shifting_time

__all__ = ["shifting_time"]
