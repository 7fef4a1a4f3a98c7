"""Laws with values of their own for each experiment: the same as one law after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from aleator.laws import (
    Beta,
    Constant,
    Free,
    Gamma,
    Hyperparameter,
    Law,
    LogNormal,
    Normal,
    QuantileLaw,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
    resolve,
)
from aleator.types import Array

SD = Free(0.05, 0.5)


@dataclass(frozen=True)
class Weibull(QuantileLaw):
    """A law written down by density and quantile only."""

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        return (
            resolve("shape", Free(0.5, 3.0), (None, None), positive=True),
            resolve("scale", Free(0.05, 2.0), (None, None), positive=True),
        )

    def log_density(self, values: Array, x: Array) -> Array:
        return stats.weibull_min(values[0], scale=values[1]).logpdf(x)

    def quantile(self, values: Array, probability: Array) -> Array:
        return stats.weibull_min(values[0], scale=values[1]).ppf(probability)


LAWS: dict[str, Law] = {
    "normal": Normal(Free(0.5, 2.0), SD),
    "lognormal": LogNormal(Free(0.5, 2.0), SD),
    "uniform": Uniform(Free(0.5, 2.0), SD),
    "gamma": Gamma(Free(0.5, 2.0), SD, lower=0.1),
    "beta": Beta((0.0, 3.0), Free(0.5, 2.0), SD),
    "truncated": TruncatedNormal((0.4, 1.2), Free(0.5, 2.0), SD),
    "truncated above": TruncatedNormal((-np.inf, 1.2), Free(0.5, 2.0), SD),
    "truncated, Hermite": TruncatedNormal((0.4, np.inf), Free(0.5, 2.0), SD, "hermite"),
    "scipy": ScipyLaw(stats.logistic(), Free(0.5, 2.0), SD),
    "by quantile": Weibull(),
    "constant": Constant(Free(0.5, 2.0)),
}
MEANS, SDS = np.array([0.6, 1.1, 1.9, 1.1]), np.array([0.4, 0.07, 0.2, 0.07])
THETA = np.random.default_rng(3).normal(size=(4, 5))


def of(law: Law) -> Array:
    """Values (k, 4, 1) of four experiments, two of which are alike."""
    return np.stack([MEANS, SDS])[: len(law.hyperparameters), :, None]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_values_of_each_experiment_are_as_good_as_a_loop(law: Law) -> None:
    values = of(law)
    found = law.standard(values, THETA)
    for b in range(4):
        for j in range(5):
            alone = law.standard(values[:, b, 0], THETA[b, j : j + 1])
            np.testing.assert_allclose(found.x[b, j], alone.x[0], rtol=1e-13)
            np.testing.assert_allclose(found.dtheta[b, j], alone.dtheta[0], rtol=1e-12)
            np.testing.assert_allclose(
                found.dvalues[b, j], alone.dvalues[0], rtol=1e-11, atol=1e-13
            )


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_one_law_takes_variates_of_any_shape(law: Law) -> None:
    values = of(law)[:, 1, 0]
    found, flat = law.standard(values, THETA), law.standard(values, THETA.ravel())
    assert np.array_equal(found.x, flat.x.reshape(THETA.shape))
    assert np.array_equal(found.dtheta, flat.dtheta.reshape(THETA.shape))
    assert np.array_equal(found.dvalues, flat.dvalues.reshape(*THETA.shape, -1))


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_derivatives_of_each_experiment_are_those_of_differences(law: Law) -> None:
    values, h = of(law), 1e-6
    found = law.standard(values, THETA)
    along = (law.standard(values, THETA + h).x - law.standard(values, THETA - h).x) / (2 * h)
    np.testing.assert_allclose(found.dtheta, along, rtol=1e-5, atol=1e-8)
    for k in range(values.shape[0]):
        move = h * np.eye(values.shape[0])[k][:, None, None]
        ends = [law.standard(values + sign * move, THETA).x for sign in (1.0, -1.0)]
        np.testing.assert_allclose(found.dvalues[..., k], (ends[0] - ends[1]) / (2 * h), atol=2e-6)
