"""The earth mover's distance against the transport problem, closed forms and its own axioms."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from aleator.errors import InputsError
from aleator.moments.densities import Gaussian, GaussianMixture, MaximumEntropy
from aleator.moments.densities.distances import earth_movers_distance
from aleator.moments.densities.gaussian import FittedGaussian
from aleator.moments.densities.moments import Moments, weighted_moments
from aleator.moments.densities.outcomes import Outcomes
from aleator.types import Array


def normal(mean: float, sd: float) -> FittedGaussian:
    return FittedGaussian(np.array([mean]), np.array([sd]), 3)


def transport(x: Array, u: Array, y: Array, v: Array) -> float:
    """The linear program of the definition: what leaves x_i, what arrives at y_j, least work."""
    cost = np.abs(x[:, None] - y).ravel()
    leaves = np.kron(np.eye(x.size), np.ones(y.size))
    arrives = np.kron(np.ones(x.size), np.eye(y.size))
    solution = optimize.linprog(
        cost, A_eq=np.vstack([leaves, arrives]), b_eq=np.concatenate([u, v]), bounds=(0, None)
    )
    return float(solution.fun)


def test_the_transport_problem() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        x, y = rng.normal(size=7), rng.normal(1.0, 2.0, size=9)
        u, v = rng.dirichlet(np.ones(7)), rng.dirichlet(np.ones(9))
        found = earth_movers_distance(Outcomes(x[None], u), Outcomes(y[None], v))
        np.testing.assert_allclose(found, transport(x, u, y, v), rtol=1e-9)


def test_scipy_on_batches_of_samples() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(5, 40)), rng.exponential(size=(5, 31))
    expected = [stats.wasserstein_distance(*pair) for pair in zip(a, b, strict=True)]
    np.testing.assert_allclose(earth_movers_distance(a, b), expected, rtol=1e-12)
    one = [stats.wasserstein_distance(row, b[0]) for row in a]
    np.testing.assert_allclose(earth_movers_distance(a, b[0]), one, rtol=1e-12)


@pytest.mark.parametrize(
    ("mean", "sd"), [(0.0, 1.0), (2.0, 1.0), (0.0, 3.0), (1.0, 1.5), (0.3, 0.05), (-40.0, 2.0)]
)
def test_two_normals(mean: float, sd: float) -> None:
    """The optimal plan is monotone, so the distance is E|m + s Z|, a folded normal's mean."""
    m, s = mean, sd - 1.0
    exact = abs(m) if s == 0.0 else float(stats.foldnorm.mean(abs(m / s)) * abs(s))
    found = earth_movers_distance(normal(0.0, 1.0), normal(mean, sd))
    np.testing.assert_allclose(found, exact, rtol=1e-7, atol=1e-12)


def test_a_normal_and_a_point() -> None:
    for point in (0.0, 0.7, 30.0):
        exact = stats.foldnorm.mean(point)
        found = earth_movers_distance(normal(0.0, 1.0), [point])
        np.testing.assert_allclose(found, exact, rtol=1e-9)


def test_a_uniform_law_and_its_nodes() -> None:
    """J midpoints stand for cells of width 1/J: every point moves 1/(4 J) in the mean."""
    m = Moments(np.array([0.5]), np.array([12**-0.5]), np.array([[1.0, 0.0, 1.0, 0.0, 1.8]]))
    uniform = MaximumEntropy(4).fit(m, [0.0], [1.0])
    for count in (1, 3, 50):
        nodes = Outcomes(((np.arange(count) + 0.5) / count)[None], np.full(count, 1.0 / count))
        np.testing.assert_allclose(earth_movers_distance(uniform, nodes), 0.25 / count, rtol=1e-6)


def test_a_mixture_and_a_normal_by_thirty_digits() -> None:
    theta, weights = np.polynomial.hermite_e.hermegauss(20)
    parts = np.add.outer([-1.0, 1.0], 0.9 * theta).ravel()[None]
    share = np.outer([0.3, 0.7], weights / weights.sum()).ravel()
    mixture = GaussianMixture().fit(weighted_moments(parts, share, 6), -np.inf, np.inf)
    with mpmath.workdps(30):

        def gap(y: mpmath.mpf) -> mpmath.mpf:
            ours = 0.3 * mpmath.ncdf((y + 1) / 0.9) + 0.7 * mpmath.ncdf((y - 1) / 0.9)
            return ours - mpmath.ncdf(y)

        roots = [mpmath.findroot(gap, start) for start in (-0.6,)]
        exact = mpmath.quad(lambda y: abs(gap(y)), [-14, -4, -2, *roots, 0, 1, 2, 4, 14])
    found = earth_movers_distance(mixture, normal(0.0, 1.0))
    np.testing.assert_allclose(found, float(exact), rtol=1e-7)


def test_a_large_sample_of_a_density_is_near_it() -> None:
    """sqrt(R) W_1 tends to int |B(F)|, of mean sqrt(2/pi) int sqrt(F (1 - F))."""
    density, size = normal(3.0, 2.0), 4000
    sample = density.quantile(np.random.default_rng(3).random(size))
    y = np.linspace(-9, 9, 4001)
    spread = np.sqrt(stats.norm.cdf(y) * stats.norm.sf(y)).sum() * (y[1] - y[0]) * 2.0
    mean = np.sqrt(2.0 / np.pi) * spread / np.sqrt(size)
    assert 0.3 * mean < float(earth_movers_distance(density, sample)[0]) < 3.0 * mean


def test_a_batch_is_its_rows() -> None:
    rng = np.random.default_rng(4)
    mean, sd, sample = rng.normal(size=4), rng.uniform(0.5, 2.0, 4), rng.normal(size=(4, 25))
    batch = earth_movers_distance(FittedGaussian(mean, sd, 3), sample)
    rows = [earth_movers_distance(normal(mean[n], sd[n]), sample[n])[0] for n in range(4)]
    np.testing.assert_allclose(batch, rows, rtol=1e-12)
    one = earth_movers_distance(FittedGaussian(mean[:1], sd[:1], 3), sample)
    np.testing.assert_allclose(one[2], earth_movers_distance(normal(mean[0], sd[0]), sample[2])[0])


signatures = st.lists(
    st.tuples(st.floats(-100, 100), st.floats(0.01, 1)), min_size=1, max_size=6
).map(
    lambda pairs: Outcomes(
        np.array([[y for y, _ in pairs]]),
        np.array([w for _, w in pairs]) / sum(w for _, w in pairs),
    )
)


@settings(max_examples=100)
@given(signatures, signatures, signatures)
def test_it_is_a_metric(a: Outcomes, b: Outcomes, c: Outcomes) -> None:
    ab, bc, ac = (float(earth_movers_distance(*pair)[0]) for pair in ((a, b), (b, c), (a, c)))
    assert ab == pytest.approx(float(earth_movers_distance(b, a)[0]), abs=1e-9)
    assert float(earth_movers_distance(a, a)[0]) == pytest.approx(0.0, abs=1e-9)
    assert ac <= ab + bc + 1e-9
    # never less than the distance of the means
    assert ab >= abs(float((a.y @ a.weights - b.y @ b.weights)[0])) - 1e-9


@settings(max_examples=30)
@given(st.floats(-5, 5), st.floats(0.1, 5), st.floats(0.1, 10), st.floats(-10, 10))
def test_units_and_origin(mean: float, sd: float, scale: float, shift: float) -> None:
    sample = np.array([-1.0, 0.2, 3.0])
    first = earth_movers_distance(normal(mean, sd), sample)
    second = earth_movers_distance(normal(scale * mean + shift, scale * sd), scale * sample + shift)
    np.testing.assert_allclose(second, scale * first, rtol=1e-6, atol=1e-9)


def test_wrong_laws_are_refused() -> None:
    nodes = np.array([[0.0, 1.0]])
    for bad in (
        Outcomes(nodes, np.array([1.5, -0.5])),
        Outcomes(nodes, np.array([0.5, 0.6])),
        Outcomes(nodes * np.nan, np.array([0.5, 0.5])),
        np.zeros((2, 2, 2)),
        np.zeros((1, 0)),
    ):
        with pytest.raises(InputsError):
            earth_movers_distance(bad, [0.0])
    with pytest.raises(InputsError, match="2 and of 3 experiments"):
        earth_movers_distance(np.zeros((2, 4)), np.zeros((3, 4)))


def test_a_point_mass_and_no_density() -> None:
    m = Moments(np.array([1.0, np.nan]), np.array([0.0, 1.0]), np.ones((2, 3)))
    found = earth_movers_distance(Gaussian().fit(m, -np.inf, np.inf), [[3.0], [3.0]])
    np.testing.assert_allclose(found, [2.0, np.nan])
