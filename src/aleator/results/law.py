"""The identified joint law of the parameters: samples, densities, probabilities, quantiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special, stats

from aleator.core.types import Array
from aleator.errors import InputsError, nearest
from aleator.laws import Law
from aleator.laws.inputs import Inputs

Points = Mapping[str, ArrayLike] | pd.DataFrame | ArrayLike


@dataclass(frozen=True, eq=False)
class Marginal:
    """The law of one parameter: its family, and the values (k,) of its hyperparameters.

    A parameter that is a known constant has no density: `pdf` gives 1 at its value, a probability.
    """

    family: Law
    values: Array

    @property
    def mean(self) -> float:
        """The parameter's mean."""
        return self.family.mean_and_sd(self.values).mean

    @property
    def sd(self) -> float:
        """The parameter's standard deviation, zero for a constant."""
        return self.family.mean_and_sd(self.values).sd

    def pdf(self, x: ArrayLike) -> Any:
        """The density at each x; zero outside the support."""
        at = np.asarray(x, dtype=np.float64)
        found = np.exp(self.family.log_density(self.values, at.ravel()))
        return found.reshape(at.shape)[()]

    def cdf(self, x: ArrayLike) -> Any:
        """The cumulative probability at each x: that the parameter is at most x."""
        at = np.asarray(x, dtype=np.float64)
        if not self.family.scatters:
            return np.where(at >= self.values[0], 1.0, 0.0)[()]
        found = special.ndtr(self.family.normal_score(self.values, at.ravel()))
        return found.reshape(at.shape)[()]

    def quantile(self, probability: ArrayLike) -> Any:
        """The value that the parameter does not exceed, with each given probability."""
        at = np.asarray(probability, dtype=np.float64)
        return self.family.quantile(self.values, at.ravel()).reshape(at.shape)[()]


@dataclass(frozen=True, eq=False)
class JointLaw:
    """The joint law of n parameters at given hyperparameters alpha (K,): P_X(alpha).

    `marginals` are the laws of the single parameters by name. Methods take points x in one of two
    forms. The first is a mapping or a data frame with a column for each parameter; its entries are
    numbers or arrays of one shape, and a constant parameter may be left out. The second is an array
    (..., n) in the order of the parameters. The methods return one value for each point, in the
    shape of the points. Raises InputsError for a parameter that is unknown or missing.

    >>> from aleator.laws import Constant, Normal
    >>> law = JointLaw(Inputs({"v": Normal(1.0, 2.0), "b": Constant(3.0)}), np.array([1., 2., 3.]))
    >>> law.sample(2, seed=1).columns.tolist(), float(law.marginals["v"].quantile(0.5))
    (['v', 'b'], 1.0)
    >>> float(law.pdf({"v": 1.0})), law.cdf({"v": [1.0, -99.0], "b": 3.0}).round(6).tolist()
    (0.199471, [0.5, 0.0])
    """

    inputs: Inputs
    alpha: Array

    @cached_property
    def marginals(self) -> Mapping[str, Marginal]:
        """The law of each single parameter, by name."""
        parts = zip(self.inputs.laws.items(), self.inputs.slices, strict=True)
        return {name: Marginal(law, self.alpha[part]) for (name, law), part in parts}

    def sample(self, size: int, seed: int = 0) -> pd.DataFrame:
        """`size` independent draws of the parameters, one a row; equal seeds give equal draws."""
        uniform = np.random.default_rng(seed).random((size, len(self.inputs.names)))
        return pd.DataFrame(self.inputs.sample(self.alpha, uniform), columns=[*self.inputs.names])

    def pdf(self, x: Points) -> Any:
        """The joint density of the parameters that scatter, at each point x.

        The density is zero outside the support, and where a constant parameter is given another
        value.
        """
        points, shape = self._points(x)
        return np.exp(self.inputs.log_density(self.alpha, points)).reshape(shape)[()]

    def cdf(self, x: Points) -> Any:
        """The probability that every parameter is at most its value in x, at each point x.

        Exact for independent parameters and for one correlated pair. For three or more correlated
        parameters it is a numerical integral with an error of about 1e-5 (Genz, 1992).
        """
        points, shape = self._points(x)
        found = np.ones(len(points))
        for i, marginal in enumerate(self.marginals.values()):
            if i not in self.inputs.correlated:
                found *= marginal.cdf(points[:, i])
        if self.inputs.correlated:
            found *= self._correlated_cdf(points)
        return found.reshape(shape)[()]

    def _correlated_cdf(self, points: Array, far: float = 40.0) -> Array:
        """The joint cdf of the correlated parameters; normal scores are limited to +-`far`."""
        tied = list(self.inputs.correlated)
        marginals = [*self.marginals.values()]
        scores = [marginals[i].family.normal_score(marginals[i].values, points[:, i]) for i in tied]
        matrix = self.inputs.correlation_matrix(self.alpha)[np.ix_(tied, tied)]
        copula = stats.multivariate_normal(cov=matrix, allow_singular=True, seed=0)
        found: Array = np.atleast_1d(copula.cdf(np.clip(np.stack(scores, axis=1), -far, far)))
        return found

    def _points(self, x: Points) -> tuple[Array, tuple[int, ...]]:
        """Points (J, n) in the order of the parameters, and the shape of the given points."""
        names = self.inputs.names
        if not isinstance(x, Mapping | pd.DataFrame):
            x = _by_name(np.asarray(x, dtype=np.float64), names)
        for name in map(str, x.keys()):
            if name not in names:
                raise InputsError(
                    f"there is no parameter '{name}'{nearest(name, names)}",
                    f"the parameters are {', '.join(names)}",
                )
        columns = []
        for name, marginal in self.marginals.items():
            if name not in x and marginal.family.scatters:
                raise InputsError(
                    f"x lacks the parameter '{name}'",
                    f"give {', '.join(names)}; the law of one alone is `law.marginals['{name}']`",
                )
            columns.append(np.asarray(x.get(name, marginal.mean), dtype=np.float64))
        whole = np.broadcast_arrays(*columns)
        return np.stack([column.ravel() for column in whole], axis=1), whole[0].shape


def _by_name(points: Array, names: tuple[str, ...]) -> dict[str, Array]:
    """The columns of points (..., n) by name. Raises InputsError if there are not n columns."""
    if points.ndim == 0 or points.shape[-1] != len(names):
        raise InputsError(
            f"x has shape {points.shape}, and there are {len(names)} parameters",
            f"give an array (..., {len(names)}) in the order {', '.join(names)}, or named columns",
        )
    return {name: points[..., i] for i, name in enumerate(names)}
