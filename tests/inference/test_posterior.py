"""Draws from posteriors against closed forms and integrals on a grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import optimize, stats

from aleator.core.types import Array
from aleator.errors import AleatorError
from aleator.inference.posterior import Chains, RealLine, convergence, sampled, scaled
from aleator.laws import Free, Gamma, Hyperparameter, Normal, resolve
from aleator.laws.law import Law
from aleator.search.interface import LogLikelihood

Y = np.random.default_rng(8).normal(1.0, 2.0, 12)


def of(name: str, lower: float, upper: float, prior: Law | None = None) -> Hyperparameter:
    return resolve(name, Free(lower, upper, prior=prior), (None, None), positive=lower >= 0.0)


def normal_data(hyperparameters: tuple[Hyperparameter, ...]) -> Callable[[Array], LogLikelihood]:
    """log N(y; mean, sd^2 + 1) of every y: the variance of a law, and that of known noise."""

    def objective(alpha: Array) -> LogLikelihood:
        mean, sd = alpha
        variance = sd**2 + 1.0
        away = Y - mean
        each = -0.5 * (away**2 / variance + np.log(2.0 * np.pi * variance))
        by_variance = 0.5 * (away**2 / variance**2 - 1.0 / variance)
        scores = np.stack([away / variance, 2.0 * sd * by_variance], axis=1)
        value = LogLikelihood(each, scores, np.zeros(Y.size, dtype=int))
        return value.believed(hyperparameters, alpha)

    return objective


def line(hyperparameters: tuple[Hyperparameter, ...], alpha: Array) -> RealLine:
    moving = np.array([k for k, h in enumerate(hyperparameters) if h.free])
    return RealLine(normal_data(hyperparameters), hyperparameters, alpha, moving)


def drawn(
    density: RealLine, draws: int = 200, seed: int = 1, count: int = 4
) -> tuple[Array, Chains]:
    """Hyperparameters (C, D, G) that move."""
    scale = scaled(density, density.u_of(density.alpha))
    found = sampled(density, scale, draws, count, seed, _unheard)
    alphas = np.array([[density.alpha_of(u) for u in chain] for chain in found.u])
    return alphas[:, :, density.moving], found


def _unheard(done: int, total: int) -> None:
    """Nobody listens."""


def require_sample_of(draws: Array, cdf: Callable[[Array], Array]) -> None:
    """The probabilities of draws (C, D) are uniform, as far as their effective size can tell."""
    told = convergence(draws[:, :, None])
    assert told.r_hat[0] < 1.06
    size = min(told.least, draws.size)
    assert size > 100
    distance = stats.kstest(cdf(draws.ravel()), "uniform").statistic
    assert distance * np.sqrt(size) < 1.95  # exceeded once in a thousand


def test_a_normal_mean_has_its_conjugate_posterior() -> None:
    own = (of("mean", -20.0, 20.0, Normal(0.0, 0.5)), resolve("sd", 2.0, (None, None)))
    density = line(own, np.array([0.5, 2.0]))
    precision = 1.0 / 0.25 + Y.size / 5.0
    truth = stats.norm(Y.sum() / 5.0 / precision, precision**-0.5)
    require_sample_of(drawn(density)[0][:, :, 0], truth.cdf)


def by_grid(log_density: Callable[[Array], Array], low: float, high: float) -> Callable[..., Array]:
    """The distribution function of a density that is known but for a factor."""
    x = np.linspace(low, high, 20_001)
    value = log_density(x)
    weight = np.exp(value - value.max())
    reached = np.concatenate([[0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))])
    return lambda v: np.interp(v, x, reached / reached[-1])


@pytest.mark.parametrize("prior", [None, Gamma(1.0, 0.5)], ids=["flat", "gamma"])
def test_an_sd_near_zero_has_the_posterior_of_a_grid(prior: Law | None) -> None:
    """The data scatter less than the noise: the maximum is at zero, where the posterior ends."""
    own = (resolve("mean", float(Y.mean()), (None, None)), of("sd", 1e-6, 10.0, prior))
    y = Y.mean() + 0.3 * (Y - Y.mean())

    def log_density(sd: Array) -> Array:
        variance = np.asarray(sd)[:, None] ** 2 + 1.0
        value = -0.5 * ((y - y.mean()) ** 2 / variance + np.log(variance)).sum(axis=1)
        return value if prior is None else value + stats.gamma.logpdf(sd, 4.0, scale=0.25)

    def objective(alpha: Array) -> LogLikelihood:
        variance = alpha[1] ** 2 + 1.0
        away = y - y.mean()
        each = -0.5 * (away**2 / variance + np.log(2.0 * np.pi * variance))
        slope = alpha[1] * (away**2 / variance**2 - 1.0 / variance)
        scores = np.stack([0.0 * slope, slope], axis=1)
        value = LogLikelihood(each, scores, np.zeros(y.size, dtype=int))
        return value.believed(own, alpha)

    density = RealLine(objective, own, np.array([y.mean(), 1e-6]), np.array([1]))
    require_sample_of(drawn(density)[0][:, :, 0], by_grid(log_density, 1e-6, 10.0))


def test_mean_and_sd_together_have_the_marginals_of_a_grid() -> None:
    own = (of("mean", -20.0, 20.0), of("sd", 1e-6, 20.0))
    draws, found = drawn(line(own, np.array([1.0, 1.5])))
    mean, sd = np.linspace(-8.0, 10.0, 801), np.linspace(1e-6, 20.0, 800)
    variance = sd**2 + 1.0
    square = np.sum((Y - Y.mean()) ** 2) + Y.size * (mean[:, None] - Y.mean()) ** 2
    log_joint = -0.5 * (square / variance + Y.size * np.log(variance))
    joint = np.exp(log_joint - log_joint.max())
    for g, (x, marginal) in enumerate(((mean, joint.sum(axis=1)), (sd, joint.sum(axis=0)))):
        reached = np.cumsum(marginal) / marginal.sum()
        require_sample_of(draws[:, :, g], lambda v, x=x, p=reached: np.interp(v, x, p))
    # what is told of a draw is that of the draw
    at = normal_data(own)(draws[2, 7])
    assert found.likelihood[2, 7] == pytest.approx(at.likelihood)
    np.testing.assert_allclose(found.each[2, 7], at.each)
    assert found.accepted.mean() > 0.7
    assert not found.divergent.any()


def test_the_slope_on_the_real_line_is_the_derivative() -> None:
    own = (of("mean", -3.0, 4.0, Normal(0.0, 0.5)), of("sd", 1e-6, 5.0, Gamma(1.0, 0.5)))
    density = line(own, np.array([1.0, 1.5]))
    for u in ([0.3, -1.0], [-6.0, 5.0], [0.0, -12.0]):
        at = np.array(u)
        numeric = optimize.approx_fprime(at, lambda v: density(v).value, 1e-6)
        np.testing.assert_allclose(density(at).slope, numeric, rtol=1e-4, atol=1e-5)
    back = density.alpha_of(density.u_of(np.array([1.0, 1.5])))
    np.testing.assert_allclose(back, [1.0, 1.5])


def test_a_likelihood_that_ends_is_not_left() -> None:
    """Outcomes of a uniform law: no mean below their largest minus one is possible."""
    y = np.array([0.2, 0.5, 0.9])
    own = (of("mean", -5.0, 5.0),)

    def objective(alpha: Array) -> LogLikelihood:
        inside = np.abs(y - alpha[0]) <= 1.0
        each = np.where(inside, -np.log(2.0), -np.inf)
        return LogLikelihood(each, np.zeros((3, 1)), np.zeros(3, dtype=int))

    density = RealLine(objective, own, np.array([0.5]), np.array([0]))
    draws, found = drawn(density, 50, count=2)
    assert draws.min() >= -0.1
    assert draws.max() <= 1.2
    assert found.divergent.any()


def test_the_same_seed_gives_the_same_draws() -> None:
    own = (of("mean", -20.0, 20.0), of("sd", 1e-6, 20.0))
    density = line(own, np.array([1.0, 1.5]))
    first, again, other = (drawn(density, 10, seed, 2)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.all(first[0] != other[0])
    assert np.all(first[0] != first[1])


def test_an_interruption_ends_it_at_once(caplog: pytest.LogCaptureFixture) -> None:
    own = (of("mean", -20.0, 20.0), resolve("sd", 2.0, (None, None)))
    inner = normal_data(own)
    asked = [0]

    def objective(alpha: Array) -> LogLikelihood:
        asked[0] += 1
        if asked[0] == 100:
            raise KeyboardInterrupt
        return inner(alpha)

    density = RealLine(objective, own, np.array([1.0, 2.0]), np.array([0]))
    with pytest.raises(KeyboardInterrupt):
        drawn(density)
    assert asked[0] == 100
    assert not caplog.records


def test_a_posterior_without_a_density_anywhere_is_told() -> None:
    own = (of("mean", -5.0, 5.0),)

    def objective(alpha: Array) -> LogLikelihood:  # noqa: ARG001
        return LogLikelihood(np.array([-np.inf]), np.zeros((1, 1)), np.zeros(1, dtype=int))

    density = RealLine(objective, own, np.array([0.5]), np.array([0]))
    with pytest.raises(AleatorError, match="at none of 50 places"):
        drawn(density)


def test_convergence_sees_chains_apart_and_chains_that_creep() -> None:
    rng = np.random.default_rng(0)
    good = rng.standard_normal((4, 500, 1))
    apart = good + np.array([0.0, 0.0, 0.0, 2.0])[:, None, None]
    creeping = np.cumsum(rng.standard_normal((4, 500, 1)), axis=1)
    assert convergence(good).converged
    assert convergence(good).r_hat[0] == pytest.approx(1.0, abs=0.01)
    assert convergence(good).bulk[0] == pytest.approx(2000.0, rel=0.25)
    assert convergence(apart).r_hat[0] > 1.1
    assert not convergence(apart).converged
    assert convergence(creeping).least < 100.0
