"""What the identified law must improve on: a deterministic fit, and a linear-Gaussian law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem
from aleator.search import Search
from aleator.search.value import LogLikelihood
from aleator.status import DEGENERATE_VALUE, Status
from aleator.surrogates.responses import Response, moving_parameters
from aleator.types import Array, Indices

HUGE = 1e100
"""A residual whose square is still finite."""


@dataclass(frozen=True)
class LeastSquares:
    """The one parameter point x (n,) that minimizes sum_l (y_l - eta_l(x))^2 over the box.

    `rmse` in the unit of the outcome; `log_likelihood` that of independent Normal(0, rmse^2)
    residuals, -N/2 (log(2 pi rmse^2) + 1), comparable with the identified law's.
    """

    x: Array
    rmse: float
    log_likelihood: float


@dataclass(frozen=True)
class LinearGaussian:
    """The law identified with the simulator linearized at one point (as CIRCE does).

    `alpha` (K,) and its `log_likelihood` under the linear-Gaussian model.
    """

    alpha: Array
    log_likelihood: float


def start_point(inputs: Inputs) -> Array:
    """The mean (n,) of every law as the search starts it.

    >>> from aleator.laws import Constant, Free, Normal
    >>> start_point(Inputs({"v": Normal(Free(0.0, 4.0), 1.0), "b": Constant(3.0)})).tolist()
    [2.0, 3.0]
    """
    starts = [np.array([h.start for h in law.hyperparameters]) for law in inputs.laws.values()]
    laws = zip(inputs.laws.values(), starts, strict=True)
    return np.array([law.mean_and_sd(values).mean for law, values in laws])


def least_squares(
    response: Response,
    condition: NDArray[np.intp],
    outcomes: Array,
    box: Array,
    start: Array,
    tolerance: float = 1e-8,
) -> LeastSquares:
    """Fit one point of the box, from `start` (n,), by a bounded trust-region method.

    Parameters whose box has no width stay at their value. It ends where a step lowers the sum of
    squares by less than a share `tolerance`. Cost: up to some tens of evaluations of the response
    at one point, each second one with its gradient. A local method: it may end in a local minimum.
    """
    moving = moving_parameters(box)
    width = box[moving, 1] - box[moving, 0]

    def at(u: Array) -> Array:
        x = start.copy()
        x[moving] = np.clip(box[moving, 0] + u * width, box[moving, 0], box[moving, 1])
        return x

    def residual(u: Array) -> Array:
        # limits many orders too wide let a simulator overflow; the fit must only move away
        with np.errstate(all="ignore"):
            off = response.evaluate(at(u)[None, :])[condition, 0] - outcomes
        return np.asarray(np.clip(np.nan_to_num(off, nan=HUGE), -HUGE, HUGE))

    def slopes(u: Array) -> Array:
        with np.errstate(all="ignore"):
            slope = response.evaluate_with_gradient(at(u)[None, :])[1]
            scaled = slope[condition, 0][:, moving] * width
        return np.asarray(np.clip(np.nan_to_num(scaled), -HUGE, HUGE))

    u0 = np.clip((start[moving] - box[moving, 0]) / width, 0.01, 0.99)
    fit = optimize.least_squares(
        residual, u0, jac=slopes, bounds=(0.0, 1.0), x_scale="jac", ftol=tolerance
    )
    x = at(fit.x)
    variance = float(np.mean(residual(fit.x) ** 2))
    count = outcomes.size
    value = -0.5 * count * (np.log(2.0 * np.pi * max(variance, 1e-300)) + 1.0)
    return LeastSquares(x, variance**0.5, float(value))


@dataclass(frozen=True)
class _LinearGaussian:
    """The log-likelihood of y_l ~ Normal of the mean and sd of eta_l(x0) + g_l (x - x0)."""

    inputs: Inputs
    x0: Array
    value: Array
    slope: Array
    outcomes: Array

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,); none where nothing scatters."""
        mean, sd, dmean, dsd = self._moments(alpha)
        some = sd > 0.0
        scale = np.where(some, sd, 1.0)
        u = (self.outcomes - mean) / scale
        each = np.where(some, -0.5 * (u**2 + np.log(2.0 * np.pi)) - np.log(scale), DEGENERATE_VALUE)
        scores = (u / scale)[:, None] * dmean + ((u**2 - 1.0) / scale)[:, None] * dsd
        status = np.where(some, int(Status.SOLVED), int(Status.DEGENERATE))
        found = LogLikelihood(each, np.where(some[:, None], scores, 0.0), status)
        return found.believed(self.inputs.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """Totals (A,) at alphas (A, K)."""
        return np.array([self(alpha).total for alpha in np.asarray(alphas)])

    def _moments(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        """Mean and sd (N,) of the outcomes with derivatives (N, K)."""
        n, k_total = self.x0.size, alpha.size
        center, spread = np.zeros(n), np.zeros(n)
        d_center, d_spread = np.zeros((n, k_total)), np.zeros((n, k_total))
        laws = zip(self.inputs.laws.values(), self.inputs.slices, strict=True)
        for i, (law, part) in enumerate(laws):
            own = law.mean_and_sd(alpha[part])
            center[i], d_center[i, part] = own.mean, own.dmean
            spread[i], d_spread[i, part] = own.sd, own.dsd
        mean = self.value + self.slope @ (center - self.x0)
        scaled = self.slope * spread
        mixed = scaled @ self.inputs.correlation_matrix(alpha)
        sd = np.sqrt(np.maximum(np.sum(mixed * scaled, axis=1), 0.0))
        safe = np.where(sd > 0.0, sd, 1.0)
        by_correlation = self.inputs.correlation_slope(alpha)
        sd_jac = (mixed * self.slope) @ d_spread / safe[:, None]
        for k in np.flatnonzero(np.any(by_correlation, axis=(0, 1))):
            sd_jac[:, k] += np.sum(scaled @ by_correlation[:, :, k] * scaled, axis=1) / (2.0 * safe)
        return mean, sd, self.slope @ d_center, sd_jac


def linear_gaussian(
    response: Response,
    model: Model,
    x0: Array,
    condition: Indices,
    outcomes: Array,
    search: Search,
    *,
    seed: int,
) -> LinearGaussian:
    """Identify the law with the simulator replaced by its tangent at x0 (n,).

    y_l ~ Normal(eta_l(x0) + g_l (mean - x0), g_l Cov(x) g_l'): the model of CIRCE (de
    Crecy and Bazin), maximized here by the same search. Needs one evaluation with gradient at one
    point.
    """
    value, slope = response.evaluate_with_gradient(x0[None, :])
    likelihood = _LinearGaussian(
        model.inputs, x0, value[condition, 0], slope[condition, 0], outcomes
    )
    result = search.maximize(likelihood, model.hyperparameters, seed=seed)
    return LinearGaussian(result.alpha, result.log_likelihood)


def baselines_of(
    problem: Problem, search: Search, seed: int
) -> tuple[LeastSquares, LinearGaussian]:
    """Both baselines of a problem, from the surfaces that it has."""
    model, outcomes = problem.model, problem.outcomes
    start = np.clip(start_point(model.inputs), *problem.region.T)
    fit = least_squares(problem.response, problem.condition, outcomes, problem.region, start)
    linear = linear_gaussian(
        problem.response, model, start, problem.condition, outcomes, search, seed=seed
    )
    return fit, linear
