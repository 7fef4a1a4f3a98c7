"""Levels: groups of experiments that share a draw of a parameter, such as a batch of specimens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Indices
from aleator.errors import InputsError, nearest
from aleator.laws.law import Law
from aleator.laws.mixture import Mixture


def checked_levels(
    laws: Mapping[str, Law], ties: Sequence[tuple[str, str]], levels: Mapping[str, str]
) -> dict[str, str]:
    """The level of each parameter that has one, by name.

    A parameter of a level has one value for each group of experiments: those with the same entry
    in the column of that name. Raises InputsError for the level of a constant or of a mixture, of
    an unknown parameter, and for a correlation between parameters of different levels.
    """
    for name, level in levels.items():
        if name not in laws:
            raise InputsError(
                f"level '{level}' of '{name}': there is no such parameter{nearest(name, laws)}",
                f"name one of {', '.join(laws)}",
            )
        if not laws[name].scatters:
            raise InputsError(
                f"parameter '{name}' of level '{level}' is a constant, which is the same in all "
                "groups",
                "take the level away, or give the parameter a law that scatters",
            )
    mixed = [name for name, law in laws.items() if isinstance(law, Mixture)]
    if levels and mixed:
        raise InputsError(
            f"parameter '{mixed[0]}' is a mixture, and others have levels: the groups of "
            "experiments would be classes too",
            "take a law of one component, or take the levels away",
        )
    for one, other in ties:
        if levels.get(one) != levels.get(other):
            raise InputsError(
                f"'{one}' and '{other}' are correlated, and they belong to different levels",
                "correlate parameters of one level, or take the correlation away",
            )
    return dict(levels)


@dataclass(frozen=True, eq=False)
class Grouping:
    """The groups of N experiments that share parameters, for L levels, the coarsest first.

    `group` (L, N) is the number of each experiment's group at each level, and `labels` the names of
    the groups. `of` (s,) is the level of each scattering parameter; L stands for the experiment
    itself. Levels are `nested` if each group of one lies within one group of every coarser level;
    otherwise they are crossed. `cluster` (N,) is the number of the cluster of each experiment.
    Experiments of different clusters share no group and are independent.

    >>> batch, cask = np.array(["A", "A", "B"]), np.array(["a", "b", "c"])
    >>> found = Grouping.by({"batch": batch, "cask": cask}, ["cask", "batch", None])
    >>> found.names, found.of.tolist(), found.nested, found.cluster.tolist()
    (('batch', 'cask'), [1, 0, 2], True, [0, 0, 1])
    """

    names: tuple[str, ...]
    group: Indices
    labels: tuple[tuple[str, ...], ...]
    of: Indices
    nested: bool
    cluster: Indices

    @classmethod
    def by(cls, columns: Mapping[str, NDArray[Any]], levels: Sequence[str | None]) -> Grouping:
        """The groups of experiments by the labels (N,) in the column of each level.

        `levels` has the level of each scattering parameter, or None. Groups and clusters are
        numbered in the order in which they appear first.
        """
        numbered = {name: _numbered(cells) for name, cells in columns.items()}
        names = tuple(sorted(numbered, key=lambda name: len(numbered[name][1])))
        group = np.array([numbered[name][0] for name in names], dtype=np.intp)
        of = [len(names) if level is None else names.index(level) for level in levels]
        nested = all(
            len({*zip(coarse.tolist(), fine.tolist(), strict=True)}) == int(fine.max()) + 1
            for coarse, fine in pairwise(group)
        )
        return cls(
            names, group, tuple(numbered[name][1] for name in names),
            np.array(of, dtype=np.intp), nested, group[0] if nested else connected(group),
        )  # fmt: skip

    @cached_property
    def clusters(self) -> int:
        """The number of clusters, which are independent of each other."""
        return int(self.cluster.max()) + 1

    @cached_property
    def counted(self) -> Array:
        """One (N, s) where an experiment is the first of its group at a variate's level, else zero.

        A variate of a group is counted once, with the first of its experiments.
        """
        found = np.ones((self.group.shape[1], self.of.size))
        for s, level in enumerate(self.of.tolist()):
            if level < len(self.names):
                found[:, s] = 0.0
                found[np.unique(self.group[level], return_index=True)[1], s] = 1.0
        return found

    def shared(self, xi: Array) -> Array:
        """The variates (N, ..., s) with each variate of a group equal to that of its first one."""
        found = xi.copy()
        for s, level in enumerate(self.of.tolist()):
            if level < len(self.names):
                first = np.unique(self.group[level], return_index=True)[1]
                found[..., s] = xi[first[self.group[level]], ..., s]
        return found


def _numbered(cells: NDArray[Any]) -> tuple[Indices, tuple[str, ...]]:
    """The number of each label in the order of first appearance, and the labels as texts."""
    number: dict[str, int] = {}
    texts = [str(int(c)) if isinstance(c, float) and c.is_integer() else str(c) for c in cells]
    found = [number.setdefault(text, len(number)) for text in texts]
    return np.array(found, dtype=np.intp), tuple(number)


def connected(group: Indices) -> Indices:
    """The smallest groups (N,) of experiments that no grouping in `group` (L, N) divides.

    >>> connected(np.array([[0, 0, 1, 2], [0, 1, 1, 2]])).tolist()
    [0, 0, 0, 1]
    """
    found = np.arange(group.shape[1])
    while True:
        before = found
        for own in group:
            least = np.full(int(own.max()) + 1, found.size)
            np.minimum.at(least, own, found)
            found = least[own]
        if np.array_equal(found, before):
            return np.unique(found, return_inverse=True)[1]
