"""Push and fork: its order, the non-zero set, and the store."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import combinations_with_replacement, pairwise
from math import comb, factorial, prod
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.expansion.moments import Basis, NonzeroSet, Origin, PushFork, prepare
from aleator.expansion.moments.multi_indices import (
    count,
    exponents,
    multinomials,
    positions,
    push_and_fork,
    stacks,
)
from aleator.expansion.moments.nonzero import CANDIDATES_AT_ONCE
from aleator.polynomials.indices import TotalDegree
from aleator.polynomials.recurrence import hermite_recurrence


def hermite_basis(n: int, d: int, order: int) -> Basis:
    recurrence = hermite_recurrence(order * d // 2 + 1)
    return Basis((recurrence,) * n, TotalDegree(d).indices((None,) * n))


# ------------------------------------------------------------------------------ I_(m,p)


def test_push_and_fork_go_as_in_the_paper() -> None:
    """(m, p) = (5, 4): all items last, pushed until the last is empty, then forked."""
    rows = list(push_and_fork(5, 4))
    assert rows[:8] == [
        (0, 0, 0, 5),
        (0, 0, 1, 4),
        (0, 0, 2, 3),
        (0, 0, 3, 2),
        (0, 0, 4, 1),
        (0, 0, 5, 0),
        (0, 1, 0, 4),
        (0, 1, 1, 3),
    ]
    assert rows[-2:] == [(4, 1, 0, 0), (5, 0, 0, 0)]
    assert len(rows) == comb(8, 5)
    assert all(one < following for one, following in pairwise(rows))


@given(st.integers(1, 7), st.integers(1, 7))
def test_blocks_are_the_generator_s_rows_in_its_order(m, p) -> None:
    rows = list(push_and_fork(m, p))
    found = stacks(0, len(rows), m, p)
    assert len(rows) == count(m, p)
    assert exponents(found, p).tolist() == [list(row) for row in rows]
    assert positions(found, p).tolist() == list(range(len(rows)))
    assert multinomials(found).tolist() == [
        factorial(m) / prod(factorial(i) for i in row) for row in rows
    ]


@given(st.integers(1, 8), st.integers(2, 70), st.integers(0, 10**12))
def test_any_block_of_a_large_set_stands_where_it_says(m, p, seed) -> None:
    size = count(m, p)
    start = seed % size
    stop = min(size, start + 50)
    found = stacks(start, stop, m, p)
    assert np.all(found[:, :-1] >= found[:, 1:])
    assert found.min() >= 0
    assert found.max() < p
    assert positions(found, p).tolist() == list(range(start, stop))


# ------------------------------------------------------------------------------ I*_(m,p)


def integral(name: str, degrees: tuple[int, ...]) -> Fraction:
    """E[q_(d_1) .. q_(d_m)] of monic polynomials q, in exact fractions."""
    recurrence: dict[str, Callable[[int], tuple[Fraction, Fraction]]] = {
        "hermite": lambda k: (Fraction(0), Fraction(k)),
        "legendre": lambda k: (Fraction(0), Fraction(k * k, 4 * k * k - 1)),
        "laguerre": lambda k: (Fraction(2 * k + 1), Fraction(k * k)),
    }
    moment: dict[str, Callable[[int], Fraction]] = {
        "hermite": lambda m: Fraction(0 if m % 2 else prod(range(1, m, 2))),
        "legendre": lambda m: Fraction(1 - m % 2, m + 1),
        "laguerre": lambda m: Fraction(factorial(m)),
    }
    product = [Fraction(1)]
    for degree in degrees:
        previous, current = [Fraction(0)], [Fraction(1)]
        for k in range(degree):
            a, b = recurrence[name](k)
            following = [Fraction(0), *current]
            for j, value in enumerate(current):
                following[j] -= a * value
            for j, value in enumerate(previous):
                following[j] -= b * value
            previous, current = current, following
        longer = [Fraction(0)] * (len(product) + degree)
        for i, u in enumerate(product):
            for j, v in enumerate(current):
                longer[i + j] += u * v
        product = longer
    return sum((v * moment[name](m) for m, v in enumerate(product)), Fraction(0))


def norm(name: str, degree: int) -> float:
    return float(integral(name, (degree, degree))) ** 0.5


def legendre(length: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k = np.arange(1.0, length)
    return np.zeros(length), np.concatenate([[1.0], k**2 / (4.0 * k**2 - 1.0)])


def laguerre(length: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k = np.arange(float(length))
    return 2.0 * k + 1.0, np.where(k > 0.0, k**2, 1.0)


RECURRENCES = {"hermite": hermite_recurrence, "legendre": legendre, "laguerre": laguerre}


@pytest.mark.parametrize("name", RECURRENCES)
@pytest.mark.parametrize(("n", "d", "m"), [(1, 4, 5), (2, 2, 5), (2, 3, 5), (3, 2, 3)])
def test_the_nonzero_set_is_that_of_exact_fractions(name, n, d, m) -> None:
    indices = hermite_basis(n, d, m).indices
    basis = Basis((RECURRENCES[name](m * d // 2 + 1),) * n, indices)
    found = PushFork().terms(basis, m)
    known: dict[tuple[int, ...], Fraction] = {}
    for degrees in combinations_with_replacement(range(d + 1), m):
        known[degrees] = integral(name, degrees)
    expected = {}
    for row in push_and_fork(m, len(indices)):
        factors = np.repeat(np.arange(len(indices)), row)
        inner = prod(known[tuple(sorted(indices[factors, k].tolist()))] for k in range(n))
        if inner:
            scale = prod(norm(name, degree) for degree in indices[factors].ravel().tolist())
            several = factorial(m) / prod(factorial(i) for i in row)
            expected[row] = several * float(inner) / scale
    assert [tuple(row) for row in found.exponents.tolist()] == list(expected)
    np.testing.assert_allclose(found.coefficients, list(expected.values()), rtol=1e-12)


def test_the_counts_are_the_paper_s() -> None:
    basis = hermite_basis(4, 3, 5)
    found = [PushFork().terms(basis, m) for m in (2, 3, 4, 5)]
    assert basis.size == 35
    assert [terms.candidates for terms in found] == [630, 7_770, 73_815, 575_757]
    assert [terms.coefficients.size for terms in found] == [35, 205, 2_315, 18_415]
    # order 2 is orthonormality: one term for each function, with coefficient one
    square = PushFork().terms(hermite_basis(3, 3, 2), 2)
    np.testing.assert_allclose(square.coefficients, 1.0, rtol=1e-14)


def test_both_sets_of_the_paper_s_figure() -> None:
    found = PushFork().terms(hermite_basis(2, 3, 5), 5)
    every = exponents(stacks(0, count(5, 10), 5, 10), 10)
    kept = {tuple(row) for row in found.exponents.tolist()}
    assert (found.candidates, every.shape, found.exponents.shape) == (2002, (2002, 10), (388, 10))
    assert kept < {tuple(row) for row in every.tolist()}
    assert np.all(every.sum(axis=1) == 5)


def test_workers_do_not_change_the_set() -> None:
    basis = hermite_basis(3, 4, 4)  # 73,815 candidates: two blocks
    one, two = PushFork().terms(basis, 4), PushFork(workers=2).terms(basis, 4)
    assert one.candidates > CANDIDATES_AT_ONCE
    assert np.array_equal(one.factors, two.factors)
    assert np.array_equal(one.coefficients, two.coefficients)


def test_what_would_take_hours_is_refused() -> None:
    with pytest.raises(InputsError, match=r"would try 2.1e\+10 .* order 8 .*\n.*Galerkin"):
        PushFork().terms(hermite_basis(4, 4, 8), 8)


# ------------------------------------------------------------------------------ the store

SMALL = hermite_basis(2, 2, 4)


def same(one: NonzeroSet, other: NonzeroSet) -> bool:
    return np.array_equal(one.factors, other.factors) and np.array_equal(
        one.coefficients, other.coefficients
    )


def only_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_a_set_is_computed_once(tmp_path) -> None:
    way = PushFork(store=tmp_path / "sets")
    first, second = way.terms(SMALL, 4), way.terms(SMALL, 4)
    assert (first.origin, second.origin) == (Origin.COMPUTED, Origin.STORED)
    assert same(first, second)
    assert only_file(tmp_path / "sets").suffix == ".npz"
    # longer recurrences of the same family are the same set
    longer = Basis((hermite_recurrence(40),) * 2, SMALL.indices)
    assert way.terms(longer, 4).origin is Origin.STORED


def test_another_family_set_or_order_is_another_file(tmp_path) -> None:
    way = PushFork(store=tmp_path)
    others = [
        (SMALL, 3),
        (Basis((legendre(5), hermite_recurrence(5)), SMALL.indices), 4),
        (Basis(SMALL.recurrences, SMALL.indices[::-1]), 4),
        (hermite_basis(2, 1, 4), 4),
    ]
    way.terms(SMALL, 4)
    assert [way.terms(basis, m).origin for basis, m in others] == [Origin.COMPUTED] * 4
    assert len(list(tmp_path.iterdir())) == 5


def damages(content: bytes) -> Iterator[bytes]:
    """Truncated, empty, another kind of file, and one bit flipped here and there."""
    yield from (b"", b"not a zip file", content[: len(content) // 2], content[:-1])
    for place in range(0, len(content), 29):
        damaged = bytearray(content)
        damaged[place] ^= 1 << (place % 8)
        yield bytes(damaged)


def test_a_damaged_file_is_never_trusted(tmp_path) -> None:
    way = PushFork(store=tmp_path)
    truth = way.terms(SMALL, 4)
    path = only_file(tmp_path)
    content, replaced = path.read_bytes(), 0
    for damaged in damages(content):
        path.write_bytes(damaged)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = way.terms(SMALL, 4)
        assert same(found, truth)
        # a bit that means nothing, such as a date of the archive, may be read over
        assert found.origin is (Origin.REPLACED if said else Origin.STORED)
        replaced += bool(said)
        assert way.terms(SMALL, 4).origin is Origin.STORED
    assert replaced > 20
    assert list(tmp_path.iterdir()) == [path]


def test_a_set_of_something_else_under_the_same_name_is_replaced(tmp_path) -> None:
    way = PushFork(store=tmp_path)
    other = Basis((legendre(5),) * 2, SMALL.indices)
    truth = way.terms(SMALL, 4)
    path = only_file(tmp_path)
    way.terms(other, 4)
    (foreign,) = set(tmp_path.iterdir()) - {path}
    path.write_bytes(foreign.read_bytes())
    with pytest.warns(RuntimeWarning, match=f"{path.name} is damaged or of something else"):
        found = way.terms(SMALL, 4)
    assert same(found, truth)
    assert found.origin is Origin.REPLACED


def test_moments_from_the_store_are_those_without(tmp_path) -> None:
    c = np.random.default_rng(0).standard_normal((3, SMALL.size))
    direct = prepare(SMALL, 4, PushFork()).moments(c).standardized
    for _ in range(2):
        stored = prepare(SMALL, 4, PushFork(store=tmp_path)).moments(c).standardized
        assert np.array_equal(stored, direct)


def test_a_store_that_cannot_be_written_is_named(tmp_path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    with pytest.raises(InputsError, match=r"sets: cannot keep a non-zero set there"):
        PushFork(store=occupied / "sets").terms(SMALL, 4)
