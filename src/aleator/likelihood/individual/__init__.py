"""The likelihood as an integral over each experiment's own parameters, at nodes adapted to it."""

from aleator.likelihood.individual.following import Following
from aleator.likelihood.individual.gauss_hermite import GaussHermite
from aleator.likelihood.individual.importance import ImportancePoints
from aleator.likelihood.individual.law_points import LawPoints
from aleator.likelihood.individual.layout import Layout
from aleator.likelihood.individual.likelihood import IndividualLikelihood
from aleator.likelihood.individual.moments import (
    IndividualParameters,
    individual_parameters,
    individual_points,
)
from aleator.likelihood.individual.on_surfaces import OnSurfaces
from aleator.likelihood.individual.panels import Panels
from aleator.likelihood.individual.plane import PlanePanels
from aleator.likelihood.individual.predictor import Direct, Evaluator, Predictor
from aleator.likelihood.individual.ridge import RidgePoints
from aleator.likelihood.individual.rule import Rule

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
    "Rule",
    "individual_parameters",
    "individual_points",
]
