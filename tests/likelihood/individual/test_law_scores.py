"""Scores of correlated laws, against differences of their whole density."""

import numpy as np
import pytest

from aleator import Free, Gamma, Inputs, Normal, TruncatedNormal
from aleator.likelihood.individual.parameters import law_scores

LAWS = {
    "a": TruncatedNormal((0.0, 3.0), Free(0.0, 3.0), Free(0.05, 2.0)),
    "alone": Normal(Free(-2.0, 2.0), Free(0.1, 2.0)),
    "b": Gamma(Free(0.5, 3.0), Free(0.05, 2.0)),
}
ALPHA = np.array([0.4, 0.8, 0.2, 0.7, 1.2, 0.5, -0.6])


@pytest.fixture
def inputs() -> Inputs:
    return Inputs(LAWS, {("a", "b"): Free(-0.9, 0.9)})


def test_scores_of_tied_laws_are_the_slopes_of_their_density(inputs: Inputs) -> None:
    rng = np.random.default_rng(3)
    x = inputs.sample(ALPHA, rng.random((12, 3))).reshape(3, 4, 3)
    share = rng.dirichlet(np.ones(4), 3)

    def mean(alpha: np.ndarray) -> np.ndarray:
        return np.sum(share * inputs.log_density(alpha, x.reshape(12, 3)).reshape(3, 4), axis=1)

    steps = 1e-6 * np.eye(ALPHA.size)
    slopes = [(mean(ALPHA + step) - mean(ALPHA - step)) / 2e-6 for step in steps]
    assert law_scores(inputs, ALPHA, x, share) == pytest.approx(np.array(slopes).T, rel=1e-5)


def test_normal_scores_of_a_truncated_law_have_no_step_where_a_tail_is_faint() -> None:
    """From where on logarithms tell them: second differences are as small there as beside it."""
    values, x = np.array([0.4, 0.1]), np.linspace(-0.1, 0.9, 20_001)
    score = TruncatedNormal((-1.0, 2.0)).normal_score(values, x)
    assert np.abs(np.diff(score, 2)).max() < 1e-9
