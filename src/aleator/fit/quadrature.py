"""Maximize the likelihood again with more quadrature nodes, until more of them change nothing.

With noise the likelihood is an integral over each experiment's parameters, whose nodes are adapted
to alpha. Without noise one set of nodes serves at every alpha: that of the level sets, or of the
law. The reported result has finer nodes than the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Indices
from aleator.inference.diagnostics import EXPERIMENTS
from aleator.inference.information import observed_information
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.likelihood.individual import (
    Following,
    GaussHermite,
    ImportancePoints,
    IndividualLikelihood,
    LevelRule,
    NodeRule,
    Panels,
    PlanePanels,
    RidgePoints,
)
from aleator.likelihood.individual.rules import RULES
from aleator.likelihood.problem import Problem
from aleator.search import Ascent, Objective, Optimum, SearchResult
from aleator.search.interface import OPTIMA
from aleator.search.newton import ASCENT, ascended, outer, positive


@dataclass(frozen=True)
class NodeAccuracy:
    """Settings for the number of quadrature nodes of the reported result.

    The values are chosen by judgement where no other reason is given.
    """

    rounds: int = 30
    """The largest number of times that nodes are adapted and the likelihood is maximized."""
    rough: float = 0.01
    """The estimated gain of log-likelihood below which alpha is near enough to fix the nodes."""
    still: float = 1e-5
    """The gain of log-likelihood by adapting the nodes again that counts as zero."""
    arrived: float = 1e-10
    """The predicted gain of log-likelihood that is left at the reported maximum. Estimates are then
    within 1e-5 standard errors (`pytest tests/test_exact_answers.py`)."""
    close: float = 0.1
    """The distance between two laws within which nodes fixed at parameter values still serve."""
    enough: float = 1e-4
    """The change of the log-likelihood by more nodes that counts as zero, so that four published
    digits are met (`pytest tests/test_exact_answers.py`; 2e-3 left Soybean 6e-4 and Loblolly 3e-4
    off). With many experiments it is `enough_each` for each of them, but never more than the change
    that the report mentions."""
    on_surfaces: float = 2e-3
    """This change on response surfaces, whose own error of the log-likelihood is larger. 1e-4 is
    four times dearer there and changes the log-likelihood of a study with 30 experiments by 3e-4,
    where 0.01 is its error (`pytest -m long tests/fit/test_emulate.py`)."""
    enough_each: float = 1e-6
    """This change for each experiment, with many experiments."""
    hardly: float = 0.02
    """The change of the log-likelihood by more nodes that does not matter for an interval."""
    little: float = 0.1
    """The change of the log-likelihood by more nodes that is admitted while response surfaces are
    still coarse."""
    scoring: int = 3
    """The least number of Gauss-Hermite nodes for each scattering parameter that scores need."""
    products: int = 4
    """The largest number of scattering parameters with a Gauss-Hermite product rule."""
    sample: int = 300
    """The number of experiments on which large rules are tried and second modes are sought."""
    large: int = 400
    """The number of nodes for each experiment from which a rule is called large."""
    slow: float = 0.7
    """The ratio of successive changes of the log-likelihood above which a large rule converges
    slowly."""
    plane_large: int = 100
    """The number of nodes from which a rule for two scattering parameters is called large; the
    alternative is a piecewise Gauss-Legendre rule over the plane."""
    plane_slow: float = 0.25
    """The ratio of successive changes of the log-likelihood above which a rule for two scattering
    parameters converges slowly."""
    smooth: float = 1e-4
    """The change by more nodes around one mode below which the integrand has no kink. With many
    experiments it is `smooth_each` for each experiment, but never more than `enough`."""
    smooth_each: float = 1e-6
    """This change for each experiment, with many experiments. A kink in a few of 2,000 experiments
    changes more; without one, 6 times 11 nodes of two truncated normal laws changed 5e-8 each
    (`benchmarks growth`)."""
    some: int = 150
    """The largest number of nodes around one mode in the test for a kink of the integrand."""
    panels_tried: int = 40
    """The number of experiments on which the piecewise Gauss-Legendre rule is tried."""
    points_tried: tuple[int, int] = (600, 1200)
    """Two numbers of importance points, with which nodes around one mode are compared."""
    certain: float = 3.0
    """The number of standard errors beyond which a difference from importance points is real."""
    mode_points: int = 16
    """The number of importance points where only the modes are needed."""
    others: int = 3
    """The number of optima besides the best that are evaluated with the reported nodes."""
    higher: float = 2e-3
    """The gain of log-likelihood from which another maximum replaces the present one."""
    same: float = 0.3
    """The distance in standard errors, by the outer product of the scores, within which two maxima
    are the same."""


NODE_ACCURACY = NodeAccuracy()


AnyLikelihood = IndividualLikelihood | Problem
"""A likelihood with noise (an integral over parameters) or without (a density of outcomes)."""


@dataclass(frozen=True, eq=False)
class Maximum:
    """A maximum alpha (K,) of a likelihood whose quadrature nodes are adapted to it.

    `gap` is the change of the log-likelihood by more nodes. `coarse` is the likelihood with the
    fewest nodes that are accurate enough for profile intervals. It is None where one set of nodes
    serves at every alpha.
    """

    likelihood: AnyLikelihood
    alpha: Array
    gap: float
    coarse: IndividualLikelihood | None

    @property
    def value(self) -> float:
        """The log-likelihood at the maximum, with the log prior density."""
        return self.likelihood.evaluate(self.alpha).total


@dataclass(frozen=True, eq=False)
class _IntegralMaximum(Maximum):
    """A maximum of a likelihood that is an integral over each experiment's parameters."""

    likelihood: IndividualLikelihood
    coarse: IndividualLikelihood


def with_enough_nodes(
    likelihood: AnyLikelihood, alpha: Array, enough: float = NODE_ACCURACY.enough
) -> Maximum:
    """The local maximum reached from alpha (K,), with enough quadrature nodes.

    Nodes are added until more of them change the log-likelihood by less than `enough`.
    """
    if isinstance(likelihood, Problem):
        fine = likelihood.fine() if enough < NODE_ACCURACY.rough else likelihood
        end, alpha = nearest_maximum(fine, alpha, _arrived(enough))
        return Maximum(end, alpha, fine.gap(alpha) if enough < NODE_ACCURACY.rough else 0.0, None)
    return _integral_with_enough_nodes(likelihood, alpha, enough)


def _integral_with_enough_nodes(
    likelihood: IndividualLikelihood, alpha: Array, enough: float
) -> Maximum:
    """Maximize, adapt the nodes, and add more of them, until the log-likelihood does not change.

    It does not change if more nodes alter it by less than `enough`. Parameters of levels have a
    rule of their own. Otherwise the first nodes lie around one mode of each experiment's integrand;
    with more than four scattering parameters they lie along its ridge. If other modes count, or too
    many nodes would be needed, importance points replace them. With two scattering parameters a
    piecewise Gauss-Legendre rule replaces them; for profile intervals and replicates nodes around
    one mode still serve where both agree there.
    """
    if isinstance(likelihood.rule, LevelRule):
        return _refined(likelihood, alpha, enough)
    variates = likelihood.inputs.scattering
    many = variates > NODE_ACCURACY.products
    end = _refined(likelihood.ruled(RidgePoints()) if many else _scoring(likelihood), alpha, enough)
    most = NODE_ACCURACY.little if enough >= NODE_ACCURACY.rough else NODE_ACCURACY.hardly
    if _one_mode_serves(end, most, _none(likelihood, enough)):
        return end
    if variates == 2:
        over = _refined(end.likelihood.ruled(PlanePanels.coarse()), end.alpha, enough)
        few = end.coarse.adapted(over.alpha)
        agree = abs(few.evaluate(over.alpha).total - over.value) < NODE_ACCURACY.hardly
        return replace(over, coarse=few) if agree else over
    none = max(enough, NODE_ACCURACY.rough) if many else enough
    again = _refined(likelihood.ruled(ImportancePoints()), end.alpha, none)
    return again if abs(again.gap) < most or abs(again.gap) < abs(end.gap) else end


def _scoring(likelihood: IndividualLikelihood) -> IndividualLikelihood:
    """The likelihood with at least three nodes for each scattering parameter, as scores need.

    One node at the mode gives the height of an experiment's density but not its width. The score
    of a standard deviation would then differ from the slope of the log-likelihood.
    """
    if not isinstance(likelihood.rule, GaussHermite) or likelihood.inputs.scattering < 2:
        return likelihood
    return likelihood.ruled(likelihood.rule.at_least(NODE_ACCURACY.scoring))


def _one_mode_serves(end: _IntegralMaximum, most: float, enough: float) -> bool:
    """Whether nodes around one mode of each experiment leave nothing out, and are enough."""
    variates = end.likelihood.inputs.scattering
    if variates < 2:
        return True
    if variates == 2:
        return _told_by_panels(end, most, enough)
    return not _misses_modes(end) and (abs(end.gap) < most or _points_tell_less(end))


def _told_by_panels(end: _IntegralMaximum, most: float, enough: float) -> bool:
    """Whether nodes around one mode agree with a piecewise rule over two scattering parameters.

    The piecewise rule covers the whole plane and misses no mode. They agree if more nodes change
    the log-likelihood by less than `most`, and the piecewise rule by less than `enough`.
    """
    if abs(end.gap) > most:
        return False
    likelihood = end.likelihood
    if _smooth(end) and not several_modes(likelihood, end.alpha):
        return True
    tried = _some(likelihood, NODE_ACCURACY.panels_tried)
    return abs(_change(tried, PlanePanels.coarse(), end.alpha, large=False)) < enough


def _smooth(end: _IntegralMaximum) -> bool:
    """Whether the integral converges with more nodes around one mode.

    It does not where the integrand has a kink. The test costs a hundredth of a piecewise rule.
    """
    held, gap = end.likelihood, end.gap
    each = NODE_ACCURACY.smooth_each * held.count
    smooth = min(max(NODE_ACCURACY.smooth, each), NODE_ACCURACY.enough)
    while abs(gap) >= smooth:
        rules = held.rule.finer(2)
        finer = held.rule.refined([np.inf] * len(rules), smooth, 2)
        if not isinstance(finer, GaussHermite) or finer.size(2) > NODE_ACCURACY.some:
            return False
        held = held.by(finer, end.alpha)
        gap = finer.gap(_gaps(held, end.alpha), 2)
    return True


def _misses_modes(end: _IntegralMaximum) -> bool:
    """Whether nodes around one mode of each experiment miss other modes that count."""
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
    """Whether importance points would have a larger error than the present nodes.

    Their error is measured with few points, and extrapolated to the largest number of points by
    the square root law of random points.
    """
    coarse, fine = (
        _some(end.likelihood).by(ImportancePoints(n), end.alpha) for n in NODE_ACCURACY.points_tried
    )
    change = _change_of_points(fine, end.alpha, coarse.evaluate(end.alpha).each)
    return change * float(np.sqrt(NODE_ACCURACY.points_tried[0] / RULES.most_points)) > abs(end.gap)


def several_modes(likelihood: IndividualLikelihood, alpha: Array) -> bool:
    """Whether the integrand of any experiment, or of a sample of them, has a second mode."""
    found = _some(likelihood).by(ImportancePoints(NODE_ACCURACY.mode_points, 2), alpha).nodes.modes
    return bool(np.any(found[:, :, 1] != found[:, :, 0]))


def _some(
    likelihood: IndividualLikelihood, size: int = NODE_ACCURACY.sample
) -> IndividualLikelihood:
    """The likelihood of an evenly spread sample of the experiments, or of all if they are few."""
    return likelihood.sampled(size) if likelihood.count > 2 * size else likelihood


def _refined(likelihood: IndividualLikelihood, alpha: Array, enough: float) -> _IntegralMaximum:
    """The local maximum with one kind of quadrature rule, whose nodes are added until `enough`."""
    tried = list[tuple[float, IndividualLikelihood]]()
    variates, information = likelihood.inputs.scattering, None
    while True:
        held, alpha, information = _nearest_of_integral(
            likelihood, alpha, _arrived(enough), information
        )
        gaps = _gaps(held, alpha)
        gap = held.rule.gap(gaps, variates)
        before = tried[-1][0] if tried else np.inf
        tried.append((abs(gap), held))
        exact = variates == 2 and enough < NODE_ACCURACY.rough
        large = NODE_ACCURACY.plane_large if exact else NODE_ACCURACY.large
        slowly = NODE_ACCURACY.plane_slow if exact else NODE_ACCURACY.slow
        slow = held.nodes.xi.shape[1] > large and abs(gap) > slowly * before
        if held.rule.centers == 1 and slow and abs(gap) > NODE_ACCURACY.hardly:
            # A rule around one mode converges slowly where the integrand is not smooth.
            return _IntegralMaximum(held, alpha, gap, _fewest(tried))
        finer = held.rule.refined(gaps, _none(held, enough), variates)
        if finer is None:
            return _IntegralMaximum(held, alpha, gap, _fewest(tried))
        likelihood = held.ruled(finer)


def _none(likelihood: IndividualLikelihood, enough: float) -> float:
    """The change of the log-likelihood that counts as zero with this number of experiments."""
    each = NODE_ACCURACY.enough_each * likelihood.count
    return max(enough, min(each, EXPERIMENTS.noted_gap))


def _fewest(tried: Sequence[tuple[float, IndividualLikelihood]]) -> IndividualLikelihood:
    """The likelihood with the fewest nodes whose error is small enough, else with the most nodes.

    `tried` has the absolute error and the likelihood of each rule, from few nodes to many.
    """
    for most in (NODE_ACCURACY.hardly, NODE_ACCURACY.little):
        for gap, held in tried:
            if gap < most:
                return held
    return tried[-1][1]


def _gaps(held: IndividualLikelihood, alpha: Array) -> list[float]:
    """The change of the log-likelihood by each quadrature rule that is one step finer."""
    variates = held.inputs.scattering
    rules = held.rule.finer(variates)
    if isinstance(held.rule, ImportancePoints | RidgePoints):
        each = held.evaluate(alpha).each
        return [_change_of_points(held.by(rule, alpha), alpha, each) for rule in rules]
    if isinstance(held.rule, GaussHermite) and variates == 1:
        # Panels are compared with the finer of the two rules, because what a sample of many
        # experiments says of a difference is the less exact, the larger it is.
        more, panels = rules
        nearer = held.by(more, alpha)
        first = nearer.evaluate(alpha).total - held.evaluate(alpha).total
        return [first, first + _change(nearer, panels, alpha, large=True)]
    return [_change(held, rule, alpha, rule.size(variates) > NODE_ACCURACY.large) for rule in rules]


def _change(held: IndividualLikelihood, rule: NodeRule, alpha: Array, large: bool) -> float:
    """The change of the log-likelihood by another quadrature rule.

    A `large` rule is tried on a sample of the experiments, and its change is scaled to all.
    """
    tried = _some(held) if large else held
    change = tried.by(rule, alpha).evaluate(alpha).total - tried.evaluate(alpha).total
    return float(change * held.count / sum(len(block) for block in tried.blocks))


def _change_of_points(finer: IndividualLikelihood, alpha: Array, each: Array) -> float:
    """The change of the log-likelihood by other importance points.

    `each` (N,) are the log-densities of the experiments by the first points. Changes of different
    experiments may cancel by chance, so that the root of the sum of their squares is a lower
    limit. Another is the estimated gain of maximizing with the other points.
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


def _arrived(enough: float) -> float:
    """The gain that may be left at a maximum, where more nodes may change `enough`."""
    return NODE_ACCURACY.arrived if enough < NODE_ACCURACY.rough else ASCENT.arrived


def nearest_maximum(
    likelihood: AnyLikelihood, alpha: Array, arrived: float = ASCENT.arrived
) -> tuple[AnyLikelihood, Array]:
    """The local maximum (K,) reached from alpha, and the likelihood with nodes adapted to it.

    `arrived` is the predicted gain of log-likelihood that may be left.
    """
    if not isinstance(likelihood, Problem):
        return _nearest_of_integral(likelihood, alpha, arrived)[:2]
    hyperparameters = likelihood.hyperparameters
    free = np.flatnonzero([h.free for h in hyperparameters])
    if not free.size:
        return likelihood, alpha
    objective = likelihood.continued
    information = _outer(objective(alpha).scores, free, hyperparameters)
    end = ascended(
        objective, alpha, hyperparameters, free, information, arrived
    )  # fmt: skip
    return likelihood, end.alpha


def _nearest_of_integral(
    likelihood: IndividualLikelihood, alpha: Array, arrived: float, known: Array | None = None
) -> tuple[IndividualLikelihood, Array, Array | None]:
    """The local maximum with noise: nodes are adapted to alpha until it is near, then fixed.

    It is returned with the information (F, F) about the free hyperparameters at the end of the
    ascent, which is `known` to the next one; None if nothing is free.
    """
    hyperparameters = likelihood.hyperparameters
    free = np.flatnonzero([h.free for h in hyperparameters])
    held = (
        likelihood
        if likelihood.distance(alpha) < NODE_ACCURACY.close
        else likelihood.adapted(alpha)
    )
    if not free.size:
        return held, alpha, None
    information = _information(held, alpha, free, known)
    following = held.continued
    near = ascended(following, alpha, hyperparameters, free, information, NODE_ACCURACY.rough)
    alpha, information = near.alpha, near.information
    nearest = following.nearest(alpha)
    held = nearest if nearest.distance(alpha) < NODE_ACCURACY.close else held.adapted(alpha)
    if isinstance(held.rule, RidgePoints | LevelRule):
        # Points fixed along one ridge give wrong, too high values beside it, and fixed points of
        # many shared parameters miss those that belong to another alpha.
        end = ascended(held.followed, alpha, hyperparameters, free, information)
        return held.adapted(end.alpha), end.alpha, end.information
    if held.rule.centers > 1:
        return *_climbed_with_points(held, alpha, information, free), information
    for _ in range(NODE_ACCURACY.rounds):
        before = held.evaluate(alpha).total
        following.remember(held)
        # Nodes fixed as standard variates are passed as a plain function, so that they stay fixed.
        objective = held.__call__ if held.parameters is None else following
        end = ascended(
            objective, alpha, hyperparameters, free, information, arrived
        )  # fmt: skip
        again, close = held.adapted(end.alpha), held.distance(end.alpha) < NODE_ACCURACY.close
        gain = again.evaluate(end.alpha).total - before
        if gain < 0.0 and end.value > before:
            # The gain was an error of nodes too far from the alpha that they were adapted to.
            break
        held, alpha, information = again, end.alpha, end.information
        if close or abs(gain) < NODE_ACCURACY.still:
            break
    return held, alpha, information


def _climbed_with_points(
    held: IndividualLikelihood, alpha: Array, information: Array, free: Indices
) -> tuple[IndividualLikelihood, Array]:
    """The local maximum with importance points, drawn anew until maximizing gains nothing."""
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


def _information(
    held: IndividualLikelihood, alpha: Array, free: Indices, known: Array | None
) -> Array:
    """The information (F, F) with which a quasi-Newton ascent from alpha begins.

    Scores of experiments that share parameters depend on each other, and their outer products are
    no estimate of it; it is then that of the last ascent, or at first the difference of scores.
    """
    here, hyperparameters = held(alpha), held.hyperparameters
    if here.cluster is None:
        return _outer(here.scores, free, hyperparameters)
    if known is not None:
        return known
    assert here.scores is not None
    own = here.scores[:, free]
    return positive(observed_information(held.followed, alpha, hyperparameters, free, own))


def _outer(scores: Array | None, free: Indices, hyperparameters: Sequence[Hyperparameter]) -> Array:
    """The sum of outer products of the scores (F, F), plus 1/width^2 of the limits' intervals.

    F is the number of free hyperparameters; the second term keeps the matrix positive definite.
    """
    assert scores is not None
    own = scores[:, free]
    lower, upper = limits_of(hyperparameters, free)
    return np.asarray(own.T @ own + np.diag((upper - lower) ** -2.0))


@dataclass(frozen=True, eq=False)
class Highest:
    """The highest maximum, and `others`: optima (K,) less than 1.92 of log-likelihood below it.

    `search_result` is the search with this maximum as its first optimum, and the others after it.
    """

    maximum: Maximum
    search_result: SearchResult
    others: tuple[Array, ...]

    @classmethod
    def of(
        cls, end: Maximum, found: SearchResult, starts: int, looked: Sequence[Optimum]
    ) -> Highest:
        """The highest maximum `end` of so many starts, with the optima `looked` evaluated anew."""
        best = Optimum(end.alpha, end.value, starts)
        most = best.log_likelihood
        lower = [replace(o, log_likelihood=min(o.log_likelihood, most)) for o in looked]
        lower.sort(key=lambda optimum: -optimum.log_likelihood)
        optima = (best, *lower, *found.optima[1 + NODE_ACCURACY.others :])
        moved = replace(found, alpha=end.alpha, log_likelihood=most, optima=optima)
        return cls(end, moved, tuple(o.alpha for o in lower if _possible(o, best)))


def with_other_optima(end: Maximum, found: SearchResult) -> Highest:
    """The maximum unchanged, and the next optima of the search evaluated with its nodes."""
    looked = _looked_at(end.likelihood.continued, found)
    return Highest.of(end, found, found.optima[0].starts, looked)


def highest_maximum(end: Maximum, found: SearchResult) -> Highest:
    """The highest of the maxima that are reached from the best optima of the search.

    A search has few quadrature nodes. With accurate nodes another optimum than the best of the
    search may be the highest, so that the likelihood is maximized from each again: with the nodes
    of `end`, or where these do not serve with nodes of its own. An optimum far below `end` by nodes
    that serve is left out.
    """
    first = Optimum(end.alpha, end.value, found.optima[0].starts)
    looked, climbs, ends = list[Optimum](), list[Optimum](), [first]
    objective, best, held = end.likelihood.continued, first, end.likelihood
    for optimum in _looked_at(objective, found):
        near = objective.nearest(optimum.alpha) if isinstance(objective, Following) else None
        own, reached = _reached(near or end.likelihood, optimum, first, end.gap)
        ends.append(reached)
        (climbs if _possible(reached, first) else looked).append(reached)
        if reached.log_likelihood > best.log_likelihood:
            best, held = reached, own
    found, starts = _followed(found, ends), first.starts
    if best.log_likelihood > first.log_likelihood + NODE_ACCURACY.higher:
        finer = with_enough_nodes(held, best.alpha)
        if finer.value > first.log_likelihood:
            climbs.append(first)
            end, starts, found = finer, best.starts, replace(found, once=len(found.ascents) > 1)
    known = [end.alpha]
    for climb in sorted(climbs, key=lambda one: -one.log_likelihood):
        if not any(_same(climb.alpha, alpha, end) for alpha in known):
            known.append(climb.alpha)
            looked.append(climb)
    return Highest.of(end, found, starts, looked)


def _looked_at(objective: Objective, found: SearchResult) -> list[Optimum]:
    """The next best optima of a search, with log-likelihoods by the accurate nodes."""
    return [
        replace(optimum, log_likelihood=objective(optimum.alpha).total)
        for optimum in found.optima[1 : 1 + NODE_ACCURACY.others]
    ]


def _possible(optimum: Optimum, best: Optimum) -> bool:
    return best.log_likelihood - optimum.log_likelihood < OPTIMA.ruled_out


def _reached(
    near: AnyLikelihood, optimum: Optimum, best: Optimum, gap: float
) -> tuple[AnyLikelihood, Optimum]:
    """The maximum reached from an optimum, and the likelihood with nodes that serve there.

    `near` has the rule of the best maximum, where more nodes change the log-likelihood by `gap`,
    with nodes adapted to the optimum.
    """
    if not _serves(near, optimum.alpha, gap):
        own = with_enough_nodes(near, optimum.alpha, NODE_ACCURACY.rough)
        return own.likelihood, replace(optimum, alpha=own.alpha, log_likelihood=own.value)
    if not _possible(optimum, best):
        return near, optimum
    held, alpha = nearest_maximum(near, optimum.alpha)
    return held, replace(optimum, alpha=alpha, log_likelihood=held.evaluate(alpha).total)


def _serves(near: AnyLikelihood, alpha: Array, allowed: float) -> bool:
    """Whether the nodes of a rule that served at another maximum serve at alpha (K,) too.

    They do if no mode is left out and more nodes change the log-likelihood by less than the gain
    from which another maximum replaces the present one, or by no more than at that maximum, which
    is `allowed`. Panels serve everywhere: they are halved where the outcome is not smooth.
    """
    if isinstance(near, Problem) or isinstance(near.rule, Panels | PlanePanels):
        return True
    gap = near.rule.gap(_gaps(near, alpha), near.inputs.scattering)
    most = max(NODE_ACCURACY.higher, abs(allowed))
    if abs(gap) > most or isinstance(near.rule, ImportancePoints | LevelRule):
        return abs(gap) <= most
    return _one_mode_serves(_IntegralMaximum(near, alpha, gap, near), NODE_ACCURACY.hardly, most)


def _followed(found: SearchResult, ends: Sequence[Optimum]) -> SearchResult:
    """The search whose first optima moved to `ends` with more nodes, and with them the ascents."""

    def moved(ascent: Ascent) -> Ascent:
        for optimum, end in zip(found.optima, ends, strict=False):
            if np.array_equal(ascent.alpha, optimum.alpha):
                return replace(ascent, alpha=end.alpha, log_likelihood=end.log_likelihood)
        return ascent

    return replace(found, ascents=tuple(moved(ascent) for ascent in found.ascents))


def _same(alpha: Array, other: Array, end: Maximum) -> bool:
    scores = end.likelihood(end.alpha).scores
    assert scores is not None
    step = alpha - other
    return float(step @ outer(scores) @ step) < NODE_ACCURACY.same**2
