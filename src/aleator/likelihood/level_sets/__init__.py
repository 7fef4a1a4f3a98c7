"""Without noise: the likelihood from where a response gives just what was measured."""

from aleator.likelihood.level_sets.likelihood import LevelLikelihood, cells_of, traceable

__all__ = ["LevelLikelihood", "cells_of", "traceable"]
