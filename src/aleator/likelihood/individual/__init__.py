"""The likelihood as an integral over the parameters of each experiment, with adapted nodes.

The individual law of an experiment is the distribution of its parameters given its observations.
Three nouns: a `Predictor` gives the simulated values of all observations, by the simulator or by
response surfaces. A `NodeRule` places quadrature nodes in the individual law of each experiment:
about its modes, by piecewise Gauss-Legendre rules ("panels"), or as importance points. The
`IndividualLikelihood` sums over the nodes. `Following` is the objective of a search, which adapts
the nodes to every alpha.
"""

from aleator.likelihood.individual.levels import LevelRule
from aleator.likelihood.individual.likelihood import Following, IndividualLikelihood
from aleator.likelihood.individual.modes import NodeRule
from aleator.likelihood.individual.panels import Panels, PlanePanels
from aleator.likelihood.individual.posterior import (
    IndividualParameters,
    individual_parameters,
    individual_points,
)
from aleator.likelihood.individual.predictors import (
    Direct,
    Evaluator,
    Layout,
    OnProcesses,
    OnSurfaces,
    Predictor,
)
from aleator.likelihood.individual.rules import (
    GaussHermite,
    ImportancePoints,
    LawPoints,
    RidgePoints,
)

__all__ = [
    "Direct",
    "Evaluator",
    "Following",
    "GaussHermite",
    "ImportancePoints",
    "IndividualLikelihood",
    "IndividualParameters",
    "LawPoints",
    "Layout",
    "LevelRule",
    "OnProcesses",
    "OnSurfaces",
    "Panels",
    "PlanePanels",
    "Predictor",
    "RidgePoints",
    "NodeRule",
    "individual_parameters",
    "individual_points",
]
