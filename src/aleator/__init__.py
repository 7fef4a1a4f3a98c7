"""Aleator identifies the probability law of uncertain parameters from experiments."""

from aleator.cubature import (
    GermGrid,
    MonteCarloPoints,
    ProbabilityGrid,
    Smolyak,
    SobolPoints,
    TensorGauss,
)
from aleator.densities import Convolution, Gaussian, GaussianMixture, LogSpline, MaximumEntropy
from aleator.distances import earth_movers_distance
from aleator.errors import AleatorError
from aleator.expansion import Projection, Regression, Sparse, SparseProjection
from aleator.experiments import Experiments
from aleator.identification import Identification
from aleator.identify import identify
from aleator.indices import Anisotropic, Hyperbolic, TotalDegree
from aleator.inputs import Inputs
from aleator.laws import (
    Beta,
    Constant,
    Free,
    Gamma,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.noise import Noise
from aleator.prediction import predict
from aleator.propagation import Collocation
from aleator.response import ResponseSurface
from aleator.search import (
    CMAES,
    CustomSearch,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
)
from aleator.sobol import sobol_indices
from aleator.verification import MonteCarlo

__all__ = [
    "identify",
    "predict",
    "Identification",
    "Experiments",
    "Inputs",
    "Normal",
    "TruncatedNormal",
    "Uniform",
    "Beta",
    "Gamma",
    "LogNormal",
    "ScipyLaw",
    "Constant",
    "Free",
    "Noise",
    "ResponseSurface",
    "Collocation",
    "TensorGauss",
    "Smolyak",
    "SobolPoints",
    "MonteCarloPoints",
    "ProbabilityGrid",
    "GermGrid",
    "Projection",
    "SparseProjection",
    "Regression",
    "Sparse",
    "TotalDegree",
    "Hyperbolic",
    "Anisotropic",
    "sobol_indices",
    "Gaussian",
    "MaximumEntropy",
    "GaussianMixture",
    "Convolution",
    "LogSpline",
    "earth_movers_distance",
    "GradientMultistart",
    "GeneticAlgorithm",
    "DifferentialEvolution",
    "CMAES",
    "CustomSearch",
    "MonteCarlo",
    "AleatorError",
]
