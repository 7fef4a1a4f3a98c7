"""The fitted surfaces: one polynomial an experiment, evaluated for all of them at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aleator.blocks import blocks
from aleator.errors import InputsError
from aleator.surrogates.axes import Axes
from aleator.surrogates.basis import products, products_with_gradient
from aleator.surrogates.scales import chained, outcomes
from aleator.threads import single_threaded
from aleator.types import Array, Flags, Indices

# Numbers held at once by one block of basis functions: 32 MB.
BLOCK = 4_000_000


@dataclass(frozen=True)
class Group:
    """Experiments that share one index set: the first `size` rows of the common list."""

    members: Indices
    coefficients: Array  # (members, size)

    @property
    def size(self) -> int:
        """Number of polynomial terms."""
        return int(self.coefficients.shape[1])


@dataclass(frozen=True)
class Surface:
    """Polynomial surfaces eta_l(x) of N experiments over one box.

    eta_l(x) = sum over nu in Lambda_l of c_(l, nu) phi_nu(z), with phi_nu the tensor product of
    orthonormal Legendre polynomials and z the point mapped to [-1, 1]^n. The sets are prefixes of
    one common list of indices, so one basis serves all experiments. The polynomial of a
    `logarithmic` (N,) experiment is log eta_l; what is asked of it is eta_l all the same.

    `error` (N,) is the estimated root-mean-square error over the box in units of the outcome,
    `scatter` (N,) the standard deviation of the surface over the box, `converged` (N,) whether
    error <= tolerance * scatter, `runs` (N,) the runs spent, `failed` (N,) those of them without an
    outcome, `lower` and `upper` (N,) the range of the outcome over the box, `degrees` (N, n) the
    degree of each parameter beyond which all terms together are smaller than the error. Where
    hardly a run worked there is no surface: `error` is infinite.

    Outside the box the polynomial is an extrapolation and grows without limit: evaluation there
    is not refused, and not to be trusted.
    """

    axes: Axes
    indices: Indices
    groups: tuple[Group, ...]
    error: Array
    scatter: Array
    converged: Flags
    runs: Indices
    failed: Indices
    degrees: Indices
    logarithmic: Flags
    lower: Array = field(default_factory=lambda: np.empty(0))
    upper: Array = field(default_factory=lambda: np.empty(0))

    @property
    def box(self) -> Array:
        """The region of the parameters, (n, 2)."""
        return self.axes.box

    @property
    def total_runs(self) -> int:
        """Runs of all experiments together."""
        return int(self.runs.sum())

    def take(self, rows: Indices) -> Surface:
        """Return the surfaces of the experiments `rows`, each at most once."""
        place = np.full(len(self.error), -1)
        place[rows] = np.arange(len(rows))
        groups = []
        for group in self.groups:
            kept = place[group.members] >= 0
            if kept.any():
                groups.append(Group(place[group.members[kept]], group.coefficients[kept]))
        ends = (end[rows] if end.size else end for end in (self.lower, self.upper))
        return Surface(
            self.axes, self.indices, tuple(groups), self.error[rows], self.scatter[rows],
            self.converged[rows], self.runs[rows], self.failed[rows], self.degrees[rows],
            self.logarithmic[rows], *ends,
        )  # fmt: skip

    @single_threaded
    def evaluate(self, x: Array) -> Array:
        """Return the outcomes (N, J) of all experiments at points x (J, n)."""
        x = self._points(x)
        out = np.empty((len(self.error), len(x)))
        for part in self._blocks(len(x), 1):
            basis = products(self.indices, self.axes.inward(x[part]))
            out[:, part] = _sums(self.groups, len(out), basis)
        return outcomes(out, self.logarithmic)

    @single_threaded
    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Return outcomes (N, J) and their derivatives (N, J, n) with respect to x (J, n).

        The derivatives are a transposed view: memory runs over J last.
        """
        x = self._points(x)
        n = x.shape[1]
        value = np.empty((len(self.error), len(x)))
        slope = np.empty((len(self.error), n, len(x)))
        for part in self._blocks(len(x), 1 + n):
            basis = products_with_gradient(self.indices, self.axes.inward(x[part]))
            basis[:, 1:] *= self.axes.rates(x[part]).T
            value[:, part], slope[:, :, part] = _sums_with_gradient(self.groups, len(value), basis)
        value = outcomes(value, self.logarithmic)
        chained(slope, value, self.logarithmic)
        return value, slope.transpose(0, 2, 1)

    @single_threaded
    def at(self, index: Indices, x: Array) -> Array:
        """Return the outcome (R,) of experiment index[r] at the point x[r], x (R, n)."""
        index, x = np.asarray(index), self._points(x)
        if index.shape != (len(x),) or not np.issubdtype(index.dtype, np.integer):
            raise InputsError(
                f"surface: {len(x)} points but experiments of shape {index.shape}",
                "pass one whole number, the experiment, for each point",
            )
        strangers = index[(index < 0) | (index >= len(self.error))]
        if len(strangers):
            raise InputsError(
                f"surface: no experiment {strangers[0]}", f"count from 0 to {len(self.error) - 1}"
            )
        out = np.empty(len(x))
        for part in self._blocks(len(x), 1):
            z = self.axes.inward(x[part])
            out[part] = _sums_at(self.groups, self.indices, index[part], z)
        return outcomes(out, self.logarithmic[index])

    def _points(self, x: Array) -> Array:
        x = np.asarray(x, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != len(self.box):
            raise InputsError(
                f"surface: points of shape {x.shape}",
                f"pass an array with one row a point and {len(self.box)} columns",
            )
        return x

    def _blocks(self, count: int, parts: int) -> list[slice]:
        return blocks(count, parts * len(self.indices), BLOCK)


def _sums(groups: tuple[Group, ...], count: int, basis: Array) -> Array:
    """Return the polynomials (N, J) of N = `count` experiments, each in a group, for (P, J)."""
    out = np.empty((count, basis.shape[1]))
    for group in groups:
        out[group.members] = group.coefficients @ basis[: group.size]
    return out


def _sums_with_gradient(groups: tuple[Group, ...], count: int, basis: Array) -> tuple[Array, Array]:
    """Return the polynomials (N, J) and their gradients (N, n, J), for the basis (P, 1 + n, J)."""
    columns = basis.reshape(len(basis), -1)
    value = np.empty((count, basis.shape[2]))
    slope = np.empty((count, basis.shape[1] - 1, basis.shape[2]))
    for group in groups:
        both = (group.coefficients @ columns[: group.size]).reshape(
            len(group.members), *basis.shape[1:]
        )
        value[group.members], slope[group.members] = both[:, 0], both[:, 1:]
    return value, slope


def _sums_at(groups: tuple[Group, ...], indices: Indices, place: Indices, z: Array) -> Array:
    """Return the polynomial (R,) of experiment place[r] at the point z[r], z (R, n)."""
    out = np.empty(len(z))
    count = 1 + max(int(group.members.max()) for group in groups)
    where, which = np.empty((2, count), dtype=np.intp)
    for g, group in enumerate(groups):
        where[group.members], which[group.members] = np.arange(len(group.members)), g
    for g, group in enumerate(groups):
        rows = np.flatnonzero(which[place] == g)
        terms = group.coefficients[where[place[rows]]]
        out[rows] = np.einsum("rp,pr->r", terms, products(indices[: group.size], z[rows]))
    return out
