"""Markov chains by the No-U-Turn sampler: the one place that knows the package that makes them.

Hoffman and Gelman (2014), with multinomial draws from each trajectory (Betancourt, 2017), in the
package Mici: it takes any function with its slope, and needs no compiler.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from aleator.errors import AleatorError, installing
from aleator.inference.posterior import Asked, Scale
from aleator.types import Array, Flags, Indices

SAMPLER = "mici"
WARM_UP = 100
"""Steps of each chain that set the length of its steps, and are no draws."""
TARGET = 0.85
"""Share of proposals that is to be accepted."""
DEEPEST = 5
"""Times that a trajectory is doubled, at most: the density has been scaled to about N(0, I)."""
TRIES = 50
"""Points that a chain may try to begin at."""


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws u (C, D, G) of C chains of D, with what is told of each.

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
    density: Callable[[Array], Asked],
    scale: Scale,
    draws: int,
    chains: int,
    seed: int,
    told: Callable[[int, int], None],
) -> Chains:
    """So many chains of draws of a density of u; `told` hears of each step, and of how many.

    Each chain has a stream of random numbers of its own. Cost: some five evaluations a draw.
    Raises AleatorError where the package is missing, and where a chain finds no place to begin.
    """
    streams = np.random.SeedSequence(seed).spawn(chains)
    total = chains * (WARM_UP + draws)
    found = []
    for c, stream in enumerate(streams):
        done = c * (WARM_UP + draws)
        chain = _Chain(density, scale, partial(_counted, told, done, total))
        found.append(chain.run(np.random.default_rng(stream), draws))
    parts = {key: np.stack([one[key] for one in found]) for key in found[0] if key != "evaluations"}
    return Chains(**parts, evaluations=sum(one["evaluations"] for one in found))


def _counted(told: Callable[[int, int], None], done: int, total: int, steps: int) -> None:
    told(done + steps, total)


class _Chain:
    """One chain in z, u = center + factor z, that remembers what it asked in its trajectory."""

    def __init__(
        self, density: Callable[[Array], Asked], scale: Scale, told: Callable[[int], None]
    ) -> None:
        self._density, self._scale, self._told = density, scale, told
        self._known: dict[bytes, Asked] = {}
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
            max_tree_depth=DEEPEST,
        )
        with np.errstate(all="ignore"), _quiet():
            out = sampler.sample_chains(
                WARM_UP,
                draws,
                [self._begin(rng)],
                trace_funcs=[self._traced],
                trace_warm_up=True,
                adapters=[mici.adapters.DualAveragingStepSizeAdapter(TARGET)],
                display_progress=False,
                monitor_stats=None,
            )
        if self._steps < WARM_UP + draws:
            # the package returns what it has when it is interrupted
            raise KeyboardInterrupt
        kept = {name: np.asarray(values[0][WARM_UP:]) for name, values in out.traces.items()}
        told = {name: np.asarray(values[0][WARM_UP:]) for name, values in out.statistics.items()}
        return {
            **kept,
            "divergent": told["diverging"].astype(bool),
            "steps": told["n_step"],
            "accepted": told["accept_stat"],
            "evaluations": self._evaluations,
        }

    def _begin(self, rng: np.random.Generator) -> Array:
        for _ in range(TRIES):
            z = rng.standard_normal(self._scale.center.size)
            if np.isfinite(self._at(z).value):
                return z
        raise AleatorError(
            f"at none of {TRIES} places about its mode the posterior has a density",
            "see the warnings of the identification, and widen the limits of the law or add noise",
        )

    def _at(self, z: Array) -> Asked:
        key = z.tobytes()
        found = self._known.get(key)
        if found is None:
            found = self._density(self._scale.center + self._scale.factor @ z)
            self._evaluations += 1
            self._known[key] = found
        return found

    def _traced(self, state: Any) -> dict[str, Any]:
        """What is kept of a draw; the trajectory that led there is forgotten."""
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
    """No word of the package's own on an interruption, which is told by whoever asked."""
    log = logging.getLogger("mici.samplers")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before
