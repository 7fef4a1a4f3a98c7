"""Hyperparameters that follow covariates: the coefficients of their formulas, and the values.

v_l = sum_j X_lj beta_j for experiment l, X the columns of a formula; alpha holds beta instead of v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.errors import InputsError, nearest
from aleator.laws.covariates import DesignMatrix, Table
from aleator.laws.hyperparameter import Beside, By, Hyperparameter, Specification, resolve, within
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Entry:
    """A hyperparameter of a law, and where in alpha it is: one place, or its coefficients."""

    own: Hyperparameter
    places: slice
    design: DesignMatrix | None

    def value(self, alpha: Array, experiments: slice) -> Array:
        """The value (B,), or () where it is the same in every experiment; within its limits."""
        if self.design is None:
            return np.asarray(alpha[self.places.start])
        linear = self.design.matrix[experiments] @ alpha[self.places]
        return np.asarray(np.clip(linear, self.own.lower, self.own.upper))

    def score(self, alpha: Array, by_value: Array, experiments: slice) -> Array:
        """Derivatives (B, p) by its part of alpha from those by its value (B,)."""
        if self.design is None:
            return by_value[:, None]
        columns = self.design.matrix[experiments]
        linear = columns @ alpha[self.places]
        inside = (linear >= self.own.lower) & (linear <= self.own.upper)
        return np.asarray(np.where(inside, by_value, 0.0)[:, None] * columns)


@dataclass(frozen=True, eq=False)
class CovariateModel:
    """All hyperparameters of the laws, each with its part of alpha, for N experiments.

    A value that would leave the limits of its hyperparameter is held on them: no law exists beyond.
    """

    entries: tuple[Entry, ...]
    hyperparameters: tuple[Hyperparameter, ...]
    count: int

    @classmethod
    def of(cls, own: Sequence[Hyperparameter], covariates: Table) -> CovariateModel:
        """From the hyperparameters of the laws, and covariates with a row for each experiment.

        Raises InputsError, with the name of the hyperparameter, as `DesignMatrix.of` does.
        """
        entries: list[Entry] = []
        found: list[Hyperparameter] = []
        for h in own:
            design = _design(h, covariates) if h.by is not None else None
            new = [h] if design is None else coefficients(h, design)
            entries.append(Entry(h, slice(len(found), len(found) + len(new)), design))
            found += new
        return cls(tuple(entries), tuple(found), len(covariates))

    def at(self, covariates: Table) -> CovariateModel:
        """The same coefficients for other experiments; raises InputsError for an unknown level."""
        entries = [
            entry if entry.design is None else replace(entry, design=entry.design.at(covariates))
            for entry in self.entries
        ]
        return replace(self, entries=tuple(entries), count=len(covariates))

    def values(self, alpha: Array, part: slice, experiments: slice) -> Array:
        """Values of some of the hyperparameters: (k,), or (k, B, 1) where one has covariates."""
        found = [entry.value(alpha, experiments) for entry in self.entries[part]]
        if all(value.ndim == 0 for value in found):
            return np.array(found)
        count = len(range(*experiments.indices(self.count)))
        return np.stack([np.broadcast_to(value, count) for value in found])[:, :, None]

    def about(self, wanted: Array) -> Array:
        """The alpha whose values (H,) are nearest to the wanted ones in all experiments."""
        found = np.array([h.start for h in self.hyperparameters])
        for entry, value in zip(self.entries, wanted, strict=True):
            if entry.design is None:
                found[entry.places] = value
            else:
                matrix = entry.design.matrix
                found[entry.places] = np.linalg.lstsq(matrix, np.full(len(matrix), value))[0]
        return within(self.hyperparameters, found.tolist())

    def score(self, alpha: Array, by_values: Array, experiments: slice) -> Array:
        """Derivatives (B, K) by alpha from those by the hyperparameters' values (B, H)."""
        return np.concatenate(
            [
                entry.score(alpha, by_values[:, h], experiments)
                for h, entry in enumerate(self.entries)
            ],
            axis=1,
        )

    def held(self, alpha: Array) -> dict[str, Indices]:
        """Which experiments (B,) are held on a limit, by the name of the hyperparameter."""
        found = {}
        for entry in self.entries:
            if entry.design is not None:
                linear = entry.design.matrix @ alpha[entry.places]
                outside = (linear < entry.own.lower) | (linear > entry.own.upper)
                if outside.any():
                    found[entry.own.name] = np.flatnonzero(outside)
        return found


def coefficients(own: Hyperparameter, design: DesignMatrix) -> list[Hyperparameter]:
    """The coefficients of a formula, as hyperparameters ``mean[temperature]``.

    The columns that add up to one (the intercept, or the levels that stand for it) have the limits
    of the value itself, every other +- the width of those limits over the range of its column: no
    value within the limits is left out for which zero is among the covariates. Where zero is not
    between the smallest and the largest of a covariate, the intercept is the value far from all
    experiments: its limits are wider by as much, and the search looks at the value at the mean of
    the covariate (see `Beside`).
    """
    assert own.by is not None
    _require_terms(own, own.by, design.names)
    low, high = design.matrix.min(axis=0), design.matrix.max(axis=0)
    base, width = design.base, own.upper - own.lower
    if base.any():
        steepest = np.where(base, 0.0, width / np.where(high > low, high - low, 1.0))
    else:
        reach = max(abs(own.lower), abs(own.upper))
        steepest = reach / np.maximum(np.maximum(np.abs(low), np.abs(high)), 1e-300)
    far = ~base & ((low > 0.0) | (high < 0.0)) & base.any()
    middle = design.matrix.mean(axis=0)
    beyond = float(np.abs(middle[far]) @ steepest[far])
    terms = tuple((_name(own, design.names[j]), float(middle[j])) for j in np.flatnonzero(far))
    beside = Beside(terms, own.lower, own.upper) if terms else None
    found = []
    for name, is_base, steep in zip(design.names, base, steepest, strict=True):
        limits = (own.lower - beyond, own.upper + beyond) if is_base else (-steep, steep)
        wanted = own.by.terms.get(name)
        log = bool(is_base and own.log and beside is None)
        h = _coefficient(_name(own, name), wanted, limits, own.start if is_base else 0.0, log=log)
        found.append(replace(h, beside=beside) if is_base and wanted is None else h)
    return found


def _coefficient(
    name: str,
    wanted: Specification | None,
    limits: tuple[float, float],
    start: float,
    *,
    log: bool,
) -> Hyperparameter:
    if wanted is None:
        return Hyperparameter(name, *limits, start, free=True, log=log)
    h = resolve(name, wanted, limits)
    if h.free and getattr(wanted, "start", None) is None and h.lower <= start <= h.upper:
        h = replace(h, start=start)
    return replace(h, log=log and h.lower > 0.0)


def _name(own: Hyperparameter, term: str) -> str:
    return f"{own.name}[{term}]"


def _require_terms(own: Hyperparameter, by: By, names: Sequence[str]) -> None:
    for term in by.terms:
        if term not in names:
            raise InputsError(
                f"{own.name}: '{by.formula}' has no coefficient '{term}'{nearest(term, names)}",
                f"its coefficients are {', '.join(names)}",
            )


def _design(own: Hyperparameter, covariates: Table) -> DesignMatrix:
    assert own.by is not None
    try:
        return DesignMatrix.of(own.by.formula, covariates)
    except InputsError as error:
        raise InputsError(f"{own.name} = {error.problem}", error.remedy) from None
