"""Pearson's mixtures of two normals, which the paper's figures compare with."""

import numpy as np
from scipy import stats

from aleator.core.status import Status
from aleator.moments.moments import Moments
from reproduction.two_normals import TwoNormals, mixture_moments, two_normals


def test_a_mixture_is_found_again_from_its_moments() -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        share, means, variances = rng.uniform(0.2, 0.8), rng.normal(size=2), rng.uniform(0.3, 1, 2)
        weights = np.array([share, 1.0 - share])
        means = np.sort(means) - weights @ np.sort(means)
        sd = np.sqrt(weights @ (variances + means**2))
        truth = np.stack([weights, means / sd, variances / sd**2])
        # of several mixtures with five moments the sixth chooses this one
        np.testing.assert_allclose(two_normals(mixture_moments(*truth)), truth, atol=1e-5)


def test_the_fitted_mixture_is_a_law_and_what_has_none_says_so() -> None:
    third = stats.lognorm(0.5)
    mean, sd = third.mean(), third.std()
    central = [third.expect(lambda y, m=m: ((y - mean) / sd) ** m) for m in range(7)]
    half = mixture_moments(np.array([0.5, 0.5]), np.array([-0.6, 0.6]), np.array([0.64, 0.64]))
    both = Moments(np.array([2.0, mean]), np.array([3.0, sd]), np.array([half, central]))
    fitted = TwoNormals().fit(both, -np.inf, np.inf)
    assert fitted.status.tolist() == [Status.SOLVED, Status.NOT_REALIZABLE]
    law = TwoNormals().fit(both.take(np.array([0])), -np.inf, np.inf)
    y = np.linspace(-10.0, 14.0, 2001)[None]
    parts = [stats.norm(2.0 - 1.8, 2.4), stats.norm(2.0 + 1.8, 2.4)]
    np.testing.assert_allclose(law.pdf(y)[0], np.mean([p.pdf(y[0]) for p in parts], axis=0))
    p = np.array([0.01, 0.5, 0.9])
    np.testing.assert_allclose(law.cdf(law.quantile(p)), p[None], atol=1e-12)
