"""The likelihood as an integral over each experiment's own parameters, at nodes adapted to it.

Three nouns: a `Predictor` gives the simulated values of all observations, by the simulator or by
surfaces; a `NodeRule` places nodes in the individual law of each experiment, about its modes, on
panels, or by importance; the `IndividualLikelihood` sums over the nodes. `Following` is the
objective that adapts its nodes to every alpha.
"""

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
    "OnSurfaces",
    "Panels",
    "PlanePanels",
    "Predictor",
    "RidgePoints",
    "NodeRule",
    "individual_parameters",
    "individual_points",
]
