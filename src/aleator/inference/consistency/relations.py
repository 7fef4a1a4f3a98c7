"""The parameters of single experiments, against the columns of the table and each other.

theta_l are the variates of the parameters of experiment l, standard normal under the law. Under the
right model E[theta_l | y_l] depends on no column that the law does not follow, and theta_i theta_j
has the mean that the law's correlation says. E[theta_i theta_j | y_l] is the score of experiment l
by a correlation at zero (Fisher's identity), so that their sum is Rao's test of one. Observations
that leave a parameter open pull its mean to the law (shrinkage); those of replicates do as much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aleator.inference.consistency.columns import Column
from aleator.inference.consistency.contrasts import MAIN, Subject
from aleator.results.values import Relation, Statistic
from aleator.types import Array, Indices

INDIVIDUAL = "individual"
PAIR, COLUMN = "pair", "relation"
RELATED = (PAIR, COLUMN)
"""The kinds of its tests."""
HIDDEN = 0.5
"""Shrinkage above which two parameters are not held against each other (Savic and Karlsson, 2009).

A standard deviation of nearly zero is estimated as zero in many replicates and not in others. The
products of two parameters then scatter otherwise in these than where it was not.
"""
LEAST = 0.05
"""Sums over a column are taken to scatter at least so much: one that the law follows pins them."""
SCATTER_LEAST = 1e-9
"""Means that scatter less than this have no correlation."""


@dataclass(frozen=True, eq=False)
class Relations:
    """What is asked of s scattering parameters, whose names these are.

    `pairs` (P,) are the places of two that the law does not tie. `columns` (t,) are those that are
    one in each experiment, with centered ranks `ranks` (t, N) of length one.
    """

    names: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]
    columns: tuple[str, ...]
    ranks: Array

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        pairs: tuple[tuple[int, int], ...],
        columns: tuple[Column, ...],
        first: Indices,
    ) -> Relations:
        """Of these parameters; `first` (N,) is an observation of each experiment."""
        own = [c for c in columns if c.own and c.ranks is not None]
        ranks = np.array([c.ranks[first] for c in own if c.ranks is not None])
        ranks = ranks.reshape(len(own), len(first))
        ranks = ranks - ranks.mean(axis=1, keepdims=True)
        return cls(names, pairs, tuple(c.name for c in own), ranks / _length(ranks))

    def subjects(self) -> Iterator[Subject]:
        """What each of `values` is about: pairs, then each parameter against all columns."""
        for i, j in self.pairs:
            yield Subject(INDIVIDUAL, PAIR, self.names[i], self.names[j], weight=MAIN)
        for name in self.names:
            for column in self.columns:
                yield Subject(INDIVIDUAL, COLUMN, name, column, least=LEAST)

    def values(self, means: Array, products: Array) -> Array:
        """The statistics (P + s t,) of means (N, s) and mean products (N, s, s)."""
        pairs = [products[:, i, j].mean() for i, j in self.pairs]
        return np.concatenate([pairs, (of_size_one(means).T @ self.ranks.T).ravel()])

    def told(self, means: Array, tests: list[Statistic]) -> tuple[Relation, ...]:
        """The correlations of individual means with all else, each with the p of its test."""
        if not tests:
            return ()
        centered = means - means.mean(axis=0)
        scaled = centered / _length(centered.T).T
        within, against = scaled.T @ scaled, scaled.T @ self.ranks.T
        found = [within[i, j] for i, j in self.pairs] + against.ravel().tolist()
        return tuple(
            Relation(test.of, str(test.column), test.kind == PAIR, float(value), test.p)
            for value, test in zip(found, tests, strict=True)
        )


def apart(means: Array, pairs: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """Those of the pairs of which the observations tell both, by individual means (N, s).

    None where there are no such means (s = 0): outcomes without noise tell no single parameter.

    >>> means = np.array([[1.0, 0.2, 1.0], [-1.0, -0.2, 1.0], [1.0, 0.2, -1.0], [-1.0, -0.2, -1.0]])
    >>> apart(means, ((0, 1), (0, 2)))
    ((0, 2),)
    """
    if not means.shape[1]:
        return ()
    told = 1.0 - np.std(means, axis=0) <= HIDDEN
    return tuple((i, j) for i, j in pairs if told[i] and told[j])


def of_size_one(values: Array) -> Array:
    """Values (N, ...) over their root mean square: that of a replicate may be far smaller.

    So it is where its law hardly scatters, and each individual parameter is nearly the mean.
    """
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


def _length(rows: Array) -> Array:
    """The length of each row, as a column; one where there is nothing."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(length > SCATTER_LEAST, length, 1.0)
