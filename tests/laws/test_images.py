"""Laws as images of a variate: of each experiment, next to a scale of zero, and tabulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from aleator import Inputs
from aleator.core.types import Array
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
from aleator.laws.inputs import Individual, parameters_at

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
def test_derivatives_of_each_experiment_are_those_of_differences(law: Law) -> None:
    values, h = of(law), 1e-6
    found = law.standard(values, THETA)
    along = (law.standard(values, THETA + h).x - law.standard(values, THETA - h).x) / (2 * h)
    np.testing.assert_allclose(found.dtheta, along, rtol=1e-5, atol=1e-8)
    for k in range(values.shape[0]):
        move = h * np.eye(values.shape[0])[k][:, None, None]
        ends = [law.standard(values + sign * move, THETA).x for sign in (1.0, -1.0)]
        np.testing.assert_allclose(found.dvalues[..., k], (ends[0] - ends[1]) / (2 * h), atol=2e-6)


SD_FROM_ZERO = Free(0.0, 0.5)
FROM_ZERO: dict[str, Law] = {
    "normal": Normal(Free(0.5, 2.0), SD_FROM_ZERO),
    "lognormal": LogNormal(Free(0.5, 2.0), SD_FROM_ZERO),
    "uniform": Uniform(Free(0.5, 2.0), SD_FROM_ZERO),
    "gamma": Gamma(Free(0.5, 2.0), SD_FROM_ZERO, lower=0.1),
    "beta": Beta((0.0, 3.0), Free(0.5, 2.0), SD_FROM_ZERO),
    "truncated": TruncatedNormal((0.4, 2.2), Free(0.5, 2.0), SD_FROM_ZERO),
    "scipy": ScipyLaw(stats.logistic(), Free(0.5, 2.0), SD_FROM_ZERO),
}
FIVE = np.array([-3.0, -0.5, 0.0, 1.0, 3.0])


@pytest.mark.parametrize("law", FROM_ZERO.values(), ids=FROM_ZERO)
def test_next_to_zero_every_law_is_its_mean_and_moves_with_it(law: Law) -> None:
    sd = law.hyperparameters[1]
    assert 0.0 < sd.lower <= 1e-3 * sd.upper
    found = law.standard(np.array([1.2, sd.lower]), FIVE)
    np.testing.assert_allclose(found.x, 1.2, atol=20.0 * sd.lower)
    np.testing.assert_allclose(found.dvalues[:, 0], 1.0, atol=1e-2)
    # by the sd: the standardized variate, which for all of these is about theta
    slope = found.dvalues[:, 1]
    assert np.all(np.isfinite(slope))
    assert np.all(np.diff(slope) > 0.0)
    assert abs(slope[2]) < 0.01


def test_a_truncated_law_whose_mean_is_outside_ends_on_its_box() -> None:
    law = TruncatedNormal((0.0, 1.0), Free(-1.0, 2.0), Free(0.0, 0.5))
    found = law.standard(np.array([1.5, law.hyperparameters[1].lower]), FIVE)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-9)
    assert np.all(np.isfinite(found.dvalues))


def test_a_start_is_not_next_to_zero() -> None:
    assert Normal(Free(0.0, 1.0), SD_FROM_ZERO).hyperparameters[1].start == pytest.approx(
        0.5 * 1e-1**1.5
    )


class Kinked(QuantileLaw):
    """Uniform on [0, scale] but for its density, 0.6 below the median and 1.4 above."""

    @property
    def hyperparameters(self):
        return (resolve("scale", 1.0, (None, None), positive=True),)

    def log_density(self, values, x):
        return np.log(np.where(x < 0.5 * values[0], 0.6, 1.4) / values[0])

    def quantile(self, values, probability):
        below, above = probability / 0.6, 0.5 + (probability - 0.3) / 1.4
        return values[0] * np.where(probability < 0.3, below, above)


XI = 3.0 * np.random.default_rng(4).standard_normal((50, 400, 2))


def both(inputs: Inputs, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    quick = parameters_at(inputs, alpha, XI, slice(0, 50), often=True)[0]
    return quick, Individual.of(inputs, alpha, np.clip(XI, -9.5, 9.5), slice(0, 50)).x


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (Normal(Free(-1.0, 1.0), Free(0.1, 2.0)), (0.2, 0.7)),
        (LogNormal(Free(0.1, 5.0), Free(0.1, 2.0)), (1.0, 0.5)),
        (Gamma(Free(0.1, 5.0), Free(0.1, 2.0)), (1.0, 0.8)),
        (Uniform(Free(-1.0, 1.0), Free(0.1, 1.0)), (0.2, 0.7)),
        (Beta((0.0, 2.0), Free(0.5, 1.5), Free(0.05, 0.5)), (1.0, 0.23)),
        (TruncatedNormal((0.0, 1.0), Free(0.0, 1.0), Free(0.01, 2.0)), (0.0, 0.8)),
        (ScipyLaw(stats.weibull_min(2.0), Free(0.1, 5.0), Free(0.1, 2.0)), (2.0, 1.0)),
    ],
    ids=lambda part: type(part).__name__,
)
def test_a_table_is_as_exact_as_its_law(law, values: tuple[float, float]) -> None:
    inputs = Inputs({"a": law, "b": Normal(0.0, 1.0)})
    quick, exact = both(inputs, np.array([*values, 0.0, 1.0]))
    width = np.subtract(*np.quantile(exact[..., 0], [0.75, 0.25]))
    inside = np.abs(XI[..., 0]) < 6.0
    assert np.max(np.abs(quick - exact)[inside, 0]) < 1e-8 * width
    np.testing.assert_allclose(quick[..., 1], exact[..., 1], atol=1e-12)


def test_correlated_parameters_are_those_of_the_law() -> None:
    laws = {"a": Normal(Free(-1.0, 1.0), 1.0), "b": LogNormal(1.0, 0.3)}
    inputs = Inputs(laws, {("a", "b"): Free(-0.9, 0.9)})
    start = np.array([h.start for h in inputs.hyperparameters])
    start[inputs.partials] = 0.6
    quick = parameters_at(inputs, start, 0.5 * XI, slice(0, 50), often=True)[0]
    exact = Individual.of(inputs, start, 0.5 * XI, slice(0, 50)).x
    np.testing.assert_allclose(quick, exact, atol=1e-9)


def test_a_law_with_a_kink_is_asked_itself() -> None:
    inputs = Inputs({"a": Kinked(), "b": Normal(0.0, 1.0)})
    quick, exact = both(inputs, np.array([1.0, 0.0, 1.0]))
    np.testing.assert_allclose(quick[..., 0], exact[..., 0], atol=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_one_law_takes_variates_of_any_shape(law: Law) -> None:
    values = of(law)[:, 1, 0]
    found, flat = law.standard(values, THETA), law.standard(values, THETA.ravel())
    assert np.array_equal(found.x, flat.x.reshape(THETA.shape))
    assert np.array_equal(found.dtheta, flat.dtheta.reshape(THETA.shape))
    assert np.array_equal(found.dvalues, flat.dvalues.reshape(*THETA.shape, -1))
