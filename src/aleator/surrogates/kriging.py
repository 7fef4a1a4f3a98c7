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

import numpy as np
from scipy.linalg import LinAlgError, cholesky, qr, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices


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
    largest: float = 20.0
    """The largest size of an entry of A."""
    first: tuple[float, float, float] = (0.5, 0.1, 0.01)
    """The entries of A, the standard deviations a and b, and the noise from which a fit starts."""
    terms: float = 0.5
    """The largest number of terms of the trend, over the number of runs."""
    learned: int = 400
    """The number of runs to which the parameters of the covariance are fitted."""
    steps: tuple[int, int] = (60, 20)
    """The number of steps of the fit of the covariance, in the first round and in later rounds."""
    failed: float = 1e10
    """Minus the log-posterior that is returned for a covariance that is not positive definite."""


PROCESS = ProcessSettings()


@dataclass(frozen=True)
class Data:
    """Runs: the experiment (M,), the input u (M, D) and the outcome y (M,) of each run.

    The last `parameters` columns of u are the parameters.
    """

    experiment: Indices
    u: Array
    y: Array
    parameters: int

    @property
    def z(self) -> Array:
        """The parameters z (M, n) of the runs."""
        return self.u[:, self.u.shape[1] - self.parameters :]

    def trend(self, u: Array) -> Array:
        """The terms (R, T) of the trend at inputs u (R, D)."""
        return _trend(u, self.parameters, len(self.y))

    def take(self, rows: Indices) -> Data:
        """The runs `rows` alone."""
        return replace(self, experiment=self.experiment[rows], u=self.u[rows], y=self.y[rows])


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

    def correlation(self, squared: Array) -> Array:
        """The correlation k at squared distances, which are overwritten."""
        np.maximum(squared, 0.0, out=squared)
        if self.gaussian:
            squared *= -0.5
            return np.asarray(np.exp(squared, out=squared))
        squared *= 5.0
        r = np.sqrt(squared, out=squared)
        return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))

    def with_slope(self, squared: Array) -> tuple[Array, Array]:
        """The correlation k at squared distances, and its derivative by them."""
        if self.gaussian:
            value = self.correlation(squared)
            return value, -0.5 * value
        r = np.sqrt(5.0 * np.maximum(squared, 0.0))
        decay = np.exp(-r)
        slope = (1.0 + r) * decay
        return slope + r * r / 3.0 * decay, (-5.0 / 6.0) * slope

    def between(self, experiment: Indices, u: Array, other: Indices, v: Array) -> Array:
        """Covariances (R, M) between two lists of inputs, without noise, over v."""
        n = len(self.scale)
        out = self.correlation(_squared(u @ self.mix, v @ self.mix))
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
        gaps = [(z[..., k] - t[..., k]) * scale for k, scale in enumerate(self.scale)]
        squared = np.asarray(sum(gap**2 for gap in gaps))
        product = sum(z[..., k] * t[..., k] for k in range(len(gaps)))
        return self.individual**2 * self.correlation(squared) + self.line**2 * (1.0 + product)

    def prior(self, u: Array) -> Array:
        """Prior variances (R,) of f + g at inputs u (R, D), over v."""
        z = u[:, -len(self.scale) :]
        return np.asarray(1.0 + self.individual**2 + self.line**2 * (1.0 + (z**2).sum(axis=1)))


def _squared(a: Array, b: Array) -> Array:
    """Squared distances (A, B) between the rows of two arrays."""
    out = np.asarray(a @ (-2.0 * b).T)
    out += (a**2).sum(axis=1)[:, None]
    out += (b**2).sum(axis=1)
    return out


def _trend(u: Array, parameters: int, runs: int, settings: ProcessSettings = PROCESS) -> Array:
    """The terms 1, z, c and c_i z_j of the trend, (M, T); the first of them if runs are few."""
    c, z = u[:, : u.shape[1] - parameters], u[:, u.shape[1] - parameters :]
    products = (c[:, :, None] * z[:, None, :]).reshape(len(u), -1)
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
    c, u, z, y = covariance, data.u, data.z, data.y
    mixed, stretched = u @ c.mix, z * c.scale
    value, slope = c.with_slope(_squared(mixed, mixed))
    alike = data.experiment[:, None] == data.experiment
    own, own_slope = (alike * part for part in c.with_slope(_squared(stretched, stretched)))
    line = alike * (1.0 + z @ z.T)
    matrix = value + c.individual**2 * own + c.line**2 * line
    matrix[np.diag_indices(len(y))] += c.noise**2
    trend = _trend(u, data.parameters, len(y))
    try:
        factor = _Factor.of(matrix, trend)
    except LinAlgError:
        return settings.failed, np.zeros(c.vector.size)
    white, _ = factor.whitened(y)
    free = max(len(y) - trend.shape[1], 1)
    variance = max(float(white @ white) / free, np.finfo(float).tiny)
    dual = factor.back(white)
    loss = 0.5 * free * np.log(variance) + np.log(np.diag(factor.lower)).sum()
    loss += np.log(np.abs(np.diag(factor.r))).sum()
    gap = 0.5 * (factor.precision - np.outer(dual, dual) / variance)
    by_mix = 4.0 * _moved(gap * slope, u, u) @ c.mix
    by_own = 2.0 * c.individual**2 * float((gap * own).sum())
    by_line = 2.0 * c.line**2 * float((gap * line).sum())
    by_scale = 4.0 * c.individual**2 * c.scale**2 * np.diag(_moved(gap * own_slope, z, z))
    by_noise = 2.0 * c.noise**2 * np.trace(gap)
    gradient = np.concatenate(
        [(by_mix + settings.ridge * c.mix).ravel(), [by_own, by_line, *by_scale, by_noise]]
    )
    return float(loss + 0.5 * settings.ridge * (c.mix**2).sum()), gradient


def _moved(gap: Array, a: Array, b: Array) -> Array:
    """Half the sum over all i, j of gap_ij (a_i - a_j)(b_i - b_j)', for a symmetric gap."""
    return np.asarray(a.T @ (gap.sum(axis=1)[:, None] * b) - a.T @ gap @ b)


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
    return tuple(one for _, one in found), found[0][0] * len(data.y) / len(some.y)


@dataclass(frozen=True)
class ProcessPosterior:
    """The Gaussian process conditioned on M runs.

    `dual` (M,) is P y, `beta` (T,) the trend, and `variance` the common variance v. `surprise`
    (M,) are leave-one-out residuals over their expected standard deviations.
    """

    covariance: Covariance
    data: Data
    factor: _Factor
    dual: Array
    beta: Array
    variance: float
    surprise: Array

    @classmethod
    @single_threaded
    def of(cls, covariance: Covariance, data: Data) -> ProcessPosterior:
        """The process conditioned on the runs; O(M^3)."""
        matrix = covariance.between(data.experiment, data.u, data.experiment, data.u)
        matrix[np.diag_indices(len(data.y))] += covariance.noise**2
        factor = _Factor.of(matrix, data.trend(data.u))
        white, along = factor.whitened(data.y)
        dual = factor.back(white)
        free = max(len(data.y) - factor.q.shape[1], 1)
        variance = max(float(white @ white) / free, np.finfo(float).tiny)
        surprise = dual / np.sqrt(np.diag(factor.precision) * variance)
        beta = solve_triangular(factor.r, along)
        return cls(covariance, data, factor, dual, beta, variance, surprise)

    @property
    def noise(self) -> float:
        """The variance of outcomes of runs about the smooth function, in squared units."""
        return self.variance * self.covariance.noise**2

    @single_threaded
    def mean(self, experiment: Indices, u: Array) -> Array:
        """Expected outcomes (R,) of the experiments (R,) at inputs u (R, D)."""
        return np.asarray(self.data.trend(u) @ self.beta + self._between(experiment, u) @ self.dual)

    @single_threaded
    def with_slope(self, experiment: Indices, u: Array) -> tuple[Array, Array]:
        """Expected outcomes (R,) at inputs u (R, D), and their derivatives (R, n) by z; O(M R)."""
        c, runs, n = self.covariance, self.data, self.data.parameters
        mixed, other = u @ c.mix, runs.u @ c.mix
        value, slope = c.with_slope(_squared(mixed, other))
        out, rate = value @ self.dual, 2.0 * slope * self.dual
        by_mixed = mixed * rate.sum(axis=1)[:, None] - rate @ other
        by_z = by_mixed @ c.mix[len(c.mix) - n :].T
        # The part that each experiment has of its own.
        row, column = np.nonzero(experiment[:, None] == runs.experiment)
        z, t, dual = u[row, -n:], runs.z[column], self.dual[column]
        value, slope = c.with_slope((((z - t) * c.scale) ** 2).sum(axis=1))
        own = c.individual**2 * value + c.line**2 * (1.0 + (z * t).sum(axis=1))
        by_own = 2.0 * c.individual**2 * slope[:, None] * (z - t) * c.scale**2 + c.line**2 * t
        np.add.at(out, row, own * dual)
        np.add.at(by_z, row, by_own * dual[:, None])
        # The trend is linear in z.
        trend, step = runs.trend(u), np.eye(u.shape[1])[u.shape[1] - n :]
        out += trend @ self.beta
        by_z += np.column_stack([(runs.trend(u + one) - trend) @ self.beta for one in step])
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
        return self.covariance.between(experiment, u, self.data.experiment, self.data.u)

    def _known(self, columns: Array, trend: Array) -> tuple[Array, Array]:
        """What the runs tell (M, R), and what the trend's uncertainty adds (T, R).

        `columns` (M, R) are the covariances with the runs, and `trend` (T, R) the trend's terms.
        """
        known = _solved(self.factor.lower, columns)
        short = trend - self.factor.r.T @ (self.factor.q.T @ known)
        rest = solve_triangular(self.factor.r, short, trans="T", check_finite=False)
        return known, np.asarray(rest)
