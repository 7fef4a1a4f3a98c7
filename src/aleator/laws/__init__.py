"""Laws of the parameters: one file for each marginal law, and `Inputs`, the joint law."""

from aleator.laws.hyperparameter import (
    OPEN,
    By,
    Free,
    Hyperparameter,
    Specification,
    resolve,
    within,
)
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law, MeanSd, Rule, Standard
from aleator.laws.marginals import Beta, Constant, Gamma, LogNormal, Normal, Uniform
from aleator.laws.mixture import Mixture, QuantileLaw
from aleator.laws.scipy_law import ScipyLaw
from aleator.laws.truncated_normal import TruncatedNormal

__all__ = [
    "Beta",
    "By",
    "Constant",
    "OPEN",
    "Free",
    "Gamma",
    "Hyperparameter",
    "Inputs",
    "Law",
    "LogNormal",
    "MeanSd",
    "Mixture",
    "Normal",
    "QuantileLaw",
    "Rule",
    "ScipyLaw",
    "Specification",
    "Standard",
    "TruncatedNormal",
    "Uniform",
    "resolve",
    "within",
]
