"""The uncertainty of the estimates: information matrix, profile intervals, and other maxima.

The estimate itself may still improve here: where the search stopped on a flat top, where it stopped
at a saddle point, or where a profile meets a higher likelihood. The laws at the ends of the profile
intervals differ from the estimated law, and get simulator runs and quadrature nodes of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.fit.ledger import Ledger
from aleator.fit.quadrature import (
    NODE_ACCURACY,
    AnyLikelihood,
    Maximum,
    nearest_maximum,
    with_enough_nodes,
)
from aleator.fit.question import Question
from aleator.fit.refine import WITH_NOISE, Refined, spread
from aleator.fit.search import in_order
from aleator.inference.diagnostics import ESTIMATES, Rival
from aleator.inference.information import Inference, infer
from aleator.inference.likelihood_at import IndividualsAt, OutcomesAt
from aleator.inference.profile import ENDS, TARGET, Profile, profile_intervals
from aleator.inference.small_sample import modified_targets
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.likelihood.individual import (
    Following,
    GaussHermite,
    IndividualLikelihood,
    PlanePanels,
)
from aleator.search import SearchResult
from aleator.search.interface import Scored
from aleator.search.newton import ascend, ascended, outer


@dataclass(frozen=True)
class UncertaintySettings:
    """Settings for computing uncertainty.

    The values are chosen by judgement where no other reason is given.
    """

    wider: int = 3
    """The largest number of times that surfaces are extended to the ends of the intervals."""
    enough: float = 1e-3
    """The gain of log-likelihood still expected from the information matrix that counts as zero."""
    climbs: int = 3
    """The largest number of times that a profile may meet a better maximum and all is repeated."""
    looks: tuple[float, ...] = (-1.0, -0.5, 0.5, 1.0)
    """The distances in standard errors at which a suspected saddle point is tested."""
    higher: float = 0.01
    """The gain of log-likelihood at such a distance that proves a saddle point."""
    determined: float = 1e-2
    """The least eigenvalue of the estimates' correlation matrix for which outer products of scores
    replace the information matrix."""
    differs: float = 0.04
    """The change of the log-likelihood drop at an interval end, by other quadrature nodes, from
    which the end is computed again: twice the error of an end."""
    dear: int = 400
    """The number of nodes for each experiment beyond which a profile takes minutes."""
    unknown: float = 0.2
    """The change of the log-likelihood drop by more nodes from which an end is not reported."""
    adapted: int = 4
    """The largest number of times that an interval is computed with nodes adapted to its ends."""
    nodes: int = 5
    """The largest number of Gauss-Hermite nodes for each scattering parameter, in the search for
    other maxima."""
    others: int = 2
    """The number of optima of the search, besides the best, that are tested as other maxima."""
    evaluations: tuple[int, int] = (5, 30)
    """The usual and a large number of evaluations for an interval's end, as progress tells them:
    6 for each with 2,000 experiments (`benchmarks growth`), 22 for the fission gas."""


UNCERTAINTY = UncertaintySettings()


@dataclass(frozen=True, eq=False)
class EndSearch:
    """How the ends of intervals are computed: the progress told of each, and what is known.

    `rivals` (K,) are lower optima, from which the profile likelihood is maximized too. `near`
    (K, 2, K) are points near the ends, and `targets` (K, 2) their roots, if these are not 1.96.
    """

    progress: Progress
    rivals: Sequence[Array] = ()
    near: Array | None = None
    targets: Array | None = None

    def profile(
        self,
        objective: Scored,
        alpha: Array,
        hyperparameters: Sequence[Hyperparameter],
        inference: Inference,
        only: Indices | None = None,
        near: Array | None = None,
    ) -> Profile:
        """The profile intervals (see `profile_intervals`); `near` takes the place of the field."""
        return profile_intervals(
            objective, alpha, hyperparameters, inference, only, self.rivals,
            self.near if near is None else near, self.progress, self.targets,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Inferred:
    """A maximum with its information matrix, profile intervals, and rivals (other maxima)."""

    refined: Refined
    inference: Inference
    profile: Profile
    rivals: tuple[Rival, ...]

    @property
    def maximum(self) -> Maximum:
        """The maximum with its likelihood."""
        return self.refined.maximum

    @property
    def search_result(self) -> SearchResult:
        """The search that led to the maximum."""
        return self.refined.search_result


def with_uncertainty(answer: Refined, ledger: Ledger) -> Inferred:
    """The maximum with its uncertainty, on surfaces that are accurate at the interval ends too."""
    for widened in range(UNCERTAINTY.wider + 1):
        with ledger.stage("inference"):
            end, found, inference, profile = inferred(
                answer.maximum, answer.search_result, answer.possible, ledger.progress,
                answer.question if answer.question.choices.small_sample else None,
            )  # fmt: skip
            answer = replace(answer, maximum=end, search_result=found)
        if widened == UNCERTAINTY.wider:
            break
        wider = spread(answer, profile, ledger)
        if wider is None:
            break
        answer = wider
    with ledger.stage("inference"):
        rivals = _rivals(answer, inference) or _followed_rivals(answer, inference)
    return Inferred(answer, inference, profile, rivals)


def inferred(
    end: Maximum,
    found: SearchResult,
    others: Sequence[Array] = (),
    progress: Progress | None = None,
    small: Question | None = None,
) -> tuple[Maximum, SearchResult, Inference, Profile]:
    """The maximum, its search, the information matrix and the profile intervals.

    Each interval end has as few quadrature nodes as it needs. `others` (K,) are lower optima, from
    which the profile likelihood is maximized too. If a profile meets a higher likelihood, the
    maximum moves there. The ends are adjusted for few experiments if the question is given as
    `small`.
    """
    progress = progress or Silent()
    for _ in range(UNCERTAINTY.climbs):
        before = end
        progress.update(_cost(end))
        end, inference = informed(end)
        likelihood, alpha = end.likelihood, end.alpha
        if inference.positive and inference.edm > UNCERTAINTY.enough:
            # A search that stopped on a flat top continues with the true information matrix.
            alpha = ascend(
                likelihood.followed, alpha, likelihood.hyperparameters, inference.identified,
                inference.information,
            )[0]  # fmt: skip
            inference = infer(likelihood.followed, alpha, likelihood.hyperparameters)
            end = replace(end, alpha=alpha, likelihood=likelihood.adapted(alpha))
        if end is not before:
            found = found.moved(alpha, end.value)
        search = EndSearch(progress, others)
        profile = _profiled(end, alpha, inference, search)
        if small is not None and profile.better is None:
            profile = _adjusted(replace(end, alpha=alpha), inference, profile, search, small)
        if profile.better is None:
            break
        others = (alpha, *others)
        end = with_enough_nodes(likelihood, profile.better)
        found = found.improved(end.alpha, end.likelihood(end.alpha).total)
    return end, found, inference, profile


def _adjusted(
    end: Maximum, inference: Inference, plain: Profile, search: EndSearch, question: Question
) -> Profile:
    """The profile with ends for few experiments (see `inference.small_sample`).

    An end that cannot be computed so keeps its value, and its target is NaN.
    """
    likelihood, alpha = end.likelihood, end.alpha
    at: OutcomesAt | IndividualsAt
    if isinstance(likelihood, IndividualLikelihood):
        assert end.coarse is not None
        at = IndividualsAt(likelihood, alpha, end.coarse.rule)
    else:
        at = OutcomesAt(likelihood, alpha)
    targets = modified_targets(
        at, question.table.observations, inference, plain, question.seed, search.progress
    )
    known = np.where(np.isnan(targets), TARGET, targets)
    found = _profiled(end, alpha, inference, replace(search, near=plain.points, targets=known))
    lost = np.isnan(found.drops) & ~np.isnan(plain.drops)
    targets = np.where(lost, np.nan, targets)
    return replace(found.with_ends(plain, lost), targets=targets, unadjusted=plain.intervals)


def _rivals(answer: Refined, inference: Inference) -> tuple[Rival, ...]:
    """Other maxima of the likelihood among the optima of the search, the highest first.

    An optimum counts if maximizing from it converges to a maximum inside the limits. With the slow
    piecewise Gauss-Legendre rule for two scattering parameters, only optima already maximized with
    that rule are tried. Cost: some tens of evaluations for each.
    """
    if not inference.positive:
        return ()
    end, found = answer.maximum, answer.search_result
    likelihood = end.likelihood
    arrived = list(answer.possible)
    rule = likelihood.rule if isinstance(likelihood, IndividualLikelihood) else None
    if not isinstance(rule, PlanePanels):
        arrived += [a.alpha for a in found.ascents if a.converged]
    if isinstance(likelihood, IndividualLikelihood) and isinstance(rule, GaussHermite):
        likelihood = likelihood.by(GaussHermite(min(rule.first, UNCERTAINTY.nodes)), end.alpha)
    known, kept = [end.alpha], list[Rival]()
    for optimum in found.optima[1:]:
        if len(known) > UNCERTAINTY.others:
            break
        if not any(np.array_equal(optimum.alpha, other) for other in arrived):
            continue
        if inference.among(optimum.alpha, known, WITH_NOISE.apart):
            continue
        held, alpha = nearest_maximum(likelihood, optimum.alpha)
        alpha = in_order(alpha, end.likelihood.inputs)
        if inference.among(alpha, known, WITH_NOISE.apart):
            continue
        known.append(alpha)
        value = end.likelihood.adapted(alpha).evaluate(alpha).total
        kept += _maximum(held, alpha, end.value - value, end.alpha, inference)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def _followed_rivals(answer: Refined, inference: Inference) -> tuple[Rival, ...]:
    """Other maxima of the likelihood, found with response surfaces refined for each of them."""
    end, kept = answer.maximum, list[Rival]()
    for other in answer.others:
        if not inference.among(other.alpha, [end.alpha], WITH_NOISE.apart):
            drop = end.value - other.value
            kept += _maximum(other.likelihood, other.alpha, drop, end.alpha, inference)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def _maximum(
    likelihood: AnyLikelihood, alpha: Array, drop: float, here: Array, inference: Inference
) -> list[Rival]:
    """A list with the optimum alpha as rival of the maximum `here` (K,), if it is a maximum.

    `drop` is how much lower its log-likelihood is. Otherwise the list is empty.
    """
    about = infer(likelihood.followed, alpha, likelihood.hyperparameters)
    stuck = [a for a, b in zip(about.at_bound, inference.at_bound, strict=True) if a and a != b]
    if stuck or not about.positive or not about.edm < ESTIMATES.edm or not np.isfinite(drop):
        return []
    sizes = np.abs(inference.differences(alpha, here))
    moved = tuple(int(k) for k in np.flatnonzero(np.nan_to_num(sizes) > 1.0))
    return [Rival(alpha, here, drop, moved)]


def informed(end: Maximum) -> tuple[Maximum, Inference]:
    """The maximum and its information matrix; a saddle point is left for the maximum beside it.

    On a flat top, differences of the score may wrongly show an upward curvature. If the likelihood
    is not higher up to a standard error away, the information is taken from the outer products of
    the scores, provided that these determine every hyperparameter.
    """
    likelihood, alpha = end.likelihood, end.alpha
    objective, hyperparameters = likelihood.followed, likelihood.hyperparameters
    inference = infer(objective, alpha, hyperparameters)
    if inference.positive or not np.all(np.isfinite(inference.information)):
        return end, inference
    told = infer(objective, alpha, hyperparameters, by_scores=True)
    if (
        not told.positive
        or np.linalg.eigvalsh(np.linalg.inv(told.correlation))[0] < UNCERTAINTY.determined
    ):
        return end, inference
    higher = _beside_a_saddle(likelihood, alpha, inference, told)
    if higher is None:
        return end, told
    end = with_enough_nodes(likelihood, higher)
    return end, infer(end.likelihood.followed, end.alpha, hyperparameters)


def _beside_a_saddle(
    likelihood: AnyLikelihood, alpha: Array, inference: Inference, told: Inference
) -> Array | None:
    """The highest point (K,) along the direction of upward curvature; None if alpha is higher."""
    inside = np.isin(inference.identified, told.free)
    errors = told.standard_error[told.free]
    bends = inference.information[np.ix_(inside, inside)] * np.outer(errors, errors)
    steepest = errors * np.linalg.eigh(bends)[1][:, 0]
    points = np.tile(alpha, (len(UNCERTAINTY.looks), 1))
    points[:, told.free] += np.outer(UNCERTAINTY.looks, steepest)
    points = np.clip(points, *limits_of(likelihood.hyperparameters))
    *values, here = likelihood.continued.values(np.vstack([points, alpha]))
    best = int(np.nanargmax(values))
    return points[best] if values[best] > here + UNCERTAINTY.higher else None


def _cost(end: Maximum) -> str:
    """What the information matrix and the intervals of a maximum cost, in words."""
    free = sum(h.free for h in end.likelihood.hyperparameters)
    few, many = UNCERTAINTY.evaluations
    return (
        f"{2 * free} evaluations of the log-likelihood for the standard errors, then {few} to "
        f"{many} for each of {2 * free} ends of the intervals"
    )


def _profiled(
    end: Maximum,
    alpha: Array,
    inference: Inference,
    search: EndSearch,
) -> Profile:
    """Profile intervals with few quadrature nodes, and with more where these change an end.

    Each experiment's integrand at an interval end differs from that at the estimate, and may need
    more nodes. An end is not reported if the finest nodes still change its log-likelihood drop.
    """
    likelihood = end.likelihood
    if end.coarse is None or not isinstance(likelihood, IndividualLikelihood):
        return search.profile(likelihood.continued, alpha, likelihood.hyperparameters, inference)
    if likelihood.parameters is not None:
        same = end.coarse.rule == likelihood.rule
        few = likelihood if same else likelihood.by(end.coarse.rule, alpha)
        return _by_held(few, alpha, inference, search)
    many = likelihood.nodes.xi.shape[1] > UNCERTAINTY.dear
    found = search.profile(end.coarse.continued, alpha, likelihood.hyperparameters, inference)
    if found.better is not None:
        return found
    least = UNCERTAINTY.unknown if many else UNCERTAINTY.differs
    found = _anew(likelihood, alpha, found, least, inference, search)
    if many:
        return found
    finer = _finer(likelihood, alpha)
    if finer is None or found.better is not None:
        return found
    if finer.nodes.xi.shape[1] > UNCERTAINTY.dear:
        return found.masked(_off(finer, alpha, found, UNCERTAINTY.unknown))
    again = _anew(finer, alpha, found, UNCERTAINTY.unknown, inference, search)
    finest = _finer(finer, alpha)
    if again is found or again.better is not None or finest is None:
        return again
    return again.masked(_off(finest, alpha, again, UNCERTAINTY.unknown))


def _anew(
    likelihood: IndividualLikelihood,
    alpha: Array,
    found: Profile,
    least: float,
    inference: Inference,
    search: EndSearch,
) -> Profile:
    """The profile, with ends computed again whose drop this likelihood changes by `least`.

    Where it changes no drop by more than a conditional maximum may still rise, none is maximized
    again: by the envelope theorem such a maximum changes as the log-likelihood at its place does.
    """
    if not np.any(_off(likelihood, alpha, found, ENDS.left)):
        return found
    higher = _climbed_on(likelihood, found, inference)
    rows = np.flatnonzero(np.any(_off(likelihood, alpha, higher, least), axis=1))
    if not rows.size:
        return found
    objective, hyperparameters = likelihood.continued, likelihood.hyperparameters
    again = search.profile(objective, alpha, hyperparameters, inference, rows, higher.points)
    return found.joined(again, rows)


def _climbed_on(likelihood: IndividualLikelihood, found: Profile, inference: Inference) -> Profile:
    """The profile, with the other hyperparameters at its ends maximized by this likelihood."""
    objective, points = likelihood.continued, found.points.copy()
    for k, side in np.argwhere(found.drops > 0.0):
        moving, point = inference.identified[inference.identified != k], points[k, side]
        scores = objective(point).scores
        assert scores is not None
        points[k, side] = ascended(
            objective, point, likelihood.hyperparameters, moving, outer(scores[:, moving]),
            ENDS.left, bent=True,
        ).alpha  # fmt: skip
    return replace(found, points=points)


def _finer(likelihood: IndividualLikelihood, alpha: Array) -> IndividualLikelihood | None:
    """The likelihood with the next finer quadrature rule; None if there is no finer rule."""
    if likelihood.rule.centers > 1:
        return None
    rules = likelihood.rule.finer(likelihood.inputs.scattering)
    return likelihood.by(rules[0], alpha) if rules else None


def _off(likelihood: IndividualLikelihood, alpha: Array, profile: Profile, least: float) -> Flags:
    """Which interval ends (K, 2) have a drop that this likelihood changes by `least` or more."""
    top = likelihood.adapted(alpha).evaluate(alpha).total
    wrong = np.zeros(profile.drops.shape, dtype=np.bool_)
    for k, side in np.argwhere(profile.drops > 0.0):
        point = profile.points[k, side]
        drop = top - likelihood.adapted(point).evaluate(point).total
        wrong[k, side] = not abs(drop - profile.drops[k, side]) < least
    return wrong


def _by_held(
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    search: EndSearch,
) -> Profile:
    """Profile intervals with quadrature nodes that are fixed points of the parameters.

    Adapting such nodes costs more than a profile. So at each alpha those adapted to the nearest
    law are used. Nodes adapted to an interval end verify its drop. Where the drop is wrong, the end
    is computed again with these nodes added.
    """
    objective, found = likelihood.continued, Profile.unknown_ends(alpha.size)
    for k in inference.identified:
        row = _row_by_held(objective, likelihood, alpha, inference, search, np.array([k]))
        found = found.joined(row, np.array([k]))
        if found.better is not None:
            break
    return found


def _row_by_held(
    objective: Following,
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    search: EndSearch,
    only: Indices,
) -> Profile:
    """The interval of one hyperparameter with fixed nodes.

    A higher likelihood on the way counts only if nodes adapted to that point confirm it.
    """
    hyperparameters, top = likelihood.hyperparameters, likelihood.evaluate(alpha).total
    off, about = np.full((alpha.size, 2), np.inf), None
    for _ in range(UNCERTAINTY.adapted):
        found = search.profile(objective, alpha, hyperparameters, inference, only, about)
        if found.better is not None:
            if top - _with_own(objective, likelihood, found.better) < -ENDS.better:
                return found
            continue
        off, about = np.zeros((alpha.size, 2)), found.points
        for k, side in np.argwhere(found.drops > 0.0):
            drop = top - _with_own(objective, likelihood, found.points[k, side])
            off[k, side] = abs(drop - found.drops[k, side])
        if np.max(off) < UNCERTAINTY.differs:
            break
    return replace(found, better=None).masked(off > UNCERTAINTY.unknown)


def _with_own(objective: Following, likelihood: IndividualLikelihood, point: Array) -> float:
    """The log-likelihood at a point (K,) with nodes adapted near it, which are kept for later."""
    own = objective.nearest(point)
    if own.distance(point) > NODE_ACCURACY.close:
        own = likelihood.adapted(point)
        objective.remember(own)
    return own.evaluate(point).total
