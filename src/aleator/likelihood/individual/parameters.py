"""Nodes that are kept as parameters, and serve for the laws of every alpha that is not far."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.likelihood.individual.predictors import Block, Predictor

QUARTERS = np.array([1, 2, 3]) / 4.0
"""Probabilities of the quartiles."""


@dataclass(frozen=True)
class FollowingSettings:
    """For which laws nodes that are kept as parameters serve, and how many are kept; by judgement.

    Nodes serve while the median of each law moves by no more than the distance between its
    quartiles. `narrower` and `wider`: factors by which the width of a law, or the noise, may have
    changed; beyond the law of the nodes there are none. `tied`: by how much a correlation may have
    changed. `shorter`: factor by which a step of alpha beyond these is shortened. `kept_values`:
    simulated values that are kept with nodes. `kept_nodes`: nodes, kept as parameters, that an
    objective remembers. `resolution`: error of a log-likelihood over what its modes are exact to.

    Scores of laws: `step` is that of differences over a hyperparameter, or over the share
    `least_size` of its range if that is more. `points`: points by which the mean of a score is
    seen. `biased`: the mean, over the size of the scores, from which on the support of a law moves.
    `counted`: share of an integral that a node has at least, to count in its score.
    """

    narrower: float = 0.4
    wider: float = 2.0
    tied: float = 0.2
    shorter: float = 0.6
    kept_values: int = 4_000_000
    kept_nodes: int = 8_000_000
    resolution: float = 0.01
    step: float = 1e-5
    least_size: float = 1e-3
    points: int = 100
    biased: float = 0.2
    counted: float = 1e-8


FOLLOWING = FollowingSettings()


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters x (T, n) at the nodes that have a weight, and simulated values eta (M, J) there.

    int p(y | eta(x)) p(x | alpha) dx = sum_j w_j p(y | eta_j) p(x_j | alpha)/p(x_j | alpha0), where
    w_j are the weights of nodes that were adapted to alpha0. It is smooth in alpha whatever the
    simulator is: with a kink or a jump, the same nodes kept as variates are not, and their scores
    leave out what moves across it. `alpha` is alpha0, `there` (N, J) tells which nodes have a
    weight, and `log_weight` (T,) is log w_j/p(x_j | alpha0) of these, experiment by experiment. It
    holds for `inputs` and `predictor` only, and for laws whose support does not move.
    """

    inputs: Inputs
    predictor: Predictor
    alpha: Array
    there: Flags
    x: Array
    log_weight: Array
    eta: Array
    settings: FollowingSettings = FOLLOWING

    def distance(self, alpha: Array) -> float:
        """How far alpha is from that of the nodes; up to one, they serve there."""
        return distance(self.inputs, self.alpha, alpha, self.settings)

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
        counted = share[there] > self.settings.counted
        owner = np.nonzero(there)[0][counted]
        x, shares = self.x[own][counted], share[there][counted]
        return _scores_of(self.inputs, alpha, x, shares, owner, len(there), self.settings)

    def _of(self, block: Block) -> tuple[Flags, slice]:
        """Which nodes (B, J) of a block there are, and where they stand among all (T,)."""
        part, ends = block.experiments, self._ends
        return self.there[part], slice(int(ends[part.start]), int(ends[part.stop]))

    @cached_property
    def _ends(self) -> Indices:
        """How many nodes (N + 1,) come before each experiment."""
        return np.concatenate([[0], np.cumsum(self.there.sum(axis=1))])


def distance(
    inputs: Inputs, alpha: Array, other: Array, settings: FollowingSettings = FOLLOWING
) -> float:
    """A distance of two alphas; up to one, nodes that are adapted to the first serve for the
    second."""
    size = inputs.size
    here, there = (_quartiles(inputs, tuple(values[:size].tolist())) for values in (alpha, other))
    width, wider = here[:, 2] - here[:, 0], there[:, 2] - there[:, 0]
    shifted = np.abs(there[:, 1] - here[:, 1]) / width
    ties = np.abs(other - alpha)[inputs.partials] / settings.tied
    pairs = [(width, wider), (alpha[size:], other[size:])]
    grown = [_grown(before, after, settings) for before, after in pairs]
    return float(np.max(np.concatenate([shifted, ties, *grown]), initial=0.0))


def holds(inputs: Inputs, values: int, settings: FollowingSettings = FOLLOWING) -> bool:
    """Whether nodes with so many simulated values can be kept as parameters under these laws."""
    return (
        values <= settings.kept_values
        and len(inputs.classes) == 1
        and inputs.covariate_model is None
        and not moving(inputs, settings)
    )


@lru_cache
def moving(inputs: Inputs, settings: FollowingSettings = FOLLOWING) -> tuple[int, ...]:
    """The free hyperparameters that move the parameters x themselves, and not only their density.

    They are the values of constants, and all those of a law whose support moves. Its score has
    another mean than zero, which is seen at the start of the hyperparameters by a hundred points of
    equal probability.
    """
    own, start = inputs.hyperparameters, np.array([h.start for h in inputs.hyperparameters])
    found = list[int]()
    for i, (law, part) in enumerate(zip(inputs.laws.values(), inputs.slices, strict=True)):
        if i not in inputs.scattered or not _fixed_support(law, start[part], settings):
            found += [k for k in range(part.start, part.stop) if own[k].free]
    return tuple(found)


def _fixed_support(law: Law, values: Array, settings: FollowingSettings) -> bool:
    least = settings.least_size
    x = law.quantile(values, (np.arange(settings.points) + 0.5) / settings.points)
    for k, (value, h) in enumerate(zip(values, law.hyperparameters, strict=True)):
        step = settings.step * (max(abs(value), least * (h.upper - h.lower)) or least)
        up, down = (law.log_density(_moved(values, k, by), x) for by in (step, -step))
        score = (up - down) / (2.0 * step)
        if not abs(np.mean(score)) <= settings.biased * np.sqrt(np.mean(score**2)):
            return False
    return True


def densities(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """log p(x | alpha) (B, J) at x (B, J, n), of parameters that scatter."""
    flat = x.reshape(-1, x.shape[2])
    return scattered_density(inputs, alpha, flat).reshape(x.shape[:2])


def scattered_density(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """log p(x | alpha) (J,) at x (J, n), of parameters that scatter."""
    return inputs.log_density_of(inputs.scattered, alpha, x, inputs.normal_scores(alpha, x))


def law_scores(
    inputs: Inputs,
    alpha: Array,
    x: Array,
    share: Array,
    settings: FollowingSettings = FOLLOWING,
) -> Array:
    """sum_j share_j d log p(x_j | alpha)/d alpha (B, K) at x (B, J, n)."""
    there = share > settings.counted
    owner = np.nonzero(there)[0]
    return _scores_of(inputs, alpha, x[there], share[there], owner, len(x), settings)


def _scores_of(
    inputs: Inputs,
    alpha: Array,
    x: Array,
    share: Array,
    owner: Indices,
    count: int,
    settings: FollowingSettings,
) -> Array:
    """Sums (B, K) of scores by central differences at x (T, n), which belong to B experiments,
    `owner` (T,)."""
    found, scores = np.zeros((count, inputs.size)), inputs.normal_scores(alpha, x)
    for k, h in enumerate(inputs.hyperparameters):
        if h.free:
            size = max(abs(alpha[k]), settings.least_size * (h.upper - h.lower))
            step = settings.step * size
            up, down = (
                _changed_density(inputs, _moved(alpha, k, by), x, k, scores) for by in (step, -step)
            )
            slope = (up - down) / (2.0 * step)
            found[:, k] = np.bincount(owner, share * slope, minlength=count)
    return found


def _changed_density(inputs: Inputs, alpha: Array, x: Array, k: int, scores: Array) -> Array:
    """The part (J,) of log p(x | alpha) that alpha_k changes.

    `scores` (m, J) are the normal scores at another alpha_k; only that of the law of alpha_k is
    computed anew.
    """
    own = [i for i in inputs.scattered if inputs.slices[i].start <= k < inputs.slices[i].stop]
    theta = scores.copy()
    for i in own:
        if i in inputs.correlated:
            theta[inputs.correlated.index(i)] = inputs.normal_score(i, alpha, x)
    return inputs.log_density_of(own, alpha, x, theta)


@lru_cache
def _quartiles(inputs: Inputs, alpha: tuple[float, ...]) -> Array:
    """Quartiles and median (s, 3) of each law that scatters."""
    laws, values = list(inputs.laws.values()), np.array(alpha)
    own = [laws[i].quantile(values[inputs.slices[i]], QUARTERS) for i in inputs.scattered]
    return np.array(own)


def _grown(before: Array, after: Array, settings: FollowingSettings) -> Array:
    """How far widths have changed, 1 being the limit; a value that is not positive must not
    change."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(after / before)
        wider, narrower = np.log(settings.wider), np.log(settings.narrower)
        scaled = np.where(ratio > 0.0, ratio / wider, ratio / narrower)
    return np.where(before == after, 0.0, np.nan_to_num(scaled, nan=np.inf))


def _moved(alpha: Array, k: int, by: float) -> Array:
    found = alpha.copy()
    found[k] += by
    return found
