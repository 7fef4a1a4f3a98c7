"""The posterior density of alpha, its Markov chains, and whether these have converged.

The posterior density p(alpha | y) is proportional to L(alpha) p(alpha) between the limits. Each
hyperparameter v with limits a and b is transformed to the real line, where a sampler meets no
limits: v = a + (b - a) / (1 + exp(-u)). The density of u has the factor dv/du (the Jacobian).
Chains are made by the No-U-Turn sampler of Hoffman and Gelman (2014), with multinomial draws from
each trajectory (Betancourt, 2017), in the package Mici. This package takes any function with its
gradient, and needs no compiler.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    """Settings of the posterior's scale, sampler and convergence, by judgement or a named paper."""

    farthest: float = 1e-3
    """Least distance from a limit at which the search for the mode begins, as a share of the range.
    """
    least: float = 0.05
    """Least curvature of the density of u: that of a density determined by the limits alone."""
    tried: int = 16
    """Number of points by which it is tested whether the normal approximation is too wide."""
    shrunk: int = 12
    """Largest number of times that the normal approximation is made narrower."""
    smaller: float = 0.6
    """Factor by which the normal approximation is made narrower."""
    impossible: float = 1e300
    """Value that replaces minus the log-density in the search for the mode where the density is
    zero.
    """
    mode: int = 50
    """Largest number of steps of the search for the mode."""
    target: float = 0.85
    """Target share of accepted proposals of the sampler."""
    deepest: int = 5
    """Largest number of doublings of a trajectory; a small number is enough, since the density has
    been scaled to approximately N(0, I).
    """
    tries: int = 50
    """Largest number of points that are tried as the start of a chain."""
    tails: tuple[float, float] = (0.05, 0.95)
    """Probabilities of the quantiles for which the tail effective sample size is computed."""
    warm_up: int = 100
    """Number of first steps of each chain, which adjust the step size and are not used as draws."""
    piece: int = 50
    """Number of draws of a chain that are made, and kept, at a time: an interruption loses no more.
    """
    largest_r_hat: float = 1.01
    """Largest R-hat of draws that count as converged (Vehtari et al., 2021)."""
    least_ess: float = 400.0
    """Least effective sample size of draws that count as converged (Vehtari et al., 2021)."""


POSTERIOR = PosteriorSettings()


@dataclass(frozen=True)
class DensityAt:
    """The log posterior density at one u (G,), its gradient (G,), and the log-likelihood."""

    value: float
    slope: Array
    likelihood: LogLikelihood


@dataclass(frozen=True, eq=False)
class RealLine:
    """The posterior of the hyperparameters `moving` (G,) as a density of u on the real line.

    `objective` is the log-likelihood plus the log prior, minus infinity where the data are
    impossible. The other hyperparameters keep their values in `alpha` (K,). Constant factors are
    left out.
    """

    objective: Scored
    hyperparameters: Sequence[Hyperparameter]
    alpha: Array
    moving: Indices
    settings: PosteriorSettings = POSTERIOR

    def __call__(self, u: Array) -> DensityAt:
        """The log-density and its gradient at u (G,); -inf and zero where it is not finite."""
        with np.errstate(all="ignore"):
            found = self.objective(self.alpha_of(u))
            slope = found.score[self.moving] * self._rate(u) + (1.0 - 2.0 * special.expit(u))
            value = found.total + float(np.sum(special.log_expit(u) + special.log_expit(-u)))
        if np.isfinite(value) and np.all(np.isfinite(slope)):
            return DensityAt(value, slope, found)
        return DensityAt(-np.inf, np.zeros(u.size), found)

    def alpha_of(self, u: Array) -> Array:
        """The alpha (K,) that belongs to u (G,)."""
        alpha = self.alpha.copy()
        low, high = self._limits
        alpha[self.moving] = low + (high - low) * special.expit(u)
        return alpha

    def u_of(self, alpha: Array) -> Array:
        """The u (G,) that belongs to alpha (K,).

        A value on a limit is first moved inside by a thousandth of the range.
        """
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
    """The normal approximation of the posterior: u = center + factor z, with z about N(0, I)."""

    center: Array
    factor: Array


def scaled(
    density: Callable[[Array], DensityAt], start: Array, settings: PosteriorSettings = POSTERIOR
) -> NormalScale:
    """The normal approximation at the mode of the density of u near `start` (G,).

    The curvature is computed by differences of the gradient. Cost: some tens of evaluations to
    reach the mode, 2 G for the curvature, and 16 to test whether the approximation is too wide.
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
    """The approximation, narrowed until the density is positive at half of its points."""
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
    """Draws u (C, D, G) of C chains with D draws each, and the values that belong to each draw.

    `value` (C, D) is the log-density of u. `likelihood` and `prior` (C, D) are the log-likelihood
    and the log prior, and `each` (C, D, N) is the log-density of every experiment. `divergent` (C,
    D) says whether the trajectory diverged, `steps` (C, D) is its length, and `accepted` (C, D) its
    mean acceptance probability. `evaluations` is the total number of evaluations of the density.
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


@dataclass(frozen=True, eq=False)
class ChainPiece:
    """Some successive draws of chain number `chain`, and where the sampler stands after them.

    `drawn` has the fields of `Chains` by name. `z` (G,) is the last point, `step` the step size.
    """

    chain: int
    number: int
    drawn: dict[str, Array]
    z: Array
    step: float
    evaluations: int

    def line(self) -> dict[str, Any]:
        """The piece as plain lists and numbers, which `read` takes."""
        drawn = {name: values.tolist() for name, values in self.drawn.items()}
        return {**vars(self), "drawn": drawn, "z": self.z.tolist()}

    @classmethod
    def read(cls, line: Mapping[str, Any]) -> ChainPiece:
        """The piece that `line` describes."""
        kinds = {"divergent": bool, "steps": np.intp}
        drawn = {k: np.array(v, dtype=kinds.get(k, float)) for k, v in line["drawn"].items()}
        return cls(**{**line, "drawn": drawn, "z": np.array(line["z"], dtype=float)})


def sampled(
    density: Callable[[Array], DensityAt],
    scale: NormalScale,
    draws: int,
    chains: int,
    seed: int,
    told: Callable[[int, int], None],
    known: Sequence[ChainPiece] = (),
    finished: Callable[[ChainPiece], None] = lambda _: None,
    settings: PosteriorSettings = POSTERIOR,
) -> Chains:
    """Markov chains of draws from a density of u.

    A chain is made in pieces, each with its own stream of random numbers. Each piece is handed to
    `finished`; those `known` from an earlier call are not made again, and the draws are the same.
    After each step `told` is called with the number of steps so far and the total number. Cost:
    about five evaluations for each draw. Raises AleatorError where the package is missing, and
    where a chain finds no starting point.
    """
    total = chains * (settings.warm_up + draws)
    before = {(piece.chain, piece.number): piece for piece in known}
    every, evaluations = [], 0
    for c in range(chains):
        parts, last = list[dict[str, Array]](), None
        for number, first in enumerate(range(0, draws, settings.piece)):
            count = min(settings.piece, draws - first)
            piece = before.get((c, number))
            if piece is None or len(piece.drawn["value"]) < count:
                done = c * (settings.warm_up + draws) + first + (settings.warm_up if first else 0)
                counted = partial(lambda begun, steps: told(begun + steps, total), done)
                stream = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(c, number)))
                chain = _Chain(density, scale, counted, settings)
                piece = chain.piece(stream, count, last, c, number)
                finished(piece)
            last, evaluations = piece, evaluations + piece.evaluations
            parts.append({name: values[:count] for name, values in piece.drawn.items()})
        every.append({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    joined: dict[str, Any] = {name: np.stack([one[name] for one in every]) for name in every[0]}
    return Chains(**joined, evaluations=evaluations)


class _Chain:
    """A piece of a Markov chain in z, where u = center + factor z; it stores values on its way."""

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
        # The sampler asks for the traced values once before the first step.
        self._steps, self._evaluations = -1, 0

    def piece(
        self, rng: np.random.Generator, draws: int, last: ChainPiece | None, chain: int, number: int
    ) -> ChainPiece:
        """The next draws of a chain after its `last` piece; the first ones follow a warm-up."""
        mici = installed(SAMPLER)

        # These are plain functions: a bound method would be copied with all the stored values.
        def loss(z: Array) -> float:
            return -self._at(z).value

        def slope(z: Array) -> tuple[Array, float]:
            found = self._at(z)
            return -(self._scale.factor.T @ found.slope), -found.value

        system = mici.systems.EuclideanMetricSystem(loss, grad_neg_log_dens=slope)
        integrator = mici.integrators.LeapfrogIntegrator(system, last and last.step)
        warm_up = 0 if last else self.settings.warm_up
        adapter = mici.adapters.DualAveragingStepSizeAdapter(self.settings.target)
        sampler = mici.samplers.DynamicMultinomialHMC(
            system,
            integrator,
            rng,
            max_tree_depth=self.settings.deepest,
        )
        with np.errstate(all="ignore"), _quiet():
            out = sampler.sample_chains(
                warm_up,
                draws,
                [last.z if last else self._begin(rng)],
                trace_funcs=[self._traced],
                trace_warm_up=True,
                adapters=[] if last else [adapter],
                display_progress=False,
                monitor_stats=None,
            )
        if self._steps < warm_up + draws:
            # When the sampler is interrupted, it returns the draws that it has so far.
            raise KeyboardInterrupt
        kept = {
            name: np.asarray(values[0][warm_up:])
            for name, values in (out.traces | out.statistics).items()
        }
        drawn = {
            **{name: kept[name] for name in out.traces},
            "divergent": kept["diverging"].astype(bool),
            "steps": kept["n_step"],
            "accepted": kept["accept_stat"],
        }
        z, step = (
            np.asarray(out.final_states[0].pos),
            float(sampler.transitions["integration_transition"].integrator.step_size),
        )
        return ChainPiece(chain, number, drawn, z, step, self._evaluations)

    @staticmethod
    def _step_of(sampler: Any) -> float:
        return float(sampler.transitions["integration_transition"].integrator.step_size)

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
        """The stored values of one draw; the values along the trajectory are deleted."""
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
    """Suppress the sampler's own message on an interruption."""
    log = logging.getLogger("mici.samplers")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


@dataclass(frozen=True, eq=False)
class Convergence:
    """Convergence of G quantities: rank-normalized split R-hat and effective sample sizes (G,).

    `bulk` is the effective sample size for the middle of the posterior, and `tail` the smaller of
    those for the quantiles of 5 % and 95 %.
    """

    r_hat: Array
    bulk: Array
    tail: Array
    settings: PosteriorSettings = POSTERIOR

    @property
    def converged(self) -> bool:
        """Whether every R-hat is below 1.01 and every effective sample size above 400."""
        return self.mixed and self.enough

    @property
    def mixed(self) -> bool:
        """Whether every R-hat is below 1.01: the chains agree."""
        return bool(np.all(self.r_hat < self.settings.largest_r_hat))

    @property
    def enough(self) -> bool:
        """Whether every effective sample size is above 400."""
        return self.least > self.settings.least_ess

    @property
    def least(self) -> float:
        """The smallest effective sample size; zero where one is unknown."""
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
