"""The statistics: residuals in, one number for each test out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from aleator.inference.consistency.columns import LEVELS, ORDER, Column
from aleator.inference.consistency.contrasts import (
    MAIN,
    Contrasts,
    Subject,
    contrasts_of,
    shared,
)
from aleator.inference.consistency.measures import moments, scatter, standardized
from aleator.inference.consistency.relations import INDIVIDUAL, Relations, of_size_one
from aleator.inference.consistency.residuals import Residuals
from aleator.types import Array, Flags, Indices

SHAPE, OUTCOMES, SCATTER, TOGETHER = "shape", "outcomes", "scatter", "together"
SHARES = {SHAPE: 0.32, OUTCOMES: 0.30, SCATTER: 0.28, TOGETHER: 0.06, INDIVIDUAL: 0.1}
"""Share of each group of tests in the false alarms, chosen by `python -m benchmarks findings`."""
PINNED = 0.05
"""What the maximum itself pins is taken to scatter at least so much: mean, scale and contrasts.

Where the standard deviation is identified the mean square of all residuals is nearly one, and where
a law follows a column its scores add up to nothing in each part of it.
"""
HEAVY = 4.0
"""The weight of heavy tails among the tests of shape: nothing else sees all of them."""
REPEATED = 0.7
"""A column is no sign of repeated subjects where it has more distinct values a row."""
SAME = "the same conditions"
SHAPES = ("level", "scale", "skewness", "heavy tails", "light tails", "outlier")
"""The kinds of tests that are about all residuals, or all scores, together."""


@dataclass(frozen=True, eq=False)
class Battery:
    """All tests of a table whose columns are these.

    `experiment` (M,) is that of each observation. `names` (F,) are the hyperparameters of the
    scores. `groups` are those by which observations may be repeated, by the name of their column.
    `ordered` tells whether neighbours mean anything: those of an experiment, or of a table that was
    not sorted.
    `relations` are asked of experiments with several observations.
    """

    contrasts: Contrasts
    experiment: Indices
    names: tuple[str, ...]
    groups: dict[str, Indices]
    ordered: bool
    relations: Relations

    @classmethod
    def of(
        cls,
        columns: tuple[Column, ...],
        experiment: Indices,
        names: tuple[str, ...],
        parameters: tuple[str, ...] = (),
        pairs: tuple[tuple[int, int], ...] = (),
    ) -> Battery:
        """The battery of a table; no law ties the `pairs` of scattering `parameters`."""
        first = np.unique(experiment, return_index=True)[1]
        several = len(first) < len(experiment)
        ordered = any(c.name == ORDER for c in columns) or several
        contrasts = contrasts_of(columns, experiment.size)
        asked = (parameters, pairs) if several else ((), ())
        relations = Relations.of(*asked, columns, first)
        return cls(contrasts, experiment, names, _groups(columns), ordered, relations)

    @cached_property
    def several(self) -> bool:
        """Whether experiments have several observations."""
        return bool(self.experiment.size > self.experiment[-1] + 1)

    @cached_property
    def subjects(self) -> tuple[Subject, ...]:
        """What each of the numbers of `values` is about."""
        return (
            *self._of_shape(),
            *self._of_columns(),
            *self._of_neighbours(),
            *self.relations.subjects(),
        )

    def values(self, residuals: Residuals) -> Array:
        """The statistics (T,); not finite where one does not exist."""
        level = standardized(residuals.normal)
        spread = standardized(scatter(residuals.normal))
        parts = [self._shape(residuals.normal[residuals.known])]
        if self.several:
            scores = of_size_one(residuals.scores)
            parts += [self._of_experiments(residuals.scores), (scores.T @ self._own.T).ravel()]
        parts += [self._rows @ level, self.contrasts.weights @ spread]
        parts.append(self._together(level, spread))
        if self.relations.names:
            parts.append(self.relations.values(residuals.means, residuals.products))
        return np.concatenate(parts)

    def _of_shape(self) -> Iterator[Subject]:
        yield Subject(SHAPE, "level", OUTCOMES, least=PINNED)
        yield Subject(SHAPE, "scale", SCATTER, least=PINNED)
        yield from self._of_moments(OUTCOMES)
        yield Subject(SHAPE, "outlier", OUTCOMES, skewed=True, one_sided=True)
        if self.several:
            for k in self._shaped:
                yield from self._of_moments(self.names[k])

    def _of_moments(self, of: str) -> Iterator[Subject]:
        yield Subject(SHAPE, "skewness", of)
        yield Subject(SHAPE, "heavy tails", of, one_sided=True, weight=HEAVY)
        yield Subject(SHAPE, "light tails", of, one_sided=True)

    def _of_columns(self) -> Iterator[Subject]:
        if self.several:
            for name in self.names:
                group = SCATTER if is_scale(name) else OUTCOMES
                yield from self._along(self._whole, group, name)
        yield from self._along(~self._whole, OUTCOMES, OUTCOMES)
        yield from self._along(np.ones_like(self._whole), SCATTER, SCATTER)

    def _along(self, which: Flags, group: str, of: str) -> Iterator[Subject]:
        """The contrasts of some columns; those of scatter are skewed, and have no main form."""
        for i in np.flatnonzero(which):
            column, where = self.contrasts.column[i], self.contrasts.where[i]
            skewed = group == SCATTER
            weight = MAIN if self.contrasts.main[i] and not skewed else 1.0
            yield Subject(
                group, "contrast", of, column.name, where, skewed, weight=weight, least=PINNED
            )

    def _of_neighbours(self) -> Iterator[Subject]:
        if self.ordered:
            yield Subject(TOGETHER, "neighbours", OUTCOMES, skewed=True)
        for name in self.groups:
            for group, kind, of in ((TOGETHER, "groups", OUTCOMES), (SCATTER, "unequal", SCATTER)):
                yield Subject(group, kind, of, name, skewed=True, one_sided=True, least=PINNED)
        if self.several:
            yield Subject(SCATTER, "unequal", SCATTER, ORDER, one_sided=True)

    @cached_property
    def _shaped(self) -> tuple[int, ...]:
        """The hyperparameters that say where a parameter's law is: their scores have its shape."""
        return tuple(
            k
            for k, name in enumerate(self.names)
            if name.split(".")[0] in self.relations.names and not is_scale(name)
        )

    @cached_property
    def _whole(self) -> Flags:
        """Which contrasts are held against scores: those that are one in each experiment."""
        own = [self.several and column.own for column in self.contrasts.column]
        return np.array(own, dtype=np.bool_)

    @cached_property
    def _rows(self) -> Array:
        """The other contrasts (t, M), of observations."""
        return self.contrasts.weights[~self._whole]

    @cached_property
    def _own(self) -> Array:
        """Contrasts (t, N) of whole experiments."""
        first = np.unique(self.experiment, return_index=True)[1]
        weights = self.contrasts.weights[self._whole][:, first]
        return np.asarray(weights - weights.mean(axis=1, keepdims=True))

    def _shape(self, w: Array) -> Array:
        """Of normal scores (M,): mean, scatter, freed of both skewness and tails, and the farthest.

        The farthest is as far as the model says: the outliers that are named are those of the test.
        """
        farthest = -special.log_ndtr(-np.abs(w).max())
        return np.array([w.mean(), np.log(np.mean(w**2)), *moments(w), farthest])

    def _of_experiments(self, scores: Array) -> Array:
        """Moments of the scores (N, K) of experiments."""
        kept = [scores[:, k] for k in self._shaped]
        return np.array([moments(each[each != 0.0]) for each in kept]).ravel()

    def _together(self, level: Array, spread: Array) -> Array:
        """How alike neighbours are, and those of each group, in level and in scatter."""
        found = [shared(group, of) for group in self.groups.values() for of in (level, spread)]
        if self.several:
            found.append(self._unequal(level))
        if not self.ordered:
            return np.array(found)
        pairs = level[1:] * level[:-1]
        if self.several:
            pairs = pairs[np.diff(self.experiment) == 0]
        return np.array([np.sum(pairs) / np.sqrt(max(pairs.size, 1)), *found])

    def _unequal(self, level: Array) -> float:
        """How unequal experiments scatter (after Bartlett, 1937)."""
        count = np.bincount(self.experiment)
        square = np.bincount(self.experiment, level**2)[count > 1] / count[count > 1]
        return -float(np.average(np.log(np.maximum(square, 1e-12)), weights=count[count > 1]))


def is_scale(name: str) -> bool:
    """Whether a hyperparameter says how far values scatter, by its name.

    >>> is_scale("x.sd"), is_scale("noise.torque.sd"), is_scale("x.mean")
    (True, True, False)
    """
    return name.startswith("noise.") or any(part.startswith("sd") for part in name.split("."))


def _groups(columns: tuple[Column, ...]) -> dict[str, Indices]:
    """Groups of rows by columns of many values that repeat, and by all numbers together."""
    size = columns[0].group.size if columns else 0
    many = {c.name: c.group for c in columns if LEVELS < c.count <= REPEATED * size}
    rows = [c.group for c in columns if c.ranks is not None and c.name != ORDER]
    if len(rows) > 1:
        together = np.unique(np.stack(rows, axis=1), axis=0, return_inverse=True)[1].ravel()
        if LEVELS < together.max() + 1 <= REPEATED * size:
            many[SAME] = together
    return many
