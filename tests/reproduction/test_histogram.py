"""The paper's density of a sample: a spline through its histogram."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate, stats

from aleator.errors import AleatorError
from aleator.moments.moments import NodeOutcomes
from aleator.status import Status
from reproduction.sampling.histogram import HistogramSpline


def sampled(law, size: int, count: int = 1) -> NodeOutcomes:
    p = (np.arange(size) + 0.5) / size
    y = np.stack([law.ppf(p) * (1.0 + k) for k in range(count)])
    return NodeOutcomes(y, np.full(size, 1.0 / size))


def test_bins_keep_their_mass_and_the_density_integrates_to_one() -> None:
    fitted = HistogramSpline(20).fit_sample(sampled(stats.gamma(3.0), 500))
    edges = np.linspace(fitted.low[0], fitted.high[0], 21)
    counts = np.histogram(sampled(stats.gamma(3.0), 500).y[0], edges)[0] / 500
    masses = [
        integrate.quad(lambda y: float(fitted.pdf([[y]])[0, 0]), a, b)[0]
        for a, b in pairwise(edges)
    ]
    np.testing.assert_allclose(masses, counts, atol=1e-9)
    np.testing.assert_allclose(np.diff(fitted.cdf(edges[None, :])[0]), counts, atol=1e-12)


def test_the_error_falls_with_the_sample() -> None:
    law, y = stats.norm(), np.linspace(-2.0, 2.0, 41)[None, :]
    errors = [
        np.abs(HistogramSpline().fit_sample(sampled(law, size)).pdf(y) - law.pdf(y)).max()
        for size in (100, 1_000, 10_000, 200_000)
    ]
    assert errors[-1] < 2e-3
    # the histogram's own order is S^(-1/3) or better: over three decades, a factor of ten
    assert errors[-1] < errors[0] / 10.0


def test_quantiles_invert_the_cdf() -> None:
    fitted = HistogramSpline(30).fit_sample(sampled(stats.beta(2.0, 5.0), 2_000, count=3))
    p = np.array([0.0, 0.01, 0.5, 0.99, 1.0])
    np.testing.assert_allclose(fitted.cdf(fitted.quantile(p)), np.tile(p, (3, 1)), atol=1e-9)


def test_outside_the_sample_there_is_no_density() -> None:
    fitted = HistogramSpline(8).fit_sample(sampled(stats.uniform(), 100))
    assert fitted.pdf([[-0.1, 1.1]]).tolist() == [[0.0, 0.0]]
    assert fitted.log_pdf([[2.0]])[0, 0] == -np.inf
    assert fitted.cdf([[-0.1, 1.1]]).tolist() == [[0.0, 1.0]]


def test_equal_samples_are_a_status() -> None:
    fitted = HistogramSpline(8).fit_sample(NodeOutcomes(np.ones((1, 50)), np.full(50, 0.02)))
    assert fitted.status.tolist() == [Status.DEGENERATE]
    assert fitted.log_pdf([1.0])[0] == -np.inf


def test_wrong_choices_are_refused() -> None:
    with pytest.raises(AleatorError, match="bins"):
        HistogramSpline(2)
    with pytest.raises(AleatorError, match="negative"):
        HistogramSpline().fit_sample(NodeOutcomes(np.ones((1, 2)), np.array([2.0, -1.0])))
