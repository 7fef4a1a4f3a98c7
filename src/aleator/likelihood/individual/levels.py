"""Nodes of parameters that experiments share: specimens of a batch, batches of a supplier.

Experiments that share no parameter, directly or through others, are in different clusters. Where
groups are nested the experiments of a group are independent given its parameters b:

    L = int p(b) prod_l [ int p(y_l | b, x_l) p(x_l) dx_l ] db,

level by level, if there are several. The parameters of crossed groups are integrated together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.types import Array
from aleator.laws.levels import Grouping
from aleator.likelihood.individual.clusters import Clusters, log_sum
from aleator.likelihood.individual.modes import (
    MODES,
    Curved,
    IndividualLaws,
    Modes,
    ModeSettings,
    NodeRule,
    PlacedNodes,
)
from aleator.likelihood.individual.rules import (
    GaussHermite,
    standard_points,
)


@dataclass(frozen=True)
class SharedNodes:
    """Settings of the nodes of shared parameters, with which a search begins.

    `nodes`: the Gauss-Hermite nodes of each variate of nested groups; two give exact scores where
    the simulator is linear. `pairs`: the least number of pairs of points for crossed levels.
    `most_nodes` and `most_points`: the largest numbers of nodes of an experiment with nested and
    with crossed levels. Chosen by `pytest tests/likelihood/individual/test_levels.py`, and the
    largest numbers by judgement.
    """

    nodes: int = 5
    pairs: int = 32
    most_nodes: int = 3000
    most_points: int = 5000


SHARED = SharedNodes()


@dataclass(frozen=True, eq=False)
class Eliminated:
    """What experiments know of the groups of stage `depth`, with all finer variates at their best.

    `gradient` (G, P, width) and `information` (G, P, width, width) are those of the groups. `steps`
    are the best finer variates as linear functions of the coarser ones, stage by stage.
    """

    clusters: Clusters
    depth: int
    gradient: Array
    information: Array
    steps: tuple[Array, ...]

    @classmethod
    def of(cls, clusters: Clusters, depth: int, gradient: Array, information: Array) -> Eliminated:
        """From the gradients (B, P, s) and information (B, P, s, s) of experiments.

        In these the law of a shared variate is counted once. The finest variates go first.
        """
        order, steps = clusters.free(depth), list[Array]()
        gradient, information = gradient[..., order], information[..., order[:, None], order]
        own = clusters.alone.size
        for stage in reversed(clusters.stages[depth:]):
            left = gradient.shape[2] - own
            coupled = [information[..., left:, :left], gradient[..., left:, None]]
            step = np.linalg.solve(information[..., left:, left:], np.concatenate(coupled, axis=3))
            across = information[..., :left, left:]
            steps.append(np.asarray(step))
            gradient, information = stage.gathered(
                gradient[..., :left] - (across @ step[..., left:])[..., 0],
                information[..., :left, :left] - across @ step[..., :left],
            )
            own = stage.variates.size
        return cls(clusters, depth, gradient, information, tuple(reversed(steps)))

    def completed(self, top: Array, *, toward: bool) -> Array:
        """The steps (B, P', s) of all variates that belong to steps (G, P', width) of the groups.

        With `toward` finer variates go to their best places; otherwise they only follow the groups.
        P' is a multiple of P.
        """
        found, clusters = top, self.clusters
        for stage, step in zip(clusters.stages[self.depth :], self.steps, strict=True):
            known = stage.of_members(found)
            each = np.repeat(step, found.shape[1] // step.shape[1], axis=1)
            finer = -(each[..., :-1] @ known[..., None])[..., 0]
            found = np.concatenate([known, finer + each[..., -1] * toward], axis=2)
        whole = np.zeros((*found.shape[:2], clusters.counted.shape[1]))
        whole[..., clusters.free(self.depth)] = found
        return whole


def cluster_modes(
    curved: Curved,
    start: Array,
    clusters: Clusters,
    depth: int = 0,
    arrived: float = MODES.arrived,
    settings: ModeSettings = MODES,
) -> Modes:
    """The modes (B, P, s) of all variates of stage `depth` and finer ones, from `start` (B, P, s).

    The coarser ones stay. Newton steps eliminate the variates of experiments, then those of their
    groups, and so on, so that the cost grows like the number of experiments (Pinheiro and Bates,
    1995). Steps are damped as those of `modes`, for each group of stage `depth`.
    """
    top = clusters.top(depth)
    groups = int(top.max()) + 1

    def summed(values: Array) -> Array:
        found = np.zeros((groups, *values.shape[1:]))
        np.add.at(found, top, values)
        return found

    z, damping = start, np.zeros((groups, start.shape[1]))
    value, gradient, information = curved(z)
    added = np.zeros_like(clusters.counted)
    added[:, clusters.free(depth)] = clusters.counted[:, clusters.free(depth)]
    for _ in range(settings.steps if arrived < settings.near else settings.near_steps):
        damped = information + damping[top][..., None, None] * (
            added[:, None, :, None] * np.eye(added.shape[1])
        )
        found = Eliminated.of(clusters, depth, gradient, damped)
        newton = np.linalg.solve(found.information, found.gradient[..., None])[..., 0]
        step = found.completed(np.asarray(newton), toward=True)
        open_ = 0.5 * summed(np.sum(gradient * step, axis=2)) > arrived
        if not np.any(open_):
            break
        trial = np.clip(z + step * open_[top][..., None], -settings.farthest, settings.farthest)
        new_value, new_gradient, new_information = curved(trial)
        better = open_ & (summed(new_value) > summed(value))
        moved = better[top]
        z, value = np.where(moved[..., None], trial, z), np.where(moved, new_value, value)
        gradient = np.where(moved[..., None], new_gradient, gradient)
        information = np.where(moved[..., None, None], new_information, information)
        harder = np.where(open_, np.maximum(settings.raised * damping, 1.0), damping)
        eased = settings.lowered * damping * (damping > settings.least_damping)
        damping = np.where(better, eased, harder)
    return Modes(z, information, value)


@dataclass(frozen=True, eq=False)
class Paths:
    """Nodes of all shared variates, and the modes z (B, P, s) of the others at each of them.

    `information` (B, P, s, s) is that at the modes, and `shared` (B, P) are the log weights (see
    `PlacedNodes`).
    """

    clusters: Clusters
    z: Array
    information: Array
    shared: Array

    @classmethod
    def of(cls, laws: IndividualLaws, points: Callable[[int, int], tuple[Array, Array]]) -> Paths:
        """Nodes about the modes, stage by stage, each given those of the coarser stages.

        `points` gives for a stage and its width the nodes t (P or 1, Q, width) for each of the P
        nodes before, standard normal where the log-density is quadratic, and log weights (Q,).
        """
        clusters = laws.clusters
        assert clusters is not None
        z, information = laws.modes.z[:, :, 0], laws.modes.information[:, :, 0]
        shared = np.zeros(z.shape[:2])
        for depth, stage in enumerate(clusters.stages):
            found = Eliminated.of(clusters, depth, np.zeros_like(z), information)
            root = np.linalg.inv(np.linalg.cholesky(found.information))
            t, log_w = points(depth, stage.width)
            t = np.broadcast_to(t, (z.shape[1], *t.shape[1:]))
            off = np.einsum("gpvw,pqv->gpqw", root, t).reshape(len(root), -1, stage.width)
            z = np.repeat(z, log_w.size, axis=1) + found.completed(off, toward=False)
            log_det = np.log(np.einsum("gpww->gpw", root)).sum(axis=2)
            of_rule = log_det[..., None] + log_w + 0.5 * np.sum(t**2, axis=2)
            of_rule = of_rule.reshape(len(root), -1)
            of_rule -= 0.5 * np.einsum("gw,gpw->gp", stage.unseen, off**2)
            shared = np.repeat(shared, log_w.size, axis=1)
            first = np.unique(clusters.top(depth), return_index=True)[1]
            shared[first] += of_rule
            own = stage.variates
            shared -= 0.5 * np.sum(clusters.counted[:, None, own] * z[..., own] ** 2, axis=2)
            if clusters.free(depth + 1).size:
                again = cluster_modes(laws.curved, z, clusters, depth + 1, MODES.near)
                z, information = again.z, again.information
        return cls(clusters, z, information, shared)


@dataclass(frozen=True)
class LevelRule(NodeRule):
    """Nodes of shared variates about the mode of a cluster, and in each nodes of its experiments.

    Nested levels have `outer` Gauss-Hermite nodes for each variate of a group, level by level,
    each about the mode given the coarser ones. Crossed levels have `outer` points of the normal law
    about the mode of all variates of a cluster, in pairs, with the mean and the covariance of that
    law; the terms are weighted by its density (importance sampling). The nodes of `inner` integrate
    over the variates of a single experiment, given those of its groups. Where the simulator is
    linear in normal parameters and the errors are normal, one node of nested levels gives the exact
    likelihood, two its exact score, and any number of points both. `widths` are the variates of a
    group at each stage, and `alone` is the number of those of a single experiment; `crossed` says
    whether there is one stage for all levels.
    """

    name: ClassVar[str] = "quadrature over levels"
    inner: NodeRule
    widths: tuple[int, ...]
    alone: int
    crossed: bool
    outer: int
    settings: SharedNodes = field(default=SHARED, repr=False)

    @classmethod
    def first(
        cls,
        grouping: Grouping,
        inner: NodeRule,
        nodes: int = SHARED.nodes,
        pairs: int = SHARED.pairs,
    ) -> LevelRule:
        """The rule with these `nodes` of a variate of nested levels, or these `pairs` of points."""
        stages = Clusters.of(grouping, slice(0, grouping.cluster.size)).stages
        widths = tuple(stage.width for stage in stages)
        alone = int(np.sum(grouping.of == len(grouping.names)))
        outer = nodes if grouping.nested else 2 * max(pairs, widths[0])
        return cls(inner, widths, alone, not grouping.nested, outer)

    @property
    def rough(self) -> LevelRule:
        """The rule whose nodes of the experiments are those for statistics of many replicates."""
        return replace(self, inner=self.inner.rough)

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of nodes of a group at each stage."""
        return (self.outer,) if self.crossed else tuple(self.outer**width for width in self.widths)

    def on(self, grouping: Grouping) -> LevelRule:
        """This rule for other groups of the same levels."""
        outer = self.outer // 2 if self.crossed else self.outer
        return self.first(grouping, self.inner, outer, outer)

    def size(self, _: int, /) -> int:
        """The number J of nodes of an experiment."""
        return int(np.prod(self.counts)) * (self.inner.size(self.alone) if self.alone else 1)

    def finer(self, _: int, /) -> tuple[LevelRule, ...]:
        """The rule with more nodes of the groups, and those with more nodes of the experiments."""
        inner = self.inner.finer(self.alone) if self.alone else ()
        return (self._more, *(replace(self, inner=rule) for rule in inner))

    def refined(self, gaps: Sequence[float], enough: float, dimensions: int, /) -> LevelRule | None:
        """The rule with more nodes where the differences `gaps` to finer rules are too large."""
        found, own = self, self.alone
        inner = self.inner.refined(gaps[1:], 0.5 * enough, own) if own else None
        if abs(gaps[0]) > 0.5 * enough and self._more.outer <= self.settings.most_points:
            found = self._more
        if inner is not None:
            found = replace(found, inner=inner)
        return found if found != self and found.size(dimensions) <= self._most else None

    def gap(self, gaps: Sequence[float], _: int, /) -> float:
        """The error estimate of this rule: that of the groups' nodes plus that of the others."""
        own = self.inner.gap(gaps[1:], self.alone) if self.alone else 0.0
        return float(gaps[0] + own)

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Nodes xi (B, J, s) of the experiments, with log weights (B, J), shared ones apart."""

        def points(_: int, width: int) -> tuple[Array, Array]:
            t, log_w = self._points(width)
            return t[None], log_w

        return self._within(laws, Paths.of(laws, points))

    def _within(self, laws: IndividualLaws, paths: Paths) -> PlacedNodes:
        """The nodes of the experiments' own variates, for each node of the groups."""
        own, z, shared = paths.clusters.alone, paths.z, paths.shared
        shared = shared.reshape(len(shared), *self.counts)
        if not own.size:
            return PlacedNodes(z, np.zeros(z.shape[:2]), shared)

        def whole(x: Array) -> Array:
            found = np.repeat(z, x.shape[1] // z.shape[1], axis=1)
            found[..., own] = x
            return found

        def curved(z: Array) -> tuple[Array, Array, Array]:
            value, gradient, found = laws.curved(whole(z))
            return value, gradient[..., own], found[..., own[:, None], own]

        about = paths.information[..., own[:, None], own][:, :, None]
        known = Modes(z[..., own][:, :, None], about, np.zeros((*z.shape[:2], 1)))
        inner = IndividualLaws(curved, lambda x: laws.valued(whole(x)), known, laws.first)
        placed = self.inner.place(inner)
        return PlacedNodes(whole(placed.xi), placed.log_weight, shared)

    def at_points(self, laws: IndividualLaws, clusters: Clusters, xi: Array) -> tuple[Array, Array]:
        """Modes (B, P, s) and log-likelihoods (B, P) of experiments, given shared variates of xi.

        The modes are those of the experiments' own variates, and are sought from xi (B, P, s).
        About them the own variates are integrated out by `inner`.
        """
        z, information = xi, np.zeros((*xi.shape, xi.shape[2]))
        if clusters.alone.size:
            found = cluster_modes(laws.curved, xi, clusters, len(clusters.stages), MODES.near)
            z, information = found.z, found.information
        paths = Paths(clusters, z, information, np.zeros(xi.shape[:2]))
        placed = self._within(laws, paths)
        total = _of_observations(laws, clusters, placed.xi) + placed.log_weight
        return z, log_sum(total.reshape(*xi.shape[:2], -1))[0]

    def sample(self, laws: IndividualLaws, count: int) -> PlacedNodes:
        """Points xi (B, J, s) of the variates of each experiment given all observations.

        `count` points of the groups' variates, each with one point of the experiment's own, are
        drawn from the normal laws about the modes (Sobol'); the log weights (B, J) make them a
        sample (importance sampling). The integrals over the other experiments are those of `inner`.
        """
        clusters = laws.clusters
        assert clusters is not None
        widths = [stage.width for stage in clusters.stages]
        t = standard_points(count, sum(widths) + clusters.alone.size)
        ends = np.cumsum([0, *widths])

        def points(depth: int, _: int) -> tuple[Array, Array]:
            own = t[:, ends[depth] : ends[depth + 1]]
            # Each point of the coarsest groups has one point of each finer group.
            return (own[:, None], np.zeros(1)) if depth else (own[None], np.full(count, -log_count))

        log_count = np.log(count)
        paths = Paths.of(laws, points)
        rule = replace(self, crossed=True, outer=count)
        placed = rule._within(laws, paths)
        assert placed.shared is not None
        total = _of_observations(laws, clusters, placed.xi)
        shape = (len(total), count, *(1 for _ in widths[1:]))
        found = clusters.mean_of(total + placed.log_weight, placed.shared.reshape(shape))
        path, given = found.path.reshape(len(total), count), found.inner.reshape(len(total), count)
        with np.errstate(divide="ignore"):
            log_path = np.log(path)
        own = clusters.alone
        if not own.size:
            return PlacedNodes(placed.xi, log_path)
        root = np.linalg.inv(np.linalg.cholesky(paths.information[..., own[:, None], own]))
        of_own, xi = t[:, ends[-1] :], paths.z.copy()
        xi[..., own] += np.einsum("bpvw,pv->bpw", root, of_own)
        value = _of_observations(laws, clusters, xi)
        log_weight = np.log(np.einsum("bpww->bpw", root)).sum(axis=2) + 0.5 * (
            np.sum(of_own**2, axis=1) - np.sum(xi[..., own] ** 2, axis=2)
        )
        with np.errstate(invalid="ignore"):
            log_weight = np.where(path > 0.0, log_path + value + log_weight - given, -np.inf)
        return PlacedNodes(xi, log_weight)

    def _points(self, width: int) -> tuple[Array, Array]:
        """The nodes (Q, width) of a group about its mode, and their log weights (Q,)."""
        if not self.crossed:
            return GaussHermite(self.outer).nodes(width)
        points = balanced_points(self.outer // 2, width)
        return points, np.full(len(points), -np.log(len(points)))

    @property
    def _more(self) -> LevelRule:
        """The rule with about half as many nodes again of each variate, or twice the points."""
        more = 2 * self.outer if self.crossed else self.outer + self.outer // 2 + 2
        return replace(self, outer=more)

    @property
    def _most(self) -> int:
        return self.settings.most_points if self.crossed else self.settings.most_nodes


def _of_observations(laws: IndividualLaws, clusters: Clusters, xi: Array) -> Array:
    """The log-likelihood (B, P) of each experiment at variates xi (B, P, s), without their law."""
    law = 0.5 * np.sum(clusters.counted[:, None] * xi**2, axis=2)
    return np.asarray(laws.valued(xi) + law)


@lru_cache
def balanced_points(pairs: int, dimensions: int) -> Array:
    """Quasi-random normal points t (2 pairs, s) and -t, with covariance one exactly.

    Averages of polynomials of degree three are exact. There are at least as many pairs as
    dimensions.

    >>> t = balanced_points(8, 3)
    >>> bool(np.allclose(t.T @ t / len(t), np.eye(3))), bool(np.allclose(t.sum(axis=0), 0.0))
    (True, True)
    """
    # Scrambled, because the first points of a plain Sobol' sequence lie in a few planes.
    count = max(pairs, dimensions)
    sobol = qmc.Sobol(dimensions, rng=np.random.default_rng(dimensions))
    t = special.ndtri(sobol.random_base2(int(np.ceil(np.log2(count))))[:count])
    values, vectors = np.linalg.eigh(t.T @ t / len(t))
    t = t @ (vectors / np.sqrt(values)) @ vectors.T
    found = np.concatenate([t, -t])
    found.flags.writeable = False  # All callers share it.
    return found
