"""The likelihood as an integral over each experiment's own parameters, at nodes adapted to it."""

from aleator.likelihood.individual.layout import Layout
from aleator.likelihood.individual.likelihood import IndividualLikelihood
from aleator.likelihood.individual.moments import IndividualParameters, individual_parameters
from aleator.likelihood.individual.on_surfaces import OnSurfaces
from aleator.likelihood.individual.predictor import Direct, Evaluator, Predictor
from aleator.likelihood.individual.rule import GaussHermite, Panels, Rule

__all__ = [
    "Direct",
    "Evaluator",
    "GaussHermite",
    "IndividualLikelihood",
    "IndividualParameters",
    "Layout",
    "OnSurfaces",
    "Panels",
    "Predictor",
    "Rule",
    "individual_parameters",
]
