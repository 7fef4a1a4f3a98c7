"""What is to stand on the seams of the likelihood fits without a change elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from aleator import Free, Inputs, LogNormal
from aleator.likelihood.level_sets.sets import LevelSets

COUNT = 6


@pytest.mark.parametrize("folded", [False, True])
def test_several_exact_outcomes(folded: bool) -> None:
    """(a b, a/b), and (a b, |log(a/b)|) that folds: one preimage, or two, weighted by 1/|det J|."""
    inputs = Inputs({name: LogNormal(Free(0.1, 5.0), Free(0.01, 3.0)) for name in "ab"})
    alpha = np.array([1.0, 0.3, 1.4, 0.5])
    variance = np.log1p((alpha[1::2] / alpha[::2]) ** 2)
    mean = np.log(alpha[::2]) - 0.5 * variance
    rng = np.random.default_rng(2)
    a, b = np.exp(mean[:, None] + np.sqrt(variance)[:, None] * rng.standard_normal((2, COUNT)))
    total, ratio = np.log(a * b), np.log(a / b)
    law = stats.multivariate_normal(
        [mean.sum(), mean[0] - mean[1]],
        [[variance.sum(), variance[0] - variance[1]], [variance[0] - variance[1], variance.sum()]],
    )
    if folded:
        density = sum(law.pdf(np.stack([total, s * ratio], axis=1)) for s in (1.0, -1.0))
        exact = np.log(density) - total
        roots = np.stack([ratio, -ratio], axis=1)
        det = np.broadcast_to(2.0, roots.shape)
    else:
        exact = law.logpdf(np.stack([total, ratio], axis=1)) - total - ratio
        roots = ratio[:, None]
        det = 2.0 * np.exp(roots)
    x = np.exp(0.5 * np.stack([total[:, None] + roots, total[:, None] - roots], axis=2))
    # d(a b, log(a/b))/d(a, b) has the determinant -2, and d(a b, a/b)/d(a, b) -2 a/b
    found = LevelSets(inputs, x, -np.log(det)).evaluate(alpha)
    np.testing.assert_allclose(found.each, exact, atol=1e-10)
