"""Clusters: experiments that share parameters, and sums over the nodes that they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.core.types import Array, Indices
from aleator.laws.levels import Grouping


@dataclass(frozen=True, eq=False)
class Stage:
    """The groups of one level, or the clusters where levels are crossed, and their variates.

    `variates` (k,) are the indices of the variates that a member of a group sees. `group` (E,) is
    the group of each member: of each group of the next finer level, or of each experiment. A group
    has `width` variates, and `slot` (E, k) are the places of those that a member sees; None where
    it sees all.
    """

    variates: Indices
    group: Indices
    width: int
    slot: Indices | None = None

    @cached_property
    def _sorted(self) -> tuple[Indices, Indices]:
        """The members in the order of their groups, and the first of each group among them."""
        order = np.argsort(self.group, kind="stable")
        return order, np.unique(self.group[order], return_index=True)[1]

    @cached_property
    def unseen(self) -> Array:
        """One (G, width) for each variate of a group that no member sees, else zero."""
        found = np.zeros((int(self.group.max()) + 1, self.width))
        if self.slot is not None:
            found += 1.0
            found[self.group[:, None], self.slot] = 0.0
        return found

    def summed(self, values: Array) -> Array:
        """The sums (G, ...) of values (E, ...) over the members of each group."""
        order, first = self._sorted
        return np.add.reduceat(values[order], first, axis=0)

    def of_members(self, values: Array) -> Array:
        """The variates (E, P, k) that the members see, of the variates (G, P, width) of groups."""
        found = values[self.group]
        if self.slot is None:
            return np.asarray(found)
        places = np.broadcast_to(self.slot[:, None], (*found.shape[:2], self.variates.size))
        return np.take_along_axis(found, places, axis=2)

    def gathered(self, gradient: Array, information: Array) -> tuple[Array, Array]:
        """The gradients (G, P, width) and information (G, P, width, width) about the groups.

        They are sums of those of the members, (E, P, k) and (E, P, k, k). A variate that no member
        sees has the information one.
        """
        if self.slot is None:
            return self.summed(gradient), self.summed(information)
        groups, points = int(self.group.max()) + 1, gradient.shape[1]
        slopes = np.zeros((groups, self.width, points))
        whole = np.zeros((groups, self.width, self.width, points))
        at, rows, columns = self.group[:, None], self.slot[:, :, None], self.slot[:, None]
        np.add.at(slopes, (at, self.slot), np.moveaxis(gradient, 1, 2))
        np.add.at(whole, (at[..., None], rows, columns), np.moveaxis(information, 1, 3))
        each = np.arange(self.width)
        whole[:, each, each] += self.unseen[..., None]
        return np.moveaxis(slopes, 2, 1), np.moveaxis(whole, 3, 1)


@dataclass(frozen=True, eq=False)
class Clusters:
    """The clusters of B consecutive experiments; no experiment of them is left out.

    `stages` are the levels, the coarsest first, or one stage for all crossed levels. `alone` are
    the indices of the variates that are not shared, and `counted` (B, s) is that of `Grouping`.
    `every` are the places of the clusters among all.
    """

    stages: tuple[Stage, ...]
    alone: Indices
    counted: Array
    every: slice

    @classmethod
    def of(cls, grouping: Grouping, part: slice) -> Clusters:
        """The clusters of the consecutive experiments `part`."""
        levels, cluster = len(grouping.names), grouping.cluster[part]
        counted, alone = grouping.counted[part], np.flatnonzero(grouping.of == levels)
        every = slice(int(cluster.min()), int(cluster.max()) + 1)
        shared = [np.flatnonzero(grouping.of == level) for level in range(levels)]
        group = grouping.group[:, part] - grouping.group[:, part].min(axis=1, keepdims=True)
        if not grouping.nested:
            stage = _crossed(cluster - every.start, group, shared)
            return cls((stage,), alone, counted, every)
        # The members of a group are the groups of the next finer level, one experiment for each.
        firsts = [np.unique(finer, return_index=True)[1] for finer in group[1:]]
        members = [own[first] for own, first in zip(group[:-1], firsts, strict=True)]
        stages = zip(shared, [*members, group[-1]], strict=True)
        return cls(tuple(Stage(of, own, of.size) for of, own in stages), alone, counted, every)

    @property
    def plain(self) -> bool:
        """Whether there is one level, with one group in each cluster."""
        return len(self.stages) == 1 and self.stages[0].slot is None

    def top(self, depth: int) -> Indices:
        """The group (B,) of each experiment at stage `depth`; beyond the last its own number."""
        found = np.arange(len(self.counted))
        for stage in reversed(self.stages[depth:]):
            found = stage.group[found]
        return found

    def summed(self, values: Array) -> Array:
        """The sums (U, ...) of values (B, ...) over the experiments of each cluster."""
        found = values
        for stage in reversed(self.stages):
            found = stage.summed(found)
        return found

    def free(self, depth: int) -> Indices:
        """The indices of the variates of stage `depth` and of the finer ones."""
        return np.concatenate([*(stage.variates for stage in self.stages[depth:]), self.alone])

    def mean_of(self, total: Array, shared: Array) -> ClusterMean:
        """The sums over nested nodes of terms `total` (B, J) with weights `shared`.

        All are logarithms; see `PlacedNodes`.
        """
        inner, part = log_sum(total.reshape(*shared.shape, -1))
        value, parts = inner + shared, list[Array]()
        for stage in reversed(self.stages):
            value, own = log_sum(stage.summed(value))
            parts.append(own)
        path = np.ones(len(value))
        for stage, own in zip(self.stages, reversed(parts), strict=True):
            path = (path[..., None] * own)[stage.group]
        return ClusterMean(value, (path[..., None] * part).reshape(total.shape), path, inner)


@dataclass(frozen=True, eq=False)
class ClusterMean:
    """The log-likelihoods `each` (U,) of clusters, and the `share` (B, J) of each node.

    `path` (B, Q_1, ..., Q_L) are the shares of the nodes of shared variates, and `inner` the
    log-likelihood of each experiment at these.
    """

    each: Array
    share: Array
    path: Array
    inner: Array

    @property
    def conditional(self) -> Array:
        """log p(y_l | all other experiments of the cluster) (B,): the mean of 1/p given all."""
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(self.path > 0.0, np.log(self.path) - self.inner, -np.inf)
        return -log_sum(terms.reshape(len(terms), -1))[0]


def log_sum(terms: Array) -> tuple[Array, Array]:
    """The log-sum-exp over the last axis, and the share of each term."""
    top = terms.max(axis=-1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    part = np.exp(terms - safe)
    whole = part.sum(axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (safe + np.log(whole))[..., 0], np.where(whole > 0.0, part / whole, 0.0)


def _crossed(cluster: Indices, group: Indices, shared: Sequence[Indices]) -> Stage:
    """The one stage of crossed levels: a cluster has the variates of all its groups."""
    filled, slots = np.zeros(int(cluster.max()) + 1, dtype=np.intp), []
    for own, variates in zip(group, shared, strict=True):
        _, first, place = np.unique(own, return_index=True, return_inverse=True)
        owner = cluster[first]
        order = np.argsort(owner, kind="stable")
        starts = np.searchsorted(owner[order], owner)
        rank = np.empty(owner.size, dtype=np.intp)
        rank[order] = np.arange(owner.size)
        start = filled[cluster] + (rank - starts)[place] * variates.size
        slots.append(start[:, None] + np.arange(variates.size))
        filled = filled + np.bincount(owner, minlength=filled.size) * variates.size
    slot = np.concatenate(slots, axis=1)
    return Stage(np.concatenate(shared), cluster, int(filled.max()), slot)
