"""References of likelihood ratios, and criteria: published numbers and simulated cones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from aleator.inference.model_choice import Criteria, LikelihoodRatio, ratio_p

NONE = np.zeros(0)


def test_inside_it_is_chi_squared() -> None:
    """lme4's anova of the sleep study: 0.0639 with one degree of freedom, p = 0.8004."""
    assert ratio_p(0.0639, 1, boundary=False) == pytest.approx(0.8004, abs=1e-4)


@pytest.mark.parametrize("df", [1, 2, 3])
def test_on_a_boundary_it_is_the_distribution_of_a_projection(df: int) -> None:
    """The squared length of a normal vector projected on a half-space x_1 >= 0."""
    z = np.random.default_rng(0).standard_normal((400_000, df))
    z[:, 0] = np.maximum(z[:, 0], 0.0)
    length = np.sum(z**2, axis=1)
    for level in (0.5, 2.0, 5.0):
        exact = np.mean(length >= level)
        assert ratio_p(level, df, boundary=True) == pytest.approx(exact, abs=0.003)


def test_of_several_scales_it_is_an_upper_bound() -> None:
    """Two scales of zero, with any correlation of their estimates: projections on a quadrant."""
    rng = np.random.default_rng(1)
    for correlation in (-0.8, 0.0, 0.8):
        matrix = np.array([[1.0, correlation], [correlation, 1.0]])
        root = np.linalg.cholesky(np.linalg.inv(matrix))
        z = rng.multivariate_normal([0.0, 0.0], matrix, 200_000)
        whole = np.sum((z @ root) ** 2, axis=1)
        best = np.full(len(z), np.inf)
        for points in (np.zeros_like(z), _edge(z, matrix, 0), _edge(z, matrix, 1)):
            best = np.minimum(best, np.sum(((z - points) @ root) ** 2, axis=1))
        length = np.where(np.all(z >= 0.0, axis=1), whole, whole - best)
        exact = np.mean(length >= 3.0)
        assert exact <= ratio_p(3.0, 2, boundary=True) + 0.003


def _edge(z: np.ndarray, matrix: np.ndarray, k: int) -> np.ndarray:
    """The nearest point with only coordinate k above zero, in the metric of the estimates."""
    inverse = np.linalg.inv(matrix)
    points = np.zeros_like(z)
    points[:, k] = np.maximum((z @ inverse[:, k]) / inverse[k, k], 0.0)
    return points


def test_a_ratio_below_zero_says_nothing() -> None:
    assert ratio_p(-0.2, 1, boundary=True) == 1.0


def test_drawn_ratios_count_ties_and_leave_out_what_did_not_arrive() -> None:
    found = LikelihoodRatio("a", "b", 0.0, 1, 1, True, np.array([0.0, 0.0, 2.0, np.nan]))
    assert found.bootstrap_p == 1.0
    found = LikelihoodRatio("a", "b", 1.0, 1, 1, True, np.array([0.0, 0.0, 2.0, np.nan]))
    assert found.bootstrap_p == 0.5


def test_without_a_reference_there_is_the_bootstrap_alone() -> None:
    found = LikelihoodRatio("a", "b", 3.0, 1, 0, False, NONE)
    assert math.isnan(found.p)
    assert math.isnan(found.bootstrap_p)
    assert found.reference == "bootstrap"


def test_the_criteria_of_the_sleep_study_are_the_published_ones() -> None:
    """lme4, (Days | Subject) by maximum likelihood: AIC 1763.9; BIC 1783.1 counts 180 rows."""
    found = Criteria(-875.9697, 5, 1, 18, 180)
    assert found.aic == pytest.approx(1763.94, abs=0.01)
    assert Criteria(-875.9697, 0, 6, 18, 180).bic == pytest.approx(1783.1, abs=0.05)
    assert found.bic == pytest.approx(1751.9394 + 5 * math.log(18) + math.log(180), abs=1e-3)


def test_too_few_experiments_for_the_correction() -> None:
    assert math.isinf(Criteria(0.0, 4, 1, 6, 6).aicc)
    assert Criteria(0.0, 1, 1, 10_000, 10_000).aicc == pytest.approx(4.0, abs=0.01)


def test_the_reference_of_a_boundary_is_named() -> None:
    assert stats.chi2.sf(0.0, 1) == 1.0
    assert LikelihoodRatio("a", "b", 3.0, 1, 1, True, NONE).reference == "1/2 chi2(0) + 1/2 chi2(1)"
    assert LikelihoodRatio("a", "b", 3.0, 2, 2, True, NONE).reference.startswith("<= ")
