"""Without noise: the likelihood from where a response gives just what was measured."""

from aleator.likelihood.level_sets.likelihood import LevelLikelihood, on_a_grid, searched, traceable

__all__ = ["LevelLikelihood", "on_a_grid", "searched", "traceable"]
