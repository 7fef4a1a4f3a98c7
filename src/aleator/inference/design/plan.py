"""What a set of experiments leaves unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.types import Array, Flags

SINGULAR = 1e-9
"""Information along a direction, over that of all experiments together, that is none."""
FLOOR = 1e-12
"""What stands for no information: candidates that leave fewer directions open are then better."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Information that there is (A, F, F), and what each of C candidates would add (A, C, F, F).

    Both are of F hyperparameters, at A values of them that are all possible. What is wanted is a
    small variance of d' alpha, the mean over G directions d (A, G, F): c-optimality for one,
    A-optimality for several. With `directions` None it is a small volume of the confidence
    ellipsoid, det(I)^(-1/F): D-optimality (Atkinson, Donev and Tobias, 2007, chapter 10).
    Variances are in units of `unit`. A candidate whose information is not finite is never chosen.
    """

    present: Array
    offered: Array
    directions: Array | None
    unit: float = 1.0

    def relative(self) -> Plan:
        """The same with variances over the present ones, of each direction over its own.

        Unchanged for one direction, and where something is not known at all.
        """
        if not self.known(self.present):
            return self
        if self.directions is None:
            return replace(self, unit=float(self.variance(self.present)))
        if self.directions.shape[1] == 1:
            return self
        inverse = np.linalg.inv(self.present)
        now = np.einsum("agf,afh,agh->ag", self.directions, inverse, self.directions)
        return replace(self, directions=self.directions / np.sqrt(now)[..., None])

    def variance(self, information: Array) -> Array:
        """The criterion (...) of information (A, ..., F, F), the mean over the A values.

        It is large where a direction has no information, and infinite where that is not finite.
        """
        values, vectors, finite = self._decomposed(information)
        values = np.maximum(values, FLOOR)
        if self.directions is None:
            each = np.exp(-np.mean(np.log(values), axis=-1))
            each = each * self._volume.reshape(-1, *[1] * (each.ndim - 1))
        else:
            along = np.einsum("agf,a...fh->a...gh", self._directions, vectors)
            each = np.mean(np.sum(along**2 / values[..., None, :], axis=-1), axis=-1)
        return np.asarray(np.where(finite, each, np.inf).mean(axis=0) / self.unit)

    def known(self, information: Array) -> Flags:
        """Whether information (A, ..., F, F) tells something of all that is wanted, bool (...)."""
        values, vectors, finite = self._decomposed(information)
        nothing = values < SINGULAR
        if self.directions is not None:
            along = np.einsum("agf,a...fh->a...gh", self._directions, vectors) ** 2
            share = along / np.maximum(along.sum(axis=-1, keepdims=True), 1e-300)
            nothing = np.any((share > SINGULAR) & nothing[..., None, :], axis=-2)
        return np.asarray(np.all(finite & ~np.any(nothing, axis=-1), axis=0))

    def standard_error(self, information: Array) -> Array:
        """The root (...) of the criterion; infinite where something is not known at all."""
        known = self.known(information)
        return np.where(known, np.sqrt(self.variance(information)), np.inf)

    def _decomposed(self, information: Array) -> tuple[Array, Array, Flags]:
        """Eigenvalues and vectors of scaled information, and whether it is finite."""
        between = [1] * (information.ndim - 3)
        size = information.shape[-1]
        scaled = information * self._scale.reshape(-1, *between, size, size)
        finite = np.all(np.isfinite(scaled), axis=(-2, -1))
        values, vectors = np.linalg.eigh(np.where(finite[..., None, None], scaled, np.eye(size)))
        return values, vectors, finite

    @cached_property
    def _scale(self) -> Array:
        """(A, F, F): the information of all experiments together has ones on its diagonal."""
        offered = np.where(np.isfinite(self.offered), self.offered, 0.0)
        whole = np.diagonal(self.present + offered.sum(axis=1), axis1=1, axis2=2)
        scale = 1.0 / np.sqrt(np.maximum(whole, 1e-300))
        return np.asarray(scale[:, :, None] * scale[:, None, :])

    @cached_property
    def _directions(self) -> Array:
        assert self.directions is not None
        return np.asarray(self.directions * np.sqrt(self._diagonal)[:, None])

    @cached_property
    def _volume(self) -> Array:
        """(A,): of the scale that was multiplied by, det^(1/F)."""
        return np.asarray(np.exp(np.mean(np.log(self._diagonal), axis=1)))

    @property
    def _diagonal(self) -> Array:
        return np.diagonal(self._scale, axis1=1, axis2=2)
