"""Nodes that are held as parameters: what the simulator says there is known, the law moves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from aleator.likelihood.individual.layout import Block
from aleator.types import Array, Flags, Indices

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs
    from aleator.laws.law import Law
    from aleator.likelihood.individual.predictor import Predictor

STEP = 1e-5
"""Step of differences over a hyperparameter, or over a thousandth of its range if that is more."""
LEAST = 1e-3
QUARTERS = np.array([0.25, 0.5, 0.75])
SHIFTED = 1.0
"""Distance between quartiles by which a law may have moved for nodes to serve."""
NARROWER, WIDER = 0.4, 2.0
"""Share of its width that it, or the noise, may have become: nodes end where a law did."""
TIED = 0.2
"""What a correlation may have changed by."""
POINTS, BIASED = 100, 0.2
"""Points by which the mean of a score is seen, and its share of their size that is too much."""
COUNTED = 1e-8
"""Share of an integral that a node has at least, to count in its score."""
MOST = 4_000_000
"""Simulated values that are kept."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters x (T, n) at the nodes that have a weight, and simulated values eta (M, J) there.

    int p(y | eta(x)) p(x | alpha) dx = sum_j w_j p(y | eta_j) p(x_j | alpha)/p(x_j | alpha0), where
    w_j are the weights of nodes that were adapted to alpha0. It is smooth in alpha whatever the
    simulator is: with a kink or a jump, the same nodes held as variates are not, and their scores
    leave out what moves across it. `alpha` is alpha0, `there` (N, J) tells which nodes have a
    weight, and `log_weight` (T,) is log w_j/p(x_j | alpha0) of these, experiment by experiment.
    It holds for `inputs` and `predictor` only, and for laws whose support does not move.
    """

    inputs: Inputs
    predictor: Predictor
    alpha: Array
    there: Flags
    x: Array
    log_weight: Array
    eta: Array

    def distance(self, alpha: Array) -> float:
        """How far alpha is from that of the nodes: up to one, they serve there."""
        return distance(self.inputs, self.alpha, alpha)

    def log_weights(self, alpha: Array, block: Block) -> Array:
        """log w_j p(x_j | alpha)/p(x_j | alpha0) (B, J) of a block; -inf where there is no node."""
        there, own = self._of(block)
        found = np.full(there.shape, -np.inf)
        with np.errstate(invalid="ignore"):
            known = self.log_weight[own] + scattered_density(self.inputs, alpha, self.x[own])
        found[there] = np.where(np.isnan(known), -np.inf, known)
        return found

    def scores(self, alpha: Array, block: Block, share: Array) -> Array:
        """sum_j share_j d log p(x_j | alpha)/d alpha (B, K) of a block."""
        there, own = self._of(block)
        counted = share[there] > COUNTED
        owner = np.nonzero(there)[0][counted]
        x, shares = self.x[own][counted], share[there][counted]
        return _scores_of(self.inputs, alpha, x, shares, owner, len(there))

    def _of(self, block: Block) -> tuple[Flags, slice]:
        """Which nodes (B, J) of a block there are, and where they stand among all (T,)."""
        part, ends = block.experiments, self._ends
        return self.there[part], slice(int(ends[part.start]), int(ends[part.stop]))

    @cached_property
    def _ends(self) -> Indices:
        """How many nodes (N + 1,) come before each experiment."""
        return np.concatenate([[0], np.cumsum(self.there.sum(axis=1))])


def distance(inputs: Inputs, alpha: Array, other: Array) -> float:
    """How far another alpha is from this one: up to one, nodes that are held serve there too."""
    size = inputs.size
    here, there = (_quartiles(inputs, tuple(values[:size].tolist())) for values in (alpha, other))
    width, wider = here[:, 2] - here[:, 0], there[:, 2] - there[:, 0]
    shifted = np.abs(there[:, 1] - here[:, 1]) / (SHIFTED * width)
    ties = np.abs(other - alpha)[inputs.partials] / TIED
    grown = [_grown(width, wider), _grown(alpha[size:], other[size:])]
    return float(np.max(np.concatenate([shifted, ties, *grown]), initial=0.0))


def holds(inputs: Inputs, values: int) -> bool:
    """Whether so many simulated values can be held so under these laws."""
    return (
        values <= MOST
        and len(inputs.classes) == 1
        and inputs.covariate_model is None
        and not moving(inputs)
    )


@lru_cache(maxsize=16)
def moving(inputs: Inputs) -> tuple[int, ...]:
    """The free hyperparameters with which parameters x move, and not only their density.

    The values of constants, and what laws have whose support moves: there the score has another
    mean than zero, at the start of the hyperparameters by a hundred points of equal probability.
    """
    own, start = inputs.hyperparameters, np.array([h.start for h in inputs.hyperparameters])
    found = list[int]()
    for i, (law, part) in enumerate(zip(inputs.laws.values(), inputs.slices, strict=True)):
        if i not in inputs.scattered or not _fixed_support(law, start[part]):
            found += [k for k in range(part.start, part.stop) if own[k].free]
    return tuple(found)


def _fixed_support(law: Law, values: Array) -> bool:
    x = law.quantile(values, (np.arange(POINTS) + 0.5) / POINTS)
    for k, (value, h) in enumerate(zip(values, law.hyperparameters, strict=True)):
        step = STEP * (max(abs(value), LEAST * (h.upper - h.lower)) or LEAST)
        up, down = (law.log_density(_moved(values, k, by), x) for by in (step, -step))
        score = (up - down) / (2.0 * step)
        if not abs(np.mean(score)) <= BIASED * np.sqrt(np.mean(score**2)):
            return False
    return True


def densities(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """log p(x | alpha) (B, J) at x (B, J, n), of parameters that scatter."""
    flat = x.reshape(-1, x.shape[2])
    return scattered_density(inputs, alpha, flat).reshape(x.shape[:2])


def scattered_density(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """The same (J,) at x (J, n)."""
    return inputs.log_density_of(inputs.scattered, alpha, x, inputs.normal_scores(alpha, x))


def law_scores(inputs: Inputs, alpha: Array, x: Array, share: Array) -> Array:
    """sum_j share_j d log p(x_j | alpha)/d alpha (B, K) at x (B, J, n)."""
    there = share > COUNTED
    return _scores_of(inputs, alpha, x[there], share[there], np.nonzero(there)[0], len(x))


def _scores_of(
    inputs: Inputs, alpha: Array, x: Array, share: Array, owner: Indices, count: int
) -> Array:
    """The same (B, K) by central differences at x (T, n), whose owners (T,) count B."""
    found, scores = np.zeros((count, inputs.size)), inputs.normal_scores(alpha, x)
    for k, h in enumerate(inputs.hyperparameters):
        if h.free:
            step = STEP * max(abs(alpha[k]), LEAST * (h.upper - h.lower))
            up, down = (
                _changed_density(inputs, _moved(alpha, k, by), x, k, scores) for by in (step, -step)
            )
            slope = (up - down) / (2.0 * step)
            found[:, k] = np.bincount(owner, share * slope, minlength=count)
    return found


def _changed_density(inputs: Inputs, alpha: Array, x: Array, k: int, scores: Array) -> Array:
    """The part (J,) of log p(x | alpha) that alpha_k changes.

    Given the normal scores (m, J) at another alpha_k: only those of its own law are others here.
    """
    own = [i for i in inputs.scattered if inputs.slices[i].start <= k < inputs.slices[i].stop]
    theta = scores.copy()
    for i in own:
        if i in inputs.correlated:
            theta[inputs.correlated.index(i)] = inputs.normal_score(i, alpha, x)
    return inputs.log_density_of(own, alpha, x, theta)


@lru_cache(maxsize=64)
def _quartiles(inputs: Inputs, alpha: tuple[float, ...]) -> Array:
    """Quartiles and median (s, 3) of each law that scatters."""
    laws, values = list(inputs.laws.values()), np.array(alpha)
    own = [laws[i].quantile(values[inputs.slices[i]], QUARTERS) for i in inputs.scattered]
    return np.array(own)


def _grown(before: Array, after: Array) -> Array:
    """How far widths have changed; values that are not positive only serve themselves."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(after / before)
        scaled = np.where(ratio > 0.0, ratio / np.log(WIDER), ratio / np.log(NARROWER))
    return np.where(before == after, 0.0, np.nan_to_num(scaled, nan=np.inf))


def _moved(alpha: Array, k: int, by: float) -> Array:
    found = alpha.copy()
    found[k] += by
    return found
