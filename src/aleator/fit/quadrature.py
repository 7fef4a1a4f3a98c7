"""From a maximum that a search found to one that neither nodes nor further steps move.

Without noise the nodes are those of the level sets, or of the law: they serve at every alpha, and
an answer has finer ones than a search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Indices
from aleator.inference.diagnostics import EXPERIMENTS
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.likelihood.individual import (
    Following,
    GaussHermite,
    ImportancePoints,
    IndividualLikelihood,
    NodeRule,
    PlanePanels,
    RidgePoints,
)
from aleator.likelihood.individual.rules import RULES
from aleator.likelihood.problem import Problem
from aleator.search import Ascent, Objective, Optimum, SearchResult
from aleator.search.interface import OPTIMA, one_hill
from aleator.search.newton import ascended, outer


@dataclass(frozen=True)
class NodeAccuracy:
    """When the nodes of an answer are enough, by judgement where nothing else is said."""

    rounds: int = 30
    """Times that nodes are adapted and climbed with, at most."""
    rough: float = 0.01
    """Log-likelihood that may be left to climb before nodes are fixed."""
    still: float = 1e-5
    """Gain of log-likelihood by adapting the nodes again that counts as none."""
    close: float = 0.1
    """Distance in law over which nodes that are fixed as parameters still serve."""
    enough: float = 2e-3
    """Change of the log-likelihood by more nodes that counts as none. If it is more, 1e-5 an
    experiment, up to the change that is reported."""
    hardly: float = 0.02
    """Change of the log-likelihood by more nodes that does not matter to an interval."""
    little: float = 0.1
    """The same while surfaces are still coarse and more runs follow."""
    scoring: int = 3
    """Gauss-Hermite nodes a variate that scores need, at least."""
    products: int = 4
    """Variates for which product rules of Gauss-Hermite nodes are affordable, at most."""
    sample: int = 300
    """Experiments on which rules of many nodes are tried and second modes are sought."""
    large: int = 400
    """Nodes of an experiment from which a rule is large."""
    slow: float = 0.7
    """Ratio of successive changes of a large rule above which it converges slowly."""
    plane_large: int = 100
    """Nodes from which a rule of two variates is large; panels are the alternative."""
    plane_slow: float = 0.25
    """Ratio of successive changes above which a rule of two variates converges slowly."""
    smooth: float = 1e-4
    """Change by more nodes about one mode that rules out a kink."""
    some: int = 150
    """Nodes about one mode, at most, by which it is tested whether there is a kink."""
    panels_tried: int = 40
    """Experiments on which panels of two variates are tried."""
    points_tried: tuple[int, int] = (600, 1200)
    """Importance points, coarse and fine, that show what nodes about one mode miss."""
    certain: float = 3.0
    """Standard errors of the points beyond which a difference is no chance."""
    mode_points: int = 16
    """Importance points where only the modes matter."""
    others: int = 3
    """Optima besides the best that are evaluated with the nodes of the answer."""
    higher: float = 2e-3
    """Log-likelihood by which another maximum must be higher to be taken."""
    same: float = 0.3
    """Standard errors, by the outer product of the scores, within which two maxima are one."""


NODE_ACCURACY = NodeAccuracy()


AnyLikelihood = IndividualLikelihood | Problem
"""The integral over individual parameters, or the density of exact outcomes."""


@dataclass(frozen=True, eq=False)
class Maximum:
    """A maximum alpha (K,), with nodes adapted there and the `gap` that more nodes change.

    `coarse` is the likelihood with the fewest nodes of which more hardly change it, or change it
    little; None where the nodes serve at every alpha.
    """

    likelihood: AnyLikelihood
    alpha: Array
    gap: float
    coarse: IndividualLikelihood | None

    @property
    def value(self) -> float:
        """The log-likelihood with priors, by the nodes of the maximum."""
        return self.likelihood.evaluate(self.alpha).total


@dataclass(frozen=True, eq=False)
class _IntegralMaximum(Maximum):
    """A maximum of an integral over individual parameters."""

    likelihood: IndividualLikelihood
    coarse: IndividualLikelihood


def with_enough_nodes(
    likelihood: AnyLikelihood, alpha: Array, enough: float = NODE_ACCURACY.enough
) -> Maximum:
    """The nearest maximum, with as many nodes as are `enough` for it."""
    if isinstance(likelihood, Problem):
        fine = likelihood.fine() if enough < NODE_ACCURACY.rough else likelihood
        end, alpha = nearest_maximum(fine, alpha)
        return Maximum(end, alpha, fine.gap(alpha) if enough < NODE_ACCURACY.rough else 0.0, None)
    return _integral_with_enough_nodes(likelihood, alpha, enough)


def _integral_with_enough_nodes(
    likelihood: IndividualLikelihood, alpha: Array, enough: float
) -> Maximum:
    """Climb with fixed nodes, adapt them, and take more of them, until nothing moves.

    Nodes are enough where more of them change the log-likelihood by less than `enough`. With more
    than four variates they are points along the ridge of each individual law. Importance points
    replace nodes about one mode where an individual law has other modes that count, or where these
    nodes would be too many; with two variates panels do.
    """
    variates = likelihood.inputs.scattering
    many = variates > NODE_ACCURACY.products
    end = _refined(likelihood.ruled(RidgePoints()) if many else _scoring(likelihood), alpha, enough)
    if variates < 2:
        return end
    most = NODE_ACCURACY.little if enough >= NODE_ACCURACY.rough else NODE_ACCURACY.hardly
    if variates == 2:
        if _told_by_panels(end, most, enough):
            return end
        return _refined(end.likelihood.ruled(PlanePanels.coarse()), end.alpha, enough)
    if not _misses_modes(end) and (abs(end.gap) < most or _points_tell_less(end)):
        return end
    none = max(enough, NODE_ACCURACY.rough) if many else enough
    again = _refined(likelihood.ruled(ImportancePoints()), end.alpha, none)
    return again if abs(again.gap) < most or abs(again.gap) < abs(end.gap) else end


def _scoring(likelihood: IndividualLikelihood) -> IndividualLikelihood:
    """The likelihood with at least three nodes a variate, as scores need.

    One node at the mode gives an individual density its height but not its width, so that the score
    of a standard deviation would not be the slope of the log-likelihood.
    """
    if not isinstance(likelihood.rule, GaussHermite) or likelihood.inputs.scattering < 2:
        return likelihood
    return likelihood.ruled(likelihood.rule.at_least(NODE_ACCURACY.scoring))


def _told_by_panels(end: _IntegralMaximum, most: float, enough: float) -> bool:
    """Whether nodes about one mode of two variates give the same value as panels.

    Panels cover the whole plane and miss nothing. It is so where more nodes change less than
    `most`, and panels change less than `enough`.
    """
    if abs(end.gap) > most:
        return False
    likelihood = end.likelihood
    if _smooth(end) and not several_modes(likelihood, end.alpha):
        return True
    tried = _some(likelihood, NODE_ACCURACY.panels_tried)
    return abs(_change(tried, PlanePanels.coarse(), end.alpha, large=False)) < enough


def _smooth(end: _IntegralMaximum) -> bool:
    """Whether ever more nodes about one mode converge, as they do not at a kink.

    A hundred nodes cost a hundredth of what panels cost.
    """
    held, gap = end.likelihood, end.gap
    while abs(gap) >= NODE_ACCURACY.smooth:
        rules = held.rule.finer(2)
        finer = held.rule.refined([np.inf] * len(rules), NODE_ACCURACY.smooth, 2)
        if not isinstance(finer, GaussHermite) or finer.size(2) > NODE_ACCURACY.some:
            return False
        held = held.by(finer, end.alpha)
        gap = finer.gap(_gaps(held, end.alpha), 2)
    return True


def _misses_modes(end: _IntegralMaximum) -> bool:
    """Whether nodes about one mode of each experiment miss a part of the likelihood."""
    likelihood, alpha = end.likelihood, end.alpha
    if not several_modes(likelihood, alpha):
        return False
    tried = _some(likelihood)
    known = tried.evaluate(alpha).each
    coarse, fine = (
        tried.by(ImportancePoints(count), alpha).evaluate(alpha).each
        for count in NODE_ACCURACY.points_tried
    )
    error = float(np.sqrt(np.sum((fine - coarse) ** 2)))
    return float(np.sum(fine - known)) > NODE_ACCURACY.hardly + NODE_ACCURACY.certain * error


def _points_tell_less(end: _IntegralMaximum) -> bool:
    """Whether importance points would have a larger error than the nodes of the answer.

    The error of the largest number of points is extrapolated as that of random points.
    """
    coarse, fine = (
        _some(end.likelihood).by(ImportancePoints(n), end.alpha) for n in NODE_ACCURACY.points_tried
    )
    change = _change_of_points(fine, end.alpha, coarse.evaluate(end.alpha).each)
    return change * float(np.sqrt(NODE_ACCURACY.points_tried[0] / RULES.most_points)) > abs(end.gap)


def several_modes(likelihood: IndividualLikelihood, alpha: Array) -> bool:
    """Whether the individual law of an experiment has a second mode; a sample of many is tested."""
    found = _some(likelihood).by(ImportancePoints(NODE_ACCURACY.mode_points, 2), alpha).nodes.modes
    return bool(np.any(found[:, :, 1] != found[:, :, 0]))


def _some(
    likelihood: IndividualLikelihood, size: int = NODE_ACCURACY.sample
) -> IndividualLikelihood:
    """The likelihood of a sample of the experiments; of all where they are few."""
    return likelihood.sampled(size) if likelihood.count > 2 * size else likelihood


def _refined(likelihood: IndividualLikelihood, alpha: Array, enough: float) -> _IntegralMaximum:
    """The nearest maximum by one kind of rule, with as many nodes as are enough."""
    tried = list[tuple[float, IndividualLikelihood]]()
    variates = likelihood.inputs.scattering
    while True:
        held, alpha = _nearest_of_integral(likelihood, alpha)
        gaps = _gaps(held, alpha)
        gap = held.rule.gap(gaps, variates)
        before = tried[-1][0] if tried else np.inf
        tried.append((abs(gap), held))
        exact = variates == 2 and enough < NODE_ACCURACY.rough
        large = NODE_ACCURACY.plane_large if exact else NODE_ACCURACY.large
        slowly = NODE_ACCURACY.plane_slow if exact else NODE_ACCURACY.slow
        slow = held.nodes.xi.shape[1] > large and abs(gap) > slowly * before
        if held.rule.centers == 1 and slow and abs(gap) > NODE_ACCURACY.hardly:
            # what is not smooth converges slowly about one centre
            return _IntegralMaximum(held, alpha, gap, _fewest(tried))
        none = max(enough, min(1e-5 * held.count, EXPERIMENTS.noted_gap))
        finer = held.rule.refined(gaps, none, variates)
        if finer is None:
            return _IntegralMaximum(held, alpha, gap, _fewest(tried))
        likelihood = held.ruled(finer)


def _fewest(tried: Sequence[tuple[float, IndividualLikelihood]]) -> IndividualLikelihood:
    """The likelihood with the fewest nodes of which more hardly change it; else with the most."""
    for most in (NODE_ACCURACY.hardly, NODE_ACCURACY.little):
        for gap, held in tried:
            if gap < most:
                return held
    return tried[-1][1]


def _gaps(held: IndividualLikelihood, alpha: Array) -> list[float]:
    """The changes of the log-likelihood by each of the finer rules."""
    variates = held.inputs.scattering
    rules = held.rule.finer(variates)
    if isinstance(held.rule, ImportancePoints | RidgePoints):
        each = held.evaluate(alpha).each
        return [_change_of_points(held.by(rule, alpha), alpha, each) for rule in rules]
    return [_change(held, rule, alpha, rule.size(variates) > NODE_ACCURACY.large) for rule in rules]


def _change(held: IndividualLikelihood, rule: NodeRule, alpha: Array, large: bool) -> float:
    """The change of the log-likelihood by a rule; a large rule is tried on a sample."""
    tried = _some(held) if large else held
    change = tried.by(rule, alpha).evaluate(alpha).total - tried.evaluate(alpha).total
    return float(change * held.count / sum(len(block) for block in tried.blocks))


def _change_of_points(finer: IndividualLikelihood, alpha: Array, each: Array) -> float:
    """The change of the log-likelihood by other importance points.

    It is at least the root of the sum of squares, since changes of experiments may cancel by
    chance, and at least what there is left to climb with the other points.
    """
    hyperparameters, found = finer.hyperparameters, finer(alpha)
    free = np.array(
        [k for k, h in enumerate(hyperparameters) if h.lower < alpha[k] < h.upper], dtype=np.intp
    )
    information = _outer(found.scores, free, hyperparameters)
    score = found.score[free]
    left = 0.5 * float(score @ np.linalg.solve(information, score))
    change = found.each - each
    return max(abs(float(change.sum())), float(np.sqrt(np.sum(change**2))), left)


def nearest_maximum(likelihood: AnyLikelihood, alpha: Array) -> tuple[AnyLikelihood, Array]:
    """The nearest maximum, and the likelihood with nodes adapted there."""
    if not isinstance(likelihood, Problem):
        return _nearest_of_integral(likelihood, alpha)
    hyperparameters = likelihood.hyperparameters
    free = np.flatnonzero([h.free for h in hyperparameters])
    if not free.size:
        return likelihood, alpha
    objective = likelihood.continued
    information = _outer(objective(alpha).scores, free, hyperparameters)
    return likelihood, ascended(objective, alpha, hyperparameters, free, information).alpha


def _nearest_of_integral(
    likelihood: IndividualLikelihood, alpha: Array
) -> tuple[IndividualLikelihood, Array]:
    """The nearest maximum: nodes follow alpha until it is near, then they are fixed."""
    hyperparameters = likelihood.hyperparameters
    free = np.flatnonzero([h.free for h in hyperparameters])
    held = (
        likelihood
        if likelihood.distance(alpha) < NODE_ACCURACY.close
        else likelihood.adapted(alpha)
    )
    if not free.size:
        return held, alpha
    information = _outer(held(alpha).scores, free, hyperparameters)
    following = held.continued
    near = ascended(following, alpha, hyperparameters, free, information, NODE_ACCURACY.rough)
    alpha, information = near.alpha, near.information
    nearest = following.nearest(alpha)
    held = nearest if nearest.distance(alpha) < NODE_ACCURACY.close else held.adapted(alpha)
    if isinstance(held.rule, RidgePoints):
        # held where a ridge was, points promise much beside it that is not there
        alpha = ascended(held.followed, alpha, hyperparameters, free, information).alpha
        return held.adapted(alpha), alpha
    if held.rule.centers > 1:
        return _climbed_with_points(held, alpha, information, free)
    for _ in range(NODE_ACCURACY.rounds):
        before = held.evaluate(alpha).total
        following.remember(held)
        # variates as a plain function: a search would let the nodes follow
        objective = held.__call__ if held.parameters is None else following
        end = ascended(objective, alpha, hyperparameters, free, information)
        again, close = held.adapted(end.alpha), held.distance(end.alpha) < NODE_ACCURACY.close
        gain = again.evaluate(end.alpha).total - before
        if gain < 0.0 and end.value > before:
            # nodes that were held too far from where they were adapted promised what is not there
            break
        held, alpha, information = again, end.alpha, end.information
        if close or abs(gain) < NODE_ACCURACY.still:
            break
    return held, alpha


def _climbed_with_points(
    held: IndividualLikelihood, alpha: Array, information: Array, free: Indices
) -> tuple[IndividualLikelihood, Array]:
    """The maximum with fixed importance points, drawn anew until a climb gains nothing."""
    for _ in range(NODE_ACCURACY.rounds):
        before = held.evaluate(alpha).total
        end = ascended(held.__call__, alpha, held.hyperparameters, free, information)
        alpha, information = end.alpha, end.information
        if end.value < before + NODE_ACCURACY.rough:
            break
        held = held.adapted(alpha)
        if held.evaluate(alpha).total < before + NODE_ACCURACY.rough:
            break
    return held, alpha


def _outer(scores: Array | None, free: Indices, hyperparameters: Sequence[Hyperparameter]) -> Array:
    """The sum of outer products of the scores (F, F), and at least 1/width^2 of the limits."""
    assert scores is not None
    own = scores[:, free]
    lower, upper = limits_of(hyperparameters, free)
    return np.asarray(own.T @ own + np.diag((upper - lower) ** -2.0))


@dataclass(frozen=True, eq=False)
class Highest:
    """The highest maximum, and other optima (K,) less than 1.92 below it by the same nodes.

    `search_result` is the search with the answer as its first optimum, and the others after it.
    """

    maximum: Maximum
    search_result: SearchResult
    others: tuple[Array, ...]

    @classmethod
    def of(
        cls, end: Maximum, found: SearchResult, looked: Sequence[Optimum], rest: Sequence[Optimum]
    ) -> Highest:
        """The maximum with those optima that were evaluated anew, then the `rest`."""
        lower = [replace(o, log_likelihood=min(o.log_likelihood, end.value)) for o in looked]
        lower.sort(key=lambda optimum: -optimum.log_likelihood)
        optima = (Optimum(end.alpha, end.value, found.optima[0].starts), *lower, *rest)
        moved = replace(found, alpha=end.alpha, log_likelihood=end.value, optima=optima)
        return cls(end, moved, tuple(o.alpha for o in lower if _possible(o, end)))


def with_other_optima(end: Maximum, found: SearchResult) -> Highest:
    """The maximum as it is, with the log-likelihoods of the next optima by its nodes."""
    looked = _looked_at(end.likelihood.continued, found)
    return Highest.of(end, found, looked, found.optima[1 + NODE_ACCURACY.others :])


def highest_maximum(end: Maximum, found: SearchResult) -> Highest:
    """The highest of the maxima climbed to from the best optima of the search.

    A search has few nodes: with those of the answer another optimum than its best may be the
    highest. One that is ruled out by these is not climbed from.
    """
    looked, climbs, ascents = [], list[Optimum](), found.ascents
    objective = end.likelihood.continued
    for optimum in _looked_at(objective, found):
        if not _possible(optimum, end):
            looked.append(optimum)
            continue
        near = objective.nearest(optimum.alpha) if isinstance(objective, Following) else None
        climbs.append(_climbed(near or end.likelihood, optimum))
        ascents = tuple(_moved(ascent, optimum, climbs[-1]) for ascent in ascents)
    best = max(climbs, key=lambda one: one.log_likelihood, default=None)
    if best is not None and best.log_likelihood > end.value + NODE_ACCURACY.higher:
        climbs.append(Optimum(end.alpha, end.value, found.optima[0].starts))
        end = max(with_enough_nodes(end.likelihood, best.alpha), end, key=lambda one: one.value)
        found = replace(found, once=_reached(end, ascents) < 2)
    known = [end.alpha]
    for climb in sorted(climbs, key=lambda one: -one.log_likelihood):
        if not any(_same(climb.alpha, alpha, end) for alpha in known):
            known.append(climb.alpha)
            looked.append(climb)
    return Highest.of(
        end, replace(found, ascents=ascents), looked, found.optima[1 + NODE_ACCURACY.others :]
    )


def _looked_at(objective: Objective, found: SearchResult) -> list[Optimum]:
    """The next optima of a search, with their log-likelihoods by the nodes of the answer."""
    return [
        replace(optimum, log_likelihood=objective(optimum.alpha).total)
        for optimum in found.optima[1 : 1 + NODE_ACCURACY.others]
    ]


def _possible(optimum: Optimum, end: Maximum) -> bool:
    return end.value - optimum.log_likelihood < OPTIMA.ruled_out


def _climbed(likelihood: AnyLikelihood, optimum: Optimum) -> Optimum:
    held, alpha = nearest_maximum(likelihood, optimum.alpha)
    return replace(optimum, alpha=alpha, log_likelihood=held.evaluate(alpha).total)


def _moved(ascent: Ascent, optimum: Optimum, climb: Optimum) -> Ascent:
    """An ascent whose end is moved to where a climb from its optimum ended."""
    if not np.array_equal(ascent.alpha, optimum.alpha):
        return ascent
    return replace(ascent, alpha=climb.alpha, log_likelihood=climb.log_likelihood)


def _reached(end: Maximum, ascents: Sequence[Ascent]) -> int:
    """The number of starts that ended on the hill of the answer."""
    scores = end.likelihood(end.alpha).scores
    assert scores is not None
    free = np.flatnonzero([h.free for h in end.likelihood.hyperparameters])
    return sum(one_hill(a.alpha - end.alpha, scores, free) for a in ascents)


def _same(alpha: Array, other: Array, end: Maximum) -> bool:
    scores = end.likelihood(end.alpha).scores
    assert scores is not None
    step = alpha - other
    return float(step @ outer(scores) @ step) < NODE_ACCURACY.same**2
