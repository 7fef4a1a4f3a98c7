"""Sets of multi-indices against their definition, looked up in the full tensor."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aleator.errors import InputsError
from aleator.moments.expansion.indices import Anisotropic, Hyperbolic, IndexSet, TotalDegree


def rows(indices: np.ndarray) -> set[tuple[int, ...]]:
    found = {tuple(row) for row in indices.tolist()}
    assert len(found) == len(indices)
    return found


@pytest.mark.parametrize(("n", "degree"), [(1, 5), (2, 4), (3, 3), (4, 2)])
def test_the_total_degree_set_has_the_size_of_the_paper(n, degree) -> None:
    indices = TotalDegree(degree).indices((None,) * n)
    assert len(rows(indices)) == math.comb(n + degree, degree)
    assert indices.sum(axis=1).max() == degree
    assert indices[0].tolist() == [0] * n
    assert np.all(np.diff(indices.sum(axis=1)) >= 0)


def test_limits_cut_the_index_set() -> None:
    expected = {i for i in product(range(4), range(1), range(2)) if sum(i) <= 3}
    assert rows(TotalDegree(3).indices((3, 0, 1))) == expected
    assert rows(TotalDegree(3).indices((None, 0, 1))) == expected


def test_ten_parameters_and_twenty_need_no_full_tensor() -> None:
    assert len(TotalDegree(5).indices((None,) * 10)) == math.comb(15, 5)
    assert len(TotalDegree(3).indices((None,) * 40)) == math.comb(43, 3)
    # q = 1/2: up to k = 4 alone, (1, 1) and its like cost 4
    assert len(Hyperbolic(4).indices((None,) * 40)) == 1 + 4 * 40 + math.comb(40, 2)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 6),
    st.floats(0.2, 1.0),
    st.lists(st.one_of(st.none(), st.integers(0, 4)), min_size=1, max_size=4),
    st.lists(st.floats(1.0, 4.0), min_size=4, max_size=4),
)
def test_every_set_is_what_its_definition_says(degree, norm, limits, weights) -> None:
    n = len(limits)
    tops = [degree if limit is None else min(limit, degree) for limit in limits]
    full = list(product(*(range(top + 1) for top in tops)))
    weights = tuple(weights[:n])
    near = 1e-9 * degree

    def chosen(choice: IndexSet, measure) -> None:
        found = rows(choice.indices(limits))
        assert {k for k in full if measure(k) < degree - near} <= found
        assert found <= {k for k in full if measure(k) <= degree + 10 * near + 1e-12}
        for k in found:
            below = {(*k[:i], k[i] - 1, *k[i + 1 :]) for i in range(n) if k[i]}
            assert below <= found

    chosen(TotalDegree(degree), sum)
    chosen(Anisotropic(degree, weights), lambda k: float(np.dot(weights, k)))
    chosen(Hyperbolic(degree, norm), lambda k: sum(e**norm for e in k) ** (1.0 / norm))


def test_limits_of_the_norm_are_the_known_sets() -> None:
    assert rows(Hyperbolic(4, 1.0).indices((None,) * 3)) == rows(
        TotalDegree(4).indices((None,) * 3)
    )
    assert rows(Anisotropic(4, (1.0,) * 3).indices((None,) * 3)) == rows(
        TotalDegree(4).indices((None,) * 3)
    )
    assert TotalDegree(5).lowered(2) == TotalDegree(2)
    assert Hyperbolic(5, 0.7).lowered(2) == Hyperbolic(2, 0.7)
    assert Anisotropic(5, (1.0, 2.0)).lowered(2) == Anisotropic(2, (1.0, 2.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TotalDegree(-1), "negative"),
        (lambda: Hyperbolic(3, 0.0), "norm"),
        (lambda: Hyperbolic(3, 1.5), "norm"),
        (lambda: Anisotropic(3, (0.5, 1.0)), "at least 1"),
        (lambda: Anisotropic(3, (1.0, 1.0)).indices((None,)), "2 weights for 1 parameters"),
        (lambda: TotalDegree(30).indices((None,) * 20), "more than"),
    ],
)
def test_misuse_is_told(make, words) -> None:
    with pytest.raises(InputsError, match=words):
        make()
