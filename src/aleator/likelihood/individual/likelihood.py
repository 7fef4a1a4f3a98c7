"""The likelihood of experiments with any number of observations each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from aleator.densities import Status
from aleator.laws.hyperparameter import Hyperparameter
from aleator.laws.individual import Individual
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual.modes import Modes, modes
from aleator.likelihood.individual.predictor import Predictor, rows_of
from aleator.likelihood.individual.rule import GaussHermite
from aleator.observations.errors import MeasurementErrors, Terms
from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices

BLOCK = 2_000_000
"""Simulated values that are held at once."""
AROUND = (-2.0, -1.0, 1.0, 2.0)
"""Where modes are sought along each variate, besides about the last one."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """Standard normal variates xi (N, J, s) of each experiment, log weights (N, J), modes (N, s).

    int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j).
    """

    xi: Array
    log_weight: Array
    mode: Array
    information: Array


@dataclass(frozen=True, eq=False)
class IndividualLikelihood:
    """log L(alpha) = sum_l log int prod_k p(y_lk | eta_lk(x), sigma_lk) p(x | alpha) dx.

    x is the image of standard normal variates xi (see `Individual`), and the integral over them a
    quadrature at `nodes` that are adapted to each experiment (Pinheiro and Bates, 1995) and held:
    called, it is smooth in alpha with an exact score (Fisher's identity). `adapted` returns the
    same with nodes adapted to another alpha; nothing changes in place. Nodes that are held far
    from where they were adapted integrate poorly. `experiment` (M,) is sorted.
    """

    inputs: Inputs
    errors: MeasurementErrors
    predictor: Predictor
    experiment: Indices
    count: int
    rule: GaussHermite
    nodes: Nodes

    @classmethod
    def of(
        cls,
        inputs: Inputs,
        errors: MeasurementErrors,
        predictor: Predictor,
        experiment: Indices,
        count: int,
        rule: GaussHermite,
    ) -> IndividualLikelihood:
        """The likelihood of `count` experiments with nodes of the law itself."""
        mode = np.zeros((count, inputs.scattering))
        nodes = _placed(Modes(mode, _units(mode)), rule)
        return cls(inputs, errors, predictor, experiment, count, rule, nodes)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: the inputs', then the errors'."""
        return (*self.inputs.hyperparameters, *self.errors.hyperparameters)

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score (N, K) at alpha (K,), nodes held."""
        each, scores = np.empty(self.count), np.empty((self.count, alpha.size))
        for part in self._blocks():
            found = self._at(alpha, part, self.nodes.xi[part])
            total = found.sums + self.nodes.log_weight[part]
            each[part], share = _mean_of(total)
            scores[part] = found.scores(share)
        status = np.where(np.isfinite(each), Status.SOLVED, Status.OUTSIDE_SUPPORT)
        return LogLikelihood(each, scores, status.astype(np.int64))

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The value at alpha without its score, nodes held."""
        each = np.empty(self.count)
        for part in self._blocks():
            individual = self.inputs.individual(
                alpha[: self.inputs.size], self.nodes.xi[part], part
            )
            terms = self._terms(alpha, part, self.predictor.values(part, individual.x))
            total = _summed(terms.value, self._starts(part)) + self.nodes.log_weight[part]
            each[part] = _mean_of(total)[0]
        status = np.where(np.isfinite(each), Status.SOLVED, Status.OUTSIDE_SUPPORT)
        return LogLikelihood(each, None, status.astype(np.int64))

    def adapted(self, alpha: Array) -> IndividualLikelihood:
        """The same with nodes adapted to alpha: about each mode, as wide as its curvature says."""
        if not self.inputs.scattering:
            return self
        found = Modes.joined([self._modes(alpha, part) for part in self._blocks()])
        return replace(self, nodes=_placed(found, self.rule))

    def by(self, rule: GaussHermite) -> IndividualLikelihood:
        """The same with other nodes about the same modes."""
        found = Modes(self.nodes.mode, self.nodes.information)
        return replace(self, rule=rule, nodes=_placed(found, rule))

    @property
    def continued(self) -> Following:
        """What a search climbs."""
        return Following(self)

    def _modes(self, alpha: Array, part: slice) -> Modes:
        start = self._best_start(alpha, part)
        return modes(lambda z: self._curved(alpha, part, z), start)

    def _best_start(self, alpha: Array, part: slice) -> Array:
        """Of the last modes and of points all about, the most likely of each experiment."""
        s = self.inputs.scattering
        last = self.nodes.mode[part]
        axes = [reach * np.eye(s) for reach in AROUND]
        around = np.concatenate([np.zeros((1, s)), *axes])
        trial = np.concatenate([last[:, None], np.tile(around, (len(last), 1, 1))], axis=1)
        individual = self.inputs.individual(alpha[: self.inputs.size], trial, part)
        terms = self._terms(alpha, part, self.predictor.values(part, individual.x))
        value = _summed(terms.value, self._starts(part)) - 0.5 * np.sum(trial**2, axis=2)
        return np.asarray(trial[np.arange(len(last)), np.argmax(value, axis=1)])

    def _curved(self, alpha: Array, part: slice, z: Array) -> tuple[Array, Array, Array]:
        found = self._at(alpha, part, z[:, None])
        by_xi = found.individual.by_variates()[:, 0]
        starts = self._starts(part)
        rows = rows_of(self.experiment, part)
        owner = self.experiment[rows] - part.start
        # (m, s): slopes of each observation by the variates
        slopes = np.einsum("nm,mns->ms", found.slopes[:, :, 0], by_xi[owner])
        curvature = self.errors.curvature(alpha[self.inputs.size :], found.eta, rows)[:, 0]
        value = found.sums[:, 0] - 0.5 * np.sum(z**2, axis=1)
        gradient = _summed(found.terms.d_eta * slopes, starts) - z
        outer = curvature[:, None, None] * slopes[:, :, None] * slopes[:, None, :]
        return value, gradient, _summed(outer, starts) + np.eye(z.shape[1])

    def _at(self, alpha: Array, part: slice, xi: Array) -> _Evaluated:
        individual = self.inputs.individual(alpha[: self.inputs.size], xi, part)
        eta, slopes = self.predictor.with_slopes(part, individual.x)
        return _Evaluated(
            individual, eta, slopes, self._terms(alpha, part, eta), self._starts(part),
            self.experiment[rows_of(self.experiment, part)] - part.start,
        )  # fmt: skip

    def _terms(self, alpha: Array, part: slice, eta: Array) -> Terms:
        return self.errors.terms(alpha[self.inputs.size :], eta, rows_of(self.experiment, part))

    def _starts(self, part: slice) -> Indices:
        rows = rows_of(self.experiment, part)
        within = self.experiment[rows] - part.start
        return np.searchsorted(within, np.arange(part.stop - part.start))

    def _blocks(self) -> Iterator[slice]:
        widest = int(np.bincount(self.experiment, minlength=self.count).max())
        nodes = self.nodes.xi.shape[1]
        step = max(1, BLOCK // (widest * nodes))
        return (slice(a, min(a + step, self.count)) for a in range(0, self.count, step))


@dataclass(frozen=True)
class Following:
    """The objective of a search: nodes are adapted to every alpha that is asked for.

    Its score is exact but for the error of the quadrature; modes are sought from those of the
    likelihood that it was made of, so that the value is a function of alpha alone.
    """

    likelihood: IndividualLikelihood

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,)."""
        return self.likelihood.adapted(alpha)(alpha)

    def values(self, alphas: Array) -> Array:
        """The totals (A,) at alphas (A, K)."""
        return np.array([self.likelihood.adapted(a).evaluate(a).total for a in np.asarray(alphas)])


@dataclass(frozen=True, eq=False)
class _Evaluated:
    """A block of experiments at their nodes, with all that scores are made of."""

    individual: Individual
    eta: Array
    slopes: Array
    terms: Terms
    starts: Indices
    owner: Indices

    @property
    def sums(self) -> Array:
        """sum_k log p(y_k | eta_k), (B, J)."""
        return _summed(self.terms.value, self.starts)

    def scores(self, share: Array) -> Array:
        """The scores (B, K) where node j has this share (B, J) of the likelihood."""
        gradient = np.zeros(self.individual.x.shape)
        for i, slope in enumerate(self.slopes):
            if np.any(slope):
                gradient[..., i] = share * _summed(self.terms.d_eta * slope, self.starts)
        law = self.individual.score(np.where(share[..., None] > 0.0, gradient, 0.0))
        errors = np.zeros((len(share), len(self.terms.d_values)))
        for p, (rows, derivative) in enumerate(self.terms.d_values):
            owner = self.owner[rows]
            each = np.sum(share[owner] * derivative, axis=1)
            errors[:, p] = np.bincount(owner, each, minlength=len(share))
        return np.concatenate([law, errors], axis=1)


def _units(mode: Array) -> Array:
    return np.tile(np.eye(mode.shape[1]), (len(mode), 1, 1))


def _placed(found: Modes, rule: GaussHermite) -> Nodes:
    """xi_j = mode + C t_j with C C' = information^-1, and the weights of the integral.

    log weight_j = log w_j + log det C + (|t_j|^2 - |xi_j|^2)/2.
    """
    z, information = found.z, found.information
    t, log_w = rule.nodes(z.shape[1])
    if not z.shape[1]:
        return Nodes(np.zeros((len(z), 1, 0)), np.zeros((len(z), 1)), z, information)
    root = np.linalg.cholesky(np.linalg.inv(information))
    xi = z[:, None] + np.einsum("nst,jt->njs", root, t)
    log_det = np.log(np.einsum("nss->ns", root)).sum(axis=1)
    spread = 0.5 * (np.sum(t**2, axis=1) - np.sum(xi**2, axis=2))
    return Nodes(xi, log_w + log_det[:, None] + spread, z, information)


def _mean_of(total: Array) -> tuple[Array, Array]:
    """log sum_j exp(total_j) (B,), and the share (B, J) of each."""
    top = total.max(axis=1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    part = np.exp(total - safe)
    whole = part.sum(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (safe + np.log(whole))[:, 0], np.where(whole > 0.0, part / whole, 0.0)


def _summed(values: Array, starts: Indices) -> Array:
    """Sums (B, ...) over the observations (m, ...) of each experiment; every one has some."""
    return np.add.reduceat(values, starts, axis=0)
