"""The smallest and the largest value of a prediction that bounds and experiments leave possible.

A hyperparameter b that is only bounded has no probability (see `Between`). For each b the others
are identified again: alpha(b) is the conditional maximum of the likelihood. A prediction then lies
between its smallest and its largest value over all b that the experiments do not rule out, which
are those whose log L(alpha(b)) is at most chi2_1(0.95)/2 = 1.92 below the highest one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np
from scipy import optimize
from scipy.stats import qmc

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Indices
from aleator.inference.fit import Fit, positive
from aleator.inference.profile import DROP
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import Scored
from aleator.search.newton import ascended, outer

Statistic = Callable[[Array], Array]
"""A function of alphas (A, K): T predictions of interest (A, T) under each of the laws."""


@dataclass(frozen=True)
class ExtremeSettings:
    """Settings of the search for extremes. The values are chosen by judgement.

    `tests/inference/test_extremes.py` compares the results with exact ones.
    """

    corners: int = 64
    """The largest number of corners of the bounds where every search begins; all of up to six
    bounded hyperparameters."""
    inside: int = 4
    """The number of points inside the bounds where every search begins is two to this power."""
    step: float = 0.05
    """The step of numerical derivatives, as a share of the width of the bounds, or of a standard
    error."""
    still: float = 1e-3
    """The change of a prediction at which its search ends, divided by its steepest derivative."""
    most: int = 30
    """The largest number of points of a search. Predictions from finite samples are not quite
    smooth, so that a search may not end by itself."""
    slack: float = 0.02
    """The excess of the drop in log-likelihood over 1.92 that counts as zero."""
    lost: float = 1e3
    """The drop in log-likelihood that a search sees where the likelihood is zero."""


EXTREMES = ExtremeSettings()


@dataclass(frozen=True, eq=False)
class Conditional:
    """The maximum of the likelihood at values of the bounded hyperparameters: `alpha` (K,).

    `value` is its log-likelihood, `score` (K,) the derivative, and `left` the gain that is left.
    """

    alpha: Array
    value: float
    score: Array
    left: float


@dataclass(frozen=True, eq=False)
class PossibleAlphas:
    """The values of alpha (K,) that bounds, and the experiments of a `fit`, leave possible.

    `center` (K,) has the bounded hyperparameters at their starts. Without a fit all others keep
    their values. Conditional maxima are computed once and kept.
    """

    hyperparameters: tuple[Hyperparameter, ...]
    center: Array
    fit: Fit | None = None
    settings: ExtremeSettings = EXTREMES
    _found: dict[tuple[float, ...], Conditional] = field(default_factory=dict, repr=False)

    @cached_property
    def bounded(self) -> Indices:
        """The indices (d,) of the hyperparameters that are only bounded."""
        return np.flatnonzero([h.bounded for h in self.hyperparameters])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The lower and the upper bounds (d,)."""
        return limits_of(self.hyperparameters, self.bounded)

    @cached_property
    def moving(self) -> Indices:
        """The indices of the hyperparameters that are identified again for each bounded value."""
        return np.zeros(0, np.intp) if self.fit is None else self.fit.inference.identified

    @cached_property
    def objective(self) -> Scored | None:
        """The log-likelihood of the experiments; None without."""
        return None if self.fit is None else self.fit.objective()

    def share(self, alpha: Array) -> Array:
        """The bounded values of alpha (K,) as shares (d,) of the width of their bounds."""
        lower, upper = self.bounds
        return np.asarray((alpha[self.bounded] - lower) / (upper - lower))

    def conditional(self, share: Array) -> Conditional:
        """The maximum of the likelihood at bounded values, as shares (d,) of the bounds' width."""
        key = tuple(share.tolist())
        if key not in self._found:
            self._found[key] = self._climbed(share)
        return self._found[key]

    def _climbed(self, share: Array) -> Conditional:
        alpha = self.center.copy()
        if self._found:
            apart = np.abs(np.array([*self._found]) - share).sum(axis=1)
            alpha = [*self._found.values()][int(np.argmin(apart))].alpha.copy()
        lower, upper = self.bounds
        alpha[self.bounded] = lower + share * (upper - lower)
        if self.fit is None or self.objective is None:
            return Conditional(alpha, 0.0, np.zeros(alpha.size), 0.0)
        information = positive(self.fit.inference.information)
        end = ascended(self.objective, alpha, self.hyperparameters, self.moving, information)
        return Conditional(end.alpha, end.value, end.score, end.gain)

    @cached_property
    def starts(self) -> tuple[Array, ...]:
        """Shares (d,) where searches begin: the center, corners, points inside, and the best."""
        d, most = self.bounded.size, self.settings.corners
        if 2**d <= most:
            corners = np.array([*product((0.0, 1.0), repeat=d)])
        else:
            corners = (qmc.Sobol(d, rng=0).random(most) > 0.5).astype(float)
        first = [self.share(self.center), *corners]
        if d:
            first += [*qmc.Sobol(d, rng=1).random_base2(self.settings.inside)]
        return (*first, self._highest(first))

    def _highest(self, first: Sequence[Array]) -> Array:
        """The shares (d,) of highest likelihood, reached from the best of the `first` ones."""
        best = max((self.conditional(share) for share in first), key=lambda one: one.value)
        if self.objective is None:
            return first[0]
        every = np.union1d(self.moving, self.bounded)
        scores = self.objective(best.alpha).scores
        assert scores is not None
        information = outer(scores[:, every])
        end = ascended(self.objective, best.alpha, self.hyperparameters, every, information)
        return self.share(end.alpha)

    @cached_property
    def best(self) -> Conditional:
        """The conditional maximum of highest likelihood; without experiments at the center."""
        return max((self.conditional(share) for share in self.starts), key=lambda one: one.value)

    def pinned(self, k: int, value: float) -> PossibleAlphas:
        """The values of alpha that are left when the bounded hyperparameter k becomes known."""
        known, center = list(self.hyperparameters), self.center.copy()
        known[k] = replace(known[k], lower=value, upper=value, start=value)
        center[k] = value
        return replace(self, hyperparameters=tuple(known), center=center, _found={})


@dataclass(frozen=True, eq=False)
class Extremes:
    """The smallest and the largest values (T,) of T predictions, and alpha (T, K) at each.

    `left` is the largest gain in log-likelihood that was left at one of the conditional maxima.
    """

    lower: Array
    upper: Array
    at_lower: Array
    at_upper: Array
    left: float = 0.0


def extremes(
    possible: PossibleAlphas, statistic: Statistic, progress: Progress | None = None
) -> Extremes:
    """The extremes over the bounded hyperparameters, the others identified again at each value.

    lower = min over b of s(alpha(b)), upper the maximum, over all b within the bounds whose
    log L(alpha(b)) is at most 1.92 below the highest. The searches (sequential quadratic
    programming) begin at corners of the bounds and inside them; all points that were met count.
    A maximum between these that no search climbs is missed. Cost: some evaluations of the
    likelihood for each point, no runs but those of the statistic.
    """
    search = _ExtremeSearch(_BoundedOnly(possible), statistic, possible.settings)
    search.look(possible.starts)
    return search.ended(progress)


def extremes_with_uncertainty(
    possible: PossibleAlphas,
    statistic: Statistic,
    begun: Extremes,
    progress: Progress | None = None,
) -> Extremes:
    """The extremes over all alpha whose log-likelihood is at most 1.92 below the highest.

    Identified and bounded hyperparameters move together. Where the bounded ones are known, the
    result is the profile-likelihood interval (95 %) of the prediction (Wilks, 1938). The searches
    begin at the extremes `begun` of the bounded ones alone.
    """
    domain = _AllOpen(possible)
    search = _ExtremeSearch(domain, statistic, possible.settings)
    search.look([domain.place(alpha) for alpha in (*begun.at_lower, *begun.at_upper)])
    return search.ended(progress)


class _Domain(Protocol):
    """Coordinates v (n,) of alphas, between `lower` and `upper` (n,)."""

    lower: Array
    upper: Array

    def alpha(self, v: Array) -> Array:
        """The alpha (K,) at coordinates v."""

    def drop(self, v: Array) -> tuple[float, Array, float]:
        """The drop of the log-likelihood, its derivative (n,), and the gain left of a maximum."""


class _BoundedOnly:
    """Coordinates: the bounded hyperparameters, as shares of the width of their bounds."""

    def __init__(self, possible: PossibleAlphas) -> None:
        self.possible = possible
        self.lower, self.upper = np.zeros(possible.bounded.size), np.ones(possible.bounded.size)
        self.width = possible.bounds[1] - possible.bounds[0]

    def alpha(self, v: Array) -> Array:
        return self.possible.conditional(v).alpha

    def drop(self, v: Array) -> tuple[float, Array, float]:
        # The slope of a profile is the score of what is held fixed (envelope theorem).
        found = self.possible.conditional(v)
        slope = -found.score[self.possible.bounded] * self.width
        return self.possible.best.value - found.value, slope, found.left


class _AllOpen:
    """Coordinates: all hyperparameters that are not known, in standard errors or bounds' widths."""

    def __init__(self, possible: PossibleAlphas) -> None:
        assert possible.fit is not None
        self.possible = possible
        self.moving = np.concatenate([possible.moving, possible.bounded])
        low, high = limits_of(possible.hyperparameters, self.moving)
        curved = np.diag(positive(possible.fit.inference.information))
        self.scale = high - low
        self.scale[: curved.size] = np.minimum(self.scale[: curved.size], 1.0 / np.sqrt(curved))
        self.base = possible.center
        self.lower = (low - self.base[self.moving]) / self.scale
        self.upper = (high - self.base[self.moving]) / self.scale

    def place(self, alpha: Array) -> Array:
        """The coordinates of alpha (K,)."""
        return np.asarray((alpha - self.base)[self.moving] / self.scale)

    def alpha(self, v: Array) -> Array:
        found = self.base.copy()
        found[self.moving] += v * self.scale
        return np.clip(found, *limits_of(self.possible.hyperparameters))

    def drop(self, v: Array) -> tuple[float, Array, float]:
        assert self.possible.objective is not None
        found = self.possible.objective(self.alpha(v))
        return self.possible.best.value - found.total, -found.score[self.moving] * self.scale, 0.0


@dataclass(frozen=True, eq=False)
class _Seen:
    """A point of a search: alpha (K,), its drop with derivative (n,), and the statistic (T,)."""

    alpha: Array
    drop: float
    slope: Array
    left: float
    values: Array


class _ExtremeSearch:
    """Searches for the extremes of T predictions that share all points that they meet."""

    def __init__(self, domain: _Domain, statistic: Statistic, settings: ExtremeSettings) -> None:
        self.domain, self.statistic, self.settings = domain, statistic, settings
        self._most = DROP + settings.slack
        self.seen: dict[bytes, _Seen] = {}
        self.slopes: dict[bytes, Array] = {}

    def look(self, points: Sequence[Array]) -> None:
        """Compute the statistic at points (n,) that were not met before, all at once."""
        new = {v.tobytes(): v for v in points if v.tobytes() not in self.seen}
        if not new:
            return
        alphas = np.stack([self.domain.alpha(v) for v in new.values()])
        values = self.statistic(alphas)
        for (key, v), alpha, own in zip(new.items(), alphas, values, strict=True):
            drop, slope, left = self.domain.drop(v)
            if not (np.isfinite(drop) and np.isfinite(slope).all()):
                drop, slope = self.settings.lost, np.zeros(v.size)
            self.seen[key] = _Seen(alpha, drop, slope, left, own)

    def at(self, v: Array) -> _Seen:
        """The point at coordinates v (n,), moved into the limits."""
        inside = np.clip(v, self.domain.lower, self.domain.upper)
        self.look([inside])
        return self.seen[inside.tobytes()]

    def slope(self, v: Array) -> Array:
        """The derivatives (n, T) of the statistic at v (n,), by differences within the limits."""
        v = np.clip(v, self.domain.lower, self.domain.upper)
        key = v.tobytes()
        if key not in self.slopes:
            steps = self.settings.step * np.eye(v.size)
            up, down = (
                np.clip(v + sign * steps, self.domain.lower, self.domain.upper)
                for sign in (1.0, -1.0)
            )
            values = self.statistic(np.stack([self.domain.alpha(point) for point in (*up, *down)]))
            apart = np.sum(up - down, axis=1)
            self.slopes[key] = (values[: v.size] - values[v.size :]) / apart[:, None]
        return self.slopes[key]

    def ended(self, progress: Progress | None) -> Extremes:
        """The extremes of every prediction, each sought from the best point met so far."""
        shown = progress or Silent()
        size = next(iter(self.seen.values())).values.size
        signs = (1.0, -1.0) if self.domain.lower.size else ()
        ends = [(t, sign) for t in range(size) for sign in signs]
        for done, (t, sign) in enumerate(ends):
            shown.update(f"bound {done + 1} of {len(ends)}", done, len(ends))
            self._minimize(t, sign)
        lower, upper = ([self._best(t, sign) for t in range(size)] for sign in (1.0, -1.0))
        return Extremes(
            np.array([one.values[t] for t, one in enumerate(lower)]),
            np.array([one.values[t] for t, one in enumerate(upper)]),
            np.stack([one.alpha for one in lower]),
            np.stack([one.alpha for one in upper]),
            max(one.left for one in (*lower, *upper)),
        )

    def _best(self, t: int, sign: float) -> _Seen:
        """The point not ruled out where prediction t, times the sign, is smallest."""
        inside = [one for one in self.seen.values() if one.drop <= self._most]
        values = [sign * one.values[t] for one in inside]
        return inside[int(np.argmin(np.where(np.isnan(values), np.inf, values)))]

    def _minimize(self, t: int, sign: float) -> None:
        best = self._best(t, sign)
        start = np.frombuffer(next(key for key, one in self.seen.items() if one is best))
        steep = float(np.abs(self.slope(start)[:, t]).max())
        if not 0.0 < steep < np.inf:
            return
        left = self.settings.most

        def value(v: Array) -> float:
            nonlocal left
            if left == 0:
                raise _Ended
            left -= 1
            return sign * float(self.at(v).values[t]) / steep

        with suppress(_Ended):
            optimize.minimize(
                value,
                start,
                jac=lambda v: sign * self.slope(v)[:, t] / steep,
                bounds=optimize.Bounds(self.domain.lower, self.domain.upper),
                constraints={
                    "type": "ineq",
                    "fun": lambda v: DROP - self.at(v).drop,
                    "jac": lambda v: -self.at(v).slope,
                },
                method="SLSQP",
                options={"ftol": self.settings.still},
            )


class _Ended(Exception):
    """Raised to end a search."""
