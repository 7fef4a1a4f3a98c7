"""Laws: their rules, polynomials and quantiles against integrals that do not use the package."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from problems import from_raw, raw_truncated

from aleator import Constant, Free, Noise, Normal, TruncatedNormal
from aleator.core.polynomials import evaluate
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Law

INF = math.inf

# box, mean, sd: what is hard about it
TRUNCATED = [
    pytest.param((-1.0, 1.0), 0.1, 0.3, id="box at three sd"),
    pytest.param((-1.0, 1.0), 0.9, 0.5, id="binding box"),
    pytest.param((0.0, 1.0), -5.0, 0.5, id="box ten sd in the tail"),
    pytest.param((0.0, 1.0), -20.0, 1.0, id="box twenty sd in the tail"),
    pytest.param((0.0, 1.0), 0.5, 100.0, id="nearly uniform"),
    pytest.param((0.0, 1.0), 0.5, 0.01, id="box at fifty sd"),
    pytest.param((0.0, INF), 0.0, 1.0, id="half normal"),
    pytest.param((0.0, INF), -3.0, 1.0, id="nearly exponential"),
    pytest.param((-INF, 0.0), 2.0, 1.0, id="open below"),
    pytest.param((-INF, INF), 0.3, 2.0, id="no box"),
]


def standardized_by(x: Array, weights: Array, order: int) -> tuple[float, float, list[float]]:
    mean = float(weights @ x)
    sd = math.sqrt(float(weights @ (x - mean) ** 2))
    return mean, sd, [float(weights @ ((x - mean) / sd) ** m) for m in range(order + 1)]


# ------------------------------------------------------------------------------ rules


@pytest.mark.parametrize(("box", "mean", "sd"), TRUNCATED)
@pytest.mark.parametrize("q", [2, 5, 8])
def test_the_own_rule_has_the_moments_up_to_degree_2q_minus_1(box, mean, sd, q) -> None:
    law = TruncatedNormal(box, mean, sd)
    rule = law.rule(np.array([mean, sd]), q)
    order = 2 * q - 1
    truth = from_raw([raw_truncated(mean, sd, box, m) for m in range(order + 1)])
    found = standardized_by(rule.x, rule.weights, order)
    # the law's own scatter may be a thousandth of the distance of its mean to the box
    assert found[0] == pytest.approx(truth[0], abs=1e-11 * truth[1])
    assert found[1] == pytest.approx(truth[1], rel=1e-11)
    # the absolute moments, which an even one bounds, are what rounding is relative to
    even = np.array([truth[2][m - m % 2] for m in range(order + 1)])
    np.testing.assert_allclose(found[2] / even, truth[2] / even, atol=1e-11)


def test_a_nearly_uniform_law_has_gauss_legendre_nodes() -> None:
    rule = TruncatedNormal((2.0, 4.0), 3.0, 1e4).rule(np.array([3.0, 1e4]), 6)
    t, w = np.polynomial.legendre.leggauss(6)
    # the density falls by 5e-9 towards the ends
    np.testing.assert_allclose(rule.x, 3.0 + t, atol=1e-8)
    np.testing.assert_allclose(rule.weights, w / 2.0, atol=1e-8)


def test_a_box_that_does_not_bind_leaves_the_rule_of_the_normal_law() -> None:
    values = np.array([0.4, 0.01])
    own = TruncatedNormal((0.0, 1.0), 0.4, 0.01).rule(values, 12)
    normal = Normal(0.4, 0.01).rule(values, 12)
    # differences of the box's ends enter the derivatives, at a step of 1e-4
    np.testing.assert_allclose(own.x, normal.x, atol=1e-14)
    np.testing.assert_allclose(own.weights, normal.weights, atol=1e-14)
    np.testing.assert_allclose(own.dx, normal.dx, atol=1e-10)
    np.testing.assert_allclose(own.dweights, normal.dweights, atol=1e-8)


@pytest.mark.parametrize("basis", ["own", "hermite"])
@pytest.mark.parametrize("q", [2, 12, 20])
@pytest.mark.parametrize("mean", [-1.0, 0.0, 1.0, 2.5])
@pytest.mark.parametrize("box", [(0.0, 1.0), (0.0, INF), (-INF, 0.0)], ids=str)
def test_nodes_and_quantiles_never_leave_the_box(box, mean, q, basis) -> None:
    law = TruncatedNormal(box, mean, Free(1e-3, 4.0), polynomials=basis)
    lower, upper = law.box
    assert lower < upper
    assert np.isfinite([lower, upper]).all()
    for sd in (1e-3, 0.1, 4.0):
        values = np.array([mean, sd])
        x = law.rule(values, q).x
        u = np.array([0.0, 1e-15, 0.3, 1.0 - 1e-15, 1.0])
        sampled = law.quantile(values, u)
        assert lower <= x.min()
        assert x.max() <= upper
        assert np.all(np.diff(x) >= 0.0)
        assert box[0] <= sampled.min()
        assert sampled.max() <= box[1]


# ------------------------------------------------------------------------------ derivatives


def differences(law: Law, values: Array, q: int) -> tuple[Array, Array]:
    """Derivatives of nodes and weights, by differences of fourth order."""
    dx, dw = np.empty((q, values.size)), np.empty((q, values.size))
    for k in range(values.size):
        h = 1e-3 * values[-1]
        rules = {}
        for steps in (-2, -1, 1, 2):
            moved = values.copy()
            moved[k] += steps * h
            rules[steps] = law.rule(moved, q)
        for out, name in ((dx, "x"), (dw, "weights")):
            f = {s: getattr(rule, name) for s, rule in rules.items()}
            out[:, k] = (8.0 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12.0 * h)
    return dx, dw


@pytest.mark.parametrize("basis", ["own", "hermite"])
@pytest.mark.parametrize(("box", "mean", "sd"), TRUNCATED)
def test_derivatives_of_the_rule_are_those_of_differences(box, mean, sd, basis) -> None:
    law = TruncatedNormal(box, mean, sd, polynomials=basis)
    values = np.array([mean, sd])
    rule = law.rule(values, 6)
    dx, dw = differences(law, values, 6)
    # nodes good to 1e-13 standard deviations over a step of 1e-3 of them leave 1e-9 of noise
    np.testing.assert_allclose(rule.dx, dx, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(rule.dweights * sd, dw * sd, rtol=1e-6, atol=1e-7)


def test_derivatives_of_the_normal_rule_are_those_of_differences() -> None:
    values = np.array([0.4, 1.7])
    rule = Normal(0.4, 1.7).rule(values, 7)
    dx, dw = differences(Normal(0.4, 1.7), values, 7)
    np.testing.assert_allclose(rule.dx, dx, atol=1e-10)
    np.testing.assert_array_equal(rule.dweights, dw)


def test_the_mean_of_a_binding_law_moves_with_the_variance() -> None:
    """d E[x]/d mean = Var[x]/sd^2, an identity of the exponential family, box or no box."""
    mean, sd = 0.9, 0.5
    rule = TruncatedNormal((-1.0, 1.0), mean, sd).rule(np.array([mean, sd]), 10)
    center = rule.weights @ rule.x
    moved = rule.weights @ rule.dx[:, 0] + rule.x @ rule.dweights[:, 0]
    assert moved == pytest.approx(rule.weights @ (rule.x - center) ** 2 / sd**2, rel=1e-8)


# ------------------------------------------------------------------------------ polynomials


@pytest.mark.parametrize(
    "law",
    [
        Normal(0.0, 1.0),
        TruncatedNormal((-1.0, 1.0), 0.0, 1.0, polynomials="hermite"),
        TruncatedNormal((-1.0, 1.0), 0.0, 1.0),
    ],
    ids=["normal", "hermite", "own"],
)
def test_polynomials_are_orthonormal_on_their_own_rule(law) -> None:
    rule = law.rule(np.array([0.0, 1.0]), 16)
    table = evaluate(*law.recurrence(np.array([0.0, 1.0]), 16), rule.t, 15)
    # 16 nodes serve degree 31, products have 30
    np.testing.assert_allclose(table.T @ (rule.weights[:, None] * table), np.eye(16), atol=1e-10)


# ------------------------------------------------------------------------------ quantiles


@pytest.mark.parametrize(("box", "mean", "sd"), TRUNCATED)
def test_the_quantile_is_the_inverse_of_the_distribution(box, mean, sd) -> None:
    law = TruncatedNormal(box, mean, sd)
    for u in (1e-6, 0.02, 0.5, 0.9, 1.0 - 1e-6):
        x = float(law.quantile(np.array([mean, sd]), np.array([u]))[0])
        with mpmath.workdps(120):  # far in a tail 90 digits cancel
            low, high, at = (mpmath.ncdf((mpmath.mpf(e) - mean) / sd) for e in (*box, x))
            below, above = (at - low) / (high - low), (high - at) / (high - low)
        # a rounding of x at 200 standard deviations from zero is 1e-12 of probability
        assert float(below) == pytest.approx(u, rel=1e-8, abs=1e-12)
        assert float(above) == pytest.approx(1.0 - u, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("box", [(-480.0, 520.0), (-520.0, 480.0), (-INF, INF)])
def test_far_variates_of_a_narrow_law_keep_their_place_in_both_tails(box) -> None:
    theta = np.array([-60.0, -42.7, -38.0, 0.0, 38.0, 42.7, 60.0])
    made = TruncatedNormal(box, 0.0, 1.0).standard(np.array([0.0, 1.0]), theta)
    np.testing.assert_allclose(made.x, theta, rtol=1e-12)
    np.testing.assert_allclose(made.dtheta, 1.0, rtol=1e-9)


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Normal(), "Normal: mean"),
        (lambda: Normal(mean=Free(0.0, 1.0), sd=Free(-1.0, 1.0)), "sd"),
        (lambda: Free(1.0, 0.0), r"Free\(1, 0\)"),
        (lambda: Normal(mean=Free(0.0, 1.0, start=2.0), sd=1.0), "mean"),
        (lambda: Normal(mean=0.0), "sd"),
        (lambda: Normal(mean=math.nan, sd=1.0), "mean"),
        (lambda: Normal(mean=Free(0.0, 1.0), sd=-0.1), "sd"),
        (lambda: Normal(0.5, 0.0), "sd"),
        (lambda: TruncatedNormal((0.0, 1.0), mean=0.5, sd=0.0), "sd"),
        (lambda: Normal(mean=Free(0.0, INF), sd=1.0), "mean"),
        (lambda: TruncatedNormal((1.0, 0.0)), "box"),
        (lambda: TruncatedNormal((0.0, math.nan)), "box"),
        (lambda: TruncatedNormal((0.0, INF)), "mean"),
        (lambda: TruncatedNormal((0.0, INF), mean=0.0), "sd"),
        (lambda: TruncatedNormal((0.0, 1.0), sd=Free(-0.1, 1.0)), "sd"),
        (lambda: TruncatedNormal((0.0, 1.0), polynomials="legendre"), "legendre"),  # type: ignore[arg-type]
        (lambda: Constant(), "Constant: value"),
        (lambda: Free(2.0, 2.0), r"Free\(2, 2\)"),
        (lambda: Noise(Free()), "noise: sd"),
        (lambda: Noise(-1.0), "sd"),
    ],
)
def test_misuse_names_the_hyperparameter_and_a_remedy(make, named) -> None:
    with pytest.raises(InputsError, match=named) as caught:
        make()
    assert caught.value.remedy


def test_default_limits_come_from_the_box() -> None:
    mean, sd = TruncatedNormal((2.0, 6.0)).hyperparameters
    assert (mean.lower, mean.upper, mean.start) == (2.0, 6.0, 4.0)
    assert (sd.lower, sd.upper) == pytest.approx((0.004, 2.0))
    assert sd.start == pytest.approx(math.sqrt(0.004 * 2.0))
    assert (mean.log, sd.log) == (False, True)
