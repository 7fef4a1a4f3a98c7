"""Nodes that are held as parameters: what the simulator says there is known, the law moves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from aleator.likelihood.individual.layout import Block
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs
    from aleator.likelihood.individual.predictor import Predictor

STEP = 1e-5
"""Step of differences over a hyperparameter, or over a thousandth of its range if that is more."""
LEAST = 1e-3
QUARTERS = np.array([0.25, 0.5, 0.75])
NEAR = 0.2
"""Laws that move by less than this share of their width, and noise by less of itself, are near."""
POINTS, BIASED = 100, 0.2
"""Points by which the mean of a score is seen, and its share of their size that is too much."""
MOST = 4_000_000
"""Simulated values that are kept."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters x (N, J, n) at the nodes, simulated values eta (M, J) there, and log densities.

    int p(y | eta(x)) p(x | alpha) dx = sum_j w_j p(y | eta_j) p(x_j | alpha)/p(x_j | alpha0), where
    w_j are the weights of nodes that were adapted to alpha0. It is smooth in alpha whatever the
    simulator is: with a kink or a jump, the same nodes held as variates are not, and their scores
    leave out what moves across it. `alpha` is alpha0, and `log_density` (N, J) is that of x under
    it. It holds for `inputs` and `predictor` only, and for laws whose support does not move.
    """

    inputs: Inputs
    predictor: Predictor
    alpha: Array
    x: Array
    eta: Array
    log_density: Array

    def near(self, alpha: Array) -> bool:
        """Whether nodes that are adapted to `self.alpha` serve at another alpha."""
        size = self.inputs.size
        here, there = (_quartiles(self.inputs, values[:size]) for values in (self.alpha, alpha))
        width = here[:, 2] - here[:, 0]
        laws = bool(np.all(np.abs(there - here) <= NEAR * width[:, None]))
        ties = np.abs(alpha - self.alpha)[self.inputs.partials]
        errors = np.abs(alpha - self.alpha)[size:] <= NEAR * np.abs(self.alpha[size:])
        return laws and bool(np.all(ties <= NEAR) and np.all(errors))

    def change(self, alpha: Array, block: Block) -> Array:
        """log p(x | alpha)/p(x | alpha0) (B, J) of a block."""
        part = block.experiments
        density = densities(self.inputs, alpha, self.x[part])
        with np.errstate(invalid="ignore"):
            found = density - self.log_density[part]
        return np.where(np.isnan(found), -np.inf, found)

    def scores(self, alpha: Array, block: Block, share: Array) -> Array:
        """sum_j share_j d log p(x_j | alpha)/d alpha (B, K) of a block."""
        return law_scores(self.inputs, alpha, self.x[block.experiments], share)


def holds(inputs: Inputs, values: int) -> bool:
    """Whether so many simulated values can be held so under these laws."""
    return (
        values <= MOST
        and len(inputs.classes) == 1
        and inputs.covariate_model is None
        and not _moves_constants(inputs)
        and regular(inputs)
    )


def _moves_constants(inputs: Inputs) -> bool:
    """Whether a parameter that does not scatter is identified: what is simulated moves with it."""
    own, scattered = inputs.hyperparameters, set(inputs.scattered)
    constant = [part for i, part in enumerate(inputs.slices) if i not in scattered]
    return any(h.free for part in constant for h in own[part])


@lru_cache(maxsize=16)
def regular(inputs: Inputs) -> bool:
    """Whether the score of each law has the mean zero: its support does not move.

    At the start of its hyperparameters, by a hundred points of equal probability.
    """
    start = np.array([h.start for h in inputs.hyperparameters])
    probability = (np.arange(POINTS) + 0.5) / POINTS
    for i in inputs.scattered:
        law, values = list(inputs.laws.values())[i], start[inputs.slices[i]]
        x = law.quantile(values, probability)
        for k, value in enumerate(values):
            step = STEP * max(abs(value), LEAST)
            up, down = (law.log_density(_moved(values, k, by), x) for by in (step, -step))
            score = (up - down) / (2.0 * step)
            if not abs(np.mean(score)) <= BIASED * np.sqrt(np.mean(score**2)):
                return False
    return True


def densities(inputs: Inputs, alpha: Array, x: Array, only: int | None = None) -> Array:
    """log p(x | alpha) (B, J), of parameters that scatter; or its part that alpha_k changes."""
    flat = x.reshape(-1, x.shape[2])
    return inputs.scattered_log_density(alpha, flat, only).reshape(x.shape[:2])


def law_scores(inputs: Inputs, alpha: Array, x: Array, share: Array) -> Array:
    """sum_j share_j d log p(x_j | alpha)/d alpha (B, K) at x (B, J, n), by central differences."""
    found = np.zeros((len(x), inputs.size))
    for k, h in enumerate(inputs.hyperparameters):
        if h.free:
            step = STEP * max(abs(alpha[k]), LEAST * (h.upper - h.lower))
            ends = [densities(inputs, _moved(alpha, k, by), x, k) for by in (step, -step)]
            with np.errstate(invalid="ignore"):
                slope = (ends[0] - ends[1]) / (2.0 * step)
            found[:, k] = np.sum(share * np.where(share > 0.0, slope, 0.0), axis=1)
    return found


def _quartiles(inputs: Inputs, alpha: Array) -> Array:
    """Quartiles and median (s, 3) of each law that scatters."""
    laws = list(inputs.laws.values())
    own = [laws[i].quantile(alpha[inputs.slices[i]], QUARTERS) for i in inputs.scattered]
    return np.array(own)


def _moved(alpha: Array, k: int, by: float) -> Array:
    found = alpha.copy()
    found[k] += by
    return found
