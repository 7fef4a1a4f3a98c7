"""Without noise, on the simulator itself: the likelihood from where it gives what was measured."""

from aleator.likelihood.level_sets.likelihood import FEW, LevelLikelihood, traceable

__all__ = ["FEW", "LevelLikelihood", "traceable"]
