"""The likelihood without noise: where the simulator gives just what was measured.

Three nouns: a `Grid` has the simulated values in whose cells sets are found, if one or two
parameters scatter; `LevelSets` are points with weights on those sets, so that a density is a sum
over them; the `LevelLikelihood` of alpha chooses the grid, or the lines where no grid serves.
`predicted` has the distributions of outcomes under a law.
"""

from aleator.likelihood.level_sets.likelihood import LevelLikelihood, on_a_grid, searched, traceable

__all__ = ["LevelLikelihood", "on_a_grid", "searched", "traceable"]
