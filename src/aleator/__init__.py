"""Aleator identifies the probability law of uncertain parameters from experiments."""

from aleator.densities import Convolution, Gaussian, GaussianMixture, LogSpline, MaximumEntropy
from aleator.densities.distances import earth_movers_distance
from aleator.errors import AleatorError
from aleator.expansion import Projection, Regression, Sparse, SparseProjection
from aleator.expansion.sobol import sobol_indices
from aleator.inference.verification import MonteCarlo
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
from aleator.laws.inputs import Inputs
from aleator.likelihood.propagation import Collocation
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.polynomials.indices import Anisotropic, Hyperbolic, TotalDegree
from aleator.quadrature import (
    GermGrid,
    MonteCarloPoints,
    ProbabilityGrid,
    Smolyak,
    SobolPoints,
    TensorGauss,
)
from aleator.search import (
    CMAES,
    CustomSearch,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
)
from aleator.surrogates import ResponseSurface
from aleator.tasks.identify import identify
from aleator.tasks.predict import predict
from aleator.tasks.result import Identification

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
