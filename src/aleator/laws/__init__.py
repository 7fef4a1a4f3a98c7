"""Marginal laws of the parameters: one file a law, one interface."""

from aleator.laws.constant import Constant
from aleator.laws.hyperparameter import (
    OPEN,
    Free,
    Hyperparameter,
    Specification,
    resolve,
    within,
)
from aleator.laws.law import Law, MeanSd, Rule, Standard
from aleator.laws.normal import Normal
from aleator.laws.truncated_normal import TruncatedNormal

__all__ = [
    "Constant",
    "OPEN",
    "Free",
    "Hyperparameter",
    "Law",
    "MeanSd",
    "Normal",
    "Rule",
    "Specification",
    "Standard",
    "TruncatedNormal",
    "resolve",
    "within",
]
