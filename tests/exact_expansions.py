"""Expansions in four families of polynomials, and their moments in exact arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import product

import mpmath
import numpy as np
from numpy.typing import NDArray
from problems import from_raw

from aleator.core.polynomials import hermite_recurrence
from aleator.core.types import Array
from aleator.laws import Beta, Gamma, Law, Normal, Uniform
from aleator.moments.exact_moments import ExactQuadrature, Galerkin
from aleator.moments.expansion import Basis

Recurrence = tuple[Array, Array]
WAYS = [ExactQuadrature(), Galerkin(), None]


# ------------------------------------------------- four families, and their moments of monomials


def legendre(count: int) -> Recurrence:
    k = np.arange(1.0, count)
    return np.zeros(count), np.concatenate([[1.0], k**2 / (4.0 * k**2 - 1.0)])


def laguerre(count: int, shape: float = 1.5) -> Recurrence:
    """Weight of the gamma law, whose moments are E[t^m] = shape (shape + 1) .. (shape + m - 1)."""
    k = np.arange(float(count))
    return 2.0 * k + shape, np.where(k > 0.0, k * (k + shape - 1.0), 1.0)


def jacobi(count: int, p: float = 1.0, q: float = 2.5) -> Recurrence:
    """Weight (1 - t)^p (1 + t)^q on [-1, 1]: (1 + t)/2 is Beta(q + 1, p + 1)."""
    k = np.arange(float(count))
    s = 2.0 * k + p + q
    b = 4.0 * k * (k + p) * (k + q) * (k + p + q) / (s**2 * (s + 1.0) * (s - 1.0))
    b[0] = 1.0
    return (q**2 - p**2) / (s * (s + 2.0)), b


@cache
def beta_moment(m: int) -> mpmath.mpf:
    # rf is the rising factorial: E[u^j] = rf(3.5, j)/rf(5.5, j), t = 2 u - 1
    return mpmath.fsum(
        mpmath.binomial(m, j) * 2**j * (-1) ** (m - j) * mpmath.rf(3.5, j) / mpmath.rf(5.5, j)
        for j in range(m + 1)
    )


FAMILIES: dict[str, tuple[Callable[[int], Recurrence], Callable[[int], mpmath.mpf]]] = {
    "hermite": (hermite_recurrence, lambda m: mpmath.mpf(0 if m % 2 else mpmath.fac2(m - 1))),
    "legendre": (legendre, lambda m: mpmath.mpf(1 - m % 2) / (m + 1)),
    "laguerre": (laguerre, lambda m: mpmath.rf(mpmath.mpf("1.5"), m)),
    "jacobi": (jacobi, beta_moment),
}
LAWS: dict[str, Law] = {
    "hermite": Normal(0.0, 1.0),
    "legendre": Uniform.between(-1.0, 1.0),
    "laguerre": Gamma(1.5, 1.5**0.5),
    "jacobi": Beta((-1.0, 1.0), 3.0 / 11.0, (28.0 / (5.5**2 * 6.5)) ** 0.5),
}
"""Laws with these polynomials, in their own coordinates."""
MIXED = ("hermite", "laguerre", "jacobi")
TOTAL = {n: np.array([k for k in product(range(4), repeat=n) if sum(k) <= 3]) for n in (1, 2, 3)}
# neither downward closed nor in any order, the constant not first
SCATTERED = np.array([[0, 2], [3, 0], [0, 0], [1, 1], [4, 1], [1, 0], [2, 2]])
SETS = {"total": TOTAL[2], "scattered": SCATTERED}


def basis_of(*names: str) -> Basis:
    laws = tuple(LAWS[name] for name in names)
    return Basis(laws, tuple(np.array([h.start for h in law.hyperparameters]) for law in laws))


@cache
def exact_polynomials(name: str, degree: int) -> list[list[mpmath.mpf]]:
    """Coefficients of the orthonormal polynomials by Gram and Schmidt, from the moments alone."""
    moment = FAMILIES[name][1]

    def inner(u: list[mpmath.mpf], v: list[mpmath.mpf]) -> mpmath.mpf:
        return mpmath.fsum(
            a * b * moment(i + j) for i, a in enumerate(u) for j, b in enumerate(v) if a * b
        )

    found: list[list[mpmath.mpf]] = []
    for k in range(degree + 1):
        monomial = [mpmath.mpf(i == k) for i in range(degree + 1)]
        rest = monomial
        for known in found:
            share = inner(monomial, known)
            rest = [r - share * u for r, u in zip(rest, known, strict=True)]
        norm = mpmath.sqrt(inner(rest, rest))
        found.append([r / norm for r in rest])
    return found


def exact_moments(
    names: tuple[str, ...], indices: NDArray[np.int64], c: Array, order: int
) -> tuple[float, float, list[float]]:
    """Mean, sd and standardized moments by expanding Y^m in monomials with 60 digits."""
    with mpmath.workdps(60):
        families = [exact_polynomials(name, 4) for name in names]
        y: dict[tuple[int, ...], mpmath.mpf] = {}
        for index, value in zip(indices.tolist(), c.tolist(), strict=True):
            for powers in product(*(range(k + 1) for k in index)):
                part = mpmath.mpf(value)
                for family, k, power in zip(families, index, powers, strict=True):
                    part *= family[k][power]
                y[powers] = y.get(powers, mpmath.mpf(0)) + part
        power, raw = {(0,) * len(names): mpmath.mpf(1)}, []
        for _ in range(order + 1):
            raw.append(
                mpmath.fsum(
                    v * mpmath.fprod(FAMILIES[f][1](m) for f, m in zip(names, k, strict=True))
                    for k, v in power.items()
                )
            )
            following: dict[tuple[int, ...], mpmath.mpf] = {}
            for (k1, v1), (k2, v2) in product(power.items(), y.items()):
                k = tuple(a + b for a, b in zip(k1, k2, strict=True))
                following[k] = following.get(k, mpmath.mpf(0)) + v1 * v2
            power = following
        return from_raw(raw)


@cache
def drawn_with_truth(
    names: tuple[str, ...], key: str
) -> tuple[Array, list[tuple[float, float, list[float]]]]:
    c = np.random.default_rng(1).standard_normal((2, len(SETS[key])))
    return c, [exact_moments(names, SETS[key], row, 8) for row in c]


def assert_same(found: Array, truth: Array, digits: float) -> None:
    """Equal to `digits` relative to E[|z|^m], which an odd moment may be far below."""
    even = truth.shape[1] - 1 - (truth.shape[1] - 1) % 2
    size = np.maximum(np.abs(truth), 1.0)
    size[:, 3:even:2] = np.sqrt(truth[:, 2:even:2] * truth[:, 4 : even + 1 : 2])
    assert np.max(np.abs(found - truth) / size) < digits
