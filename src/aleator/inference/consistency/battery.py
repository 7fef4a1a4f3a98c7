"""The statistics: residuals in, one number for each test out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.inference.consistency.columns import LEVELS, Column
from aleator.inference.consistency.contrasts import (
    FARTHEST,
    Contrasts,
    Subject,
    contrasts_of,
    shared,
)
from aleator.inference.consistency.residuals import Residuals
from aleator.types import Array, Indices

OUTCOMES, SCATTER = "outcomes", "scatter"
REPEATED = 0.7
"""A column is no sign of repeated subjects where it has more distinct values a row."""
SAME = "the same conditions"


@dataclass(frozen=True, eq=False)
class Battery:
    """All tests of a table whose columns are these.

    `experiment` (M,) is that of each observation. `names` (F,) are the hyperparameters of the
    scores, and `covariance` (F, F) that of their estimates, from the information. `groups` are
    those by which observations may be repeated, by the name of their column.
    """

    contrasts: Contrasts
    experiment: Indices
    names: tuple[str, ...]
    covariance: Array
    groups: dict[str, Indices]

    @classmethod
    def of(
        cls,
        columns: tuple[Column, ...],
        experiment: Indices,
        names: tuple[str, ...],
        covariance: Array,
    ) -> Battery:
        """The battery of a table."""
        return cls(contrasts_of(columns), experiment, names, covariance, _groups(columns))

    @property
    def several(self) -> bool:
        """Whether experiments have several observations."""
        return bool(self.experiment.size > self.experiment[-1] + 1)

    @property
    def subjects(self) -> tuple[Subject, ...]:
        """What each of the numbers of `values` is about."""
        return tuple(self._subjects())

    def values(self, residuals: Residuals) -> Array:
        """The statistics (T,); infinite where one does not exist."""
        w = residuals.normal
        near = np.clip(w, -FARTHEST, FARTHEST)
        features = np.stack([near, np.abs(near) - np.sqrt(2.0 / np.pi)], axis=1)
        sums = self.contrasts.weights @ features
        parts = [
            self._shape(w[residuals.known]),
            np.log(np.maximum(self._robust(residuals.scores), 1e-300)),
            sums[:, 0],
            sums[:, 1],
            self._together(near),
        ]
        if self.several:
            own = self._own[0] @ residuals.scores
            parts += [own.ravel(), self._laws(residuals.scores)]
        return np.concatenate(parts)

    def _subjects(self) -> Iterator[Subject]:
        yield Subject("shape", "uniformity", OUTCOMES, skewed=True, one_sided=True)
        yield Subject("shape", "skewness", OUTCOMES)
        yield Subject("shape", "tails", OUTCOMES, skewed=True)
        yield Subject("shape", "outlier", OUTCOMES, skewed=True, one_sided=True)
        for name in self.names:
            yield Subject("shape", "sandwich", name)
        for of in (OUTCOMES, SCATTER):
            for column, where in zip(self.contrasts.column, self.contrasts.where, strict=True):
                yield Subject(of, "contrast", of, column.name, where, skewed=of == SCATTER)
        yield Subject("together", "neighbours", OUTCOMES)
        for name in self.groups:
            yield Subject("together", "groups", OUTCOMES, name, skewed=True, one_sided=True)
        if self.several:
            for i in self._own[1]:
                along, where = self.contrasts.column[i].name, self.contrasts.where[i]
                for name in self.names:
                    yield Subject("parameters", "contrast", name, along, where, skewed=True)
            for name in self.names:
                yield Subject("shape", "skewness", name)

    @property
    def _own(self) -> tuple[Array, list[int]]:
        """Contrasts (t, N) of the columns that are the same in all rows of each experiment."""
        which = [i for i, column in enumerate(self.contrasts.column) if column.own]
        first = np.unique(self.experiment, return_index=True)[1]
        weights = self.contrasts.weights[which][:, first]
        return weights - weights.mean(axis=1, keepdims=True), which

    def _shape(self, w: Array) -> Array:
        """Of normal scores (M,): Anderson and Darling's, third and fourth moment, the farthest."""
        m = w - w.mean()
        square = np.mean(m**2)
        return np.array(
            [
                np.log(anderson_darling(np.sort(special.ndtr(w)))),
                np.mean(m**3) / square**1.5,
                np.log(np.mean(m**4) / square**2),
                -special.log_ndtr(-np.abs(w).max()),
            ]
        )

    def _robust(self, scores: Array) -> Array:
        """Variances (F,) by the sandwich over those by the information (White, 1982)."""
        outer = scores.T @ scores
        sandwich = np.einsum("ij,jk,ki->i", self.covariance, outer, self.covariance)
        return np.asarray(sandwich / np.diag(self.covariance))

    def _together(self, w: Array) -> Array:
        """How alike neighbours are, and those of each group."""
        neighbours = float(w[1:] @ w[:-1]) / np.sqrt(max(w.size - 1, 1))
        return np.array([neighbours, *(shared(group, w) for group in self.groups.values())])

    def _laws(self, scores: Array) -> Array:
        """Skewness (F,) of the scores of the experiments."""
        m = scores - scores.mean(axis=0)
        return np.asarray(np.mean(m**3, axis=0) / np.mean(m**2, axis=0) ** 1.5)


def anderson_darling(u: Array) -> float:
    """A^2 of sorted probabilities u (M,) against the uniform law (Anderson and Darling, 1954).

    >>> round(anderson_darling(np.array([0.25, 0.5, 0.75])), 3)
    0.269
    """
    inside = np.clip(u, 1e-15, 1.0 - 1e-15)
    odd = 2.0 * np.arange(u.size) + 1.0
    return float(-u.size - np.mean(odd * (np.log(inside) + np.log1p(-inside[::-1]))))


def _groups(columns: tuple[Column, ...]) -> dict[str, Indices]:
    """Groups of rows by columns of many values that repeat, and by all numbers together."""
    size = columns[0].group.size if columns else 0
    many = {
        column.name: column.group for column in columns if LEVELS < column.count <= REPEATED * size
    }
    rows = [column.group for column in columns if column.ranks is not None][:-1]
    if rows:
        together = np.unique(np.stack(rows, axis=1), axis=0, return_inverse=True)[1].ravel()
        if LEVELS < together.max() + 1 <= REPEATED * size:
            many[SAME] = together
    return many
