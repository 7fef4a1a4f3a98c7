"""Densities of the outcome from its moments or its nodes: one interface, a file or folder a choice.

A choice (`Gaussian()`, `MaximumEntropy(order=4)`) is a `Density`; its `fit` returns a
`FittedDensity`, N densities at once with a `Status` each.
"""

from aleator.densities.convolution import Convolution, FittedConvolution
from aleator.densities.gaussian import FittedGaussian, Gaussian
from aleator.densities.gaussian_mixture import FittedGaussianMixture, GaussianMixture
from aleator.densities.interface import (
    DEGENERATE_VALUE,
    FAILED_SOLVE_PENALTY,
    Density,
    FittedDensity,
    FittedMomentDensity,
    FittedNodeDensity,
    NodeDensity,
    NodeSensitivity,
    Sensitivity,
    Status,
)
from aleator.densities.maximum_entropy import FittedMaximumEntropy, MaximumEntropy
from aleator.densities.standardized import StandardizedDensity

__all__ = [
    "Density",
    "FittedDensity",
    "FittedMomentDensity",
    "FittedNodeDensity",
    "NodeDensity",
    "NodeSensitivity",
    "Gaussian",
    "MaximumEntropy",
    "Convolution",
    "FittedConvolution",
    "GaussianMixture",
    "FittedGaussianMixture",
    "FittedGaussian",
    "FittedMaximumEntropy",
    "Sensitivity",
    "StandardizedDensity",
    "Status",
    "FAILED_SOLVE_PENALTY",
    "DEGENERATE_VALUE",
]
