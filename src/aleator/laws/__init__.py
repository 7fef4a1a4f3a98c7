"""Probability laws of the uncertain parameters, and priors of their hyperparameters.

Three nouns: a `Hyperparameter` is fixed, or is free within limits and may have a prior, or follows
covariates. A `Law` is the marginal law of one parameter, the image of a standard normal variate.
`Inputs` is the joint law of all parameters, x = T(theta | alpha): it has their correlations, and
the laws of single experiments where these differ.

`law` defines what a marginal law offers. The laws themselves are in `constant`, `marginals`,
`truncated_normal`, `scipy_law` and `mixture`. The entries of the vector alpha of hyperparameters
come from `hyperparameter`, `covariates` and `correlation`. `inputs` has the joint law, which is all
that a likelihood needs. `quadrature` has nodes and weights for averages over the joint law, and
`classes` orders the components of mixtures.
"""

from aleator.laws.constant import Constant
from aleator.laws.hyperparameter import (
    OPEN,
    Between,
    By,
    Free,
    Hyperparameter,
    Specification,
    resolve,
    within,
)
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law, MeanSd, Rule, Standard
from aleator.laws.marginals import Beta, Gamma, LogNormal, Normal, Uniform
from aleator.laws.mixture import Mixture, QuantileLaw
from aleator.laws.scipy_law import ScipyLaw
from aleator.laws.truncated_normal import TruncatedNormal

__all__ = [
    "Beta",
    "Between",
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
