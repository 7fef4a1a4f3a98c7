"""The numerics under the surfaces, each against a slower way to the same number."""

import numpy as np
import pytest

from aleator.surrogates.fit import (
    SmoothnessPrior,
    first_priors,
    fitted,
    judged,
    leave_one_out,
    shares,
    spread,
    weights,
)
from aleator.surrogates.surface import ball, legendre, products, products_with_gradient

PRIOR = SmoothnessPrior((1.0, 1.6), 2.0, 2.5, 0.25)


def test_points_are_nested_distinct_and_cover_the_box() -> None:
    many = spread(100, 2)
    assert np.array_equal(spread(30, 2), many[:30])
    assert np.array_equal(spread(100, 2), spread(600, 2)[:100])
    assert np.abs(many).max() <= 1.0
    assert (np.abs(many).max(axis=0) > 0.98).all()
    distance = np.linalg.norm(many[:, None] - many, axis=2)
    assert distance[~np.eye(100, dtype=bool)].min() > 0.05
    random = np.random.default_rng(0).uniform(-1, 1, (500, 2))
    assert np.linalg.norm(random[:, None] - many, axis=2).min(axis=1).max() < 0.25


def test_shares_are_the_parts_of_the_box() -> None:
    points = np.array([[-0.5], [0.5], [0.9]])
    assert shares(points) == pytest.approx([0.5, 0.35, 0.15], abs=0.002)


def test_legendre_products_are_orthonormal() -> None:
    indices, _ = ball((1.0, 1.0), 1.0, 21)
    nodes, weight = np.polynomial.legendre.leggauss(8)
    z = np.stack(np.meshgrid(nodes, nodes), -1).reshape(-1, 2)
    basis = products(indices, z)
    gram = basis * np.outer(weight, weight).ravel() / 4.0 @ basis.T
    assert gram == pytest.approx(np.eye(21), abs=1e-12)


def test_derivatives_hold_at_the_ends_too() -> None:
    z = np.array([-1.0, -0.3, 0.4, 1.0])
    _, slope = legendre(z, 6)
    for k in range(7):
        series = np.polynomial.Legendre.basis(k).deriv()
        assert slope[k] == pytest.approx(np.sqrt(2 * k + 1) * series(z), abs=1e-11)
    assert products_with_gradient(np.array([[6]]), z[:, None])[0, 1] == pytest.approx(slope[6])


@pytest.mark.parametrize("norm", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("scale", [(1.0,), (1.0, 1.0), (5.0, 0.2), (1.0, 2.0, 0.5), (1.0,) * 10])
def test_index_sets_are_the_smallest_and_closed(scale: tuple[float, ...], norm: float) -> None:
    indices, size = ball(scale, norm, 60)
    expected = ((indices / np.array(scale)) ** norm).sum(axis=1) ** (1.0 / norm)
    assert size == pytest.approx(expected)
    assert (np.diff(size) >= -1e-8).all()
    known = {tuple(nu) for nu in indices.tolist()}
    assert len(known) == 60
    for nu in known:
        for i in range(len(nu)):
            forward = (*nu[:i], nu[i] + 1, *nu[i + 1 :])
            step = ((np.array(forward) / np.array(scale)) ** norm).sum() ** (1.0 / norm)
            assert forward in known or step >= size[-1] - 1e-8


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_leave_one_out_equals_leaving_one_out(noise: float) -> None:
    z = spread(20, 2)
    y = np.random.default_rng(0).normal(size=(20, 2))
    indices, weight = weights(PRIOR, 20)
    scaled = np.vstack([weight[:, None] * products(indices, z), noise * np.eye(20)])
    residual = leave_one_out(PRIOR._replace(noise=noise), z, y)
    for i in range(20):
        others = np.arange(20) != i
        terms = np.linalg.lstsq(scaled[:, others].T, y[others], rcond=None)[0]
        assert residual[i] == pytest.approx(y[i] - scaled[:, i] @ terms, rel=1e-5)


@pytest.mark.parametrize("prior", [PRIOR, *first_priors(2)])
def test_surfaces_pass_through_their_runs(prior: SmoothnessPrior) -> None:
    z = spread(30, 2)
    y = np.random.default_rng(0).normal(size=(30, 2))
    indices, terms = fitted(prior, z, y)
    assert products(indices, z).T @ terms == pytest.approx(y, abs=1e-8)
    assert judged(prior, z, y).coefficients == pytest.approx(terms, abs=1e-8)
    assert judged(prior, z, y).residual == pytest.approx(leave_one_out(prior, z, y), rel=1e-6)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_expected_error_is_the_true_one_for_outcomes_drawn_from_the_prior(noise: float) -> None:
    z = spread(25, 2)
    random = np.random.default_rng(0)
    indices, weight = weights(PRIOR, 25)
    sd = np.where(weight > 1.0, 3.0, weight)  # a free term has no scale of its own
    draw = sd[:, None] * random.normal(size=(len(weight), 2000))
    y = products(indices, z).T @ draw + noise * random.normal(size=(25, 2000))
    fit = judged(PRIOR._replace(noise=noise), z, y)
    true = ((fit.coefficients - draw) ** 2).sum(axis=0)
    assert (fit.expected**2).mean() == pytest.approx(true.mean(), rel=0.1)
