"""Laws of the parameters, and of what is believed of their hyperparameters.

Three nouns: a `Hyperparameter` is fixed, or free within limits with a prior, or follows covariates;
a `Law` is the marginal law of one parameter, the image of a standard normal variate; `Inputs` are
all parameters together, x = T(theta | alpha), correlated, and with laws of single experiments.

`law` says what a marginal law is, `marginals`, `truncated_normal`, `scipy_law` and `mixture` are
those there are, `hyperparameter`, `covariates` and `correlation` are what alpha is made of, and
`inputs` is the joint law, which is all that a likelihood needs. `quadrature` has nodes and weights
of the joint law, `classes` its mixtures.
"""

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
