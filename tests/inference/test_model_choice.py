"""Criteria, likelihood ratios, and predictions of experiments that were left out."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import Check, Constant, Experiments, Free, Identification, Inputs, Noise, Normal
from aleator.inference.fit import climbed, positive, refitted
from aleator.inference.model_choice import (
    Criteria,
    LikelihoodRatio,
    informations,
    leave_one_out,
    ratio_p,
    summed_error,
)

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


COUNT = 40


def regression() -> tuple[Identification, np.ndarray, np.ndarray]:
    """A straight line with constants for coefficients, one outlier, and its design matrix."""
    rng = np.random.default_rng(1)
    t = rng.uniform(0.0, 4.0, COUNT)
    y = 1.0 + 0.5 * t + rng.normal(0.0, 0.3, COUNT)
    y[3] += 1.0
    law = Inputs({"a": Constant(Free(-5.0, 5.0)), "b": Constant(Free(-5.0, 5.0))})
    found = unjudged(
        lambda t, a, b: a + b * t, pd.DataFrame({"t": t, "y": y}), law, outcome="y",
        noise=Noise(Free(0.01, 3.0)), vectorized=True, verification=Check(0),
    )  # fmt: skip
    return found, np.column_stack([np.ones(COUNT), t]), y


def multiplied(noise: float | None, count: int = COUNT) -> Identification:
    """exp(load x) with a normal x: the likelihood is not that of a linear model."""
    rng = np.random.default_rng(4)
    load = rng.uniform(0.5, 2.0, count)
    y = np.exp(load * rng.normal(0.2, 0.3, count)) + (noise or 0.0) * rng.standard_normal(count)
    law = Inputs({"x": Normal(Free(-1.0, 1.0), Free(0.01, 1.0))})
    return unjudged(
        lambda load, x: np.exp(load * x), pd.DataFrame({"load": load, "y": y}), law, outcome="y",
        noise=None if noise is None else Noise(noise), vectorized=True, verification=Check(0),
    )  # fmt: skip


def test_a_linear_model_has_the_closed_form() -> None:
    found, design, y = regression()
    left_out = leave_one_out(found.fit)
    for l in range(COUNT):
        rest = np.arange(COUNT) != l
        beta, (squares,), *_ = np.linalg.lstsq(design[rest], y[rest])
        exact = stats.norm.logpdf(y[l], design[l] @ beta, np.sqrt(squares / (COUNT - 1)))
        assert left_out.each[l] == pytest.approx(exact, abs=0.01)
        assert left_out.alpha[l, :2] == pytest.approx(beta, abs=0.01)
    assert left_out.refitted[3]
    assert not np.all(left_out.refitted)


def test_the_information_of_experiments_is_that_of_the_line() -> None:
    found, design, _ = regression()
    fit = found.fit
    scores = fit.scored().scores
    own = informations(fit, scores)
    exact = design[:, :, None] * design[:, None, :] / fit.alpha[2] ** 2
    assert own[:, :2, :2] == pytest.approx(exact, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("noise", [None, 0.1], ids=["exact", "noisy"])
def test_steps_agree_with_refits(noise: float | None) -> None:
    fit = multiplied(noise, 24).fit
    left_out = leave_one_out(fit)
    for l in (0, 7, 21):
        weights = np.ones(24)
        weights[l] = 0.0
        end = climbed(fit, weights)
        assert left_out.each[l] == pytest.approx(end.scored().each[l], abs=0.02)


def test_a_scale_that_only_one_experiment_needs_is_zero_without_it() -> None:
    """Five groups about one mean, and one far away: left out, nothing scatters."""
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"id": np.repeat(list("abcdef"), 6)})
    frame["y"] = 2.0 + np.tile(rng.normal(0.0, 0.2, 6), 6) + 0.6 * (frame["id"] == "f")
    law = Inputs({"x": Normal(Free(0.0, 5.0), Free(0.0, 2.0))})
    found = unjudged(
        lambda x: x, Experiments.from_frame(frame, outcome="y"), law, noise=Noise(Free(0.01, 2.0)),
        vectorized=False, verification=Check(0),
    )  # fmt: skip
    left_out = leave_one_out(found.fit)
    assert found.values["x.sd"] > 0.1
    assert left_out.refitted[5]
    assert left_out.alpha[5, 1] < 1e-3
    assert np.all(left_out.alpha[:5, 1] > 0.1)


def test_a_climb_leaves_a_scale_of_zero_where_it_has_no_score() -> None:
    fit = multiplied(0.1).fit
    zero = fit.alpha.copy()
    zero[1] = fit.hyperparameters[1].lower
    assert refitted(fit.at(zero)).fit.alpha == pytest.approx(fit.alpha, rel=0.02)


def test_what_cannot_be_reached_is_told() -> None:
    fit = multiplied(0.1).fit

    class Unreachable:
        """A likelihood that is not a number."""

        def __call__(self, alpha):
            found = fit.objective()(alpha)
            return replace(found, each=np.full_like(found.each, np.nan))

    class Broken(type(fit)):
        def objective(self):
            return Unreachable()

    broken = Broken(**{each.name: getattr(fit, each.name) for each in fields(fit)})
    assert not refitted(broken).arrived


def test_a_prior_stays_when_an_experiment_goes() -> None:
    """A normal mean with a normal prior and known spread: the mean without l is a weighted one."""
    y = np.random.default_rng(2).normal(1.0, 1.0, 12)
    law = Inputs({"x": Normal(Free(-5.0, 5.0, prior=Normal(0.0, 0.5)), 0.6)})
    found = unjudged(
        lambda x: x, pd.DataFrame({"y": y}), law, outcome="y", noise=Noise(0.8), vectorized=True,
        verification=Check(0),
    )  # fmt: skip
    left_out = leave_one_out(found.fit)
    for l in range(12):
        mean = (y.sum() - y[l]) / (11.0 + 4.0)
        assert left_out.alpha[l, 0] == pytest.approx(mean, abs=2e-3)
        assert left_out.each[l] == pytest.approx(stats.norm(mean, 1.0).logpdf(y[l]), abs=0.01)


def test_errors_of_sums() -> None:
    each = np.random.default_rng(0).normal(0.0, 2.0, 10_000)
    assert summed_error(each) == pytest.approx(200.0, rel=0.02)
    assert np.isnan(summed_error(each[:1]))


def test_a_matrix_becomes_positive_whatever_its_units_are() -> None:
    """Of [[1, 5], [5, 1]] with the eigenvalues 6 and -4 that with 6 and 4 is [[5, 1], [1, 5]]."""
    matrix = np.array([[1.0, 5.0, 0.0], [5.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    expected = np.array([[5.0, 1.0, 0.0], [1.0, 5.0, 0.0], [0.0, 0.0, 2.0]])
    units = np.outer([1e-6, 1.0, 1e5], [1e-6, 1.0, 1e5])
    assert positive(matrix) == pytest.approx(expected)
    assert positive(matrix * units) / units == pytest.approx(expected)
    assert np.linalg.eigvalsh(positive(np.diag([1.0, 0.0])))[0] > 0.0
    assert positive(np.zeros((0, 0))).shape == (0, 0)
