"""Polynomial surfaces of outcomes over the parameters of a region."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError


@dataclass(frozen=True)
class SurfaceSettings:
    """Polynomials of outcomes as numbers: by judgement, but for the limits of the numbers."""

    ratio: float = 2.0
    """Upper over lower end of a region from which a logarithm is another coordinate than x."""
    largest: float = 345.0
    """Size of a logarithm beyond which squares of outcomes are no numbers."""
    block: int = 4_000_000
    """Numbers in one block of basis functions: 32 MB."""
    cached: int = 1024
    """Sets of indices that are kept."""
    alike: float = 1e-9
    """Relative difference of two sizes of an index that is none."""
    digits: int = 9
    """Decimals to which sizes are compared, where indices are put in order."""
    rounding: float = 1e-12
    """Share by which an index may be larger than the largest."""
    excess: int = 100
    """A set is given up that has this many times the indices that were to be."""


SURFACES = SurfaceSettings()


@dataclass(frozen=True, eq=False)
class Axes:
    """Coordinates z in [-1, 1]^n of points x of a region `box` (n, 2).

    z is linear in x, or in log x where an axis is `logarithmic` (n,).

    >>> axes = Axes(np.array([[1.0, 9.0], [1.0, 9.0]]), np.array([False, True]))
    >>> axes.inward(np.array([[3.0, 3.0]])).tolist(), axes.outward(np.array([[-0.5, 0.0]])).tolist()
    ([[-0.5, 0.0]], [[3.0, 3.0]])
    """

    box: Array
    logarithmic: Flags

    @classmethod
    def plain(cls, box: Array) -> Axes:
        """Linear ones."""
        return cls(box, np.zeros(len(box), dtype=np.bool_))

    def inward(self, x: Array) -> Array:
        """Coordinates z (..., n) of points x (..., n)."""
        low, high = self._terms(self.box.T)
        return np.asarray((2.0 * self._terms(x) - low - high) / (high - low))

    def outward(self, z: Array) -> Array:
        """Points x (..., n) of coordinates z (..., n)."""
        low, high = self._terms(self.box.T)
        x = 0.5 * (low + high) + 0.5 * (high - low) * z
        x[..., self.logarithmic] = np.exp(x[..., self.logarithmic])
        return np.asarray(np.clip(x, *self.box.T))

    def rates(self, x: Array) -> Array:
        """Derivatives dz/dx (..., n) at points x (..., n), each coordinate by its own parameter."""
        low, high = self._terms(self.box.T)
        return np.asarray(2.0 / (high - low) / np.where(self.logarithmic, x, 1.0))

    def moved(self, box: Array) -> Axes:
        """Those of another box: logarithms where there still are any."""
        return Axes(box, self.logarithmic & (box[:, 0] > 0.0))

    def others(self) -> list[Axes]:
        """Those that may be better: none of the logarithms, all, and one more or less."""
        able = logarithms(self.box)
        flips = [self.logarithmic ^ (np.arange(able.size) == i) for i in np.flatnonzero(able)]
        sets = {tuple(flags.tolist()) for flags in (np.zeros_like(able), able, *flips)}
        sets -= {tuple(self.logarithmic.tolist())}
        return [replace(self, logarithmic=np.array(flags)) for flags in sorted(sets)]

    def _terms(self, x: Array) -> Array:
        if not self.logarithmic.any():
            return x
        out = np.array(x, dtype=np.float64)
        out[..., self.logarithmic] = np.log(out[..., self.logarithmic])
        return out


def logarithms(box: Array) -> Flags:
    """Which parameters of a region (n, 2) have a logarithm that bends there."""
    low, high = box.T
    return np.asarray((low > 0.0) & (high > SURFACES.ratio * low))


def legendre(z: Array, degree: int) -> tuple[Array, Array]:
    """Return orthonormal Legendre polynomials and their derivatives at z (J,), both (degree+1, J).

    Orthonormal for the uniform distribution on [-1, 1]: phi_k = sqrt(2k+1) P_k. The derivative
    comes from P_k' = P_(k-2)' + (2k-1) P_(k-1), which needs no division at the ends.

    >>> legendre(np.array([1.0]), 2)[0].ravel() ** 2
    array([1., 3., 5.])
    """
    value = _unscaled(z, degree)
    slope = np.zeros_like(value)
    if degree > 0:
        slope[1] = 1.0
    for k in range(2, degree + 1):
        slope[k] = slope[k - 2] + (2 * k - 1) * value[k - 1]
    scale = _scale(degree)[:, None]
    return value * scale, slope * scale


def _unscaled(z: Array, degree: int) -> Array:
    """P_0..P_degree at z (...), by the three-term recurrence: (degree+1, ...)."""
    value = np.empty((degree + 1, *z.shape))
    value[0] = 1.0
    if degree > 0:
        value[1] = z
    for k in range(2, degree + 1):
        np.multiply(z, value[k - 1], out=value[k])
        value[k] *= (2 * k - 1) / k
        value[k] -= (k - 1) / k * value[k - 2]
    return value


def _scale(degree: int) -> Array:
    return np.asarray(np.sqrt(2.0 * np.arange(degree + 1) + 1.0))


def products(indices: Indices, z: Array) -> Array:
    """Return the products phi_nu(z) as (P, J), for indices (P, n) and points z (J, n)."""
    highest = indices.max(axis=0, initial=0)
    values = _unscaled(z.T, int(highest.max(initial=0)))
    scale = _scale(len(values) - 1)
    out = np.broadcast_to(scale[indices].prod(axis=1)[:, None], (len(indices), len(z)))
    for i in np.flatnonzero(highest):
        out = out * values[indices[:, i], i]
    return np.array(out)


def products_with_gradient(indices: Indices, z: Array) -> Array:
    """Return the products and their n partial derivatives, stacked as (P, 1 + n, J)."""
    count, n = indices.shape
    out = np.empty((count, 1 + n, len(z)))
    for i, degrees in enumerate(indices.T):
        value, slope = (table[degrees] for table in legendre(z[:, i], int(degrees.max(initial=0))))
        for part in range(1 + n):
            factor = slope if part == 1 + i else value
            out[:, part] = out[:, part] * factor if i else factor
    return out


@lru_cache(maxsize=SURFACES.cached)
def ball(scale: tuple[float, ...], norm: float, count: int) -> tuple[Indices, Array]:
    """Return the `count` indices (count, n) of smallest size, with their sizes (count,), in order.

    size(nu) = (sum_i (nu_i / scale_i)^norm)^(1/norm): norm 2 suits outcomes that vary in any
    direction, norm 1 is the total degree, norm 1/2 leaves interactions out for long.

    >>> ball((1.0, 1.0), 1.0, 3)[0]
    array([[0, 0], [1, 0], [0, 1]])
    """
    high = 1.0 / max(scale)
    low = 0.0
    found = _inside(scale, norm, high, count)
    while found is not None and len(found[1]) < count:
        low, high = high, 2.0 * high
        found = _inside(scale, norm, high, count)
    while found is None or len(found[1]) > 2 * count:
        # many indices of the same size: all of them are needed
        if high - low < SURFACES.alike * high:
            found = _inside(scale, norm, high, sys.maxsize)
            break
        middle = 0.5 * (low + high)
        trial = _inside(scale, norm, middle, count)
        if trial is not None and len(trial[1]) < count:
            low = middle
        else:
            high, found = middle, trial
    assert found is not None
    indices, size = found
    order = np.lexsort((*indices.T, np.round(size, SURFACES.digits)))[:count]
    return indices[order], size[order]


def _inside(
    scale: tuple[float, ...], norm: float, radius: float, count: int
) -> tuple[Indices, Array] | None:
    """Return all indices up to a size, or None where they are far more than `count`."""
    indices = np.zeros((1, 0), dtype=np.intp)
    total = np.zeros(1)
    for one in scale:
        term = (np.arange(int(one * radius) + 2) / one) ** norm
        grid = total[:, None] + term
        row, degree = np.nonzero(grid <= radius**norm * (1.0 + SURFACES.rounding))
        indices = np.column_stack([indices[row], degree])
        total = grid[row, degree]
        if len(total) > SURFACES.excess * count:
            return None
    return indices, total ** (1.0 / norm)


def outcomes(t: Array, logarithmic: Flags) -> Array:
    """Outcomes (A, ...) of polynomials t (A, ...), some of them (A,) of the logarithm.

    >>> outcomes(np.array([0.0, 0.0]), np.array([False, True]))
    array([0., 1.])
    """
    if not logarithmic.any():
        return t
    out = np.array(t)
    out[logarithmic] = np.exp(np.clip(t[logarithmic], -SURFACES.largest, SURFACES.largest))
    return out


def chained(slope: Array, y: Array, logarithmic: Flags) -> None:
    """Make slopes (A, n, J) of polynomials, in place, those of the outcomes y (A, J)."""
    slope[logarithmic] *= y[logarithmic][:, None]


def widened(y: Array, by: Array, logarithmic: Flags) -> Array:
    """Ends y (A,) of ranges, moved on the scale of the polynomials."""
    moved = y + by
    moved[logarithmic] = outcomes(by, logarithmic)[logarithmic] * y[logarithmic]
    return moved


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
    `logarithmic` (N,) experiment is log eta_l; values and slopes are those of eta_l all the same.

    `error` (N,) is the estimated root-mean-square error over the box in units of the outcome,
    `scatter` (N,) the standard deviation of the surface over the box, `converged` (N,) whether
    error <= tolerance * scatter, `runs` (N,) the runs spent, `failed` (N,) those of them without an
    outcome, `lower` and `upper` (N,) the range of the outcome over the box.
    Where hardly a run worked there is no surface: `error` is infinite.

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
            self.converged[rows], self.runs[rows], self.failed[rows],
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
        return blocks(count, parts * len(self.indices), SURFACES.block)


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
