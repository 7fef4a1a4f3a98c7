"""Rules that place quadrature nodes in the individual law of each experiment.

The nodes lie about the modes, along a ridge of the density, or are importance points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import ClassVar

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.polynomials import hermite_recurrence, polished_rule
from aleator.core.types import Array, Indices
from aleator.likelihood.individual.modes import (
    MODES,
    DenseRule,
    IndividualLaws,
    ModeSettings,
    NodeRule,
    PlacedNodes,
    inner,
    modes,
)
from aleator.likelihood.individual.panels import Panels


@dataclass(frozen=True)
class RuleSettings:
    """Settings of the node rules: numbers and places of nodes. The values are chosen by judgement.

    `most_nodes`: the largest number of Gauss-Hermite nodes of an experiment. `finest`: the largest
    number for one variate; with more, weights are too small for floating-point numbers. `tie`: a
    small amount of information that is added to each variate, one more for each next variate, so
    that equally informed directions are not chosen by rounding errors. `points`: the first number
    of importance points of an experiment, also used for statistics of many replicates.
    `most_points`: the largest number of them. `wider`: the factor by which importance points spread
    wider than the curvature of an individual law suggests. `ridge_points` and `most_ridge_points`:
    the first and the largest number of points along a ridge. `least_probability`: the smallest
    distance of the probability of a point from zero and from one. `converging`: the ratio of
    successive errors below which more Gauss-Hermite nodes of one variate converge, so that they are
    preferred to a piecewise rule, which costs four times as much for each law (44 bearings with
    bounds: 5, 9, 15 and 20 nodes are off by 0.06, 0.007, 2e-4 and 5e-6; a kink halves the error at
    best). `modes`: the settings of modes.
    """

    most_nodes: int = 3000
    finest: int = 250
    tie: float = 1e-6
    points: int = 300
    most_points: int = 5_000
    wider: float = 1.3
    ridge_points: int = 64
    most_ridge_points: int = 4096
    least_probability: float = 1e-12
    converging: float = 0.2
    modes: ModeSettings = MODES


RULES = RuleSettings()


@dataclass(frozen=True)
class GaussHermite(NodeRule):
    """Gauss-Hermite nodes in each of s coordinates: `first` in the first, `others` in the others.

    The rule is exact where the integrand is the normal density to which the nodes are adapted,
    times a polynomial of degree 2 q - 1 in each coordinate with q nodes. The first coordinate is
    the one about which the observations say least, and it needs most nodes. Only the highest mode
    of an individual law is used, even if there are several.

    >>> GaussHermite(5, 3).nodes(2)[0].shape
    (15, 2)
    """

    name: ClassVar[str] = "Gauss-Hermite"
    first: int
    others: int | None = None
    settings: RuleSettings = field(default=RULES, repr=False)

    def at_least(self, count: int) -> GaussHermite:
        """This rule with at least `count` nodes in every coordinate."""
        others = None if self.others is None else max(self.others, count)
        return replace(self, first=max(self.first, count), others=others)

    def coordinate(self, i: int) -> tuple[Array, Array]:
        """Nodes t (q,) of coordinate i, and their log weights (q,); the weights sum to one."""
        return _line(self.first if i == 0 or self.others is None else self.others)

    def nodes(self, dimensions: int) -> tuple[Array, Array]:
        """All nodes t (J, s) of the product rule, and their log weights (J,)."""
        if dimensions == 0:
            return np.zeros((1, 0)), np.zeros(1)
        lines = [self.coordinate(i) for i in range(dimensions)]
        nodes = np.array(list(product(*(t for t, _ in lines))))
        return nodes, np.array(list(product(*(log_w for _, log_w in lines)))).sum(axis=1)

    def size(self, dimensions: int, /) -> int:
        """The number J of nodes of the product rule."""
        return int(np.prod([self.coordinate(i)[0].size for i in range(dimensions)]))

    def finer(self, dimensions: int, /) -> tuple[GaussHermite | Panels, ...]:
        """Finer rules, whose differences from this one estimate its error.

        For one variate they are a rule with more nodes, and a piecewise Gauss-Legendre rule
        (`Panels`). For several variates they are a rule with more nodes in the first coordinate,
        and one with more nodes in the others.
        """
        others = self.others or self.first
        whole = replace(self, others=others)
        in_first = replace(whole, first=_more(self.first))
        if dimensions < 2:
            return (in_first, Panels())[: 2 * dimensions]
        return (in_first, replace(whole, others=_more(others)))

    def refined(
        self, gaps: Sequence[float], enough: float, dimensions: int, /
    ) -> GaussHermite | Panels | None:
        """The next rule to use, if the differences `gaps` to the finer rules are too large.

        It has the numbers of nodes of those finer rules that differ by too much. For one variate it
        has more nodes as long as these converge to the piecewise Gauss-Legendre rule, and is that
        rule where they do not. None where all differences are small enough, or where there would be
        too many nodes.
        """
        pairs = list(zip(self.finer(dimensions), gaps, strict=True))
        if dimensions < 2:
            whole = self.gap(gaps, dimensions)
            near = max(enough, self.settings.converging * abs(whole))
            same = (rule for rule, gap in pairs if abs(gap - whole) <= near)
            return next(same) if abs(whole) > enough else None
        found = self
        for more, gap in pairs:
            if isinstance(more, GaussHermite) and abs(gap) > enough / len(gaps):
                found = replace(
                    found,
                    first=max(found.first, more.first),
                    others=max(found.others or found.first, more.others or 0),
                )
        most = max(found.first, found.others or 0)
        own = self.settings
        fits = found.size(dimensions) <= own.most_nodes and most <= own.finest
        return found if found != self and fits else None

    def gap(self, gaps: Sequence[float], dimensions: int, /) -> float:
        """The error estimate of this rule, from the differences `gaps` to the finer rules.

        For one variate it is the difference to the piecewise Gauss-Legendre rule, which leaves
        nothing out. For several variates it is the sum of all differences.
        """
        return float(gaps[-1] if dimensions == 1 else sum(gaps))

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Nodes xi (B, C J, s) about the highest mode of each class, and their log weights.

        The coordinates are w = Q' xi with the eigenvectors Q of the information at the mode; the
        coordinate with least information comes first. Directions with equal information are made
        distinct by the setting `tie`. One coordinate after the other gets a Gauss-Hermite rule. It
        is centered at the conditional mode w_i* given the coordinates before it, and its scale c_i
        follows from the information there:

            w_i = w_i*(t_1 .. t_(i-1)) + c_i(t_1 .. t_(i-1)) t_i,
            weight = w_j prod_i c_i phi(xi)/phi(t).

        The nodes thus follow a curved ridge of the density, as it occurs with fewer observations
        than parameters. Where the log-density is quadratic, the nodes are those of Liu and Pierce
        (1994).
        """
        highest = laws.modes
        z, information = highest.z[:, :, 0], highest.information[:, :, 0]
        s = z.shape[2]
        basis = np.linalg.eigh(information + self.settings.tie * np.diag(np.arange(s)))[1]
        log_weight = np.zeros(z.shape[:2])
        for i in range(s):
            # Nodes of the same mode are neighbors in the array.
            rest = np.repeat(basis, z.shape[1] // basis.shape[1], axis=1)[..., i:]
            left = np.linalg.inv(np.swapaxes(rest, -1, -2) @ information @ rest)
            scale = np.sqrt(left[..., 0, 0])
            # The other coordinates move with this one as in the conditional normal law.
            along = (rest @ (left[..., :, :1] / scale[..., None, None]))[..., 0]
            t, log_w = self.coordinate(i)
            z = _spread(z[:, :, None] + t[:, None] * along[:, :, None])
            of_rule = log_w + 0.5 * t**2
            log_weight = _spread((log_weight + np.log(scale))[:, :, None] + of_rule)
            if i < s - 1:
                whole = np.repeat(rest, t.size, axis=1)[..., 1:]
                own, classes = self.settings.modes, highest.z.shape[1]
                again = modes(laws.curved, z, whole, own.near, classes, own)
                z, information = again.z, again.information
        return PlacedNodes(z, log_weight - 0.5 * inner(z, z))


def _more(nodes: int) -> int:
    """The next larger number of nodes: 1.5 times as many, plus two."""
    return nodes + nodes // 2 + 2


@lru_cache
def _line(count: int) -> tuple[Array, Array]:
    # The weights need all their digits, because far out they are multiplied by exp(t^2/2).
    t, weights, _ = polished_rule(*hermite_recurrence(count), 2 * count - 2)
    return t[weights > 0.0], np.log(weights[weights > 0.0])


def _spread(values: Array) -> Array:
    """The values (B, P, q, ...) reshaped to (B, P q, ...)."""
    return values.reshape(values.shape[0], -1, *values.shape[3:])


@dataclass(frozen=True)
class ImportancePoints(NodeRule):
    """Quasi-random points of a mixture of normal laws (defensive importance sampling).

        int g phi dxi = 1/J sum_j g(xi_j) phi(xi_j)/q(xi_j),
        q = phi/2 + sum_m N(z_m, c^2 I_m^-1)/(2 M),

    with M modes z_m of g phi, the information I_m there, and c the setting `wider` (Hesterberg,
    1995). Densities with several modes, and densities that are not smooth, are integrated as well
    as any other. The error falls about as 1/J. Each experiment has its own points, so that errors
    of different experiments partly cancel.

    >>> ImportancePoints(60).size(2)
    60
    """

    name: ClassVar[str] = "importance points"
    holds_parameters: ClassVar[bool] = True
    count: int = RULES.points
    centers: int = 3
    settings: RuleSettings = field(default=RULES, repr=False)

    @property
    def rough(self) -> ImportancePoints:
        """The rule for statistics of many replicates, with at most 300 points."""
        return replace(self, count=min(self.count, self.settings.points))

    def size(self, _: int, /) -> int:
        """The number J of points, made a multiple of twice the number of modes."""
        return 2 * self.centers * _each(self.count, self.centers)

    def finer(self, _: int, /) -> tuple[ImportancePoints, ...]:
        """The finer rule with twice as many points, whose difference estimates the error."""
        return (replace(self, count=2 * self.count),)

    def refined(self, gaps: Sequence[float], enough: float, _: int, /) -> ImportancePoints | None:
        """The rule with twice as many points if integrals still differ too much, else None."""
        more = 2 * self.count
        needed = abs(gaps[0]) > enough and more <= self.settings.most_points
        return replace(self, count=more) if needed else None

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Points xi (B, C J, s) about the M modes of each class, and their log weights."""
        z = laws.modes.z
        shift = np.arange(laws.first, laws.first + len(z))
        own = laws.modes.information
        return PlacedNodes(*proposed(z, own, self.count, shift, self.settings.wider))


@lru_cache
def standard_points(count: int, dimensions: int) -> Array:
    """Points (count, s) of the standard normal law: a Sobol' sequence, or in 1-D midpoints."""
    points = _normal(_uniform(count, dimensions))
    points.flags.writeable = False  # All callers share it.
    return points


def proposed(
    modes: Array,
    information: Array,
    count: int,
    shift: Indices | None = None,
    wider: float = RULES.wider,
) -> tuple[Array, Array]:
    """Importance points xi (B, C J, s), half of them about modes, and log weights (B, C J).

    The other half are points of the standard normal law. `modes` (B, C, M, s) are M modes of each
    class, and `information` (B, C, M, s, s) is the curvature there. For the J points of each class
    sum_j exp(log_weight_j) g(xi_j) approximates int g(xi) phi(xi) dxi (see `ImportancePoints`).
    `shift` (B,) is the number of lattice steps in the unit cube by which the points of an
    experiment are shifted (Cranley and Patterson, 1976).
    """
    experiments, classes, centers, s = modes.shape
    each = _each(count, centers)
    half = each * centers
    t, own = shifted_points(half, s, shift)[:, None], shifted_points(each, s, shift)[:, None]
    root = wider * np.linalg.cholesky(np.linalg.inv(information))
    near = modes[:, :, None] + np.einsum("ncmst,ncjt->ncjms", root, own)
    law = np.broadcast_to(t, (experiments, classes, half, s))
    xi = np.concatenate([law, near.reshape(experiments, classes, half, s)], axis=2)
    log_law = -0.5 * inner(xi, xi)
    log_det = np.log(np.einsum("ncmss->ncms", root)).sum(axis=3)
    # The density of the mixture over that of the law, as one sum of exponentials.
    terms = np.empty((1 + centers, *log_law.shape))
    terms[0] = np.log(centers)
    for m in range(centers):
        away = xi - modes[:, :, None, m]
        curved = inner(away @ (information[:, :, m] / wider**2), away)
        terms[1 + m] = -0.5 * curved - log_det[:, :, m, None] - log_law
    top = terms.max(axis=0)
    log_ratio = top + np.log(np.sum(np.exp(terms - top), axis=0)) - np.log(2.0 * centers)
    log_weight = -log_ratio - np.log(2.0 * half)
    whole = classes * 2 * half
    return xi.reshape(experiments, whole, s), log_weight.reshape(experiments, whole)


def _each(count: int, centers: int) -> int:
    """The number of points about each mode, so that those of all modes are half of `count`."""
    return max(1, count // (2 * centers))


def _uniform(count: int, dimensions: int) -> Array:
    """Quasi-random points (count, s) of the unit cube: a Sobol' sequence, or in 1-D midpoints."""
    if dimensions <= 1:
        return ((np.arange(count) + 0.5) / count)[:, None][:, :dimensions]
    power = int(np.ceil(np.log2(count)))
    points = qmc.Sobol(dimensions, scramble=False).random_base2(power)[:count]
    return np.asarray(points + 0.5 / count)


def shifted_points(count: int, dimensions: int, shift: Indices | None) -> Array:
    """Standard normal points (B, count, s) with shifts (B,), or (1, count, s) without a shift."""
    if shift is None:
        return standard_points(count, dimensions)[None]
    # The lattice has the steps g^-1 to g^-s, where g is the root of g^(s+1) = g + 1 (Roberts,
    # 2018).
    g = 2.0
    # Each iteration gains at least one binary digit of g.
    for _ in range(np.finfo(np.float64).nmant):
        g = (1.0 + g) ** (1.0 / (dimensions + 1.0))
    steps = np.outer(shift, g ** -np.arange(1.0, dimensions + 1.0))
    return _normal((_uniform(count, dimensions) + steps[:, None]) % 1.0)


def _normal(u: Array, least: float = RULES.least_probability) -> Array:
    """The standard normal points Phi^-1(u) of points u in the unit cube."""
    return np.asarray(special.ndtri(np.clip(u, least, 1.0 - least)))


@dataclass(frozen=True)
class LawPoints(DenseRule):
    """Quasi-random points of the law itself, with different points for each experiment.

    int g phi dxi = 1/J sum_j g(xi_j). Values simulated at these points serve for any observations.
    The error is large where only a small part of the law explains an observation.
    """

    name: ClassVar[str] = "points of the law"
    count: int

    def size(self, _: int, /) -> int:
        """The number J of points."""
        return self.count

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Points xi (B, C J, s), J for each of C mixture components, and log weights (B, C J)."""
        experiments, classes, _, s = laws.modes.z.shape
        own = shifted_points(self.count, s, laws.first + np.arange(experiments))
        xi = np.tile(own, (1, classes, 1))
        return PlacedNodes(xi, np.full(xi.shape[:2], -np.log(self.count)))


@dataclass(frozen=True)
class RidgePoints(NodeRule):
    """Quasi-random points of a normal law that follows the ridge of an individual law.

    The observations determine the s variates in k directions, with coordinates b, and say next to
    nothing about the other directions, with coordinates a: the ridge. The coordinates a of the
    points follow a normal law with the curvature at the mode. The coordinates b follow a normal law
    about the conditional mode b*(a), with the curvature there:

        int g phi dxi = 1/J sum_j g(xi_j) phi(xi_j) / (N(a_j; a*, A) N(b_j; b*(a_j), C(a_j))).

    Where the log-density is quadratic, every term equals the integral. Where the ridge bends
    slowly, the terms differ little, for any number of variates and for any noise, however small.
    The error falls about as 1/J. Only the highest mode of an individual law is used.

    >>> RidgePoints(60).size(7)
    60
    """

    name: ClassVar[str] = "importance points along a ridge"
    count: int = RULES.ridge_points
    settings: RuleSettings = field(default=RULES, repr=False)

    @property
    def rough(self) -> RidgePoints:
        """The rule for statistics of many replicates, with at most 64 points."""
        return replace(self, count=min(self.count, self.settings.ridge_points))

    def size(self, _: int, /) -> int:
        """The number J of points."""
        return self.count

    def finer(self, _: int, /) -> tuple[RidgePoints, ...]:
        """The finer rule with twice as many points, whose difference estimates the error."""
        return (replace(self, count=2 * self.count),)

    def refined(self, gaps: Sequence[float], enough: float, _: int, /) -> RidgePoints | None:
        """The rule with twice as many points if integrals still differ too much, else None."""
        more = 2 * self.count
        needed = abs(gaps[0]) > enough and more <= self.settings.most_ridge_points
        return replace(self, count=more) if needed else None

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Points xi (B, C J, s) along the ridge through each class's highest mode, and log weights.

        The directions are the eigenvectors of the information at the mode. Points come in pairs
        that lie symmetrically on both sides of the ridge, so that random errors of a score across
        the ridge cancel.
        """
        mode, information = laws.modes.z[:, :, 0], laws.modes.information[:, :, 0]
        experiments, classes, s = mode.shape
        half, own = self.count // 2, self.settings.modes
        values, basis = np.linalg.eigh(information + self.settings.tie * np.diag(np.arange(s)))
        along = s - max(1, int((values > own.informed).sum(axis=2).max(initial=1)))
        t = shifted_points(half, s, laws.first + np.arange(experiments))[:, None]
        a = t[..., :along] / np.sqrt(values[:, :, None, :along])
        start = mode[:, :, None] + np.einsum("ncst,ncjt->ncjs", basis[..., :along], a)
        across = np.repeat(basis[..., along:], half, axis=1)
        ridge = modes(
            laws.curved, start.reshape(experiments, -1, s), across, own.near, classes, own
        )
        within = np.swapaxes(across, -1, -2) @ ridge.information @ across
        root = np.linalg.cholesky(np.linalg.inv(within))
        b = np.broadcast_to(t[..., along:], (experiments, classes, half, s - along))
        b = b.reshape(experiments, -1, s - along)
        step = (across @ root @ b[..., None])[..., 0]
        log_det = np.log(np.einsum("njss->njs", root)).sum(axis=2)
        log_det -= np.repeat(0.5 * np.log(values[..., :along]).sum(axis=2), half, axis=1)
        square = np.broadcast_to(inner(t, t), (experiments, classes, half))
        of_rule = log_det + 0.5 * square.reshape(log_det.shape) - np.log(2.0 * half)
        shape = (experiments, classes, half, s)
        sides = [(ridge.z + side * step).reshape(shape) for side in (1.0, -1.0)]
        xi = np.concatenate(sides, axis=2).reshape(experiments, -1, s)
        log_rule = np.tile(of_rule.reshape(shape[:3]), (1, 1, 2)).reshape(experiments, -1)
        return PlacedNodes(xi, log_rule - 0.5 * inner(xi, xi))


@dataclass(frozen=True, eq=False)
class Nodes:
    """Quadrature nodes: J standard normal variates xi (N, J, s) of each experiment, with weights.

    int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) over the nodes of each of C classes,
    which follow one after the other (see `Individual`); `log_weight` is (N, J). The nodes lie about
    the `modes` (N, C, M, s), the highest first; `information` (N, C, M, s, s) is the information
    there. `x` (N, C, n) are the parameters at the highest modes, under the alpha to which the nodes
    are adapted. It is None for nodes of the law itself. `shared` has the weights of variates that
    experiments share (see `PlacedNodes`).
    """

    xi: Array
    log_weight: Array
    modes: Array
    information: Array
    x: Array | None = None
    shared: Array | None = None

    @classmethod
    def of_the_law(cls, count: int, classes: int, variates: int, rule: GaussHermite) -> Nodes:
        """The nodes of the standard normal law, equal for all `count` experiments."""
        t, log_w = rule.nodes(variates)
        xi, log_weight = np.tile(t, (count, classes, 1)), np.tile(log_w, (count, classes))
        information = np.tile(np.eye(variates), (count, classes, 1, 1, 1))
        return cls(xi, log_weight, np.zeros((count, classes, 1, variates)), information)

    @classmethod
    def joined(
        cls, parts: Sequence[tuple[slice, PlacedNodes]], modes: Array, information: Array, x: Array
    ) -> Nodes:
        """The nodes of all N experiments from those of parts of them, about the given modes.

        The nodes are in the order of the classes, or of the nodes of shared variates. Experiments
        that need fewer nodes than others are filled up with nodes of weight zero.
        """
        count, classes, _, variates = modes.shape
        shared, first = None, parts[0][1].shared
        if first is not None:
            classes, shared = first[0].size, np.zeros((count, *first.shape[1:]))
        most = max(placed.xi.shape[1] for _, placed in parts) // classes
        nodes = np.zeros((count, classes, most, variates))
        log_weights = np.full((count, classes, most), -np.inf)
        for part, placed in parts:
            own = placed.xi.shape[1] // classes
            whole = (len(placed.xi), classes, own)
            nodes[part, :, :own] = placed.xi.reshape(*whole, variates)
            log_weights[part, :, :own] = placed.log_weight.reshape(whole)
            if shared is not None:
                shared[part] = placed.shared
        xi, log_weight = nodes.reshape(count, -1, variates), log_weights.reshape(count, -1)
        return cls(xi, log_weight, modes, information, x, shared)

    def peaks(self, count: int) -> tuple[Array, Array]:
        """The highest mode of each class, repeated `count` times, and the information there."""
        modes, information = self.modes[:, :, :1], self.information[:, :, :1]
        return np.repeat(modes, count, axis=2), np.repeat(information, count, axis=2)

    @property
    def mode(self) -> Array:
        """The highest modes (N, C, s)."""
        return np.asarray(self.modes[:, :, 0])
