"""What the experiments and the priors say of alpha: draws from its posterior, without runs."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from aleator.errors import InputsError
from aleator.inference.chains import SAMPLER, installed, sampled
from aleator.inference.convergence import convergence
from aleator.inference.fit import Fit
from aleator.inference.posterior import RealLine, scaled
from aleator.laws import classes
from aleator.laws.individual import drawn
from aleator.progress import Progress, Silent
from aleator.tasks.results.identification import Identification
from aleator.tasks.results.posterior import Posterior
from aleator.types import Array

LOOKED_AT = 16
"""Draws at which more nodes are tried, and whose laws are held against the region."""
FEWEST = 10
SHOWN = 0.2
"""Seconds between two words to the progress."""


def posterior(
    found: Identification,
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    progress: Progress | None = None,
) -> Posterior:
    """Draws from the posterior p(alpha | y) ~ L(alpha) p(alpha) of an identification.

    L is the likelihood, minus infinity where an outcome is impossible, and p(alpha)
    the product of the priors, flat between the limits where a hyperparameter has none. `chains` (at
    least two) of so many `draws` are made by the No-U-Turn sampler with the exact score, about the
    mode; the same seed gives the same draws. Raises AleatorError where the extra `bayes` is not
    installed or the identification was read from a file, InputsError where nothing is identified.
    Cost: some three to seven evaluations of the likelihood a draw, no run of a slow simulator.

    >>> import pandas as pd
    >>> from aleator import Free, Inputs, MonteCarlo, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.0, 2.0, prior=Normal(1.2, 0.1)), sd=0.1)})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  vectorized=True, verification=MonteCarlo(0))
    >>> drawn = posterior(found, draws=50, chains=2)
    >>> bool(abs(drawn.table().loc["x.mean", "mean"] - found.values["x.mean"]) < 0.05)
    True
    """
    for package in (SAMPLER, "arviz_stats"):
        installed(package)
    _require(draws, chains)
    fit, began = found.fit, time.perf_counter()
    moving = fit.inference.identified
    if not moving.size:
        raise InputsError(
            "nothing is identified: every hyperparameter is a number",
            "give one limits: Free(lower, upper), {lower = ..., upper = ...}",
        )
    told = progress or Silent()
    told.stage("posterior")
    density = RealLine(fit.honest(), fit.hyperparameters, fit.alpha, moving)
    scale = scaled(density, density.u_of(fit.alpha))
    made = sampled(density, scale, draws, chains, seed, _listener(told))
    alphas = np.array([[_in_order(density.alpha_of(u), fit) for u in chain] for chain in made.u])
    own = alphas[:, :, moving]
    few = alphas.reshape(-1, alphas.shape[2])
    few = few[np.linspace(0, len(few) - 1, LOOKED_AT).astype(np.intp)]
    names = [h.name for h in fit.hyperparameters]
    return Posterior(
        names=tuple(names[k] for k in moving),
        draws=own,
        chains=made,
        convergence=convergence(own),
        estimates=fit.alpha[moving],
        fixed={n: float(fit.alpha[k]) for k, n in enumerate(names) if k not in moving},
        priors=tuple(h.name for h in fit.hyperparameters if h.prior is not None),
        ids=tuple(fit.table.ids),
        outcome=found.outcome,
        seed=seed,
        seconds=time.perf_counter() - began,
        nodes_error=_nodes_error(fit, few),
        outside=_outside(fit, few, seed),
        sound=found.sound,
        consistent=found.consistent,
    )


def _require(draws: int, chains: int) -> None:
    if draws < FEWEST:
        raise InputsError(f"draws = {draws} are too few", f"take {FEWEST} at least, better 1000")
    if chains < 2:
        raise InputsError(f"chains = {chains}: R-hat compares chains", "take 2 at least, better 4")


def _listener(progress: Progress) -> Callable[[int, int], None]:
    last = [0.0]

    def tell(done: int, total: int) -> None:
        now = time.perf_counter()
        if now - last[0] > SHOWN or done == total:
            last[0] = now
            progress.update(f"step {done} of {total}", done, total)

    return tell


def _in_order(alpha: Array, fit: Fit) -> Array:
    """Equal components of a mixture in one order: which of them is the first is arbitrary."""
    size = fit.inputs.size
    return np.concatenate([classes.ordered(fit.inputs, alpha[:size]), alpha[size:]])


def _nodes_error(fit: Fit, alphas: Array) -> float:
    """The standard deviation over alphas (A, K) of what more nodes change of log L."""
    changes = np.array([fit.more_nodes(alpha) for alpha in alphas])
    return float(np.std(changes[np.isfinite(changes)])) if np.any(np.isfinite(changes)) else 0.0


def _outside(fit: Fit, alphas: Array, seed: int) -> float:
    """The share of the laws alphas (A, K) that lies where no simulated values are known."""
    rng = np.random.default_rng(seed)
    size, low, high = fit.inputs.size, *fit.region.T
    beyond = [
        np.any((x < low) | (x > high), axis=1)
        for x in (drawn(fit.inputs, alpha[:size], fit.count, rng) for alpha in alphas)
    ]
    return float(np.mean(beyond))
