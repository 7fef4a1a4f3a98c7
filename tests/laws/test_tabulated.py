"""Many parameters at once, without derivatives: what laws themselves say."""

import numpy as np
import pytest
from scipy import stats

from aleator import (
    Beta,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.laws import QuantileLaw
from aleator.laws.hyperparameter import resolve
from aleator.laws.inputs import Individual, parameters_at


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
