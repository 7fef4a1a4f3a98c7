"""The likelihood as an integral over each experiment's own parameters, at nodes adapted to it."""

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
