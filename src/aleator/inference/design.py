"""The design of further experiments: the information of each, and the most informative set.

A `DesignPlan` computes the variances that remain after a set of experiments from the expected
information of each (`virtual_scores`), and `chosen` picks the set with the smallest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special
from scipy.optimize import brentq
from scipy.stats import qmc

from aleator.core.types import Array, Flags
from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of


@dataclass(frozen=True)
class DesignSettings:
    """Settings of plans and of the choice of sets, all chosen by judgement."""

    singular: float = 1e-9
    """Information along a direction, relative to that of all experiments together, that counts as
    zero.
    """
    floor: float = 1e-12
    """Value that replaces a zero information, so that candidates that leave fewer directions
    undetermined are preferred.
    """
    equal: float = 1e-6
    """Relative difference below which two variances count as equal."""
    sweeps: int = 50
    """Largest number of passes of exchanges through a set."""
    starts: int = 5
    """Number of candidates, the best single ones, from which a set is started."""
    most: float = 1e6
    """Number of repetitions above which the answer is that no number is enough."""
    seed: int = 5
    """Seed of the draws of alpha over which a plan is averaged."""
    edge: float = 1e-6
    """Distance from zero and one of the uniform numbers from which draws of alpha are made."""
    close: float = 1e-6
    """Tolerance of the computed number of repetitions."""


DESIGN = DesignSettings()


@dataclass(frozen=True, eq=False)
class DesignPlan:
    """Present information (A, F, F), and information (A, C, F, F) added by each of C candidates.

    Both belong to F hyperparameters, at A plausible values of alpha. The criterion to be made small
    is the variance of d' alpha, averaged over G directions d (A, G, F): c-optimality for one
    direction, A-optimality for several. With `directions` None it is det(I)^(-1/F), which measures
    the volume of the confidence ellipsoid: D-optimality (Atkinson, Donev and Tobias, 2007, chapter
    10). Variances are divided by `unit`. A candidate whose information is not finite is never
    chosen.
    """

    present: Array
    offered: Array
    directions: Array | None
    unit: float = 1.0
    settings: DesignSettings = DESIGN

    def relative(self) -> DesignPlan:
        """The plan with each variance divided by its present value, separately for each direction.

        The plan is unchanged for a single direction, and where a direction is undetermined at
        present.
        """
        if not self.determined(self.present):
            return self
        if self.directions is None:
            return replace(self, unit=float(self.variance(self.present)))
        if self.directions.shape[1] == 1:
            return self
        inverse = np.linalg.inv(self.present)
        now = np.einsum("agf,afh,agh->ag", self.directions, inverse, self.directions)
        return replace(self, directions=self.directions / np.sqrt(now)[..., None])

    def variance(self, information: Array) -> Array:
        """The criterion (...) for information (A, ..., F, F), averaged over the A values of alpha.

        It is large where a direction has no information, and infinite where the information is not
        finite.
        """
        values, vectors, finite = self._decomposed(information)
        values = np.maximum(values, self.settings.floor)
        if self.directions is None:
            each = np.exp(-np.mean(np.log(values), axis=-1))
            each = each * self._volume.reshape(-1, *[1] * (each.ndim - 1))
        else:
            along = np.einsum("agf,a...fh->a...gh", self._directions, vectors)
            each = np.mean(np.sum(along**2 / values[..., None, :], axis=-1), axis=-1)
        return np.asarray(np.where(finite, each, np.inf).mean(axis=0) / self.unit)

    def determined(self, information: Array) -> Flags:
        """Whether information (A, ..., F, F) determines all requested quantities, bool (...)."""
        values, vectors, finite = self._decomposed(information)
        nothing = values < self.settings.singular
        if self.directions is not None:
            along = np.einsum("agf,a...fh->a...gh", self._directions, vectors) ** 2
            share = along / np.maximum(along.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
            nothing = np.any((share > self.settings.singular) & nothing[..., None, :], axis=-2)
        return np.asarray(np.all(finite & ~np.any(nothing, axis=-1), axis=0))

    def standard_error(self, information: Array) -> Array:
        """The square root (...) of the criterion; infinite where a quantity is undetermined."""
        known = self.determined(information)
        return np.where(known, np.sqrt(self.variance(information)), np.inf)

    def _decomposed(self, information: Array) -> tuple[Array, Array, Flags]:
        """Eigenvalues and eigenvectors of the scaled information, and whether it is finite."""
        between = [1] * (information.ndim - 3)
        size = information.shape[-1]
        scaled = information * self._scale.reshape(-1, *between, size, size)
        finite = np.all(np.isfinite(scaled), axis=(-2, -1))
        values, vectors = np.linalg.eigh(np.where(finite[..., None, None], scaled, np.eye(size)))
        return values, vectors, finite

    @cached_property
    def _scale(self) -> Array:
        """Factors (A, F, F) that scale the information of all experiments to a unit diagonal."""
        offered = np.where(np.isfinite(self.offered), self.offered, 0.0)
        whole = np.diagonal(self.present + offered.sum(axis=1), axis1=1, axis2=2)
        scale = 1.0 / np.sqrt(np.maximum(whole, np.finfo(float).tiny))
        return np.asarray(scale[:, :, None] * scale[:, None, :])

    @cached_property
    def _directions(self) -> Array:
        assert self.directions is not None
        return np.asarray(self.directions * np.sqrt(self._diagonal)[:, None])

    @cached_property
    def _volume(self) -> Array:
        """The determinant of the diagonal scale factors, to the power 1/F, (A,)."""
        return np.asarray(np.exp(np.mean(np.log(self._diagonal), axis=1)))

    @property
    def _diagonal(self) -> Array:
        return np.diagonal(self._scale, axis1=1, axis2=2)


@dataclass(frozen=True)
class ChosenSet:
    """The chosen candidates by number, the most useful first, and the standard error after each.

    `ties` is, for each member, the number of other candidates that would be equally good in its
    place.
    """

    order: tuple[int, ...]
    after: tuple[float, ...]
    ties: tuple[int, ...]


def chosen(
    plan: DesignPlan, count: int, repeat: int = 1, settings: DesignSettings = DESIGN
) -> ChosenSet:
    """The best set of `count` candidates: built one by one, then improved by exchanges.

    Each member is exchanged for the candidate that is best in its place (Fedorov, 1972), until no
    exchange improves the set. The result is a local optimum, no worse than the set built one by
    one. The search is started from each of the five best candidates. A candidate may occur up to
    `repeat` times. Cost: 5 count C eigenvalue decompositions for each pass of exchanges.
    """
    every = [*range(plan.offered.shape[1])] * repeat
    first = np.argsort(_beside(plan, [], every[: plan.offered.shape[1]]), kind="stable")[
        : settings.starts
    ]
    ends = [
        _exchanged(plan, _greedy(plan, every, count, [start]), repeat, settings)
        for start in first.tolist()
    ]
    members = min(ends, key=lambda end: float(plan.variance(_sum(plan, end))))
    order = _greedy(plan, members, count)
    steps = np.stack([_sum(plan, order[: k + 1]) for k in range(count)], axis=1)
    after = plan.standard_error(steps)
    return ChosenSet(tuple(order), tuple(after.tolist()), _ties(plan, order, repeat, settings))


def repetitions(
    plan: DesignPlan, again: Array, goal: float, settings: DesignSettings = DESIGN
) -> float | None:
    """How often experiments with information `again` (F, F) must be made to reach an error `goal`.

    The number need not be whole. It is None where no number of repetitions reaches the goal.
    """

    def beyond(times: float) -> float:
        return float(plan.standard_error(plan.present + times * again)) - goal

    if not np.isfinite(goal) or not beyond(settings.most) < 0.0:
        return None
    return (
        0.0
        if beyond(0.0) <= 0.0
        else float(brentq(beyond, 0.0, settings.most, xtol=settings.close))
    )


def halved(plan: DesignPlan, added: Array, count: int) -> float | None:
    """How many experiments like `count` of them, with information `added` (A, F, F), halve the
    present error.

    Each counts as 1/`count` of the added information. None where no number is enough.
    """
    times = repetitions(plan, added, 0.5 * float(plan.standard_error(plan.present)))
    return None if times is None else times * count


def _greedy(
    plan: DesignPlan, among: Sequence[int], count: int, begin: Sequence[int] = ()
) -> list[int]:
    """`count` candidates, each the best in addition to those chosen before."""
    taken = [*begin]
    left = Counter(among) - Counter(taken)
    for _ in range(count - len(taken)):
        offered = [c for c, times in left.items() if times]
        best = offered[int(np.argmin(_beside(plan, taken, offered)))]
        taken.append(best)
        left[best] -= 1
    return taken


def _exchanged(
    plan: DesignPlan, members: list[int], repeat: int, settings: DesignSettings
) -> list[int]:
    members = [*members]
    value = float(plan.variance(_sum(plan, members)))
    for _ in range(settings.sweeps):
        before = value
        for place in range(len(members)):
            others = members[:place] + members[place + 1 :]
            left = _left(plan, others, repeat)
            found = _beside(plan, others, left)
            best = int(np.argmin(found))
            if found[best] < value * (1.0 - settings.equal):
                members[place], value = left[best], float(found[best])
        if value >= before * (1.0 - settings.equal):
            break
    return members


def _ties(
    plan: DesignPlan, order: list[int], repeat: int, settings: DesignSettings
) -> tuple[int, ...]:
    value, found = float(plan.variance(_sum(plan, order))), []
    for place, own in enumerate(order):
        others = order[:place] + order[place + 1 :]
        left = [c for c in _left(plan, others, repeat) if c != own]
        found.append(int(np.sum(_beside(plan, others, left) <= value * (1.0 + settings.equal))))
    return tuple(found)


def _left(plan: DesignPlan, others: list[int], repeat: int) -> list[int]:
    """The candidates that may still be chosen in addition to the other members."""
    taken = Counter(others)
    return [c for c in range(plan.offered.shape[1]) if taken[c] < repeat]


def _sum(plan: DesignPlan, members: list[int]) -> Array:
    return np.asarray(plan.present + plan.offered[:, members].sum(axis=1))


def _beside(plan: DesignPlan, members: list[int], candidates: list[int]) -> Array:
    """The criterion after these members together with each one of the candidates."""
    return plan.variance(_sum(plan, members)[:, None] + plan.offered[:, candidates])


def possible_laws(
    alpha: Array,
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    count: int,
    settings: DesignSettings = DESIGN,
) -> Array:
    """Values (A, K) of alpha drawn from the law of its estimates; for a count of one, alpha itself.

    The law is normal, with the covariance of the estimates. Points are quasi-random, and moved to
    the limits of the hyperparameters where they lie beyond.
    """
    if count < 2 or not inference.positive or not inference.free.size:
        return alpha[None]
    power = int(np.ceil(np.log2(count)))
    uniform = qmc.Sobol(inference.free.size, rng=settings.seed).random_base2(power)[:count]
    root = np.linalg.cholesky(inference.covariance)
    found = np.tile(alpha, (count, 1))
    found[:, inference.free] += (
        special.ndtri(np.clip(uniform, settings.edge, 1.0 - settings.edge)) @ root.T
    )
    return np.asarray(np.clip(found, *limits_of(hyperparameters)))
