"""What is to stand on the seams of the likelihood fits without a change elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from aleator import Free, Inputs, Normal
from aleator.core.types import Array, Indices
from aleator.likelihood.individual import Direct, GaussHermite, IndividualLikelihood, Layout
from aleator.observations.errors import Terms

COUNT, EACH = 6, 5
EXPERIMENT = np.repeat(np.arange(COUNT), EACH)
TIMES = np.tile(np.linspace(0.0, 1.0, EACH), COUNT)
SD, RHO = 0.1, 0.7


@dataclass(frozen=True, eq=False)
class Autoregressive:
    """e_1 ~ N(0, sd^2), e_k = rho e_(k-1) + sd sqrt(1 - rho^2) N(0, 1), within each experiment."""

    y: Array
    first: Array

    hyperparameters = ()

    def terms(self, _values: Array, eta: Array, rows: slice) -> Terms:
        """log p of each observation given the earlier ones, and the derivative of their sum."""
        e, first = self.y[rows, None] - eta, self.first[rows, None]
        before = np.where(first, 0.0, RHO * np.roll(e, 1, axis=0))
        sd = np.where(first, SD, SD * np.sqrt(1.0 - RHO**2))
        u = (e - before) / sd
        value = -0.5 * u**2 - np.log(sd * np.sqrt(2.0 * np.pi))
        after = np.where(np.roll(first, -1, axis=0), 0.0, RHO * np.roll(u / sd, -1, axis=0))
        return Terms(value, u / sd - after, ())

    def curvature(self, _values: Array, eta: Array, rows: slice) -> Array:
        """Of each by itself, which places the nodes."""
        return np.broadcast_to(np.where(self.first[rows, None], 1.0, 0.4) / SD**2, eta.shape)


@dataclass(frozen=True, eq=False)
class Line(Direct):
    """eta = a + b t at the times of all observations."""

    def values(self, block, x: Array) -> Array:  # type: ignore[no-untyped-def]
        t = TIMES[block.rows, None]
        return x[block.owner, :, 0] + x[block.owner, :, 1] * t

    def with_slopes(self, block, x: Array) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
        eta = self.values(block, x)
        t = np.broadcast_to(TIMES[block.rows, None], eta.shape)
        return eta, np.stack([np.ones_like(eta), t])


def test_errors_of_an_experiment_together() -> None:
    """A line with AR(1) errors is multivariate normal."""
    inputs = Inputs(
        {"a": Normal(Free(-2.0, 4.0), Free(0.05, 2.0)), "b": Normal(Free(-2.0, 2.0), 0.4)}
    )
    rng, alpha = np.random.default_rng(1), np.array([1.0, 0.3, 0.5, 0.4])
    lags = np.abs(np.subtract.outer(np.arange(EACH), np.arange(EACH)))
    noise = SD**2 * RHO**lags
    t = TIMES[:EACH]
    covariance = noise + 0.3**2 + 0.4**2 * np.outer(t, t)
    y = rng.multivariate_normal(1.0 + 0.5 * t, covariance, COUNT)
    first = np.tile(np.arange(EACH) == 0, COUNT)
    unit: Indices = np.arange(COUNT * EACH)
    likelihood = IndividualLikelihood.of(
        inputs, Autoregressive(y.ravel(), first), Line(None, np.arange(2), inputs.box),  # type: ignore[arg-type]
        Layout(COUNT, EXPERIMENT, unit, np.zeros_like(unit)), GaussHermite(15),
    )  # fmt: skip

    def exact(alpha: Array) -> Array:
        own = noise + alpha[1] ** 2 + alpha[3] ** 2 * np.outer(t, t)
        return stats.multivariate_normal.logpdf(y, alpha[0] + alpha[2] * t, own)

    found = likelihood.adapted(alpha)(alpha)
    np.testing.assert_allclose(found.each, exact(alpha), atol=1e-3)
    step = 1e-5 * np.eye(4)
    for k in range(3):
        slope = (exact(alpha + step[k]) - exact(alpha - step[k])) / 2e-5
        np.testing.assert_allclose(found.scores[:, k], slope, atol=1e-2)
