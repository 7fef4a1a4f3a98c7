"""The error of alpha and of the log-likelihood by the errors of an emulator, to first order.

The score of alpha changes with the error e_u(x) of each simulated value, and alpha changes by
H^-1 times the change of the score, where H is the information matrix. Both are sums over nodes x of
weights times errors (`functional`). The covariance of the errors of a Gaussian process, which are
not independent, then gives the covariance of alpha.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Indices
from aleator.inference.check import smoothed
from aleator.likelihood.individual import IndividualLikelihood, Layout
from aleator.likelihood.individual.likelihood import Evaluated
from aleator.likelihood.individual.posterior import values_under_law
from aleator.likelihood.individual.predictors import Block, Predictor
from aleator.likelihood.problem import Problem


@dataclass(frozen=True)
class FunctionalSettings:
    """Settings of the dependence of alpha on errors of values. The values are by judgement."""

    smooth: float = 0.1
    """The standard deviation of the auxiliary error of an exact outcome, over its scatter, and the
    least one of an experiment's only value."""
    draws: int = 128
    """The number of points of the law that tell this scatter."""
    sites: int = 2
    """The number of nodes of an experiment at which the errors of its values are taken, for each
    term of a polynomial of degree two. They are drawn by their shares in the likelihood where there
    are more."""
    aside: float = 0.25
    """The weight of a point above or below a constant's value, where the nodes have weight one."""
    step: float = 1e-4
    """The step of differences of the score by a value, over the scatter of the value."""
    least: float = 0.05
    """Polynomials of an error that the nodes determine less than this share of the best are left
    out."""


FUNCTIONAL = FunctionalSettings()


@dataclass(frozen=True)
class Functional:
    """How alpha and the log-likelihood depend on errors of simulated values, to first order.

    The change of (alpha, log L) is the sum over r of e_u(x_r) weights[r] (F + 1,), where u is the
    output site[r] and x_r (n,) are the parameters that are not fixed. Only the F hyperparameters
    with a standard error count.
    """

    site: Indices
    x: Array
    weights: Array


@dataclass(frozen=True)
class InfluentialPoints:
    """Points x (P, n) of cases (P,) whose values alpha depends on.

    `effect` (P,) is the root mean square change of alpha in standard errors, where each value at
    the point has an independent error as large as its scatter. Without free hyperparameters it is
    the change of the log-likelihood.
    """

    case: Indices
    x: Array
    effect: Array

    @classmethod
    def of(cls, found: Functional, case: Indices, by: Array, scatter: Array) -> InfluentialPoints:
        """The points of a functional: `by` (K, F) times changes of alpha are in standard errors."""
        each = found.weights[:, : by.shape[1]] @ by.T * scatter[found.site, None]
        points, owner = np.unique(
            np.column_stack([case[found.site], found.x]), axis=0, return_inverse=True
        )
        squares = np.bincount(owner.ravel(), (each**2).sum(axis=1))
        return cls(points[:, 0].astype(np.intp), points[:, 1:], np.sqrt(squares))


def functional(
    likelihood: IndividualLikelihood,
    alpha: Array,
    free: Indices,
    covariance: Array,
    moving: Indices,
    spread: Array,
    of: Indices,
    scatter: Array,
    settings: FunctionalSettings = FUNCTIONAL,
) -> Functional:
    """The dependence of alpha and log L on errors of the values at the nodes of the likelihood.

    About the nodes of an experiment, the error of each value is a polynomial of degree two, by
    whose coefficients the scores are differentiated. `covariance` (F, F) is that of the
    hyperparameters `free` (F,). `moving` are the parameters that are not fixed. Those that do not
    scatter have the same value at all nodes; further points lie `spread` (n,) above and below it.
    `of` (M,) is the output of each observation, and `scatter` (U,) that of the outputs. Cost: an
    evaluation of the measurement errors for each coefficient and observation of an experiment.
    """
    aside = [k for k, i in enumerate(moving) if i not in likelihood.inputs.scattered]
    terms = len(_quadratic(moving.size))
    parts = []
    for block in likelihood.blocks:
        found = likelihood.at(alpha, block, likelihood.nodes.xi[block.experiments])
        share = likelihood.mean_over_nodes(block, found.sums)[1]
        x = found.individual.x[..., moving]
        middle = np.einsum("bj,bjn->bn", share, x)
        off = [by * spread[k] * np.eye(moving.size)[k] for k in aside for by in (1.0, -1.0)]
        points = np.concatenate([x, *((middle + one)[:, None] for one in off)], axis=1)
        rest = np.full((len(share), len(off)), settings.aside)
        local = _Polynomials.over(
            points, np.hstack([_thinned(share, settings.sites * terms), rest]), settings
        )
        step = settings.step * scatter[of[block.rows]]
        slopes = _slopes(likelihood, alpha, block, found, local, moving, step)
        slopes = slopes[..., [*free, alpha.size]]
        weights = np.einsum(
            "msq,mqk->msk", (local.value * local.share[..., None])[block.owner], slopes
        )
        weights[..., :-1] = weights[..., :-1] @ covariance
        kept = local.share[block.owner] > 0.0
        site = np.broadcast_to(of[block.rows][:, None], kept.shape)[kept]
        parts.append((site, points[block.owner][kept], weights[kept]))
    return Functional(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def near_outcomes(
    problem: Problem, alpha: Array, predictor: Predictor, settings: FunctionalSettings = FUNCTIONAL
) -> IndividualLikelihood:
    """The likelihood of outcomes with a small auxiliary error, by simulated values."""
    rows = np.arange(problem.count)
    layout = Layout(rows.size, rows, rows, np.zeros(rows.size, dtype=np.intp))
    law = alpha[: problem.inputs.size]
    return smoothed(problem.inputs, law, predictor, layout, problem.ends, settings.smooth)


def eased(
    likelihood: IndividualLikelihood, alpha: Array, settings: FunctionalSettings = FUNCTIONAL
) -> IndividualLikelihood:
    """The likelihood where the only value of an experiment has no error far below its scatter.

    A parameter that scatters gives such a value whatever the error is: its density is about that of
    the outcome, and an error e of the simulated value changes it as if the value were off by -e. So
    a small error hardly matters, but nodes would have to follow a ridge as thin as it, and the
    bound of a censored value would be a step. An auxiliary error makes it as large as the share
    `smooth` of the scatter under the law alpha (K,). Several values of an experiment, or of a
    group, may tell its parameters as exactly as their errors are small, and are left alone.
    """
    experiment, inputs = likelihood.layout.experiment, likelihood.inputs
    only = np.bincount(experiment, minlength=likelihood.count)[experiment] == 1
    if not only.any() or not inputs.scattering or likelihood.layout.grouping is not None:
        return likelihood
    added = np.zeros(experiment.size)
    for block, eta, share in values_under_law(likelihood, alpha, settings.draws):
        scale = likelihood.errors.scale(alpha[inputs.size :], eta, block.rows)
        off = eta - np.sum(share * eta, axis=1, keepdims=True)
        short = np.sum(share * ((settings.smooth * off) ** 2 - scale**2), axis=1)
        added[block.rows] = np.sqrt(np.maximum(np.nan_to_num(short), 0.0))
    added *= only
    if not added.any():
        return likelihood
    return replace(likelihood, errors=likelihood.errors.eased(added))


def _slopes(
    likelihood: IndividualLikelihood,
    alpha: Array,
    block: Block,
    found: Evaluated,
    local: _Polynomials,
    moving: Indices,
    step: Array,
) -> Array:
    """Derivatives (m, Q, K + 1) of scores and log-densities by the errors' coefficients."""

    def scored(one: Evaluated) -> Array:
        each, share = likelihood.mean_over_nodes(block, one.sums)
        scores = one.scores(share)
        if block.clusters is not None:
            scores = block.clusters.summed(scores)
        return np.column_stack([scores, each])

    base, nodes = scored(found), found.eta.shape[1]
    # The values of one observation of each independent term are moved at a time.
    term = block.owner if block.clusters is None else block.clusters.top(0)[block.owner]
    order = np.argsort(term, kind="stable")
    rank = np.empty(term.size, dtype=np.intp)
    rank[order] = np.arange(term.size) - np.searchsorted(term[order], term[order])
    out = np.zeros((len(block.owner), local.value.shape[2], base.shape[1]))
    for place in range(int(rank.max(initial=-1)) + 1):
        rows = np.flatnonzero(rank == place)
        own = block.owner[rows]
        for q in range(out.shape[1]):
            eta, slopes = found.eta.copy(), found.slopes.copy()
            eta[rows] += step[rows, None] * local.value[own, :nodes, q]
            along = step[rows, None, None] * local.slope[own, :nodes, :, q]
            slopes[np.ix_(moving, rows)] += along.transpose(2, 0, 1)
            terms = likelihood.errors.terms(alpha[likelihood.inputs.size :], eta, block.rows)
            moved = scored(replace(found, eta=eta, slopes=slopes, terms=terms))
            out[rows, q] = (moved - base)[term[rows]] / step[rows, None]
    return out


@dataclass(frozen=True)
class _Polynomials:
    """Polynomials of degree two for each of B experiments, orthonormal over weighted points.

    `value` (B, S, Q) and `slope` (B, S, n, Q) are those at the points with weights `share` (B, S).
    A function with values e (B, S) has the coefficients sum_s e_s share_s value_sq. Polynomials
    that the points do not determine are zero.
    """

    value: Array
    slope: Array
    share: Array

    @classmethod
    def over(cls, x: Array, weight: Array, settings: FunctionalSettings) -> _Polynomials:
        indices, tiny = _quadratic(x.shape[2]), np.finfo(float).tiny
        share = weight / np.maximum(weight.sum(axis=1, keepdims=True), tiny)
        middle = np.einsum("bs,bsn->bn", share, x)[:, None]
        off = (x - middle) * np.sqrt(share)[..., None]
        turn, size, _ = np.linalg.svd(off.transpose(0, 2, 1), full_matrices=False)
        into = turn / np.maximum(size, 1e-9 * size[:, :1] + tiny)[:, None, :]
        # Far from the nodes that count, powers are cut off.
        t = np.clip(np.einsum("bsi,bij->bsj", x - middle, into), -1e3, 1e3)
        value, slope = _powers(t, indices)
        _, s, v = np.linalg.svd(value * np.sqrt(share)[..., None], full_matrices=False)
        known = s > settings.least * s[:, :1]
        inverse = (
            v.transpose(0, 2, 1) * np.where(known, 1.0 / np.where(known, s, 1.0), 0.0)[:, None]
        )
        slope = np.einsum("bij,bsjq,bqk->bsik", into, slope, inverse, optimize=True)
        return cls(value @ inverse, slope, share)


def _thinned(share: Array, count: int) -> Array:
    """Shares (B, J) of the points, or of those that remain of `count` systematic draws of many."""
    if share.shape[1] <= count:
        return share
    ends = np.round(np.cumsum(share, axis=1) * count)
    return np.diff(ends, axis=1, prepend=0.0) / count


def _quadratic(n: int) -> Indices:
    """The multi-indices (Q, n) of all terms up to degree two."""
    eye = np.eye(n, dtype=np.intp)
    pairs = [eye[i] + eye[j] for i in range(n) for j in range(i, n)]
    return np.vstack([np.zeros((1, n), dtype=np.intp), eye, *pairs])


def _powers(t: Array, indices: Indices) -> tuple[Array, Array]:
    """Monomials (..., Q) of points t (..., n), and their derivatives (..., n, Q)."""
    value = np.stack([np.prod(t**nu, axis=-1) for nu in indices], axis=-1)
    slope = np.zeros((*t.shape, len(indices)))
    for q, nu in enumerate(indices):
        for i in np.flatnonzero(nu):
            less = nu - (np.arange(len(nu)) == i)
            slope[..., i, q] = nu[i] * np.prod(t**less, axis=-1)
    return value, slope
