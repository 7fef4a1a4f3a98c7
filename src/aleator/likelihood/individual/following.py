"""A likelihood whose nodes follow alpha, and nodes that are held as parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws.hyperparameter import log_prior
from aleator.likelihood.individual.predictors import Block
from aleator.search.interface import LogLikelihood

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs
    from aleator.laws.law import Law
    from aleator.likelihood.individual.likelihood import IndividualLikelihood
    from aleator.likelihood.individual.predictors import Predictor
    from aleator.observations.errors import MeasurementErrors


QUARTERS = np.array([1, 2, 3]) / 4.0
"""Probabilities of the quartiles."""


@dataclass(frozen=True)
class FollowingSettings:
    """How far nodes that are kept as parameters serve, and how many are kept; by judgement.

    Laws and noise: a median moves by the distance between the quartiles at most. `narrower` and
    `wider`: share of its width that a law, or the noise, may have become; nodes end where a law
    did. `tied`: what a correlation may have changed by. `shorter`: factor by which a step of alpha
    beyond these is shortened. `kept_values`: simulated values that are kept with nodes.
    `kept_nodes`: nodes, kept as parameters, that an objective remembers. `resolution`: error of a
    log-likelihood over what its modes are exact to.

    Scores of laws: `step` is that of differences over a hyperparameter, or over the share
    `least_size` of its range if that is more. `points`: points by which the mean of a score is
    seen. `biased`: its share of their size from where on the support of a law moves. `counted`:
    share of an integral that a node has at least, to count in its score.
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
    settings: FollowingSettings = FOLLOWING

    def distance(self, alpha: Array) -> float:
        """How far alpha is from that of the nodes: up to one, they serve there."""
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
    """How far another alpha is from this one: up to one, nodes that are held serve there too."""
    size = inputs.size
    here, there = (_quartiles(inputs, tuple(values[:size].tolist())) for values in (alpha, other))
    width, wider = here[:, 2] - here[:, 0], there[:, 2] - there[:, 0]
    shifted = np.abs(there[:, 1] - here[:, 1]) / width
    ties = np.abs(other - alpha)[inputs.partials] / settings.tied
    pairs = [(width, wider), (alpha[size:], other[size:])]
    grown = [_grown(before, after, settings) for before, after in pairs]
    return float(np.max(np.concatenate([shifted, ties, *grown]), initial=0.0))


def holds(inputs: Inputs, values: int, settings: FollowingSettings = FOLLOWING) -> bool:
    """Whether so many simulated values can be held so under these laws."""
    return (
        values <= settings.kept_values
        and len(inputs.classes) == 1
        and inputs.covariate_model is None
        and not moving(inputs, settings)
    )


@lru_cache
def moving(inputs: Inputs, settings: FollowingSettings = FOLLOWING) -> tuple[int, ...]:
    """The free hyperparameters with which parameters x move, and not only their density.

    The values of constants, and what laws have whose support moves: there the score has another
    mean than zero, at the start of the hyperparameters by a hundred points of equal probability.
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
    """The same (J,) at x (J, n)."""
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
    """The same (B, K) by central differences at x (T, n), whose owners (T,) count B."""
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

    Given the normal scores (m, J) at another alpha_k: only those of its own law are others here.
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
    """How far widths have changed; values that are not positive only serve themselves."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(after / before)
        wider, narrower = np.log(settings.wider), np.log(settings.narrower)
        scaled = np.where(ratio > 0.0, ratio / wider, ratio / narrower)
    return np.where(before == after, 0.0, np.nan_to_num(scaled, nan=np.inf))


def _moved(alpha: Array, k: int, by: float) -> Array:
    found = alpha.copy()
    found[k] += by
    return found


@dataclass(frozen=True)
class ExpectationSettings:
    """How long a step of expectation and maximization may be; chosen by judgement.

    `least_share`: share of a law's information that observations give, at least, so that no step
    becomes too long. `stretch`: how many times larger or smaller a step may make the sd of a law.
    `smaller` and `larger`: the same of errors; laws must have time to explain more.
    """

    least_share: float = 0.05
    stretch: float = 10.0
    smaller: float = 0.1
    larger: float = 2.0


EXPECTATION = ExpectationSettings()


def toward(
    likelihood: IndividualLikelihood,
    alpha: Array,
    settings: ExpectationSettings = EXPECTATION,
) -> tuple[float, Array]:
    """log L at alpha, where the nodes are adapted, and where it may be larger: alpha (K,).

    A step of expectation and maximization (Dempster, Laird and Rubin, 1977), made longer where
    observations tell less (Louis, 1982). With m_l and V_l the mean and the variance of x in
    experiment l given its observations, and mu and v those of the law,

        mu' = mu + sum_l (m_l - mu) / sum_l w_l,                 w_l = 1 - V_l/v,
        v'  = v + sum_l ((m_l - mu)^2 + V_l - v) / sum_l w_l^2,
        sd'^2 = sd^2 (1 + sd/M d log L/d sd)                     of the errors of M observations.

    For normal laws and errors its end is the maximum, for others near one. Constants, correlations,
    shapes and laws without a mean and an sd stay; limits are not kept. Cost: an evaluation without
    a score.
    """
    inputs, errors = likelihood.inputs, likelihood.errors
    center, spread = _laws(inputs, alpha, likelihood.count)
    mean, square = np.full(center.shape, np.nan), np.full(center.shape, np.nan)
    slope, count = np.zeros(len(errors.hyperparameters)), np.zeros(len(errors.hyperparameters))
    value = log_prior(likelihood.hyperparameters, alpha)
    for block in likelihood.blocks:
        part = block.experiments
        each, share, individual, terms = likelihood.weighed(alpha, block)
        value += float(each.sum())
        mean[part] = np.einsum("bj,bjn->bn", share, individual.x)
        away = individual.x - center[part, None]
        square[part] = np.einsum("bj,bjn->bn", share, away**2)
        for p, (rows, derivative) in enumerate(terms.d_values):
            slope[p] += np.sum(share[block.owner[rows]] * derivative)
            count[p] += len(rows)
    found, counted = alpha.copy(), ~np.isnan(mean[:, 0])
    if not np.isfinite(value) or not np.all(np.isfinite(square[counted])):
        return value, found
    for i in _known(inputs):
        own = (mean[counted, i] - center[counted, i], square[counted, i], spread[counted, i])
        _place(inputs, i, found, *own, counted, settings)
    _place_errors(errors, found[inputs.size :], slope / np.maximum(count, 1.0), settings)
    return value, found


def _known(inputs: Inputs) -> list[int]:
    """The parameters whose laws have a mean and an sd."""
    names = [[h.name for h in law.hyperparameters] for law in inputs.laws.values()]
    return [i for i in inputs.scattered if names[i] == ["mean", "sd"]]


def _laws(inputs: Inputs, alpha: Array, count: int) -> tuple[Array, Array]:
    """The means and variances (N, n) of these laws in all experiments; of others zero and one."""
    values = inputs.values(alpha[: inputs.size], slice(0, count))
    center, spread = np.zeros((count, len(values))), np.ones((count, len(values)))
    for i in _known(inputs):
        center[:, i], spread[:, i] = values[i][0].ravel(), values[i][1].ravel() ** 2
    return center, spread


def _place(
    inputs: Inputs,
    i: int,
    alpha: Array,
    shift: Array,
    square: Array,
    spread: Array,
    counted: Flags,
    settings: ExpectationSettings,
) -> None:
    """Set the law of parameter i in alpha, by m_l - mu, its mean square and v of experiments."""
    at, model = inputs.parts[i].start, inputs.covariate_model
    mean, sd = slice(at, at + 1), slice(at + 1, at + 2)
    columns = np.ones((len(shift), 1))
    if model is not None:
        of_mean, of_sd = model.entries[at], model.entries[at + 1]
        mean, sd = of_mean.places, of_sd.places
        columns = columns if of_mean.design is None else of_mean.design.matrix[counted]
    share = np.clip(1.0 - (square - shift**2) / spread, settings.least_share, 1.0)
    alpha[mean] += np.linalg.lstsq((columns.T * share) @ columns, columns.T @ shift)[0]
    if model is None or of_sd.design is None:
        grown = 1.0 + np.mean(square / spread - 1.0) / np.mean(share**2)
        stretch = settings.stretch
        alpha[sd] *= np.sqrt(np.clip(grown, stretch**-2.0, stretch**2.0))


def _place_errors(
    errors: MeasurementErrors, values: Array, slope: Array, settings: ExpectationSettings
) -> None:
    """Set the sds of the errors, by the slope (P,) of the log-likelihood an observation."""
    for p, h in enumerate(errors.hyperparameters):
        if h.free and h.name.endswith(".sd"):
            ratio = np.sqrt(np.maximum(1.0 + values[p] * slope[p], 0.0))
            values[p] *= np.clip(ratio, settings.smaller, settings.larger)


class Following:
    """An objective whose nodes are adapted to every alpha that is asked for.

    Its score is exact but for the error of the quadrature. Modes are sought from the last ones, and
    nodes that are held as parameters serve until the laws have moved far: the nearest are taken of
    some that it remembers, and that is all it does. Where an experiment has one mode, the value is
    a function of alpha alone. Modes are found to `arrived` in log-density.
    """

    def __init__(
        self,
        likelihood: IndividualLikelihood,
        arrived: float,
        settings: FollowingSettings = FOLLOWING,
    ) -> None:
        self._known, self._arrived, self._settings = [likelihood], arrived, settings
        self.resolution = settings.resolution * arrived

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,)."""
        return self._adapted(alpha)(alpha)

    def values(self, alphas: Array) -> Array:
        """The totals (A,) at alphas (A, K)."""
        return np.array([self._adapted(a).evaluate(a).total for a in np.asarray(alphas)])

    def toward(self, alpha: Array) -> tuple[float, Array]:
        """log L at alpha, and where it may be larger (see `toward`)."""
        return toward(self._adapted(alpha), alpha)

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share of the way from alpha (K,) to another that a step may go.

        Where nodes are held as parameters a step far beyond them costs new ones, and what made it
        so long was seen here only.
        """
        nearest, share, settings = self.nearest(alpha), 1.0, self._settings
        while (
            nearest.parameters is not None
            and distance(nearest.inputs, alpha, alpha + share * (ahead - alpha), settings) > 1.0
        ):
            share *= settings.shorter
        return share

    def remember(self, adapted: IndividualLikelihood) -> None:
        """Take these nodes where they are the nearest."""
        known = [*self._known, adapted] if adapted.parameters is not None else [adapted]
        kept = self._settings.kept_nodes
        while len(known) > 1 and sum(k.nodes.log_weight.size for k in known) > kept:
            known = known[1:]
        self._known = known

    def nearest(self, alpha: Array) -> IndividualLikelihood:
        """That with the nodes nearest to alpha, of those that it remembers."""
        return min(self._known, key=lambda known: known.distance(alpha))

    def _adapted(self, alpha: Array) -> IndividualLikelihood:
        nearest = self.nearest(alpha)
        if nearest.distance(alpha) <= 1.0:
            return nearest
        found = nearest.adapted(alpha, self._arrived)
        if np.all(np.isfinite(found.nodes.mode)):
            self.remember(found)
        return found
