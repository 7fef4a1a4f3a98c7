"""Laws defined by their density and quantile function alone, and mixtures of laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from scipy import optimize, special
from scipy.optimize import elementwise

from aleator.core.polynomials import gauss_legendre
from aleator.core.types import Array, Indices
from aleator.errors import InputsError, described
from aleator.laws.hyperparameter import (
    OPEN,
    Free,
    Hyperparameter,
    Specification,
    limits_of,
    resolve,
    within,
)
from aleator.laws.law import (
    NUMERICS,
    Law,
    MeanSd,
    Standard,
    ThroughNormal,
    by_distinct,
    difference,
    from_tails,
    require_law,
    slope,
    to_score,
)


@dataclass(frozen=True)
class QuantilePoints:
    """Settings for laws computed from their quantile function, and for mixtures.

    The values are chosen by tests/laws and tests/extensions; theta is the standard normal score.
    count: the number of quadrature points in theta for expectations. widest: these points cover
    -widest to widest, for moments of long tails. deepest: the largest normal score that is sought
    when a quantile function is inverted. halvings: the number of bisections for it. least: a share
    of a mixture that is this small counts as zero.
    """

    count: int = 400
    widest: float = 14.0
    deepest: float = 40.0
    halvings: int = 60
    least: float = 1e-6


POINTS = QuantilePoints()


class QuantileLaw(ThroughNormal, ABC):
    """Base class of laws defined by `hyperparameters`, `log_density` and `quantile` alone.

    x = F^-1(Phi(theta)) with theta ~ N(0, 1). Expectations are integrals over theta with 400
    points. Derivatives by the hyperparameters are central differences of fourth order. Their step
    is 1e-3 of the value for a positive hyperparameter, and 1e-3 of the width of the limits for any
    other; for a fixed one it is 1e-3 of its magnitude, or 1e-3 if it is zero. The law must exist up
    to two steps beyond the limits and beyond fixed values. For Weibull laws the mean, the sd and
    their derivatives have errors of 1e-11. A subclass may override `upper_quantile` where it can
    compute the upper tail exactly, and `box` and `bounded` where its support is known. It costs
    about ten times as much as a law in closed form.

    >>> from dataclasses import dataclass
    >>> from aleator.laws.hyperparameter import resolve
    >>> @dataclass(frozen=True)
    ... class Exponential(QuantileLaw):
    ...     scale: float
    ...     @property
    ...     def hyperparameters(self):
    ...         return (resolve("scale", self.scale, (None, None), positive=True),)
    ...     def log_density(self, values, x):
    ...         return np.where(x < 0.0, -np.inf, -x / values[0] - np.log(values[0]))
    ...     def quantile(self, values, probability):
    ...         return -values[0] * np.log1p(-probability)
    >>> law, two = Exponential(2.0), np.array([2.0])
    >>> round(law.mean_and_sd(two).sd, 6), law.standard(two, np.zeros(1)).x.round(6).tolist()
    (2.0, [1.386294])
    """

    scatters = True

    def __post_init__(self) -> None:
        _ = self.hyperparameters

    @property
    @abstractmethod
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The law's hyperparameters with their limits, in the order of `values`."""

    @abstractmethod
    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log f(x) at each x (J,), minus infinity outside the support."""

    @abstractmethod
    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability (J,)."""

    def upper_quantile(self, values: Array, probability: Array) -> Array:
        """The value that is exceeded with each probability (J,).

        A subclass that overrides it keeps the digits of its upper tail.
        """
        return self.quantile(values, np.minimum(1.0 - probability, 1.0 - 2.0**-53))

    @property
    def box(self) -> tuple[float, float]:
        """The range of 1 - 2e-15 of the probability, of every law with values on limits."""
        limits = [(h.lower, h.upper) for h in self.hyperparameters]
        corners = [np.array(corner) for corner in product(*limits)]
        tail = np.array([NUMERICS.tail])
        lower = min(float(self.quantile(corner, tail)[0]) for corner in corners)
        return lower, max(float(self.upper_quantile(corner, tail)[0]) for corner in corners)

    @property
    def bounded(self) -> bool:
        """False: the range `box` is computed from quantiles and not stated by the user."""
        return False

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(F(x)), by bisection with the quantile function."""
        low, high = np.full(x.shape, -POINTS.deepest), np.full(x.shape, POINTS.deepest)
        for _ in range(POINTS.halvings):
            middle = 0.5 * (low + high)
            below = self._image(values, middle) < x
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        outside = ~np.isfinite(self.log_density(values, x))
        return np.asarray(np.where(outside, np.sign(low) * np.inf, 0.5 * (low + high)))

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta), with derivatives; one call for each distinct law."""
        return by_distinct(self._standard, values, theta)

    def _standard(self, values: Array, theta: Array) -> Standard:
        x = self._image(values, theta)
        dvalues = self._slopes(lambda at: self._image(at, theta), values)
        return Standard(x, slope(theta, self.log_density(values, x)), dvalues)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean and sd of the law with derivatives, by quadrature over the normal score."""
        mean, sd = self._moments(values).tolist()
        return MeanSd(mean, sd, *self._slopes(self._moments, values))

    def customary(self, values: Array) -> Mapping[str, float]:
        """The mean and the sd, which are no hyperparameters here."""
        mean, sd = self._moments(values).tolist()
        return {"mean": mean, "sd": sd}

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The values (k,) of the law whose mean and sd are as near to these as the limits admit."""
        start = np.array([h.start for h in self.hyperparameters])
        free = np.array([h.free for h in self.hyperparameters], dtype=bool)
        if not free.any():
            return start
        lower, upper = limits_of(self.hyperparameters, np.flatnonzero(free))
        scale = self._moments(start)[1] if sd is None else sd

        def away(at: Array) -> Array:
            values = start.copy()
            values[free] = at
            mean, own = self._moments(values)
            gaps = [(mean - center) / scale, 0.0 if sd is None else np.log(own / sd)]
            return np.array(gaps)

        margin = NUMERICS.step * (upper - lower)
        inside = np.clip(start[free], lower + margin, upper - margin)
        start[free] = optimize.least_squares(
            away, inside, bounds=(lower, upper), x_scale=upper - lower
        ).x
        return within(self.hyperparameters, start.tolist())

    def _image(self, values: Array, theta: Array) -> Array:
        return from_tails(
            theta, lambda p: self.quantile(values, p), lambda p: self.upper_quantile(values, p)
        )

    def _moments(self, values: Array) -> Array:
        """The mean and the sd of the law (2,), by quadrature in theta."""
        t, weights = gauss_legendre(POINTS.count)
        theta = POINTS.widest * t
        weights = weights * np.exp(-0.5 * theta**2)
        x = self._image(values, theta)
        mean = weights @ x / weights.sum()
        return np.array([mean, np.sqrt(weights @ (x - mean) ** 2 / weights.sum())])

    def _slopes(self, function: Callable[[Array], Array], values: Array) -> Array:
        """Numerical derivatives (..., k) by the hyperparameters of a function with values (...)."""
        columns = []
        for k, known in enumerate(self.hyperparameters):
            width = known.upper - known.lower or abs(known.start) or 1.0
            at = float(values[k])

            def moved(value: Array, k: int = k) -> Array:
                return function(np.concatenate([values[:k], [value], values[k + 1 :]]))

            columns.append(difference(moved, at, NUMERICS.step * (at if known.log else width)))
        return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class Mixture(QuantileLaw):
    """Mixture of laws, f(x) = sum_c w_c f_c(x) (McLachlan and Peel, 2000).

    `components` are two laws or more. A `Constant` is a point with the probability w_c; points
    alone are latent classes (nonparametric maximum likelihood of a law: Laird, 1978). `shares` has
    a number v_c in (0, 1) for every component except the last: the part of the probability not used
    by earlier components that component c takes. Thus w_1 = v_1, w_2 = v_2 (1 - v_1), and so on.
    Shares that are left out are identified. Hyperparameters are named by component: ``x.1.mean``,
    ``x.2.sd``, ``x.1.share``. The component of an experiment is not known; with measurement noise
    the likelihood is the sum over all components. Components of the same kind and limits can be
    exchanged: the likelihood has a maximum for each order, and `identify` reports the one in which
    the smallest location comes first. Raises InputsError for fewer than two components, a component
    that is a mixture itself, and a number of shares that is not one less than that of components.

    >>> from aleator.laws import Free, Normal
    >>> law = Mixture((Normal(Free(0, 1), 0.1), Normal(Free(1, 2), 0.1)))
    >>> [h.name for h in law.hyperparameters]
    ['1.mean', '1.sd', '2.mean', '2.sd', '1.share']
    >>> values = np.array([0.0, 0.1, 1.0, 0.1, 0.25])
    >>> law.quantile(values, np.array([0.125, 0.625])).round(6).tolist()    # the two medians
    [0.0, 1.0]
    """

    components: tuple[Law, ...]
    shares: tuple[Specification, ...] | None = None

    def __post_init__(self) -> None:
        given: object = self.components
        if not isinstance(given, Iterable) or isinstance(given, str):
            raise InputsError(
                f"the components of a mixture are {described(given)}",
                "give them in brackets: Mixture([Normal(...), Normal(...)])",
            )
        object.__setattr__(self, "components", tuple(self.components))
        if len(self.components) < 2:
            raise InputsError(
                f"a mixture needs two components or more, not {len(self.components)}",
                "add a law to components, or take the only one as the law",
            )
        for c, law in enumerate(self.components):
            require_law(law, f"component {c + 1} of a mixture")
            if isinstance(law, Mixture):
                raise InputsError(
                    f"component {c + 1} of a mixture is a mixture itself",
                    "give its components beside the others",
                )
        if self.shares is not None and len(self.shares) != len(self.components) - 1:
            raise InputsError(
                f"{len(self.components)} components need {len(self.components) - 1} shares, "
                f"not {len(self.shares)}: the last component has what is left",
                "leave shares out to identify them, or give one for each component but the last",
            )
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the components, then the shares."""
        numbered = enumerate(self.components, start=1)
        own = [h.named(str(c)) for c, law in numbered for h in law.hyperparameters]
        left = len(self.components) - 1
        shares = self.shares or (OPEN,) * left
        return (*own, *(_share(c, share, left + 1 - c) for c, share in enumerate(shares)))

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """The places of each component's hyperparameters and, last, the places of the shares."""
        sizes = [len(law.hyperparameters) for law in self.components]
        ends = np.cumsum([0, *sizes, len(self.components) - 1]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def placed(self) -> tuple[tuple[Law, slice], ...]:
        """Each component with the places of its hyperparameters."""
        return tuple(zip(self.components, self.parts[:-1], strict=True))

    @cached_property
    def points(self) -> tuple[int, ...]:
        """The numbers of the components that are points, with a probability and no density."""
        return tuple(c for c, law in enumerate(self.components) if not law.scatters)

    @property
    def box(self) -> tuple[float, float]:
        """The smallest interval that contains the ranges of all components."""
        boxes = [law.box for law in self.components]
        return min(low for low, _ in boxes), max(high for _, high in boxes)

    @property
    def bounded(self) -> bool:
        """Whether the user stated the ranges of all components."""
        return all(law.bounded for law in self.components)

    def log_weights(self, values: Array) -> tuple[Array, Array]:
        """The log weights log w (C, ...) at values (k, ...), and derivatives (C, k, ...) by these.

        >>> from aleator.laws import Normal
        >>> law = Mixture((Normal(0.0, 1.0),) * 3, shares=(0.5, 0.2))
        >>> np.exp(law.log_weights(np.array([0, 1, 0, 1, 0, 1, 0.5, 0.2]))[0]).round(6).tolist()
        [0.5, 0.1, 0.4]
        """
        v = values[self.parts[-1]]
        count = len(self.components)
        found = np.zeros((count, *v.shape[1:]))
        slopes = np.zeros((count, *values.shape))
        first = self.parts[-1].start
        for c in range(count):
            for b in range(min(c, count - 1)):
                found[c] += np.log1p(-v[b])
                slopes[c, first + b] = -1.0 / (1.0 - v[b])
            if c < count - 1:
                found[c] += np.log(v[c])
                slopes[c, first + c] = 1.0 / v[c]
        return found, slopes

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log sum_c w_c f_c(x); at a point, the log probability of the point."""
        log_w = self.log_weights(values)[0]
        own = np.stack([law.log_density(values[part], x) for law, part in self.placed])
        points = [*self.points]
        spread = np.delete(np.arange(len(own)), points)
        own[spread] = np.where(np.any(own[points] == 0.0, axis=0), -np.inf, own[spread])
        with np.errstate(divide="ignore"):
            found = special.logsumexp(own, axis=0, b=_beside(np.exp(log_w), x))
        return np.asarray(found)

    def probabilities(self, values: Array, x: Array) -> Array:
        """The probability (C, ...) of each component at x; NaN where the density is zero."""
        own = np.stack([law.log_density(values[part], x) for law, part in self.placed])
        with np.errstate(invalid="ignore", divide="ignore"):
            weighted = np.log(_beside(np.exp(self.log_weights(values)[0]), x)) + own
            return np.asarray(special.softmax(weighted, axis=0))

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(sum_c w_c F_c(x)), computed from the nearer tail."""
        return self._joined(values, self._scores(values, x))

    def normal_score_within(self, values: Array, c: int, theta: Array) -> Array:
        """The normal score Phi^-1(F(x-) + w Phi(theta)) at the point of component c.

        F jumps by w at the point, and theta is a standard normal variate on which x does not
        depend. With it the score of a random x is standard normal.
        """
        scores = self._scores(values, np.broadcast_to(values[self.parts[c]][0], theta.shape))
        scores[c] = theta
        return self._joined(values, scores)

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile, where the components' probabilities add up to this one, by root finding."""
        theta = special.ndtri(probability)
        return self._at(values, theta, self._point(values, theta))

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta) for `values` (k,), with derivatives.

        dx/dv_c = w_c f_c(x)/f(x) dx_c/dv_c for a value v_c of component c, where x_c is the
        quantile of that component at F_c(x); dx/dw_c = -F_c(x)/f(x) for a weight. At a point, x is
        the value of the point and does not depend on the shares.
        """
        flat = theta.ravel()
        point = self._point(values, flat)
        x = self._at(values, flat, point)
        found, dtheta = np.zeros((flat.size, values.size)), np.zeros(flat.size)
        for c in self.points:
            found[point == c, self.parts[c].start] = 1.0
        rows = point < 0
        found[rows], dtheta[rows] = self._slopes_between(values, flat[rows], x[rows])
        return Standard(
            x.reshape(theta.shape), dtheta.reshape(theta.shape), found.reshape(*theta.shape, -1)
        )

    def _slopes_between(self, values: Array, theta: Array, x: Array) -> tuple[Array, Array]:
        """The derivatives dx/dvalues (J, k) and dx/dtheta (J,), where x is not at a point."""
        log_w, log_slopes = self.log_weights(values)
        w, log_f = np.exp(log_w), self.log_density(values, x)
        scores = self._scores(values, x)
        found = np.zeros((theta.size, values.size))
        for c, (law, part) in enumerate(self.placed):
            share = w[c] * np.exp(law.log_density(values[part], x) - log_f)
            inside = share > 0.0
            own = law.standard(values[part], np.where(inside, scores[c], 0.0))
            found[:, part] = np.where(inside, share, 0.0)[:, None] * own.dvalues
            # The smaller tail keeps its digits. Either may be used: weight changes sum to zero.
            tail = np.where(theta < 0.0, special.ndtr(scores[c]), -special.ndtr(-scores[c]))
            found[:, self.parts[-1]] -= np.outer(
                tail * np.exp(-log_f) * w[c], log_slopes[c, self.parts[-1]]
            )
        return found, slope(theta, log_f)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean sum_c w_c m_c and the sd, with derivatives.

        The variance is sum_c w_c (s_c^2 + (m_c - mean)^2), with the components' means m_c and sds
        s_c.
        """
        log_w, slopes = self.log_weights(values)
        w, own = np.exp(log_w), [law.mean_and_sd(values[part]) for law, part in self.placed]
        mean = float(w @ [one.mean for one in own])
        away = np.array([one.mean for one in own]) - mean
        squares = np.array([one.sd for one in own]) ** 2 + away**2
        sd = float(np.sqrt(w @ squares))
        dmean, dvariance = (w * (away + mean)) @ slopes, (w * squares) @ slopes
        for c, part in enumerate(self.parts[:-1]):
            dmean[part] += w[c] * own[c].dmean
            dvariance[part] += 2.0 * w[c] * (own[c].sd * own[c].dsd + away[c] * own[c].dmean)
        return MeanSd(mean, sd, dmean, dvariance / (2.0 * sd) if sd else np.zeros(values.size))

    @cached_property
    def exchangeable(self) -> bool:
        """Whether the components are specified alike with free shares, and so can be exchanged."""
        shares = self.hyperparameters[self.parts[-1]]
        free = all(h.free and h.lower <= POINTS.least and h.prior is None for h in shares)
        return free and all(law == self.components[0] for law in self.components)

    def ordered(self, values: Array) -> Array:
        """The values of the same law with its components ordered by their first hyperparameters.

        >>> from aleator.laws import Normal
        >>> law = Mixture((Normal(Free(0, 2), 0.1), Normal(Free(0, 2), 0.1)))
        >>> law.ordered(np.array([1.5, 0.1, 0.5, 0.1, 0.25])).tolist()
        [0.5, 0.1, 1.5, 0.1, 0.75]
        """
        if not self.exchangeable:
            return values
        order = np.argsort([values[part.start] for part in self.parts[:-1]], kind="stable")
        w = np.exp(self.log_weights(values)[0])[order]
        left = 1.0 - np.concatenate([[0.0], np.cumsum(w)[:-2]])
        shares = np.clip(w[:-1] / np.maximum(left, POINTS.least), POINTS.least, 1.0 - POINTS.least)
        return np.concatenate([*(values[self.parts[c]] for c in order), shares])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """Values (k,) that place the components side by side about the center.

        The shares are at their starts.
        """
        count = len(self.components)
        parts = [_spread(law, center, sd, c, count) for c, law in enumerate(self.components)]
        shares = [h.start for h in self.hyperparameters[self.parts[-1]]]
        return np.concatenate([*parts, shares])

    def apart(self, x: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Values (k,) that place the components at groups of the points x (N,).

        Also returns the center (N,) of each point's group. The groups come from one step of k-means
        from random centers (k-means++, Arthur and Vassilvitskii, 2007), so that another random
        generator gives other groups.

        >>> from aleator.laws import Normal
        >>> law = Mixture((Normal(Free(0, 9), Free(0.01, 1)), Normal(Free(0, 9), Free(0.01, 1))))
        >>> x = np.array([1.0, 1.2, 1.4, 5.9, 6.1])
        >>> values, centers = law.apart(x, np.random.default_rng(1))
        >>> law.ordered(values).round(3).tolist(), centers.round(3).tolist()
        ([1.2, 0.163, 6.0, 0.1, 0.6], [1.2, 1.2, 1.2, 6.0, 6.0])
        """
        count = len(self.components)
        seeds = x[rng.integers(x.size, size=1)]
        while seeds.size < count:
            away = np.min((x[:, None] - seeds) ** 2, axis=1)
            share = away / away.sum() if np.any(away) else None
            seeds = np.append(seeds, rng.choice(x, p=share))
        label = np.argmin(np.abs(x[:, None] - np.sort(seeds)), axis=1)
        parts, left, shares, centers = [], x.size, [], np.sort(seeds)
        for c, law in enumerate(self.components):
            own = x[label == c]
            centers[c] = own.mean() if own.size else centers[c]
            parts.append(law.filling(float(centers[c]), float(np.std(own)) if own.size else None))
            shares.append(own.size / max(left, 1))
            left -= own.size
        values = np.concatenate([*parts, shares[:-1]])
        return within(self.hyperparameters, values.tolist()), centers[label]

    @cached_property
    def location(self) -> tuple[float, float]:
        """The smallest and the largest mean that any component may have."""
        ends = [_ends(law, None) for law in self.components]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def _scores(self, values: Array, x: Array) -> Array:
        """The normal scores (C, ...) of x under each component; infinite for a point component."""
        return np.stack(
            [
                law.normal_score(values[part], x)
                if law.scatters
                else np.where(x >= values[part][0], np.inf, -np.inf)
                for law, part in self.placed
            ]
        )

    def _joined(self, values: Array, scores: Array) -> Array:
        """The normal score (...) under the mixture, from scores (C, ...) under the components."""
        w = _beside(np.exp(self.log_weights(values)[0]), scores[0])
        below, above = (np.sum(w * special.ndtr(sign * scores), axis=0) for sign in (1.0, -1.0))
        return to_score(below, above)

    def _point(self, values: Array, theta: Array) -> Indices:
        """The point component at which the law's normal score jumps over theta (...), or -1."""
        found = np.full(theta.shape, -1)
        for c in self.points:
            x = values[self.parts[c]]
            scores = self._scores(values, x)
            same = [p for p in self.points if values[self.parts[p].start] == x[0]]
            scores[same] = -np.inf
            before = self._joined(values, scores)
            scores[same] = np.inf
            first = (theta > before) | (before == -np.inf)
            found[first & (theta <= self._joined(values, scores)) & (found < 0)] = c
        return found

    def _at(self, values: Array, theta: Array, point: Indices) -> Array:
        """The x whose normal score is theta, by root finding between the components' quantiles."""
        images = np.stack([law.standard(values[part], theta).x for law, part in self.placed])
        low, high = images.min(axis=0), images.max(axis=0)
        x = low.copy()
        for c in self.points:
            x[point == c] = values[self.parts[c].start]
        apart = (high > low) & (point < 0)

        def away(x: Array, wanted: Array) -> Array:
            return self.normal_score(values, x) - wanted

        if np.any(apart):
            bracket = (low[apart], high[apart])
            x[apart] = elementwise.find_root(away, bracket, args=(theta[apart],)).x
        return np.asarray(x)


def _share(c: int, share: Specification, left: int) -> Hyperparameter:
    """The hyperparameter for the share of component c, within (0, 1).

    Its default start is 1/`left`, where `left` is the number of components from c on.
    """
    if isinstance(share, Free) and share.start is None and share.lower is None:
        share = replace(share, start=1.0 / left)
    h = resolve(f"{c + 1}.share", share, (0.0, 1.0))
    if not (h.lower >= 0.0 and h.upper <= 1.0):
        raise InputsError(
            f"{h.name}: a share lies between 0 and 1, not between {h.lower:g} and {h.upper:g}",
            "give limits between 0 and 1",
        )
    lower, upper, start = np.clip(
        [h.lower, h.upper, h.start], POINTS.least, 1.0 - POINTS.least
    ).tolist()
    return replace(h, lower=lower, upper=upper, start=start)


def _spread(law: Law, center: float, sd: float | None, c: int, count: int) -> Array:
    """Values for component c of `count` components that are spread evenly about the center.

    They take up half of the range of the mean on either side of the center.
    """
    low, high = _ends(law, sd)
    share = (2.0 * c - (count - 1.0)) / (2.0 * count)
    beside = share * (high - center if share > 0.0 else center - low)
    return law.filling(center + beside, sd)


def _ends(law: Law, sd: float | None) -> tuple[float, float]:
    """The smallest and the largest mean that a law of this family may have."""
    low, high = (law.mean_and_sd(law.filling(end, sd)).mean for end in law.box)
    return low, high


def _beside(weights: Array, x: Array) -> Array:
    """The weights (C, ...) reshaped so that they broadcast against values (C, *x.shape)."""
    return weights.reshape(*weights.shape, *[1] * (x.ndim + 1 - weights.ndim))
