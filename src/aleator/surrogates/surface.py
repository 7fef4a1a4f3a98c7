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
    """Settings of polynomial surfaces.

    The values are chosen by judgement. Only `largest` follows from the range of floating-point
    numbers.
    """

    ratio: float = 2.0
    """A logarithmic coordinate is considered for a parameter if the upper limit of its range
    exceeds the lower limit by more than this factor."""
    largest: float = 345.0
    """The largest size of a logarithm of an outcome; beyond it the square of the outcome overflows.
    """
    block: int = 4_000_000
    """How many numbers a block of values of the polynomials may have: 32 MB."""
    cached: int = 1024
    """How many sets of multi-indices are kept in memory."""
    alike: float = 1e-9
    """Sizes of multi-indices with less than this relative difference count as equal."""
    digits: int = 9
    """The number of decimals to which sizes are compared when multi-indices are sorted."""
    rounding: float = 1e-12
    """The relative rounding error that is allowed where a size is compared with its limit."""
    excess: int = 100
    """The construction of a set stops when it has this many times the number of multi-indices that
    was asked for."""


SURFACES = SurfaceSettings()


@dataclass(frozen=True, eq=False)
class Axes:
    """The map of parameters x in a region `box` (n, 2) to coordinates z in [-1, 1]^n.

    z_i is linear in x_i, or in log x_i where `logarithmic` (n,) is true.

    >>> axes = Axes(np.array([[1.0, 9.0], [1.0, 9.0]]), np.array([False, True]))
    >>> axes.inward(np.array([[3.0, 3.0]])).tolist(), axes.outward(np.array([[-0.5, 0.0]])).tolist()
    ([[-0.5, 0.0]], [[3.0, 3.0]])
    """

    box: Array
    logarithmic: Flags

    @classmethod
    def plain(cls, box: Array) -> Axes:
        """Linear coordinates for all parameters of a box (n, 2)."""
        return cls(box, np.zeros(len(box), dtype=np.bool_))

    def inward(self, x: Array) -> Array:
        """Coordinates z (..., n) in [-1, 1] of parameters x (..., n) in the box."""
        low, high = self._terms(self.box.T)
        return np.asarray((2.0 * self._terms(x) - low - high) / (high - low))

    def outward(self, z: Array) -> Array:
        """Parameters x (..., n) at the coordinates z (..., n)."""
        low, high = self._terms(self.box.T)
        x = 0.5 * (low + high) + 0.5 * (high - low) * z
        x[..., self.logarithmic] = np.exp(x[..., self.logarithmic])
        return np.asarray(np.clip(x, *self.box.T))

    def rates(self, x: Array) -> Array:
        """Derivatives dz_i/dx_i (..., n) of the coordinates at parameters x (..., n)."""
        low, high = self._terms(self.box.T)
        return np.asarray(2.0 / (high - low) / np.where(self.logarithmic, x, 1.0))

    def wider_than(self, other: Axes) -> Array:
        """How many times as wide (n,) this box is as another, in coordinates that both have."""
        alike = self.logarithmic & other.logarithmic
        low, high = replace(self, logarithmic=alike)._terms(self.box.T)
        least, most = replace(other, logarithmic=alike)._terms(other.box.T)
        return np.asarray((high - low) / (most - least))

    def moved(self, box: Array) -> Axes:
        """The same kinds of coordinates for another box; linear where a parameter can be <= 0."""
        return Axes(box, self.logarithmic & (box[:, 0] > 0.0))

    def others(self) -> list[Axes]:
        """Alternatives to try: no logarithm, every possible one, and one parameter changed."""
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
    """Which parameters of a region (n, 2) are positive and vary by more than a factor 2, (n,)."""
    low, high = box.T
    return np.asarray((low > 0.0) & (high > SURFACES.ratio * low))


def legendre(z: Array, degree: int) -> tuple[Array, Array]:
    """Return orthonormal Legendre polynomials and their derivatives at z (J,), both (degree+1, J).

    They are orthonormal for the uniform distribution on [-1, 1]: phi_k = sqrt(2k+1) P_k. The
    derivative comes from P_k' = P_(k-2)' + (2k-1) P_(k-1), which has no division by zero at the
    ends.

    >>> legendre(np.array([1.0]), 2)[0].ravel() ** 2
    array([1., 3., 5.])
    """
    value = _unscaled(z, degree)
    slope = np.empty_like(value)
    slope[0] = 0.0
    if degree > 0:
        slope[1] = 1.0
    for k in range(2, degree + 1):
        np.multiply(value[k - 1], 2 * k - 1, out=slope[k])
        slope[k] += slope[k - 2]
    scale = _scale(degree)[:, None]
    value *= scale
    slope *= scale
    return value, slope


def _unscaled(z: Array, degree: int) -> Array:
    """Legendre polynomials P_0..P_degree at z (...), as (degree+1, ...)."""
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
    """Return products of Legendre polynomials (P, J), for multi-indices (P, n) at z (J, n)."""
    highest = indices.max(axis=0, initial=0)
    values = _unscaled(z.T, int(highest.max(initial=0)))
    scale = _scale(len(values) - 1)[indices].prod(axis=1)[:, None]
    moving = np.flatnonzero(highest).tolist()
    if not moving:
        return np.tile(scale, len(z))
    out = values[indices[:, moving[0]], moving[0]] * scale
    for i in moving[1:]:
        out *= values[indices[:, i], i]
    return np.asarray(out)


def products_with_gradient(indices: Indices, z: Array) -> Array:
    """Return products of Legendre polynomials and their n partial derivatives, (P, 1 + n, J)."""
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
    """Return the `count` multi-indices (count, n) of smallest size, sorted, with sizes (count,).

    size(nu) = (sum_i (nu_i / scale_i)^norm)^(1/norm). Norm 2 suits outcomes that vary in any
    direction, norm 1 is the total degree, and norm 1/2 includes few products of several parameters.

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
        # Many multi-indices have the same size; then all of them are needed.
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
    """Return all multi-indices up to a size, or None if there are far more than `count`."""
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
    """Outcomes (A, ...) from values t (A, ...) of polynomials.

    Where `logarithmic` (A,) is true, the polynomial is one of the logarithm of the outcome.

    >>> outcomes(np.array([0.0, 0.0]), np.array([False, True]))
    array([0., 1.])
    """
    if not logarithmic.any():
        return t
    out = np.array(t)
    out[logarithmic] = np.exp(np.clip(t[logarithmic], -SURFACES.largest, SURFACES.largest))
    return out


def chained(slope: Array, y: Array, logarithmic: Flags) -> None:
    """Turn derivatives (A, n, J) of logarithms into those of the outcomes y (A, J), in place."""
    slope[logarithmic] *= y[logarithmic][:, None]


def widened(y: Array, by: Array, logarithmic: Flags) -> Array:
    """Limits y (A,) of outcomes, moved by `by` (A,), or multiplied by exp(by) if logarithmic."""
    moved = y + by
    moved[logarithmic] = outcomes(by, logarithmic)[logarithmic] * y[logarithmic]
    return moved


@dataclass(frozen=True)
class Group:
    """Experiments whose polynomials have the same terms, the first of the common list.

    `members` are the experiments, and `coefficients` (members, size) those of the first `size`
    multi-indices.
    """

    members: Indices
    coefficients: Array  # The coefficients of the polynomials (members, size).

    @property
    def size(self) -> int:
        """The number of terms of each polynomial of the group."""
        return int(self.coefficients.shape[1])


@dataclass(frozen=True)
class Surface:
    """Polynomial surfaces eta_l(x) of N experiments over one box of the parameters.

    eta_l(x) = sum over nu in Lambda_l of c_(l, nu) phi_nu(z). phi_nu is the product of orthonormal
    Legendre polynomials with multi-index nu, and z is x mapped to [-1, 1]^n. The sets Lambda_l are
    first parts of one common list of multi-indices, so that all experiments share one basis. Where
    `logarithmic` (N,) is true the polynomial is that of log eta_l; the methods return eta_l and its
    derivatives all the same.

    `error` (N,) is the estimated root-mean-square error over the box in units of the outcome,
    `scatter` (N,) the standard deviation of the surface over the box, `converged` (N,) whether
    error <= tolerance * scatter, `runs` (N,) the number of runs, `failed` (N,) the number of failed
    runs, `lower` and `upper` (N,) the range of the outcome over the box. Where almost all runs
    failed there is no surface, and `error` is infinite.

    Outside the box the polynomial is an extrapolation that grows without limit. It is evaluated
    there without an error being raised, but its values must not be trusted.
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
        """The region of the parameters that the surfaces cover, lower and upper limits (n, 2)."""
        return self.axes.box

    @property
    def total_runs(self) -> int:
        """The number of runs of all experiments together."""
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

        The array of derivatives is a transposed view, in which J is contiguous in memory.
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
    """Return the polynomials (N, J) of N = `count` experiments, for basis values (P, J)."""
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
