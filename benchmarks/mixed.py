"""Linear mixed models in closed form: a `Fit` of them makes the studies that take seconds cheap.

y_l = C_l (D_l beta + b_l) + e_l with b_l ~ N(0, S) and e_l ~ N(0, s^2): experiment l has the m
observations y_l, whose parameters follow covariates by D_l and are seen by the curves C_l. The
likelihood is that of a normal vector (Laird and Ware, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy import special

from aleator import Experiments, Free, Inputs, Normal
from aleator.core.types import Array, Indices
from aleator.inference.information import Inference, infer
from aleator.laws.hyperparameter import Hyperparameter
from aleator.search.interface import LogLikelihood
from aleator.search.newton import ascended

ARRIVED = 1e-9


@dataclass(frozen=True)
class Plan:
    """What was done: curves (N, m, n), a design (N, q) for each of the n parameters.

    alpha has q coefficients and a standard deviation of each parameter, a correlation of the first
    two where they are `tied`, and the standard deviation of the noise.
    """

    names: tuple[str, ...]
    curves: Array
    designs: tuple[Array, ...]
    hyperparameters: tuple[Hyperparameter, ...]
    tied: bool = False

    @cached_property
    def regressors(self) -> Array:
        """Slopes (N, m, P) of the expected observations by all coefficients."""
        pairs = zip(np.moveaxis(self.curves, 2, 0), self.designs, strict=True)
        return np.concatenate([c[:, :, None] * d[:, None, :] for c, d in pairs], axis=2)

    @cached_property
    def places(self) -> tuple[Indices, Indices]:
        """Where alpha has the coefficients (P,), and where the standard deviations (n,)."""
        ends = np.cumsum([d.shape[1] + 1 for d in self.designs])
        return np.setdiff1d(np.arange(ends[-1]), ends - 1), ends - 1

    def ties(self, alpha: Array) -> Array:
        """The correlations (n, n)."""
        found = np.eye(len(self.names))
        if self.tied:
            found[0, 1] = found[1, 0] = alpha[-2]
        return found

    def scatter(self, alpha: Array) -> tuple[Array, Array]:
        """S (n, n), and its derivatives (n + 1, n, n) by standard deviations and correlation."""
        sd, ties, n = alpha[self.places[1]], self.ties(alpha), len(self.names)
        by = np.zeros((n + 1, n, n))
        for j in range(n):
            by[j, j] += ties[j] * sd
            by[j, :, j] += ties[j] * sd
        by[n, 0, -1] = by[n, -1, 0] = sd[0] * sd[-1]
        return ties * np.outer(sd, sd), by


@dataclass(frozen=True, eq=False)
class Mixed:
    """Observations y (N, m) of a plan at alpha (K,)."""

    plan: Plan
    y: Array
    alpha: Array
    inference: Inference
    table: Experiments

    @classmethod
    def of(cls, plan: Plan, y: Array, near: Array, frame: pd.DataFrame) -> Mixed:
        """At the maximum next to an alpha; the table has a row for each observation."""
        found = maximum(plan, y, near)
        inference = infer(Model(plan, y), found, plan.hyperparameters)
        return cls(plan, y, found, inference, Experiments.from_frame(frame, outcome="y"))

    @property
    def likelihood(self) -> Mixed:
        """Its own."""
        return self

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the plan."""
        return self.plan.hyperparameters

    @property
    def count(self) -> int:
        """N."""
        return len(self.y)

    @property
    def inputs(self) -> Inputs:
        """Independent parameters of these names, constants left out; or two that are correlated."""
        names = [self.plan.names[k] for k in self.scattering]
        laws = {name: Normal(Free(-9.0, 9.0), Free(0.01, 9.0)) for name in names}
        pair = (self.plan.names[0], self.plan.names[-1])
        return Inputs(laws, {pair: Free(-0.9, 0.9)} if self.plan.tied else None)

    @property
    def scattering(self) -> Indices:
        """The places of the parameters that are no constants: their standard deviation is not 0."""
        return np.flatnonzero(self.alpha[self.plan.places[1]] > 0.0)

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) with scores (N, K)."""
        return Model(self.plan, self.y)(self.alpha)

    def probabilities(self, points: int | None = None) -> Array:  # noqa: ARG002
        """Of each observation given the earlier ones of its experiment (M,)."""
        variance, left = _normal(self.plan, self.y, self.alpha)
        w = np.linalg.solve(np.linalg.cholesky(variance), left[..., None])
        return np.asarray(special.ndtr(w[..., 0]).ravel())

    def variates(self) -> tuple[Array, Array]:
        """Means (N, s) and mean products (N, s, s) of the independent variates of b."""
        variance, left = _normal(self.plan, self.y, self.alpha)
        root = np.linalg.cholesky(self.plan.ties(self.alpha))
        loads = self.plan.curves @ (self.alpha[self.plan.places[1]][:, None] * root)
        gain = np.linalg.solve(variance, loads)
        means = np.einsum("lmj,lm->lj", gain, left)
        rest = np.eye(len(self.plan.names)) - np.einsum("lmi,lmj->lij", loads, gain)
        products, s = rest + means[:, :, None] * means[:, None, :], self.scattering
        return means[:, s], products[:, s[:, None], s]

    def for_replicates(self) -> Mixed:
        """The same: it has no nodes."""
        return self

    def at(self, alpha: Array) -> Mixed:
        """The same observations."""
        return replace(self, alpha=alpha)

    def drawn(self, rng: np.random.Generator) -> Mixed:
        """Other observations under alpha."""
        return replace(self, y=drawn(self.plan, self.alpha, rng))


def drawn(plan: Plan, alpha: Array, rng: np.random.Generator) -> Array:
    """Observations (N, m) under alpha."""
    zero = np.zeros(plan.curves.shape[:2])
    variance, left = _normal(plan, zero, alpha)
    z = rng.standard_normal((*zero.shape, 1))
    return np.asarray((np.linalg.cholesky(variance) @ z)[..., 0] - left)


@dataclass(frozen=True, eq=False)
class Model:
    """The log-likelihood of observations y (N, m) as a function of alpha (K,)."""

    plan: Plan
    y: Array

    def values(self, alphas: Array) -> Array:
        """Those of many alphas (B, K), (B,)."""
        return np.array([self(alpha).total for alpha in alphas])

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Log-densities (N,) with scores (N, K).

        By V they are half of u' dV u - tr(V^-1 dV), where u = V^-1 r.
        """
        plan, y = self.plan, self.y
        variance, left = _normal(plan, y, alpha)
        inverse = np.linalg.inv(variance)
        u = np.einsum("lmk,lk->lm", inverse, left)
        sign = y.shape[1] * np.log(2.0 * np.pi) + np.linalg.slogdet(variance)[1]
        each = -0.5 * (np.sum(left * u, axis=1) + sign)
        scores = np.zeros((len(y), alpha.size))
        means, sds = plan.places
        scores[:, means] = np.einsum("lmp,lm->lp", plan.regressors, u)
        seen = np.einsum("lmj,lm->lj", plan.curves, u)
        outer = np.einsum("lmi,lmk,lkj->lij", plan.curves, inverse, plan.curves)
        inner = 0.5 * (seen[:, :, None] * seen[:, None, :] - outer)
        by = np.einsum("lij,kij->lk", inner, plan.scatter(alpha)[1])
        scores[:, sds] = by[:, :-1]
        if plan.tied:
            scores[:, -2] = by[:, -1]
        scores[:, -1] = alpha[-1] * (np.sum(u**2, axis=1) - np.trace(inverse, axis1=1, axis2=2))
        return LogLikelihood(each, scores, np.zeros(len(y), dtype=np.int64))


def maximum(plan: Plan, y: Array, near: Array, held: int | None = None) -> Array:
    """alpha of the largest log-likelihood next to this one, with one entry held, or none."""
    free = [k for k, h in enumerate(plan.hyperparameters) if h.free and k != held]
    moving, objective = np.array(free, dtype=np.intp), Model(plan, y)
    alpha = near
    for _ in range(2):
        scores = objective(alpha).scores
        assert scores is not None
        outer = scores[:, moving].T @ scores[:, moving]
        alpha = ascended(objective, alpha, plan.hyperparameters, moving, outer, ARRIVED).alpha
    return alpha


def _normal(plan: Plan, y: Array, alpha: Array) -> tuple[Array, Array]:
    """V (N, m, m), and what the expectation leaves of y (N, m)."""
    within = np.einsum("lmi,ij,lkj->lmk", plan.curves, plan.scatter(alpha)[0], plan.curves)
    expected = plan.regressors @ alpha[plan.places[0]]
    return within + alpha[-1] ** 2 * np.eye(y.shape[1]), y - expected
