"""The density of largest entropy that has the first moments of the outcome.

`choice` asks `solution` for the multipliers (Newton's method on the dual, in `dual`, whitened for
hard targets) on the support that `support` sets, and `fitted` is the answer in the unit of the
outcome: `distribution` for probabilities, `partials` for the search.
"""

from aleator.moments.densities.maximum_entropy.choice import MaximumEntropy
from aleator.moments.densities.maximum_entropy.fitted import FittedMaximumEntropy

__all__ = ["FittedMaximumEntropy", "MaximumEntropy"]
