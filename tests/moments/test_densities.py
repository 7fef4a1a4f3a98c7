"""Densities of moments: what cannot be known is a status and never a gain; exact partials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moments.targets import mixed

from aleator.core.status import DEGENERATE_VALUE, Status
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.moments.densities import DensityPartials, Gaussian
from aleator.moments.entropy_solver import SETTINGS
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments
from aleator.study.sections import DENSITIES

INF = np.array([np.inf])


def of(standardized: list[float], mean: float = 0.0, sd: float = 1.0) -> Moments:
    return Moments(np.array([mean]), np.array([sd]), np.array([standardized]))


def assert_finite(found: DensityPartials) -> None:
    for name in found.__dataclass_fields__:
        assert np.isfinite(getattr(found, name)).all(), name


@pytest.mark.parametrize(
    ("standardized", "lower", "upper"),
    [
        ([1.0, 0.0, 1.0, 1.0, 1.5], -np.inf, np.inf),  # kurtosis under 1 + skewness^2
        ([1.0, 0.0, 1.0, 0.0, 1.8], -0.9, 0.9),  # sd above half the range
        ([1.0, 0.0, 1.0, 0.0, 9.0], -2.0, 2.0),  # u^4 <= 4 u^2 on the support
        ([1.0, 0.0, 1.0, 0.0, 3.0], 0.5, 2.0),  # mean outside the range
        ([1.0, 0.0, 1.0, np.nan, 3.0], -np.inf, np.inf),
        ([1.0, 0.0, 1.0, 0.0, 3.0], 2.0, -2.0),
        ([1.0, 0.0, 1.0, 0.0, 3.0], np.nan, np.inf),
    ],
)
def test_impossible_moments_are_rejected(
    standardized: list[float], lower: float, upper: float
) -> None:
    fitted = MaximumEntropy(4).fit(of(standardized), [lower], [upper])
    assert fitted.status.tolist() == [Status.NOT_REALIZABLE]
    found = fitted.sensitivity([0.3])
    assert_finite(found)
    assert found.status.tolist() == [Status.NOT_REALIZABLE]
    np.testing.assert_allclose(found.value, fitted.log_pdf([0.3]) - SETTINGS.penalty)


def test_odd_orders_know_their_boundary() -> None:
    # on [-1, 2]: E[(1 + u)(q0 + q1 u)^2] >= 0 and E[(2 - u)(q0 + q1 u)^2] >= 0 bound the skewness
    # to 0 <= E u^3 <= 1: the two-point laws at (-1, 1) and (-1/2, 2) have 0 and 1.5
    status = [
        int(MaximumEntropy(3).fit(of([1.0, 0.0, 1.0, skew]), [-1.0], [2.0]).status[0])
        for skew in (-0.01, 0.01, 0.7, 1.49, 1.51)
    ]
    assert status == [1, 0, 0, 0, 1]


def test_failed_solve_never_gains() -> None:
    """Random moments near and beyond the boundary: the search never sees more than honesty."""
    rng = np.random.default_rng(0)
    skew = rng.normal(size=400)
    kurtosis = 1.0 + skew**2 + rng.normal(scale=0.3, size=400)
    ones, zeros = np.ones(400), np.zeros(400)
    standardized = np.stack([ones, zeros, ones, skew, kurtosis], axis=1)
    m = Moments(zeros, ones, standardized)
    fitted = MaximumEntropy(4).fit(m, np.full(400, -3.0), np.full(400, 4.0))
    y = rng.uniform(-4, 5, 400)
    found, honest = fitted.sensitivity(y), fitted.log_pdf(y)
    assert_finite(found)
    failed, inside = fitted.status != Status.SOLVED, np.isfinite(honest)
    assert failed.sum() > 100
    assert (~failed).sum() > 100
    assert (fitted.solution.residual[~failed] < 1e-6).all()
    assert (fitted.solution.order_used[~failed] == 4).all()
    both = failed & inside
    assert (found.value[both] <= honest[both] - SETTINGS.penalty + 1e-9).all()
    np.testing.assert_allclose(found.value[~failed & inside], honest[~failed & inside], atol=1e-8)
    assert (found.status[failed] == fitted.status[failed]).all()


def test_nothing_outside_and_a_continuation_that_never_exceeds_the_edge() -> None:
    m, low, high = mixed(60, 4, seed=11)
    low = np.where(np.arange(60) % 5 == 0, -np.inf, low)
    fitted = MaximumEntropy(4).fit(m, low, high)
    for side, edge in zip((-1.0, 1.0), fitted.quantile([0.0, 1.0]).T, strict=True):
        at_edge = fitted.sensitivity(edge)
        assert (at_edge.status == Status.SOLVED).all()
        np.testing.assert_allclose(at_edge.value, fitted.log_pdf(edge), atol=1e-6)
        last = at_edge.value
        for distance in (1e-9, 1e-3, 0.1, 1.0, 30.0, 1e6, 1e150):
            y = edge + side * distance * m.sd
            found = fitted.sensitivity(y)
            assert_finite(found)
            assert (found.value <= last + 1e-9).all()
            assert (found.status == Status.OUTSIDE_SUPPORT).all()
            assert (fitted.log_pdf(y) == -np.inf).all()
            assert (fitted.pdf(y) == 0.0).all()
            last = found.value


@pytest.mark.parametrize("density", [Gaussian(), MaximumEntropy(4)])
@pytest.mark.parametrize(
    ("mean", "sd"), [(1.0, 0.0), (1.0, -1.0), (1.0, np.nan), (np.inf, 1.0), (np.nan, 1.0)]
)
def test_no_scatter_is_a_status(density: Gaussian | MaximumEntropy, mean: float, sd: float) -> None:
    both = Moments(
        np.array([mean, 1.0]), np.array([sd, 1.0]), np.tile([1.0, 0.0, 1.0, 0.0, 2.5], (2, 1))
    )
    fitted = density.fit(both, np.array([-5.0, -5.0]), np.array([5.0, 5.0]))
    found = fitted.sensitivity([1.0, 1.0])
    assert fitted.status.tolist() == found.status.tolist() == [Status.DEGENERATE, Status.SOLVED]
    assert_finite(found)
    assert found.value[0] == DEGENERATE_VALUE
    assert found.d_mean[0] == found.d_sd[0] == 0.0
    assert fitted.log_pdf([1.0, 1.0])[0] == -np.inf
    assert np.isfinite(fitted.quantile([0.2])[1, 0])


def test_a_point_mass_is_a_step() -> None:
    for density in (Gaussian(), MaximumEntropy(2)):
        fitted = density.fit(of([1.0, 0.0, 0.0], mean=2.0, sd=0.0), -INF, INF)
        assert fitted.cdf(np.array([[1.9, 2.0, 2.1]])).tolist() == [[0.0, 1.0, 1.0]]
        assert fitted.quantile([0.1, 0.9]).tolist() == [[2.0, 2.0]]


def test_an_outcome_that_is_no_number_is_degenerate() -> None:
    m = of([1.0, 0.0, 1.0, 0.0, 2.5])
    for density in (Gaussian(), MaximumEntropy(4)):
        found = density.fit(m, -INF, INF).sensitivity([np.nan])
        assert_finite(found)
        assert found.status.tolist() == [Status.DEGENERATE]


def test_spikes_that_the_nodes_do_not_see_are_not_called_solved() -> None:
    """Few nodes, two narrow modes: whatever is called solved has the moments, by other means."""
    kurtosis = 1.0 + np.geomspace(1e-5, 1.8, 40)
    ones, zeros = np.ones(40), np.zeros(40)
    m = Moments(zeros, ones, np.stack([ones, zeros, ones, zeros, kurtosis], axis=1))
    fitted = MaximumEntropy(4, nodes=32).fit(m, np.full(40, -8.0), np.full(40, 8.0))
    solved = fitted.status == Status.SOLVED
    assert (~solved).sum() > 3
    assert solved.sum() > 3
    x, w = np.polynomial.legendre.leggauss(20)
    u = np.ravel(np.arange(-8.0, 8.0, 0.05)[:, None] + 0.025 * (1.0 + x))
    w = np.tile(0.025 * w, 320)
    density = fitted.pdf(np.broadcast_to(u, (40, u.size)))
    found = np.stack([(density * u**k) @ w for k in range(5)], axis=1)
    np.testing.assert_allclose(found[solved], m.standardized[solved], atol=1e-4)


@pytest.mark.parametrize(
    "choice", [{"order": 1}, {"order": 9}, {"reach": 0.0}, {"reach": np.inf}, {"nodes": 10}]
)
def test_inadmissible_choices_are_refused(choice: dict[str, float]) -> None:
    with pytest.raises(InputsError, match="Remedy"):
        MaximumEntropy(**choice)  # type: ignore[arg-type]


def test_misuse_is_refused() -> None:
    m = of([1.0, 0.0, 1.0, 0.0, 2.5])
    with pytest.raises(InputsError, match="needs 6 moments, 4 given"):
        MaximumEntropy(6).fit(m, -INF, INF)
    with pytest.raises(InputsError, match="lower"):
        MaximumEntropy(4).fit(m, [0.0, 1.0], INF)
    fitted = MaximumEntropy(4).fit(m, -INF, INF)
    with pytest.raises(InputsError, match="one number to each experiment"):
        fitted.sensitivity([[0.0]])
    with pytest.raises(InputsError, match="one row to each experiment"):
        fitted.log_pdf([0.0, 1.0])
    with pytest.raises(InputsError, match="probability"):
        fitted.quantile([1.2])


def test_the_farthest_outcome_is_finite() -> None:
    m = of([1.0, 0.0, 1.0, 0.0, 2.5], sd=1e-90)
    for density in (Gaussian(), MaximumEntropy(4)):
        fitted = density.fit(m, [-1e300], [1e300])
        assert_finite(fitted.sensitivity([1e300]))
        np.testing.assert_allclose(fitted.cdf([1e300]), [1.0], rtol=1e-13)


Change = Callable[[float], tuple[Moments, Array, Array]]


def difference(density: MaximumEntropy | Gaussian, y: Array, change: Change) -> Array:
    """Central differences of order four."""
    h = 1e-4
    value = [density.fit(*change(k * h)).sensitivity(y).value for k in (-2, -1, 1, 2)]
    slope: Array = (8.0 * (value[2] - value[1]) - (value[3] - value[0])) / (12.0 * h)
    return slope


def check_all(
    density: MaximumEntropy | Gaussian, m: Moments, low: Array, high: Array, y: Array
) -> DensityPartials:
    found = density.fit(m, low, high).sensitivity(y)

    def close(exact: Array, change: Change) -> None:
        slope = difference(density, y, change)
        np.testing.assert_allclose(exact, slope, rtol=1e-6, atol=1e-6 * (1 + np.abs(exact).max()))

    close(found.d_mean * m.sd, lambda h: (replace(m, mean=m.mean + h * m.sd), low, high))
    close(found.d_sd * m.sd, lambda h: (replace(m, sd=m.sd * (1 + h)), low, high))
    for k in range(3, m.order + 1):
        unit = np.eye(m.order + 1)[k]
        close(
            found.d_standardized[:, k],
            lambda h, unit=unit: (replace(m, standardized=m.standardized + h * unit), low, high),
        )
    np.testing.assert_allclose(found.d_standardized[:, :3], 0.0, atol=0)
    return found


def smooth(order: int, range_known: bool) -> tuple[Moments, Array, Array]:
    m, low, high = mixed(12, order, seed=8)
    keep = np.arange(12) % 4 != 0
    m = Moments(m.mean[keep], m.sd[keep], m.standardized[keep])
    if range_known:
        return m, low[keep], high[keep]
    return m, np.full(m.mean.shape, -np.inf), np.full(m.mean.shape, np.inf)


@pytest.mark.parametrize("order", [2, 3, 4, 5])
@pytest.mark.parametrize("range_known", [True, False])
def test_inside_the_support(order: int, range_known: bool) -> None:
    m, low, high = smooth(order, range_known)
    y = m.mean + 0.9 * m.sd * np.cos(np.arange(m.mean.size))
    found = check_all(MaximumEntropy(order, reach=5.0), m, low, high, y)
    assert (found.status == Status.SOLVED).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("range_known", [True, False])
@pytest.mark.parametrize("order", [2, 4])
def test_outside_the_support(side: float, range_known: bool, order: int) -> None:
    m, low, high = smooth(order, range_known)
    edge = np.minimum(high, m.mean + 4 * m.sd) if side > 0 else np.maximum(low, m.mean - 4 * m.sd)
    found = check_all(MaximumEntropy(order, reach=4.0), m, low, high, edge + side * 0.7 * m.sd)
    assert (found.status == Status.OUTSIDE_SUPPORT).all()


@pytest.mark.parametrize("order", [6, 7, 8])
def test_high_orders(order: int) -> None:
    m, low, high = mixed(4, order, seed=9)
    m, low, high = Moments(m.mean[1::2], m.sd[1::2], m.standardized[1::2]), low[1::2], high[1::2]
    check_all(MaximumEntropy(order), m, low, high, m.mean + 0.3 * m.sd)


@pytest.mark.parametrize("place", [0.3, 3.9])
def test_fallback_has_its_own_exact_partials(place: float) -> None:
    # kurtosis 1.2 with skewness 0.8 does not exist: kurtosis >= 1 + skewness^2
    m = Moments(np.array([0.2]), np.array([0.5]), np.array([[1.0, 0.0, 1.0, 0.8, 1.2]]))
    low, high = np.array([-1.0]), np.array([1.5])
    found = check_all(MaximumEntropy(4), m, low, high, m.mean + place * m.sd)
    assert found.status.tolist() == [Status.NOT_REALIZABLE]


def test_gaussian() -> None:
    m, low, high = smooth(4, range_known=True)
    check_all(Gaussian(), m, low, high, m.mean + 2.3 * m.sd)


@pytest.mark.parametrize(
    ("section", "choice"),
    [
        ({"kind": "maximum_entropy"}, MaximumEntropy()),
        ({"kind": "maximum_entropy", "order": 6}, MaximumEntropy(6)),
        ({"kind": "gaussian"}, Gaussian()),
        ({"kind": "automatic"}, None),
        ({}, None),
    ],
)
def test_the_study_file_names_every_density(section: dict, choice: object) -> None:
    assert DENSITIES.read(section).build(Path()) == choice
