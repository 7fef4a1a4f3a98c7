"""Densities of the outcome from its moments: one interface, a file or folder a choice.

A choice (`Gaussian()`, `MaximumEntropy(order=4)`) is a `Density`; its `fit` returns a
`FittedDensity`, N densities at once with a `Status` each.
"""

from aleator.moments.densities.gaussian import FittedGaussian, Gaussian
from aleator.moments.densities.gaussian_mixture import FittedGaussianMixture, GaussianMixture
from aleator.moments.densities.interface import (
    FAILED_SOLVE_PENALTY,
    Density,
    FittedDensity,
    FittedMomentDensity,
    Sensitivity,
)
from aleator.moments.densities.maximum_entropy import FittedMaximumEntropy, MaximumEntropy
from aleator.moments.densities.standardized import StandardizedDensity

__all__ = [
    "Density",
    "FittedDensity",
    "FittedMomentDensity",
    "Gaussian",
    "MaximumEntropy",
    "GaussianMixture",
    "FittedGaussianMixture",
    "FittedGaussian",
    "FittedMaximumEntropy",
    "Sensitivity",
    "StandardizedDensity",
    "FAILED_SOLVE_PENALTY",
]
