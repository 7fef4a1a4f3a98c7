"""How far the moments reach: hard targets solved and recomputed, a support that follows them."""

import numpy as np
import pytest
from moments.densities.targets import cubics, row, varied
from scipy.integrate import quad_vec
from scipy.linalg import eigh

from aleator.moments.densities import FittedDensity, MaximumEntropy
from aleator.moments.densities.maximum_entropy.support import reach_of, support_of
from aleator.moments.densities.moments import Moments
from aleator.status import Status
from aleator.types import Array

UNBOUNDED = (-np.inf, np.inf)


def recomputed(fitted: FittedDensity, moments: Moments, rows: Array) -> Array:
    """Largest relative error (n,) of the moments of some rows, by SciPy's adaptive quadrature."""
    count, order = moments.mean.size, moments.order
    a, b = ((fitted.quantile([0.0, 1.0]) - moments.mean[:, None]) / moments.sd[:, None]).T
    half, center = 0.5 * (b - a), 0.5 * (a + b)

    def powers(t: float) -> Array:
        u = center + half * t
        f = fitted.pdf(moments.mean + moments.sd * u) * moments.sd * half
        every: Array = f[rows, None] * u[rows, None] ** np.arange(order + 1) / scale[rows]
        return every

    scale = np.maximum(1.0, np.abs(moments.standardized))
    edges = -np.cos(np.pi * np.arange(1, 40) / 40)
    found, _ = quad_vec(powers, -1.0, 1.0, epsabs=1e-9, norm="max", points=edges, limit=4000)
    assert count == fitted.status.size
    error: Array = np.abs(found - (moments.standardized / scale)[rows]).max(axis=1)
    return error


@pytest.mark.parametrize(
    ("order", "count", "failures"),
    [(3, 40, 0), (4, 200, 0), (5, 40, 0), (6, 200, 0), (7, 40, 0), (8, 200, 2)],
)
def test_targets_of_mixed_kind(order: int, count: int, failures: int) -> None:
    moments, lower, upper = varied(count, order, seed=20)
    fitted = MaximumEntropy(order).fit(moments, lower, upper)
    solved = np.flatnonzero(fitted.status == Status.SOLVED)
    assert solved.size >= count - failures
    assert (fitted.solution.order_used[solved] == order).all()
    assert recomputed(fitted, moments, solved).max() < 1e-6


@pytest.mark.parametrize(
    ("order", "failures", "decay"), [(4, 0, 1.0), (5, 0, 0.5), (6, 4, 1.0), (6, 4, 0.5)]
)
def test_two_hundred_cubics_of_a_normal_variable(order: int, failures: int, decay: float) -> None:
    moments = cubics(200, order, seed=21, decay=decay)
    fitted = MaximumEntropy(order).fit(moments, *UNBOUNDED)
    solved = np.flatnonzero(fitted.status == Status.SOLVED)
    assert solved.size >= 200 - failures
    assert recomputed(fitted, moments, solved).max() < 1e-6


def test_what_eight_moments_do_not_solve_falls_back_by_two() -> None:
    """Cubics at M = 8 are beyond float64 in every third case: six moments stand in, and say so."""
    moments = cubics(24, 8, seed=0, decay=1.0)
    fitted = MaximumEntropy(8).fit(moments, *UNBOUNDED)
    failed = np.flatnonzero(fitted.status != Status.SOLVED)
    assert 0 < failed.size < 24
    assert (fitted.solution.order_used[failed] >= 4).all()
    six = MaximumEntropy(6).fit(row(moments, failed), *UNBOUNDED)
    y = (moments.mean + 0.2 * moments.sd)[failed]
    same = fitted.solution.order_used[failed] == 6
    assert same.any()
    np.testing.assert_allclose(
        fitted.log_pdf(moments.mean + 0.2 * moments.sd)[failed][same],
        six.log_pdf(y)[same],
        atol=1e-8,
    )


@pytest.mark.parametrize("order", range(2, 9))
def test_the_reach_holds_every_law_with_these_moments(order: int) -> None:
    """The smallest interval by eigenvalues of the Hankel pencils, which the reach must exceed."""
    moments = cubics(40, order, seed=5, decay=1.0)
    width = reach_of(moments.standardized, 1e-3).width
    for c, r in zip(moments.standardized, width, strict=True):
        odd = order % 2
        size = order // 2 + odd
        shift = 1 if odd else 2
        place = np.add.outer(np.arange(size), np.arange(size))
        needed = np.abs(eigh(c[place + shift], c[place], eigvals_only=True)).max()
        assert r > 1.1 * (needed if odd else np.sqrt(needed))


@pytest.mark.parametrize("order", range(2, 9))
def test_the_slope_of_the_reach_is_its_derivative(order: int) -> None:
    c = cubics(30, order, seed=6, decay=0.5).standardized
    found = reach_of(c, 8.0)
    assert (found.width >= 8.0).all()
    for k in range(order + 1):
        h = 1e-6 * np.maximum(1.0, np.abs(c[:, k]))[:, None] * np.eye(order + 1)[k]
        rise = reach_of(c + h, 8.0).width - reach_of(c - h, 8.0).width
        slope = rise / (2.0 * h[:, k])
        np.testing.assert_allclose(found.slope[:, k], slope, rtol=1e-4, atol=1e-7)


def test_the_reach_of_the_normal_law_and_of_its_cube() -> None:
    # trace A^-1 B is m^2 for the normal law, and 1 + kurtosis for a symmetric law at M = 4; that of
    # the cube is E x^12/(E x^6)^2 = 10395/225
    normal = np.array([[1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0]])
    for order, trace in ((4, 4.0), (6, 9.0)):
        r = reach_of(normal[:, : order + 1], 8.0).width
        np.testing.assert_allclose(r, (8.0**4 + (2 * trace) ** 2) ** 0.25, rtol=1e-12)
    cube = np.array([[1.0, 0.0, 1.0, 0.0, 10395.0 / 225.0]])
    r = reach_of(cube, 8.0).width
    np.testing.assert_allclose(r, (8.0**4 + 4 * (1 + 46.2) ** 2) ** 0.25, rtol=1e-12)


def test_moments_of_no_law_get_the_least_reach() -> None:
    impossible = np.array([[1.0, 0.0, 1.0, 2.0, 1.5, 0.0, 3.0], [1.0, 0.0, -1.0, 0.0, 0.0, 0, 0]])
    found = reach_of(impossible, 8.0)
    assert found.width.tolist() == [8.0, 8.0]
    assert not found.slope.any()


def test_the_physical_range_wins_where_it_is_nearer() -> None:
    c = np.array([[1.0, 0.0, 1.0, 0.0, 3.0]] * 2)
    support = support_of(np.array([-2.0, -np.inf]), np.array([np.inf, 30.0]), c, 8.0)
    r = reach_of(c, 8.0).width
    np.testing.assert_allclose(support.a, [-2.0, -r[1]])
    np.testing.assert_allclose(support.b, [r[0], r[1]])
    assert support.lower_moves.tolist() == [True, False]
    assert support.upper_moves.tolist() == [False, False]


@pytest.mark.parametrize("order", [4, 6])
def test_heavy_tails_move_value_and_support_without_a_jump(order: int) -> None:
    """A lognormal outcome whose scatter grows: the log-density is smooth in it, its slope too."""
    s = np.linspace(0.3, 0.5, 401)
    x, w = np.polynomial.hermite_e.hermegauss(60)
    y = np.exp(s[:, None] * x)
    w = w / w.sum()
    mean = y @ w
    sd = np.sqrt((y - mean[:, None]) ** 2 @ w)
    z = (y - mean[:, None]) / sd[:, None]
    c = np.stack([z**k @ w for k in range(order + 1)], axis=1)
    c[:, :3] = 1.0, 0.0, 1.0
    fitted = MaximumEntropy(order).fit(Moments(mean, sd, c), 0.0, np.inf)
    assert (fitted.status == Status.SOLVED).all()
    at = fitted.sensitivity(mean + 5.0 * sd).value
    second = np.diff(at, 2)
    assert np.abs(np.diff(second)).max() < 1e-4
    assert (np.diff(fitted.quantile([1.0])[:, 0] / sd - mean / sd) > 0.0).all()
