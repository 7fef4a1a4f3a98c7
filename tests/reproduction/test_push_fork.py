"""Push and fork: its order, the non-zero set, and the moments by the multinomial sum."""

from __future__ import annotations

from itertools import pairwise
from math import comb, factorial, prod

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aleator.core.types import Indices
from aleator.laws import Gamma, Law, Normal, Uniform
from aleator.moments.exact_moments import prepare
from aleator.moments.expansion import Basis, TotalDegree
from reproduction.push_fork import (
    count,
    exponents,
    multinomials,
    nonzero_set,
    push_and_fork,
    raw_moment,
    raw_moments,
    stacks,
)


def hermite(n: int, d: int) -> tuple[Basis, Indices]:
    return Basis.normal(n), TotalDegree(d).indices((None,) * n)


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
def test_stacks_are_the_generator_s_rows_in_its_order(m, p) -> None:
    rows = list(push_and_fork(m, p))
    found = stacks(m, p)
    assert len(rows) == count(m, p)
    assert exponents(found, p).tolist() == [list(row) for row in rows]
    assert multinomials(found).tolist() == [
        factorial(m) / prod(factorial(i) for i in row) for row in rows
    ]


# ------------------------------------------------------------------------------ I*_(m,p)


LAWS: dict[str, Law] = {
    "hermite": Normal(0.0, 1.0),
    "legendre": Uniform.between(-1.0, 1.0),
    "laguerre": Gamma(1.0, 1.0),
}


def basis_of(name: str, n: int) -> Basis:
    values = np.array([h.start for h in LAWS[name].hyperparameters])
    return Basis((LAWS[name],) * n, (values,) * n)


def test_the_counts_are_the_paper_s() -> None:
    basis, indices = hermite(4, 3)
    found = [nonzero_set(basis, indices, m) for m in (2, 3, 4, 5)]
    assert len(indices) == 35
    assert [count(m, len(indices)) for m in (2, 3, 4, 5)] == [630, 7_770, 73_815, 575_757]
    assert [terms.coefficients.size for terms in found] == [35, 205, 2_315, 18_415]
    # order 2 is orthonormality: one term for each function, with coefficient one
    square = nonzero_set(*hermite(3, 3), 2)
    np.testing.assert_allclose(square.coefficients, 1.0, rtol=1e-14)


@pytest.mark.parametrize("name", LAWS)
def test_the_multinomial_sum_is_the_moment_of_another_way(name) -> None:
    basis, (_, indices) = basis_of(name, 2), hermite(2, 3)
    c = np.random.default_rng(2).standard_normal((3, len(indices)))
    found = raw_moments(prepare(basis, indices, 5).moments(c))
    for m in range(1, 6):
        np.testing.assert_allclose(
            raw_moment(nonzero_set(basis, indices, m), c), found[:, m], rtol=1e-12
        )
