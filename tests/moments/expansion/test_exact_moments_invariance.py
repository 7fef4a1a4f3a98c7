"""What must not change the moments of an expansion: units, order, parts, and no scatter."""

from __future__ import annotations

import numpy as np
import pytest
from exact_expansions import (
    TOTAL,
    WAYS,
    assert_same,
    basis_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from aleator.moments.expansion import Basis
from aleator.moments.expansion.indices import constant
from aleator.moments.expansion.moments import ExactQuadrature, Galerkin, prepare

# ------------------------------------------------------------------------------ properties


@settings(max_examples=25)
@given(
    c=arrays(np.float64, (2, 10), elements=st.floats(-3.0, 3.0).filter(lambda v: abs(v) > 1e-3)),
    scale=st.floats(1e-6, 1e6),
    shift=st.floats(-5.0, 5.0),
)
def test_an_affine_change_of_the_outcome_changes_mean_and_sd_only(c, scale, shift) -> None:
    basis, indices = basis_of("hermite", "jacobi"), TOTAL[2]
    moved = -scale * c
    moved[:, constant(indices)] += scale * shift
    for way in (ExactQuadrature(), Galerkin()):
        ready = prepare(basis, indices, 6, way)
        one, other = ready.moments(c), ready.moments(moved)
        sign = (-1.0) ** np.arange(7)
        assert_same(sign * other.standardized, one.standardized, 1e-11)
        np.testing.assert_allclose(other.sd, scale * one.sd, rtol=1e-13)
        np.testing.assert_allclose(other.mean, scale * (shift - one.mean), atol=1e-14 * scale)


def test_no_digit_is_lost_for_a_small_scatter_about_a_large_outcome() -> None:
    basis, indices = Basis.normal(1), TOTAL[1]
    c = np.array([[0.0, 1.0, 0.3, 0.1]])
    truth = prepare(basis, indices, 8, Galerkin()).moments(c).standardized
    small = 1e-9 * c + np.array([[0.8, 0.0, 0.0, 0.0]])
    for way in WAYS:
        assert_same(prepare(basis, indices, 8, way).moments(small).standardized, truth, 1e-12)


def test_order_of_functions_and_of_experiments_does_not_matter() -> None:
    rng = np.random.default_rng(11)
    order, rows = rng.permutation(len(TOTAL[2])), rng.permutation(5)
    c = rng.standard_normal((5, len(TOTAL[2])))
    for way in WAYS:
        straight = prepare(basis_of("legendre", "legendre"), TOTAL[2], 5, way).moments(c)
        mixed = prepare(basis_of("legendre", "legendre"), TOTAL[2][order], 5, way).moments(
            c[rows][:, order]
        )
        assert_same(mixed.standardized, straight.standardized[rows], 1e-13)


@pytest.mark.parametrize("way", WAYS, ids=repr)
def test_parts_of_the_experiments_give_what_all_of_them_give(way) -> None:
    c = np.random.default_rng(0).standard_normal((7, len(TOTAL[2])))
    ready, many = prepare(basis_of("hermite", "laguerre"), TOTAL[2], 6, way), 600
    whole, parts = (
        ready.moments_with_gradient(c),
        ready.moments_with_gradient(np.tile(c, (many, 1))),
    )
    scale = np.abs(whole.standardized_jac).max()
    for start in (0, 7 * (many // 2), 7 * (many - 1)):
        part = parts.take(np.arange(start, start + 7))
        np.testing.assert_allclose(part.standardized, whole.standardized, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            part.standardized_jac, whole.standardized_jac, rtol=0, atol=1e-13 * scale
        )
    again = ready.moments(np.tile(c, (many, 1))).standardized
    assert_same(again, parts.standardized, 1e-12)


@pytest.mark.parametrize("way", WAYS, ids=repr)
def test_an_expansion_without_scatter_has_none(way) -> None:
    c = np.array([[2.0, 0.0, 0.0, 0.0], [2.0, 1e-17, 0.0, 0.0]])
    found = prepare(Basis.normal(1), TOTAL[1], 4, way).moments_with_gradient(c)
    assert (found.mean.tolist(), found.sd.tolist()) == ([2.0, 2.0], [0.0, 0.0])
    assert found.standardized.tolist() == [[1.0, 0.0, 1.0, 0.0, 0.0]] * 2
    assert np.all(found.standardized_jac == 0.0)
