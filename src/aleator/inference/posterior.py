"""The posterior density of alpha, its Markov chains, and whether these have converged.

p(alpha | y) ~ L(alpha) p(alpha) between the limits. A hyperparameter v between its limits a and b
is v = a + (b - a) / (1 + exp(-u)), and the density of u has the factor dv/du (the Jacobian): on the
real line a sampler may go anywhere. Chains are made by the No-U-Turn sampler of Hoffman and Gelman
(2014), with multinomial draws from each trajectory (Betancourt, 2017), in the package Mici: it
takes any function with its slope, and needs no compiler.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from scipy import optimize, special

from aleator.core.types import Array, Flags, Indices
from aleator.errors import AleatorError, installing
from aleator.inference.information import DIFFERENCES
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import LogLikelihood, Scored


@dataclass(frozen=True)
class PosteriorSettings:
    """How a posterior is scaled, sampled and judged; by judgement but where a paper is named."""

    farthest: float = 1e-3
    """Share of the limits' width that a search for the mode begins away from them."""
    least: float = 0.05
    """Least curvature: that of a density as flat as between limits that nothing else tells of."""
    tried: int = 16
    """Points that say whether a scale is too wide."""
    shrunk: int = 12
    """Times that a scale is made smaller, at most."""
    smaller: float = 0.6
    """Factor by which it is made smaller."""
    impossible: float = 1e300
    """Minus the log-density that the search for the mode sees where there is none."""
    mode: int = 50
    """Steps to the mode, at most."""
    target: float = 0.85
    """Share of proposals that is to be accepted."""
    deepest: int = 5
    """Times that a trajectory is doubled, at most: the density has been scaled to about N(0, I)."""
    tries: int = 50
    """Points that a chain may try to begin at."""
    tails: tuple[float, float] = (0.05, 0.95)
    """Probabilities of the quantiles whose effective sample size counts."""
    warm_up: int = 100
    """Steps of each chain that set the length of its steps, and are no draws."""
    largest_r_hat: float = 1.01
    """R-hat of draws that have converged (Vehtari et al., 2021)."""
    least_ess: float = 400.0
    """Effective sample size of draws that have converged (the same)."""


POSTERIOR = PosteriorSettings()


@dataclass(frozen=True)
class DensityAt:
    """The log posterior density at one u (G,), its slope (G,), and the log-likelihood."""

    value: float
    slope: Array
    likelihood: LogLikelihood


@dataclass(frozen=True, eq=False)
class RealLine:
    """The posterior of the hyperparameters `moving` (G,) as a density of u on the real line.

    `objective` is the honest log-likelihood with the log prior, minus infinity where the data are
    impossible; the others are as in `alpha` (K,). Constant factors are left out.
    """

    objective: Scored
    hyperparameters: Sequence[Hyperparameter]
    alpha: Array
    moving: Indices
    settings: PosteriorSettings = POSTERIOR

    def __call__(self, u: Array) -> DensityAt:
        """Value and slope at u (G,); a slope of zero where the value is no number."""
        with np.errstate(all="ignore"):
            found = self.objective(self.alpha_of(u))
            slope = found.score[self.moving] * self._rate(u) + (1.0 - 2.0 * special.expit(u))
            value = found.total + float(np.sum(special.log_expit(u) + special.log_expit(-u)))
        if np.isfinite(value) and np.all(np.isfinite(slope)):
            return DensityAt(value, slope, found)
        return DensityAt(-np.inf, np.zeros(u.size), found)

    def alpha_of(self, u: Array) -> Array:
        """The alpha (K,) of u (G,)."""
        alpha = self.alpha.copy()
        low, high = self._limits
        alpha[self.moving] = low + (high - low) * special.expit(u)
        return alpha

    def u_of(self, alpha: Array) -> Array:
        """The u (G,) of alpha (K,); one on a limit is moved a thousandth of the width inside."""
        low, high = self._limits
        share = (alpha[self.moving] - low) / (high - low)
        return np.asarray(
            special.logit(np.clip(share, self.settings.farthest, 1.0 - self.settings.farthest))
        )

    def _rate(self, u: Array) -> Array:
        low, high = self._limits
        return np.asarray((high - low) * special.expit(u) * special.expit(-u))

    @property
    def _limits(self) -> tuple[Array, Array]:
        return limits_of(self.hyperparameters, self.moving)


@dataclass(frozen=True)
class NormalScale:
    """The normal approximation of the posterior: u = center + factor z with z about N(0, I)."""

    center: Array
    factor: Array


def scaled(
    density: Callable[[Array], DensityAt], start: Array, settings: PosteriorSettings = POSTERIOR
) -> NormalScale:
    """The mode of the density of u next to `start` (G,), and a factor of its covariance there.

    The curvature is that by differences of the slope: some 2 G evaluations after some tens to the
    mode, and 16 that see whether the density reaches as far.
    """

    def loss(u: Array) -> tuple[float, Array]:
        found = density(u)
        if not np.isfinite(found.value):
            return settings.impossible, found.slope
        return -found.value, -found.slope

    climbed = optimize.minimize(
        loss, start, jac=True, method="BFGS", options={"maxiter": settings.mode}
    )
    mode, anywhere = climbed.x, np.full(start.size, np.inf)
    curvature = DIFFERENCES.bends(
        lambda u: density(u).slope[None], mode, -anywhere, anywhere, 1.0 / np.diag(climbed.hess_inv)
    )[:, 0]
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    return _within(
        density, NormalScale(mode, vectors / np.sqrt(np.maximum(values, settings.least))), settings
    )


def _within(
    density: Callable[[Array], DensityAt], scale: NormalScale, settings: PosteriorSettings
) -> NormalScale:
    """The scale, shrunk until half of its points have a density: it may end abruptly."""
    z = np.random.default_rng(0).standard_normal((settings.tried, scale.center.size))
    for _ in range(settings.shrunk):
        inside = [np.isfinite(density(scale.center + scale.factor @ one).value) for one in z]
        if np.mean(inside) >= 0.5:
            break
        scale = NormalScale(scale.center, settings.smaller * scale.factor)
    return scale


SAMPLER = "mici"


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws u (C, D, G) of C chains of D, with values that belong to each.

    `likelihood`, `prior` (C, D) are the log-likelihood and the log prior there, and `each`
    (C, D, N) that of every experiment; `divergent` (C, D) whether its trajectory broke off, `steps`
    and `accepted` (C, D) its length and the share of it that was acceptable.
    """

    u: Array
    value: Array
    likelihood: Array
    prior: Array
    each: Array
    divergent: Flags
    steps: Indices
    accepted: Array
    evaluations: int


def sampled(
    density: Callable[[Array], DensityAt],
    scale: NormalScale,
    draws: int,
    chains: int,
    seed: int,
    told: Callable[[int, int], None],
    settings: PosteriorSettings = POSTERIOR,
) -> Chains:
    """Chains of draws of a density of u; `told` is called with each step and their number.

    Each chain has a stream of random numbers of its own. Cost: some five evaluations a draw.
    Raises AleatorError where the package is missing, and where a chain finds no place to begin.
    """
    streams = np.random.SeedSequence(seed).spawn(chains)
    total = chains * (settings.warm_up + draws)
    found = []
    for c, stream in enumerate(streams):
        done = c * (settings.warm_up + draws)
        counted = partial(lambda begun, steps: told(begun + steps, total), done)
        chain = _Chain(density, scale, counted, settings)
        found.append(chain.run(np.random.default_rng(stream), draws))
    parts = {key: np.stack([one[key] for one in found]) for key in found[0] if key != "evaluations"}
    return Chains(**parts, evaluations=sum(one["evaluations"] for one in found))


class _Chain:
    """One chain in z, u = center + factor z, that remembers values along its trajectory."""

    def __init__(
        self,
        density: Callable[[Array], DensityAt],
        scale: NormalScale,
        told: Callable[[int], None],
        settings: PosteriorSettings,
    ) -> None:
        self.settings = settings
        self._density, self._scale, self._told = density, scale, told
        self._known: dict[bytes, DensityAt] = {}
        # what is traced is asked for once before the first step
        self._steps, self._evaluations = -1, 0

    def run(self, rng: np.random.Generator, draws: int) -> dict[str, Any]:
        """The draws after the warm-up, by the names of the fields of `Chains`."""
        mici = installed(SAMPLER)

        # plain functions: a bound method would be copied, with all that this remembers
        def loss(z: Array) -> float:
            return -self._at(z).value

        def slope(z: Array) -> tuple[Array, float]:
            found = self._at(z)
            return -(self._scale.factor.T @ found.slope), -found.value

        system = mici.systems.EuclideanMetricSystem(loss, grad_neg_log_dens=slope)
        sampler = mici.samplers.DynamicMultinomialHMC(
            system,
            mici.integrators.LeapfrogIntegrator(system),
            rng,
            max_tree_depth=self.settings.deepest,
        )
        with np.errstate(all="ignore"), _quiet():
            out = sampler.sample_chains(
                self.settings.warm_up,
                draws,
                [self._begin(rng)],
                trace_funcs=[self._traced],
                trace_warm_up=True,
                adapters=[mici.adapters.DualAveragingStepSizeAdapter(self.settings.target)],
                display_progress=False,
                monitor_stats=None,
            )
        if self._steps < self.settings.warm_up + draws:
            # the package returns what it has when it is interrupted
            raise KeyboardInterrupt
        kept = {
            name: np.asarray(values[0][self.settings.warm_up :])
            for name, values in (out.traces | out.statistics).items()
        }
        return {
            **{name: kept[name] for name in out.traces},
            "divergent": kept["diverging"].astype(bool),
            "steps": kept["n_step"],
            "accepted": kept["accept_stat"],
            "evaluations": self._evaluations,
        }

    def _begin(self, rng: np.random.Generator) -> Array:
        for _ in range(self.settings.tries):
            z = rng.standard_normal(self._scale.center.size)
            if np.isfinite(self._at(z).value):
                return z
        raise AleatorError(
            f"at none of {self.settings.tries} places about its mode the posterior has a density",
            "see the warnings of the identification, and widen the limits of the law or add noise",
        )

    def _at(self, z: Array) -> DensityAt:
        key = z.tobytes()
        found = self._known.get(key)
        if found is None:
            found = self._density(self._scale.center + self._scale.factor @ z)
            self._evaluations += 1
            self._known[key] = found
        return found

    def _traced(self, state: Any) -> dict[str, Any]:
        """What is stored of a draw; the values along the trajectory are forgotten."""
        z = np.asarray(state.pos)
        found = self._at(z)
        self._known = {z.tobytes(): found}
        self._steps += 1
        if self._steps:
            self._told(self._steps)
        return {
            "u": self._scale.center + self._scale.factor @ z,
            "value": found.value,
            "likelihood": found.likelihood.likelihood,
            "prior": found.likelihood.prior,
            "each": found.likelihood.each,
        }


def installed(package: str) -> Any:
    """A package that a posterior needs; raises AleatorError where it is not installed."""
    try:
        return import_module(package)
    except ImportError:
        raise AleatorError(
            f"a posterior needs the package {package}, which is not installed",
            installing("bayes"),
        ) from None


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the sampler's own message on an interruption."""
    log = logging.getLogger("mici.samplers")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


@dataclass(frozen=True, eq=False)
class Convergence:
    """Of G quantities: rank-normalized split R-hat (G,), and effective sample sizes (G,).

    `bulk` is that of the middle of the posterior, `tail` the smaller of those of the quantiles of
    5 % and 95 %.
    """

    r_hat: Array
    bulk: Array
    tail: Array
    settings: PosteriorSettings = POSTERIOR

    @property
    def converged(self) -> bool:
        """Whether every R-hat is below 1.01 and every effective sample size above 400."""
        return bool(
            np.all(self.r_hat < self.settings.largest_r_hat)
            and self.least > self.settings.least_ess
        )

    @property
    def least(self) -> float:
        """The smallest effective sample size; zero where one is not known."""
        return float(np.min(np.nan_to_num(np.concatenate([self.bulk, self.tail]))))


def convergence(draws: Array, settings: PosteriorSettings = POSTERIOR) -> Convergence:
    """R-hat and effective sample sizes of draws (C, D, G) of C chains, by ArviZ.

    Raises AleatorError where ArviZ is not installed.
    """
    stats = installed("arviz_stats")
    axes = {"chain_axis": 0, "draw_axis": 1}
    return Convergence(
        np.asarray(stats.rhat(draws, **axes)),
        np.asarray(stats.ess(draws, method="bulk", **axes)),
        np.asarray(stats.ess(draws, method="tail", prob=settings.tails, **axes)),
    )
