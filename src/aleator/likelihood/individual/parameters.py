"""Quadrature nodes that are stored as parameter values and reused for neighboring laws.

With fixed parameter values the simulated values stay valid while alpha changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws.hyperparameter import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.likelihood.individual.predictors import Block, Predictor

QUARTERS = np.array([1, 2, 3]) / 4.0
"""The probabilities of the first quartile, the median and the third quartile."""


@dataclass(frozen=True)
class FollowingSettings:
    """Settings for the reuse of nodes that are stored as parameter values.

    The values are chosen by judgement. Nodes made for one law are reused for another if its medians
    differ by no more than the distance between the quartiles. `narrower` and `wider`: the factors
    by which the width of a law, or the noise, may have changed. `tied`: the largest change of a
    correlation. `shape`: the largest change of a hyperparameter of the measurement errors that is
    no scale, as the correlation of neighbours, relative to the width of its limits. `shorter`: the
    factor by which a step of alpha is shortened until it stays within these bounds. `kept_values`:
    the largest number of simulated values stored with nodes. `kept_nodes`: the largest number of
    nodes that an objective remembers. `resolution`: the error of a log-likelihood, relative to the
    tolerance of its modes.

    The other fields concern the scores of laws. `step`: the step of differences, relative to a
    hyperparameter, or to the share `least_size` of its range if that is larger. `points`: the
    number of points for the mean of a score. `biased`: the mean of a score, relative to its root
    mean square, above which the support of a law is taken to move with the hyperparameter.
    `counted`: a node with a smaller share of the integral is left out of the score.
    """

    narrower: float = 0.4
    wider: float = 2.0
    tied: float = 0.2
    shape: float = 0.05
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
    w_j are the weights of nodes that were adapted to alpha0. The sum is smooth in alpha for any
    simulator, also for one with kinks or jumps. Nodes stored as standard normal variates would move
    across a kink or jump as alpha changes. `alpha` is alpha0. `there` (N, J) flags the nodes with a
    weight, and `log_weight` (T,) is log w_j/p(x_j | alpha0) of these, experiment by experiment.
    `of_errors` are the hyperparameters of the measurement errors, the last of alpha. The nodes are
    valid only for these `inputs` and this `predictor`, and for laws whose support does
    not depend on alpha.
    """

    inputs: Inputs
    predictor: Predictor
    of_errors: tuple[Hyperparameter, ...]
    alpha: Array
    there: Flags
    x: Array
    log_weight: Array
    eta: Array
    settings: FollowingSettings = FOLLOWING

    def distance(self, alpha: Array) -> float:
        """The distance of alpha from that of the nodes, which are valid up to a distance of 1."""
        return self.between(self.alpha, alpha)

    def between(self, alpha: Array, other: Array) -> float:
        """The distance of two alphas (see `distance`)."""
        return distance(self.inputs, self.of_errors, alpha, other, self.settings)

    def log_weights(self, alpha: Array, block: Block) -> Array:
        """The log weights log(w_j p(x_j | alpha)/p(x_j | alpha0)) (B, J) of a block of experiments.

        The log weight is minus infinity where there is no node.
        """
        there, own = self._of(block)
        found = np.full(there.shape, -np.inf)
        with np.errstate(invalid="ignore"):
            known = self.log_weight[own] + scattered_density(self.inputs, alpha, self.x[own])
        found[there] = np.where(np.isnan(known), -np.inf, known)
        return found

    def scores(self, alpha: Array, block: Block, share: Array) -> Array:
        """The scores sum_j share_j d log p(x_j | alpha)/d alpha (B, K) of B experiments."""
        there, own = self._of(block)
        counted = share[there] > self.settings.counted
        owner = np.nonzero(there)[0][counted]
        x, shares = self.x[own][counted], share[there][counted]
        return _scores_of(self.inputs, alpha, x, shares, owner, len(there), self.settings)

    def _of(self, block: Block) -> tuple[Flags, slice]:
        """Flags (B, J) of a block's nodes with a weight, and their places among all T nodes."""
        part, ends = block.experiments, self._ends
        return self.there[part], slice(int(ends[part.start]), int(ends[part.stop]))

    @cached_property
    def _ends(self) -> Indices:
        """The number of nodes (N + 1,) before each experiment, and last the number of all nodes."""
        return np.concatenate([[0], np.cumsum(self.there.sum(axis=1))])


def distance(
    inputs: Inputs,
    of_errors: tuple[Hyperparameter, ...],
    alpha: Array,
    other: Array,
    settings: FollowingSettings = FOLLOWING,
) -> float:
    """The distance of two alphas; up to a distance of 1, nodes of the first are valid at the other.

    It is the largest change of a median, a width or a correlation, relative to the allowed change.
    `of_errors` are the hyperparameters of the measurement errors.
    """
    size = inputs.size
    here, there = (_quartiles(inputs, tuple(values[:size].tolist())) for values in (alpha, other))
    width, wider = here[:, 2] - here[:, 0], there[:, 2] - there[:, 0]
    shifted = np.abs(there[:, 1] - here[:, 1]) / width
    ties = np.abs(other - alpha)[inputs.partials] / settings.tied
    scales = np.array([h.log for h in of_errors], dtype=np.bool_)
    pairs = [(width, wider), (alpha[size:][scales], other[size:][scales])]
    grown = [_grown(before, after, settings) for before, after in pairs]
    allowed = [settings.shape * (h.upper - h.lower) for h in of_errors if h.free and not h.log]
    free = np.array([h.free and not h.log for h in of_errors], dtype=np.bool_)
    shaped = np.abs(other - alpha)[size:][free] / np.array(allowed)
    return float(np.max(np.concatenate([shifted, ties, shaped, *grown]), initial=0.0))


def holds(inputs: Inputs, values: int, settings: FollowingSettings = FOLLOWING) -> bool:
    """Whether nodes with this number of simulated `values` can be stored as parameters.

    They can if there is memory for them, and if no law is a mixture, follows covariates, is an
    identified constant, or has a support that depends on alpha.
    """
    return (
        values <= settings.kept_values
        and len(inputs.classes) == 1
        and inputs.covariate_model is None
        and not moving(inputs, settings)
    )


@lru_cache
def moving(inputs: Inputs, settings: FollowingSettings = FOLLOWING) -> tuple[int, ...]:
    """The indices of hyperparameters, not known, that change the possible values of the parameters.

    They are the values of constants, and all hyperparameters of a law whose support depends on
    them. The score of such a law has a mean different from zero. This mean is computed at the start
    of the hyperparameters with a hundred points of equal probability.
    """
    own, start = inputs.hyperparameters, np.array([h.start for h in inputs.hyperparameters])
    found = list[int]()
    for i, (law, part) in enumerate(zip(inputs.laws.values(), inputs.slices, strict=True)):
        if i not in inputs.scattered or not _fixed_support(law, start[part], settings):
            found += [k for k in range(part.start, part.stop) if not own[k].is_number]
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
    """The log-density log p(x | alpha) (B, J) of the scattering parameters at x (B, J, n)."""
    flat = x.reshape(-1, x.shape[2])
    return scattered_density(inputs, alpha, flat).reshape(x.shape[:2])


def scattered_density(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """The log-density log p(x | alpha) (J,) of the scattering parameters at x (J, n)."""
    return inputs.log_density_of(inputs.scattered, alpha, x, inputs.normal_scores(alpha, x))


def law_scores(
    inputs: Inputs,
    alpha: Array,
    x: Array,
    share: Array,
    settings: FollowingSettings = FOLLOWING,
) -> Array:
    """The scores sum_j share_j d log p(x_j | alpha)/d alpha (B, K) at points x (B, J, n)."""
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
    """Weighted sums (B, K) of scores at points x (T, n) over the points of each experiment.

    `owner` (T,) is the experiment of each point. The scores are central differences; beyond the
    limits of a hyperparameter, such as the share of a component, there may be no law.
    """
    found, scores = np.zeros((count, inputs.size)), inputs.normal_scores(alpha, x)
    for k, h in enumerate(inputs.hyperparameters):
        if not h.is_number:
            size = max(abs(alpha[k]), settings.least_size * (h.upper - h.lower))
            step = settings.step * size
            rooms = h.upper - alpha[k], alpha[k] - h.lower
            ends = [room if 0.0 <= room < step else step for room in rooms]
            up, down = (
                _changed_density(inputs, _moved(alpha, k, by), x, k, scores)
                for by in (ends[0], -ends[1])
            )
            slope = (up - down) / sum(ends)
            found[:, k] = np.bincount(owner, share * slope, minlength=count)
    return found


def _changed_density(inputs: Inputs, alpha: Array, x: Array, k: int, scores: Array) -> Array:
    """The part (J,) of log p(x | alpha) that depends on alpha_k.

    `scores` (m, J) are normal scores of the correlated parameters, computed with another alpha_k.
    Only the score of the parameter whose law has alpha_k is computed again.
    """
    own = [i for i in inputs.scattered if inputs.slices[i].start <= k < inputs.slices[i].stop]
    theta = scores.copy()
    for i in own:
        if i in inputs.correlated:
            theta[inputs.correlated.index(i)] = inputs.normal_score(i, alpha, x)
    return inputs.log_density_of(own, alpha, x, theta)


@lru_cache
def _quartiles(inputs: Inputs, alpha: tuple[float, ...]) -> Array:
    """The first quartile, median and third quartile (s, 3) of each scattering parameter."""
    laws, values = list(inputs.laws.values()), np.array(alpha)
    own = [laws[i].quantile(values[inputs.slices[i]], QUARTERS) for i in inputs.scattered]
    return np.array(own)


def _grown(before: Array, after: Array, settings: FollowingSettings) -> Array:
    """The change of widths relative to the allowed change, which is 1.

    It is infinite where a value that is not positive has changed.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(after / before)
        wider, narrower = np.log(settings.wider), np.log(settings.narrower)
        scaled = np.where(ratio > 0.0, ratio / wider, ratio / narrower)
    return np.where(before == after, 0.0, np.nan_to_num(scaled, nan=np.inf))


def _moved(alpha: Array, k: int, by: float) -> Array:
    found = alpha.copy()
    found[k] += by
    return found
