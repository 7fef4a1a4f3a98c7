"""The likelihood without noise, from the parameters that give exactly the measured outcome.

These parameters form a level set of the simulator's response. Three nouns: if one or two parameters
scatter, a `Grid` of simulated values is used to find the set in its cells. `LevelSets` are points
with weights on the sets, so that the density of an outcome is a sum over them. The
`LevelLikelihood` is the log-likelihood as a function of alpha. It chooses the grid; where a grid
cannot be used, it finds the set on lines through the space of the standard normal variates.
`predicted` has the distributions of outcomes under a law.
"""

from aleator.likelihood.level_sets.likelihood import LevelLikelihood, on_a_grid, searched, traceable

__all__ = ["LevelLikelihood", "on_a_grid", "searched", "traceable"]
