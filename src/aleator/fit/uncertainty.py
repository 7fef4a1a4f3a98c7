"""How sure an answer is: information, profile intervals, and other maxima.

A search on a flat top has not learned the information, a saddle has a maximum beside it, a profile
may meet a better one: each leads the answer on. The laws at the ends of the intervals are others
than at the answer, and get runs and nodes of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.fit.ledger import Ledger
from aleator.fit.quadrature import (
    NODE_ACCURACY,
    AnyLikelihood,
    Maximum,
    nearest_maximum,
    with_enough_nodes,
)
from aleator.fit.refine import WITH_NOISE, Refined, Refinement
from aleator.fit.search import in_order
from aleator.inference.diagnostics import ESTIMATES, Rival
from aleator.inference.information import Inference, infer
from aleator.inference.profile import ENDS, Profile, profile_intervals
from aleator.laws.hyperparameter import limits_of
from aleator.likelihood.individual import (
    Following,
    GaussHermite,
    IndividualLikelihood,
    PlanePanels,
)
from aleator.search import SearchResult
from aleator.search.newton import ascend, ascended, outer


@dataclass(frozen=True)
class UncertaintySettings:
    """How uncertainty is computed; by judgement where nothing else is said."""

    wider: int = 3
    """Times that surfaces may be extended to the ends of the intervals."""
    enough: float = 1e-3
    """Log-likelihood that may be left to climb, by the information at the end."""
    climbs: int = 3
    """Times that a profile may meet a better maximum, from which all is done again."""
    looks: tuple[float, ...] = (-1.0, -0.5, 0.5, 1.0)
    """Distances in standard errors at which a suspected saddle is tested."""
    higher: float = 0.01
    """Log-likelihood by which such a point must be higher to prove a saddle."""
    determined: float = 1e-2
    """Least eigenvalue of the correlations for which outer products of scores replace the
    information."""
    differs: float = 0.04
    """Difference of a profile's drop by other nodes that counts: twice the error of an end."""
    dear: int = 400
    """Nodes of an experiment beyond which a profile costs minutes."""
    unknown: float = 0.2
    """Change of the drop by more nodes from which an end is not reported."""
    adapted: int = 4
    """Times that an interval is sought with nodes adapted to its ends."""
    nodes: int = 5
    """Gauss-Hermite nodes a variate by which a rival maximum is climbed to."""
    others: int = 2
    """Optima of the search, besides the best, that are tested for rival maxima."""


UNCERTAINTY = UncertaintySettings()


@dataclass(frozen=True, eq=False)
class Inferred:
    """A refined maximum with its information, profile intervals and rival maxima."""

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
    """The maximum with its uncertainty, on surfaces that hold at the interval ends too."""
    refinement = Refinement(answer.question, ledger)
    for widened in range(UNCERTAINTY.wider + 1):
        with ledger.stage("inference"):
            end, found, inference, profile = inferred(
                answer.maximum, answer.search_result, answer.possible
            )
            answer = replace(answer, maximum=end, search_result=found)
        if answer.surfaces is None or widened == UNCERTAINTY.wider:
            break
        spread = refinement.spread(answer, inference, profile.intervals)
        if spread is None:
            break
        answer = spread
    with ledger.stage("inference"):
        rivals = _rivals(answer, inference) or _followed_rivals(answer, inference)
    return Inferred(answer, inference, profile, rivals)


def inferred(
    end: Maximum, found: SearchResult, others: Sequence[Array] = ()
) -> tuple[Maximum, SearchResult, Inference, Profile]:
    """The information and the profile intervals, with as few nodes as each end needs.

    `others` (K,) are lower optima, whose hills the profiles may go over.
    """
    for _ in range(UNCERTAINTY.climbs):
        before = end
        end, inference = _informed(end)
        likelihood, alpha = end.likelihood, end.alpha
        if inference.positive and inference.edm > UNCERTAINTY.enough:
            # with the information itself, which a search on a flat top has not learned
            alpha = ascend(
                likelihood.followed, alpha, likelihood.hyperparameters, inference.identified,
                inference.information,
            )[0]  # fmt: skip
            inference = infer(likelihood.followed, alpha, likelihood.hyperparameters)
            end = replace(end, alpha=alpha, likelihood=likelihood.adapted(alpha))
        if end is not before:
            found = found.moved(alpha, end.value)
        profile = _profiled(end, alpha, inference, others)
        if profile.better is None:
            break
        others = (alpha, *others)
        end = with_enough_nodes(likelihood, profile.better)
        found = found.improved(end.alpha, end.likelihood(end.alpha), inference.identified)
    return end, found, inference, profile


def _rivals(answer: Refined, inference: Inference) -> tuple[Rival, ...]:
    """Other optima of the search that are maxima: the climb arrived, inside the limits.

    With panels of two variates, where a climb costs most, only optima that were climbed to with
    panels count. Cost: some tens of evaluations for each, with no more nodes than a search takes.
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
    """The maxima among those optima that were followed with surfaces of their own."""
    end, kept = answer.maximum, list[Rival]()
    for other in answer.others:
        if not inference.among(other.alpha, [end.alpha], WITH_NOISE.apart):
            drop = end.value - other.value
            kept += _maximum(other.likelihood, other.alpha, drop, end.alpha, inference)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def _maximum(
    likelihood: AnyLikelihood, alpha: Array, drop: float, here: Array, inference: Inference
) -> list[Rival]:
    """The optimum alpha as a rival of `here` (K,), if it is a maximum; it is lower by `drop`."""
    about = infer(likelihood.followed, alpha, likelihood.hyperparameters)
    stuck = [a for a, b in zip(about.at_bound, inference.at_bound, strict=True) if a and a != b]
    if stuck or not about.positive or not about.edm < ESTIMATES.edm or not np.isfinite(drop):
        return []
    sizes = np.abs(inference.differences(alpha, here))
    moved = tuple(int(k) for k in np.flatnonzero(np.nan_to_num(sizes) > 1.0))
    return [Rival(alpha, here, drop, moved)]


def _informed(end: Maximum) -> tuple[Maximum, Inference]:
    """The information at an answer; at a saddle, of the maximum beside it.

    Where the top is flat, differences of the score may say falsely that it bends upward. If the
    likelihood is not higher a standard error away, the outer products of the scores give the
    information in their place, provided that they determine all of it.
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
    """The highest point along the direction that bends upward; None if the answer is higher."""
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


def _profiled(end: Maximum, alpha: Array, inference: Inference, rivals: Sequence[Array]) -> Profile:
    """Profile intervals by few nodes, and by more of them where these change an end.

    The individual laws at an end differ from those at the answer, and may need more nodes. An end
    whose drop the finest nodes still change is not reported.
    """
    likelihood = end.likelihood
    if end.coarse is None or not isinstance(likelihood, IndividualLikelihood):
        return profile_intervals(
            likelihood.continued, alpha, likelihood.hyperparameters, inference, rivals=rivals
        )
    if likelihood.parameters is not None:
        same = end.coarse.rule == likelihood.rule
        few = likelihood if same else likelihood.by(end.coarse.rule, alpha)
        return _by_held(few, alpha, inference, rivals)
    many = likelihood.nodes.xi.shape[1] > UNCERTAINTY.dear
    found = profile_intervals(
        end.coarse.continued, alpha, likelihood.hyperparameters, inference, rivals=rivals
    )
    if found.better is not None:
        return found
    least = UNCERTAINTY.unknown if many else UNCERTAINTY.differs
    found = _anew(likelihood, alpha, found, least, inference, rivals)
    if many:
        return found
    finer = _finer(likelihood, alpha)
    if finer is None or found.better is not None:
        return found
    if finer.nodes.xi.shape[1] > UNCERTAINTY.dear:
        return found.masked(_off(finer, alpha, found, UNCERTAINTY.unknown))
    again = _anew(finer, alpha, found, UNCERTAINTY.unknown, inference, rivals)
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
    rivals: Sequence[Array],
) -> Profile:
    """The profile with those ends sought again whose drop these nodes change by `least`."""
    higher = _climbed_on(likelihood, found, inference)
    rows = np.flatnonzero(np.any(_off(likelihood, alpha, higher, least), axis=1))
    if not rows.size:
        return found
    objective, hyperparameters = likelihood.continued, likelihood.hyperparameters
    again = profile_intervals(
        objective, alpha, hyperparameters, inference, rows, rivals, higher.points
    )
    return found.joined(again, rows)


def _climbed_on(likelihood: IndividualLikelihood, found: Profile, inference: Inference) -> Profile:
    """The profile with the conditional maxima at its ends by this likelihood."""
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
    """The likelihood by more nodes about one mode or by finer panels; None if there is none."""
    if likelihood.rule.centers > 1:
        return None
    rules = likelihood.rule.finer(likelihood.inputs.scattering)
    return likelihood.by(rules[0], alpha) if rules else None


def _off(likelihood: IndividualLikelihood, alpha: Array, profile: Profile, least: float) -> Flags:
    """Which ends (K, 2) have a drop that this likelihood changes by `least` or more."""
    top = likelihood.adapted(alpha).evaluate(alpha).total
    wrong = np.zeros(profile.drops.shape, dtype=np.bool_)
    for k, side in np.argwhere(profile.drops > 0.0):
        point = profile.points[k, side]
        drop = top - likelihood.adapted(point).evaluate(point).total
        wrong[k, side] = not abs(drop - profile.drops[k, side]) < least
    return wrong


def _by_held(
    likelihood: IndividualLikelihood, alpha: Array, inference: Inference, rivals: Sequence[Array]
) -> Profile:
    """Profile intervals by nodes fixed as parameters, which cost more than a profile.

    The nearest nodes in law are used. Nodes adapted to an end verify its drop; where the drop is
    wrong, the end is sought again with these nodes added.
    """
    objective, found = likelihood.continued, Profile.unknown_ends(alpha.size)
    for k in inference.identified:
        row = _row_by_held(objective, likelihood, alpha, inference, rivals, np.array([k]))
        found = found.joined(row, np.array([k]))
        if found.better is not None:
            break
    return found


def _row_by_held(
    objective: Following,
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    rivals: Sequence[Array],
    only: Indices,
) -> Profile:
    """The interval of one hyperparameter; a better maximum must be confirmed by own nodes."""
    hyperparameters, top = likelihood.hyperparameters, likelihood.evaluate(alpha).total
    off, about = np.full((alpha.size, 2), np.inf), None
    for _ in range(UNCERTAINTY.adapted):
        found = profile_intervals(objective, alpha, hyperparameters, inference, only, rivals, about)
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
    """The log-likelihood at a point (K,) with nodes adapted near it, which are remembered."""
    own = objective.nearest(point)
    if own.distance(point) > NODE_ACCURACY.close:
        own = likelihood.adapted(point)
        objective.remember(own)
    return own.evaluate(point).total
