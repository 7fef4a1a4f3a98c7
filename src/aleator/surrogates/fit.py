"""Fit polynomials through runs: least norm in a prior, which leave-one-out residuals choose.

A surface y = sum_nu c_nu phi_nu has more coefficients than there are runs. Of all that pass through
the runs, the one with the least sum (c_nu / w_nu)^2 is taken: the mean of a Gaussian process whose
coefficients are independent Normal(0, w_nu^2) (Rasmussen and Williams 2006, section 2.7). Plain
interpolation in a fixed set of polynomials amplifies what the set leaves out; this does not. With
B = (w phi; g I), (P + M) x M, = Q R, the covariance of the runs is K = R'R and everything is closed
form; g > 0 lets the surface pass beside noisy runs.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from aleator.surrogates.basis import ball, products
from aleator.surrogates.points import everywhere
from aleator.surrogates.scales import LARGEST, outcomes
from aleator.threads import single_threaded
from aleator.types import Array, Flags, Indices

SMOOTHNESS = (1.5, 2.5, 4.0, 6.0, 9.0)
TREND = (0.0, 0.25, 0.5)
NORM = (2.0, 1.0, 0.5)
NOISE = (0.0, 0.03, 0.3)
STRETCH = 1.6
# Terms for each run, and the weight that makes a term of the trend as good as free.
TERMS = 2
FREE = 1e6
# Winners whose neighbors are tried, with few runs and with many (then priors change little).
KEEP = (5, 2)
MANY = 200
SWEEPS = 2
# Share of the mean square error that is left where logarithms are taken: with runs that change
# from one scale to the other, round by round, surfaces hardly become exact.
FALL = 0.01
# The least error that is compared with another.
TINY = np.finfo(np.float64).tiny


class Prior(NamedTuple):
    """What is assumed of the coefficients: w_nu = (1 + size(nu)^2)^(-smoothness/2).

    `scale` and `norm` define the size of an index (see `ball`). With a `trend` its first `trend` M
    indices and the linear ones are free, else the constant: polynomials in their span are
    reproduced exactly. `noise` is the standard deviation g of the runs, on the scale of w at index
    zero. With `logarithm` the coefficients are those of the logarithm of the outcome, positive in
    all runs.
    """

    scale: tuple[float, ...]
    norm: float
    smoothness: float
    trend: float
    noise: float = 0.0
    logarithm: bool = False

    def terms(self, y: Array) -> Array:
        """What is a polynomial, of outcomes y."""
        return np.log(y) if self.logarithm else y

    def outcomes(self, t: Array) -> Array:
        """The outcomes of polynomials t (A, ...)."""
        return outcomes(t, np.full(len(t), self.logarithm))


def first_priors(n: int) -> list[Prior]:
    """Return the priors to begin with: no preferred parameter."""
    even = (1.0,) * n
    choices = [(2.0, s, t) for s in (2.5, 4.0) for t in (0.0, 0.5)]
    choices += [(1.0, 2.5, 0.0), (1.0, 4.0, 0.5), (0.5, 4.0, 0.5), (0.5, 2.5, 0.0)]
    return [Prior(even, *choice) for choice in choices]


def neighbors(prior: Prior) -> list[Prior]:
    """Return the priors one step away: one parameter stretched, or one choice moved."""
    out = []
    for i, one in enumerate(prior.scale):
        for changed in (one * STRETCH, one / STRETCH):
            if 0.1 < changed < 12.0:
                scale = (*prior.scale[:i], float(f"{changed:.6g}"), *prior.scale[i + 1 :])
                out.append(prior._replace(scale=scale))
    out += [prior._replace(norm=value) for value in _beside(NORM, prior.norm)]
    out += [prior._replace(smoothness=value) for value in _beside(SMOOTHNESS, prior.smoothness)]
    out += [prior._replace(trend=value) for value in _beside(TREND, prior.trend)]
    out += [prior._replace(noise=value) for value in _beside(NOISE, prior.noise)]
    return out


def _beside(values: tuple[float, ...], one: float) -> tuple[float, ...]:
    """Return the values next to one of them."""
    k = values.index(one)
    return values[max(k - 1, 0) : k] + values[k + 1 : k + 2]


def weights(prior: Prior, runs: int) -> tuple[Indices, Array]:
    """Return indices (P, n) and weights w (P,) for a number of runs."""
    indices, size = ball(prior.scale, prior.norm, TERMS * runs + 10)
    weight = (1.0 + size**2) ** (-0.5 * prior.smoothness)
    free = indices.sum(axis=1) <= (prior.trend > 0.0)
    free[: int(prior.trend * runs)] = True
    return indices, np.where(free, FREE * weight, weight)


def _scaled(prior: Prior, z: Array) -> tuple[Indices, Array, Array]:
    """Return indices (P, n), weights (P,) and the matrix B ((P, M) or, with noise, (P + M, M))."""
    indices, weight = weights(prior, len(z))
    matrix = weight[:, None] * products(indices, z)
    if prior.noise > 0.0:
        matrix = np.vstack([matrix, prior.noise * np.eye(len(z))])
    return indices, weight, matrix


def leave_one_out(prior: Prior, z: Array, t: Array) -> Array:
    """Return t_i minus the polynomial fitted without run i (M, A), for t (M, A) at z (M, n).

    r_i = [K^-1 y]_i / [K^-1]_ii (Dubrule 1983): one factorization for all runs and experiments.
    """
    triangle = np.linalg.qr(_scaled(prior, z)[2], mode="r")
    inverse = solve_triangular(triangle, np.eye(len(z)))
    return np.asarray((inverse @ (inverse.T @ t)) / (inverse**2).sum(axis=1)[:, None])


@single_threaded
def fitted(prior: Prior, z: Array, y: Array) -> tuple[Indices, Array]:
    """Return indices (P, n) and coefficients (P, A) of the surfaces through runs y (M, A)."""
    indices, weight, matrix = _scaled(prior, z)
    q, r = np.linalg.qr(matrix)
    q = q[: len(weight)]
    return indices, weight[:, None] * (q @ solve_triangular(r, prior.terms(y), trans="T"))


class Judged(NamedTuple):
    """Surfaces of some experiments through the same runs, and what the runs say of their error.

    `expected` is in units of the polynomials, and all else in those of the outcome.
    """

    indices: Indices
    coefficients: Array  # (P, A)
    expected: Array  # (A,) root-mean-square error over the box that the prior expects
    there: Array  # (A,) the same at the points that were asked for, or over the box
    residual: Array  # (M, A) leave-one-out
    rate: Array  # (A,) root-mean-square derivative there of outcomes by polynomials


@single_threaded
def judged(prior: Prior, z: Array, y: Array, where: Array | None = None) -> Judged:
    """Return the surfaces with the error that the prior expects over the box, or at some points.

    The posterior covariance of the coefficients is s^2 W (I - Q Q') W; its trace is the mean
    square error over the box, because the basis is orthonormal there. s^2 is the mean square of
    the leave-one-out residuals over their variances 1 / [K^-1]_ii. At points `where` (J, n) it is
    the mean of s^2 (W phi)' (I - Q Q') W phi, for a logarithm times the square of the outcome.
    """
    indices, weight, matrix = _scaled(prior, z)
    q, r = np.linalg.qr(matrix)
    inverse = solve_triangular(r, np.eye(len(z)))
    precision = (inverse**2).sum(axis=1)[:, None]
    t = prior.terms(y)
    dual = inverse @ (inverse.T @ t)
    variance = (dual**2 / precision).mean(axis=0)
    trace = _over_box(q, weight)
    coefficients = weight[:, None] * (q[: len(weight)] @ solve_triangular(r, t, trans="T"))
    expected, residual = np.sqrt(variance * trace), dual / precision
    if not prior.logarithm:
        at = trace if where is None else _at(q, weight, products(indices, where)).mean()
        rate = np.ones_like(variance)
        return Judged(indices, coefficients, expected, np.sqrt(variance * at), residual, rate)
    basis = products(indices, everywhere(z.shape[1]) if where is None else where)
    found = prior.outcomes(coefficients.T @ basis)
    there = found**2 @ _at(q, weight, basis) / basis.shape[1]
    return Judged(
        indices, coefficients, expected, np.sqrt(variance * there),
        missed(y, residual), np.sqrt((found**2).mean(axis=1)),
    )  # fmt: skip


def missed(y: Array, residual: Array) -> Array:
    """Outcomes (M, A) minus those of polynomials of logarithms that are off by `residual`."""
    return np.asarray(-y * np.expm1(np.clip(-residual, -LARGEST, LARGEST)))


def _over_box(q: Array, weight: Array) -> float:
    """Return the mean posterior variance over the box, in units of s^2."""
    unknown = 1.0 - (q[: len(weight)] ** 2).sum(axis=1)
    # 1 - |q|^2 loses all digits where a coefficient is all but known: square the small vector
    # itself there, and take what is left at the level of rounding for nothing.
    near = np.flatnonzero(unknown < 1e-3)
    rest = -(q @ q[near].T)
    rest[near, np.arange(len(near))] += 1.0
    unknown[near] = (rest**2).sum(axis=0)
    unknown[unknown < 1e-24] = 0.0
    return float(weight**2 @ np.maximum(unknown, 0.0))


def _at(q: Array, weight: Array, basis: Array) -> Array:
    """Return the posterior variance (J,) at points with basis (P, J), in units of s^2."""
    own = weight[:, None] * basis
    rest = -(q @ (q[: len(weight)].T @ own))
    rest[: len(weight)] += own
    return np.asarray((rest**2).sum(axis=0))


class Found(NamedTuple):
    """Priors, the `best` of them (A,), its mean square `error` (A,), and a pool to go on with."""

    priors: list[Prior]
    best: Indices
    error: Array
    pool: list[Prior]


@single_threaded
def search(pool: list[Prior], z: Array, y: Array, share: Array, sweeps: int = SWEEPS) -> Found:
    """Return priors, the best of them for each experiment (A,), and the pool to go on with.

    All experiments are judged together, one factorization a prior; each takes the prior with the
    least leave-one-out error. Where all its outcomes are positive it takes the best prior of their
    logarithms instead, if outcomes are missed by less (`_fall`), each with the share (M,) of its
    run.
    The neighbors of the most frequent winners are tried in turn; with one sweep only the pool is.
    """
    score: dict[Prior, Array] = {}
    error: dict[Prior, Array] = {}
    count, positive = y.shape[1], np.flatnonzero((y > 0.0).all(axis=0))
    terms = np.hstack([y, np.log(y[:, positive])])
    trial = list(pool)
    for _ in range(sweeps):
        for prior in trial:
            if prior not in score:
                residual = leave_one_out(prior, z, terms)
                score[prior] = (residual**2).mean(axis=0)
                residual[:, count:] = missed(y[:, positive], residual[:, count:])
                error[prior] = share @ residual**2
        known = sorted(score)
        best = np.argmin([score[prior] for prior in known], axis=0)
        errors = np.array([error[prior] for prior in known])[best, np.arange(best.size)]
        takes = _fall(errors[positive], errors[count:])
        chosen = best[:count].copy()
        chosen[positive[takes]] = best[count:][takes]
        left = errors[:count].copy()
        left[positive[takes]] = errors[count:][takes]
        wins = Counter(known[k] for k in chosen)
        leaders = sorted(wins, key=lambda prior: (-wins[prior], prior))[: KEEP[len(z) > MANY]]
        trial = [other for prior in leaders for other in neighbors(prior)]
    chosen[positive[takes]] += len(known)
    known += [prior._replace(logarithm=True) for prior in known]
    pool = list(dict.fromkeys([*leaders, *first_priors(z.shape[1])[:2]]))
    return Found(known, chosen, left, pool)


def _fall(before: Array, after: Array) -> Flags:
    """Whether mean square errors (A,) fall to FALL, by the mean of the experiment and the median.

    The experiments are alike, and the few runs of one tell little: where neither is good, as with a
    kink, chance would choose.
    """
    change = np.log(np.maximum(after, TINY)) - np.log(np.maximum(before, TINY))
    return np.asarray(change + (np.median(change) if change.size else 0.0) < 2.0 * np.log(FALL))
