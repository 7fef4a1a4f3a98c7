"""Gaussian processes over conditions and parameters, conditioned on the runs of all experiments.

The outcome of experiment l is a function of u = (c_l, z), its conditions and the parameters, each
scaled to [-1, 1]. Its prior is

    y = beta' (1, z, c, c z') + f(u) + g_l(z),   with Cov f = v k(|A'(u - u')|)
    and Cov g_l = v (a^2 k(|s (z - z')|) + b^2 (1 + z . z')).

beta is a trend without prior (universal kriging). k is a correlation as a function of distance:
Matern's of smoothness 5/2, or the Gaussian one for smooth simulators. A rotates and stretches the
inputs, so that a steep front whose place changes with the conditions is the same function for all
experiments (Vivarelli and Williams 1999). g is the part that each experiment has of its own. A, s,
a, b and the noise of a run maximize the restricted likelihood of the runs under a weak normal prior
on A (Rasmussen and Williams 2006, sections 2.7 and 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, qr, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from aleator.core.blocks import blocks
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Flags, Indices
from aleator.surrogates.slopes import (
    SlopeCorrelations,
    correlation,
    derivatives,
    moved,
    squared_distances,
    with_slope,
)


@dataclass(frozen=True)
class ProcessSettings:
    """Settings of the covariance in the module's description; chosen by judgement."""

    ridge: float = 0.01
    """Precision (inverse variance) of the normal prior on the entries of the matrix A."""
    rank: int = 8
    """The largest number of columns of A, the directions in which the outcome may vary."""
    individual: tuple[float, float] = (1e-4, 10.0)
    """Limits of the standard deviations a and b of the part that each experiment has of its own."""
    scale: tuple[float, float] = (0.02, 10.0)
    """Limits of the scales s of the parameters in the part that each experiment has of its own."""
    noise: tuple[float, float] = (1e-5, 0.3)
    """Limits of the standard deviation of the noise of a run."""
    slopes: float = 3.0
    """The noise of slopes by the scaled parameters, over that of values. Of 0.1, 0.3, 1, 3 and 10
    it predicted further runs of the wet clutch best, and those of smooth simulators as well."""
    largest: float = 20.0
    """The largest size of an entry of A."""
    first: tuple[float, float, float] = (0.5, 0.1, 0.01)
    """The entries of A, the standard deviations a and b, and the noise from which a fit starts."""
    terms: float = 0.5
    """The largest number of terms of the trend, over the number of runs."""
    learned: int = 400
    """The number of runs to which the parameters of the covariance are fitted. Slopes count in this
    fit while all values and slopes are no more: with kinks they make the covariance too rough."""
    steps: tuple[int, int] = (60, 20)
    """The number of steps of the fit of the covariance, in the first round and in later rounds."""
    block: int = 2**16
    """The number of covariances that are computed at once: they stay in the cache of a processor.
    A million values from 120 runs took 2.4 s, and 7.2 s in blocks of four million."""
    failed: float = 1e10
    """Minus the log-posterior that is returned for a covariance that is not positive definite."""


PROCESS = ProcessSettings()


@dataclass(frozen=True)
class Data:
    """Runs: the experiment (M,), the input u (M, D) and the outcome y (M,) of each run.

    The last n = `parameters` columns of u are the parameters. `slopes` (M, n) are the derivatives
    of the outcome by these, NaN where they are not known. All that is known of the runs are the
    outcomes and then, parameter by parameter, the slopes of the S runs that have them: M + n S
    `values`.
    """

    experiment: Indices
    u: Array
    y: Array
    parameters: int
    slopes: Array

    @property
    def z(self) -> Array:
        """The parameters z (M, n) of the runs."""
        return self.u[:, self.u.shape[1] - self.parameters :]

    @cached_property
    def sloped(self) -> Indices:
        """The numbers (S,) of the runs whose slopes are known."""
        return np.flatnonzero(np.isfinite(self.slopes).all(axis=1))

    @property
    def values(self) -> Array:
        """The outcomes and the slopes, (M + n S,)."""
        return np.concatenate([self.y, self.slopes[self.sloped].T.ravel()])

    def with_last_slopes(self, most: int) -> Data:
        """The runs with the slopes of the last of them, at most `most` values and slopes."""
        kept = max((most - len(self.y)) // self.parameters, 0)
        slopes = self.slopes.copy()
        slopes[self.sloped[: max(self.sloped.size - kept, 0)]] = np.nan
        return replace(self, slopes=slopes)

    @property
    def logarithms(self) -> Data:
        """The runs with the logarithm of each outcome."""
        return replace(self, y=np.log(self.y), slopes=self.slopes / self.y[:, None])

    @property
    def values_by_logarithms(self) -> float:
        """The logarithm of the determinant of the derivative of values by those of `logarithms`.

        It is called on the latter: outcomes and slopes are both proportional to the outcome.
        """
        return float(self.y.sum() + self.parameters * self.y[self.sloped].sum())

    @property
    def alike(self) -> Flags:
        """Whether two of the values belong to the same experiment, (M + n S, M + n S)."""
        rows = np.concatenate([np.arange(len(self.y)), np.tile(self.sloped, self.parameters)])
        of = self.experiment[rows]
        return np.asarray(of[:, None] == of)

    @property
    def lines(self) -> Array:
        """The terms 1 and z, and their slopes, of all values (M + n S, 1 + n)."""
        n, count = self.parameters, self.sloped.size
        slopes = np.hstack([np.zeros((n * count, 1)), np.repeat(np.eye(n), count, axis=0)])
        return np.vstack([np.insert(self.z, 0, 1.0, axis=1), slopes])

    def trend(self, u: Array) -> Array:
        """The terms (R, T) of the trend at inputs u (R, D)."""
        return _trend(u, self.parameters, len(self.y))

    def trend_slopes(self, u: Array) -> Array:
        """The derivatives (n, R, T) of the terms of the trend by the parameters."""
        trend, step = self.trend(u), np.eye(u.shape[1])[u.shape[1] - self.parameters :]
        return np.stack([self.trend(u + one) - trend for one in step])  # It is linear in z.

    @property
    def trends(self) -> Array:
        """The terms of the trend, and their slopes, of all values (M + n S, T)."""
        return np.vstack([self.trend(self.u), *self.trend_slopes(self.u[self.sloped])])

    def take(self, rows: Indices) -> Data:
        """The runs `rows` alone."""
        return Data(
            self.experiment[rows], self.u[rows], self.y[rows], self.parameters, self.slopes[rows]
        )


@dataclass(frozen=True)
class Covariance:
    """The parameters of the covariance in the module's description, all without unit.

    `mix` is the matrix A (D, r), `individual` and `line` are the standard deviations a and b,
    `scale` are the scales s (n,), and `noise` is the standard deviation of the noise of a run.
    `gaussian` says which correlation is used.
    """

    mix: Array
    individual: float
    line: float
    scale: Array
    noise: float
    gaussian: bool

    @classmethod
    def first(
        cls, inputs: int, parameters: int, gaussian: bool, settings: ProcessSettings = PROCESS
    ) -> Covariance:
        """The covariance from which the fit starts, in which all inputs have the same effect."""
        entry, own, noise = settings.first
        mix = entry * np.eye(inputs, min(inputs, settings.rank))
        mix[settings.rank :] = entry / np.sqrt(settings.rank)
        return cls(mix, own, own, 0.5 * np.ones(parameters), noise, gaussian)

    @property
    def vector(self) -> Array:
        """The parameters as one vector: A, then the logarithms of a, b, s and the noise."""
        rest = np.log([self.individual, self.line, *self.scale, self.noise])
        return np.concatenate([self.mix.ravel(), rest])

    def moved(self, vector: Array) -> Covariance:
        """The covariance whose parameters are given by a vector in the order of `vector`."""
        own, line, *scale, noise = np.exp(vector[self.mix.size :])
        mix = vector[: self.mix.size].reshape(self.mix.shape)
        return replace(self, mix=mix, individual=own, line=line, scale=np.array(scale), noise=noise)

    def stretched(self, ratio: Array) -> Covariance:
        """The same covariance where the parameters are scaled to a region `ratio` (n,) as wide."""
        mix = self.mix.copy()
        mix[len(mix) - len(ratio) :] *= ratio[:, None]
        return replace(self, mix=mix, scale=self.scale * ratio)

    def limits(self, settings: ProcessSettings = PROCESS) -> list[tuple[float, float]]:
        """Lower and upper limits of the entries of `vector`."""
        positive = [settings.individual] * 2 + [settings.scale] * len(self.scale) + [settings.noise]
        return [(-settings.largest, settings.largest)] * self.mix.size + [
            (float(np.log(low)), float(np.log(high))) for low, high in positive
        ]

    def between(self, experiment: Indices, u: Array, other: Indices, v: Array) -> Array:
        """Covariances (R, M) between two lists of inputs, without noise, over v."""
        n = len(self.scale)
        out = correlation(squared_distances(u @ self.mix, v @ self.mix), self.gaussian)
        alike, z, t = experiment[:, None] == other, u[:, -n:], v[:, -n:]
        if alike.all():
            out += self._own(z[:, None], t)
        else:
            row, column = np.nonzero(alike)
            out[row, column] += self._own(z[row], t[column])
        return np.asarray(out)

    def _own(self, z: Array, t: Array) -> Array:
        """Covariances (...) of the part that each experiment has of its own, at z and t (..., n).

        They are summed parameter by parameter, because sums over short rows are slow.
        """
        shape = np.broadcast_shapes(z.shape, t.shape)[:-1]
        squared, product = np.zeros(shape), np.zeros(shape)
        for k, scale in enumerate(self.scale):
            gap = z[..., k] - t[..., k]
            gap *= scale
            gap *= gap
            squared += gap
            product += np.multiply(z[..., k], t[..., k], out=gap)
        own = correlation(squared, self.gaussian)
        own *= self.individual**2
        product += 1.0
        product *= self.line**2
        own += product
        return own

    def with_slopes(self, experiment: Indices, u: Array, runs: Data) -> Array:
        """Covariances (R, n S) of values at inputs u (R, D) with the slopes of runs, over v."""
        n, sloped = len(self.scale), runs.sloped
        a, b, own = u @ self.mix, runs.u[sloped] @ self.mix, self.mix[len(self.mix) - n :]
        first = derivatives(squared_distances(a, b), self.gaussian)[0]
        out = -2.0 * first * ((own @ a.T)[:, :, None] - (own @ b.T)[:, None])
        row, column = np.nonzero(experiment[:, None] == runs.experiment[sloped])
        z, apart = u[row, -n:], u[row, -n:] - runs.z[sloped[column]]
        first = derivatives(((apart * self.scale) ** 2).sum(axis=1), self.gaussian)[0]
        part = -2.0 * self.individual**2 * first * (apart * self.scale**2).T
        out[:, row, column] += part + self.line**2 * z.T
        return np.asarray(out.transpose(1, 0, 2).reshape(len(u), -1))

    def slopes_of(self, runs: Data) -> tuple[SlopeCorrelations, SlopeCorrelations]:
        """The correlations with the slopes of runs, of f and of the smooth part of g."""
        n, sloped = runs.parameters, runs.sloped
        return (
            SlopeCorrelations(runs.u, self.mix, n, sloped, self.gaussian),
            SlopeCorrelations(runs.z, np.diag(self.scale), n, sloped, self.gaussian),
        )

    def of_values(self, outcomes: Array, runs: Data, settings: ProcessSettings = PROCESS) -> Array:
        """Covariances of all values of runs with their noise, over v.

        `outcomes` (M, M) are those of their outcomes without noise, which may be overwritten.
        """
        outcomes[np.diag_indices(len(outcomes))] += self.noise**2
        if not runs.sloped.size:
            return outcomes
        line, (m, n) = self.line**2 * runs.lines @ runs.lines.T, outcomes.shape
        shared, own = (
            np.block([[np.zeros((m, n)), one.across], [one.across.T, one.inner]])
            for one in self.slopes_of(runs)
        )
        out = shared + runs.alike * (self.individual**2 * own + line)
        out[:m, :m] = outcomes
        slopes = np.arange(m, len(out))
        out[slopes, slopes] += (settings.slopes * self.noise) ** 2
        return np.asarray(out)

    def prior(self, u: Array) -> Array:
        """Prior variances (R,) of f + g at inputs u (R, D), over v."""
        z = u[:, -len(self.scale) :]
        return np.asarray(1.0 + self.individual**2 + self.line**2 * (1.0 + (z**2).sum(axis=1)))


def _trend(u: Array, parameters: int, runs: int, settings: ProcessSettings = PROCESS) -> Array:
    """The terms 1, z, c and c_i z_j of the trend, (M, T); the first of them if runs are few."""
    c, z = u[:, : u.shape[1] - parameters], u[:, u.shape[1] - parameters :]
    products = (c[:, :, None] * z[:, None, :]).reshape(len(u), c.shape[1] * parameters)
    terms = np.hstack([np.ones((len(u), 1)), z, c, products])
    return terms[:, : max(1, int(settings.terms * runs))]


@dataclass(frozen=True)
class _Factor:
    """A covariance matrix K = L L' of runs, and the trend's part A = L^-1 H = Q R of it."""

    lower: Array
    q: Array
    r: Array

    @classmethod
    def of(cls, matrix: Array, trend: Array) -> _Factor:
        lower = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
        return cls(lower, *qr(_solved(lower, trend), mode="economic", check_finite=False))

    def whitened(self, columns: Array) -> tuple[Array, Array]:
        """L^-1 columns without their part along the trend, and that part's coordinates Q'."""
        white = _solved(self.lower, columns)
        along = self.q.T @ white
        return white - self.q @ along, along

    def back(self, white: Array) -> Array:
        """L^-T white."""
        return np.asarray(
            solve_triangular(self.lower, white, lower=True, trans="T", check_finite=False)
        )

    @property
    def precision(self) -> Array:
        """P = K^-1 - K^-1 H (H' K^-1 H)^-1 H' K^-1, (M, M)."""
        inverse = np.tril(dpotri(self.lower, lower=1)[0])
        along = self.back(self.q)
        return np.asarray(inverse + np.tril(inverse, -1).T - along @ along.T)


def _solved(lower: Array, columns: Array) -> Array:
    return np.asarray(solve_triangular(lower, columns, lower=True, check_finite=False))


def _loss(covariance: Covariance, data: Data, settings: ProcessSettings) -> tuple[float, Array]:
    """Minus the log-posterior of a covariance, up to a constant, and its gradient by `vector`."""
    c, u, z, m = covariance, data.u, data.z, len(data.y)
    mixed, stretched = u @ c.mix, z * c.scale
    value, slope = with_slope(squared_distances(mixed, mixed), c.gaussian)
    alike = data.experiment[:, None] == data.experiment
    own, own_slope = (
        alike * part for part in with_slope(squared_distances(stretched, stretched), c.gaussian)
    )
    line = alike * (1.0 + z @ z.T)
    values = data.values
    matrix = c.of_values(value + c.individual**2 * own + c.line**2 * line, data)
    try:
        factor = _Factor.of(matrix, data.trends)
    except LinAlgError:
        return settings.failed, np.zeros(c.vector.size)
    white, _ = factor.whitened(values)
    free = max(len(values) - factor.q.shape[1], 1)
    variance = max(float(white @ white) / free, np.finfo(float).tiny)
    dual = factor.back(white)
    loss = 0.5 * free * np.log(variance) + np.log(np.diag(factor.lower)).sum()
    loss += np.log(np.abs(np.diag(factor.r))).sum()
    whole = 0.5 * (factor.precision - np.outer(dual, dual) / variance)
    gap = whole[:m, :m]
    by_mix = 4.0 * moved(gap * slope, u, u) @ c.mix
    by_own = 2.0 * c.individual**2 * float((gap * own).sum())
    by_line = 2.0 * c.line**2 * float((gap * line).sum())
    by_scale = 4.0 * c.individual**2 * c.scale**2 * np.diag(moved(gap * own_slope, z, z))
    by_slopes = 0.0
    if data.sloped.size:
        shared, part = c.slopes_of(data)
        by_mix += shared.by_mix(whole[:m, m:], whole[m:, m:])
        within, lines = whole * data.alike, data.lines
        across, inner = within[:m, m:], within[m:, m:]
        by_own += (
            2.0
            * c.individual**2
            * float(2.0 * (across * part.across).sum() + (inner * part.inner).sum())
        )
        by_scale += c.individual**2 * c.scale * np.diag(part.by_mix(across, inner))
        within[:m, :m] = 0.0
        by_line += 2.0 * c.line**2 * float((within @ lines * lines).sum())
        by_slopes = settings.slopes**2 * float(np.diag(whole)[m:].sum())
    by_noise = 2.0 * c.noise**2 * (np.trace(gap) + by_slopes)
    gradient = np.concatenate(
        [(by_mix + settings.ridge * c.mix).ravel(), [by_own, by_line, *by_scale, by_noise]]
    )
    return float(loss + 0.5 * settings.ridge * (c.mix**2).sum()), gradient


@single_threaded
def learned(
    starts: tuple[Covariance, ...], data: Data, steps: int, settings: ProcessSettings = PROCESS
) -> tuple[tuple[Covariance, ...], float]:
    """The covariances fitted from each of the starts, that of the largest posterior density first.

    Minus the logarithm of that density is returned too, up to a constant. Each fit takes at most
    `steps` iterations of L-BFGS-B, on the runs of as many whole experiments as have about
    `settings.learned` runs.
    """
    rng = np.random.default_rng(len(data.y))
    experiments, sizes = np.unique(data.experiment, return_counts=True)
    order = rng.permutation(len(experiments))
    count = max(1, int((np.cumsum(sizes[order]) <= settings.learned).sum()))
    some = data.take(np.flatnonzero(np.isin(data.experiment, experiments[order[:count]])))
    found = []
    for start in starts:

        def loss(vector: Array, start: Covariance = start) -> tuple[float, Array]:
            return _loss(start.moved(vector), some, settings)

        end = minimize(
            loss, start.vector, jac=True, method="L-BFGS-B", bounds=start.limits(settings),
            options={"maxiter": steps},
        )  # fmt: skip
        found.append((float(end.fun), start.moved(end.x)))
    found.sort(key=lambda pair: pair[0])
    return tuple(one for _, one in found), found[0][0] * len(data.values) / len(some.values)


@dataclass(frozen=True)
class ProcessPosterior:
    """The Gaussian process conditioned on M runs.

    `dual` (M + n S,) is P y, with the values y of `Data`, `beta` (T,) the trend, and `variance` the
    common variance v.
    """

    covariance: Covariance
    data: Data
    factor: _Factor
    dual: Array
    beta: Array
    variance: float

    @classmethod
    @single_threaded
    def of(cls, covariance: Covariance, data: Data) -> ProcessPosterior:
        """The process conditioned on the runs; O(M^3)."""
        of, values = data.experiment, data.values
        matrix = covariance.of_values(covariance.between(of, data.u, of, data.u), data)
        factor = _Factor.of(matrix, data.trends)
        white, along = factor.whitened(values)
        dual = factor.back(white)
        free = max(len(values) - factor.q.shape[1], 1)
        variance = max(float(white @ white) / free, np.finfo(float).tiny)
        beta = solve_triangular(factor.r, along)
        return cls(covariance, data, factor, dual, beta, variance)

    @property
    def surprise(self) -> Array:
        """Leave-one-out residuals (M + n S,) over their expected standard deviations; O(M^3)."""
        return np.asarray(self.dual / np.sqrt(np.diag(self.factor.precision) * self.variance))

    @property
    def noise(self) -> float:
        """The variance of outcomes of runs about the smooth function, in squared units."""
        return self.variance * self.covariance.noise**2

    @single_threaded
    def mean(self, experiment: Indices, u: Array) -> Array:
        """Expected outcomes (R,) of the experiments (R,) at inputs u (R, D)."""
        out = np.asarray(self.data.trend(u) @ self.beta)
        for rows in blocks(len(u), len(self.dual), PROCESS.block):
            out[rows] += self._between(experiment[rows], u[rows]) @ self.dual
        return out

    @single_threaded
    def with_slope(self, experiment: Indices, u: Array) -> tuple[Array, Array]:
        """Expected outcomes (R,) at inputs u (R, D), and their derivatives (R, n) by z; O(M R)."""
        c, runs, n, m = self.covariance, self.data, self.data.parameters, len(self.data.y)
        mixed, other, outcomes = u @ c.mix, runs.u @ c.mix, self.dual[:m]
        value, slope = with_slope(squared_distances(mixed, other), c.gaussian)
        out, rate = value @ outcomes, 2.0 * slope * outcomes
        by_mixed = mixed * rate.sum(axis=1)[:, None] - rate @ other
        by_z = by_mixed @ c.mix[len(c.mix) - n :].T
        # The part that each experiment has of its own.
        row, column = np.nonzero(experiment[:, None] == runs.experiment)
        z, t, dual = u[row, -n:], runs.z[column], outcomes[column]
        value, slope = with_slope((((z - t) * c.scale) ** 2).sum(axis=1), c.gaussian)
        own = c.individual**2 * value + c.line**2 * (1.0 + (z * t).sum(axis=1))
        by_own = 2.0 * c.individual**2 * slope[:, None] * (z - t) * c.scale**2 + c.line**2 * t
        np.add.at(out, row, own * dual)
        np.add.at(by_z, row, by_own * dual[:, None])
        if runs.sloped.size:
            value, by = self._of_slopes(experiment, u)
            out, by_z = out + value, by_z + by
        out += runs.trend(u) @ self.beta
        by_z += (runs.trend_slopes(u) @ self.beta).T
        return out, by_z

    def _of_slopes(self, experiment: Indices, u: Array) -> tuple[Array, Array]:
        """The part of the slopes of the runs in the mean (R,) and in its slopes (R, n)."""
        c, runs, n, sloped = self.covariance, self.data, self.data.parameters, self.data.sloped
        dual = self.dual[len(runs.y) :].reshape(n, -1)
        a, b, own = u @ c.mix, runs.u[sloped] @ c.mix, c.mix[len(c.mix) - n :]
        squared = squared_distances(a, b)
        first, second, _ = derivatives(squared, c.gaussian)
        g, h = a @ own.T, b @ own.T
        along = g @ dual - (h.T * dual).sum(axis=0)
        rate = -4.0 * second * along
        out = -2.0 * (first * along).sum(axis=1)
        by_z = g * rate.sum(axis=1)[:, None] - rate @ h - 2.0 * (first @ dual.T) @ (own @ own.T)
        row, column = np.nonzero(experiment[:, None] == runs.experiment[sloped])
        z, by = u[row, -n:], dual.T[column]
        apart = z - runs.z[sloped[column]]
        squared = ((apart * c.scale) ** 2).sum(axis=1)
        first, second, _ = derivatives(squared, c.gaussian)
        first, second, apart = first[:, None], second[:, None], apart * c.scale**2
        along = (apart * by).sum(axis=1, keepdims=True)
        part = -4.0 * second * along * apart - 2.0 * first * c.scale**2 * by
        np.add.at(out, row, -2.0 * c.individual**2 * (first * along)[:, 0])
        np.add.at(out, row, c.line**2 * (z * by).sum(axis=1))
        np.add.at(by_z, row, c.individual**2 * part + c.line**2 * by)
        return out, by_z

    @single_threaded
    def deviation(self, experiment: Indices, u: Array) -> Array:
        """Posterior standard deviations (R,) of the outcomes at inputs u (R, D); O(M^2 R)."""
        known, rest = self._known(self._between(experiment, u).T, self.data.trend(u).T)
        left = self.covariance.prior(u) - (known**2).sum(axis=0) + (rest**2).sum(axis=0)
        return np.asarray(np.sqrt(self.variance * np.maximum(left, 0.0)))

    @single_threaded
    def joint(self, experiment: Indices, u: Array) -> Array:
        """Posterior covariances (R, R) of the outcomes at a small number R of inputs u (R, D)."""
        known, rest = self._known(self._between(experiment, u).T, self.data.trend(u).T)
        prior = self.covariance.between(experiment, u, experiment, u)
        return np.asarray(self.variance * (prior - known.T @ known + rest.T @ rest))

    @single_threaded
    def of_sums(
        self, experiment: Indices, u: Array, weights: Array, part: Indices
    ) -> tuple[Array, Array]:
        """Posterior covariance of sums of the outcomes at u (R, D) times weights (R, K).

        Returns that of all outcomes (K, K), and those of each part of them alone (P, K, K). `part`
        (R,) is the number of the part of each outcome. Cost O(R^2 + M R + M^2 P K).
        """
        prior = self.covariance.between(experiment, u, experiment, u)
        between, trend = self._between(experiment, u), self.data.trend(u)
        parts = [np.flatnonzero(part == number) for number in range(int(part.max()) + 1)]
        known, rest = self._known(
            *(
                np.hstack([one[rows].T @ weights[rows] for rows in parts])
                for one in (between, trend)
            )
        )
        known, rest = (one.reshape(len(one), len(parts), -1) for one in (known, rest))
        alone = np.stack(
            [weights[rows].T @ (prior[np.ix_(rows, rows)] @ weights[rows]) for rows in parts]
        )
        alone += np.einsum("tpk,tpl->pkl", rest, rest) - np.einsum("mpk,mpl->pkl", known, known)
        known, rest = known.sum(axis=1), rest.sum(axis=1)
        total = weights.T @ (prior @ weights) - known.T @ known + rest.T @ rest
        return self.variance * total, self.variance * alone

    def _between(self, experiment: Indices, u: Array) -> Array:
        """Covariances (R, M + n S) of the outcomes at inputs u (R, D) with all that is known."""
        runs = self.data
        out = self.covariance.between(experiment, u, runs.experiment, runs.u)
        if not runs.sloped.size:
            return out
        return np.hstack([out, self.covariance.with_slopes(experiment, u, runs)])

    def _known(self, columns: Array, trend: Array) -> tuple[Array, Array]:
        """What the runs tell (M, R), and what the trend's uncertainty adds (T, R).

        `columns` (M + n S, R) are the covariances with the runs, `trend` (T, R) the trend's terms.
        """
        known = _solved(self.factor.lower, columns)
        short = trend - self.factor.r.T @ (self.factor.q.T @ known)
        rest = solve_triangular(self.factor.r, short, trans="T", check_finite=False)
        return known, np.asarray(rest)
