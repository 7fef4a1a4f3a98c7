"""Level sets by lines against closed forms: many parameters, folds, kinks, constants."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from aleator import Constant, Free, Inputs, LogNormal, Normal, Uniform
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.simulators.response_functions import DirectResponse

Array = NDArray[np.float64]
COUNT, BEND = 40, 0.05
LOADS = np.random.default_rng(2).uniform(0.5, 2.0, COUNT)


def likelihood(
    inputs: Inputs, outcome: Callable[..., Array], y: Array, lines: int = 32
) -> LevelLikelihood:
    """Of outcomes `outcome(experiments (R,), x (R, n))`."""
    response = DirectResponse(outcome, y.size, inputs.box)
    return LevelLikelihood(inputs, response, inputs.box, np.arange(y.size), y, lines)


def normals(count: int) -> Inputs:
    return Inputs({f"x{i}": Normal(Free(-3.0, 3.0), Free(0.01, 2.0)) for i in range(count)})


@pytest.mark.parametrize("count", [3, 4, 6, 10])
def test_a_bent_sum_of_many_parameters_is_exact_with_its_score(count: int) -> None:
    """y = q + BEND q^2 of a linear q, which is normal: both roots count."""
    rng = np.random.default_rng(count)
    mean, sd = np.linspace(-1.0, 1.0, count), np.linspace(0.1, 0.5, count)
    c = rng.uniform(0.2, 2.0, (COUNT, count)) * rng.choice([-1.0, 1.0], (COUNT, count))
    q = np.sum(c * (mean + sd * rng.standard_normal((COUNT, count))), axis=1)
    y = q + BEND * q**2

    def outcome(index: NDArray[np.intp], x: Array) -> Array:
        q = np.sum(c[index] * x, axis=1)
        return np.asarray(q + BEND * q**2)

    def exact(alpha: Array) -> Array:
        scale, root = np.sqrt(c**2 @ alpha[1::2] ** 2), np.sqrt(1.0 + 4.0 * BEND * y)
        parts = [stats.norm.pdf((s * root - 1.0) / (2.0 * BEND), c @ alpha[::2], scale)
                 for s in (1.0, -1.0)]  # fmt: skip
        return np.asarray(np.log(sum(parts) / root))

    alpha, of = np.stack([mean, sd], axis=1).ravel(), likelihood(normals(count), outcome, y)
    found = of(alpha)
    np.testing.assert_allclose(found.each, exact(alpha), atol=1e-6)
    np.testing.assert_allclose(of.evaluate(alpha).each, found.each, atol=1e-12)
    for k in (0, 1, 2 * count - 1):
        moved = 1e-5 * np.eye(alpha.size)[k]
        slope = (exact(alpha + moved) - exact(alpha - moved)) / 2e-5
        np.testing.assert_allclose(found.scores[:, k], slope, atol=2e-4 * np.abs(slope).max())


@pytest.mark.parametrize("count", [3, 5])
def test_spheres_have_the_noncentral_chi_square_density(count: int) -> None:
    """Every line touches a sphere somewhere: where it does another direction counts."""
    rng, sd, mean = np.random.default_rng(3), 0.4, np.linspace(0.0, 1.0, count)
    y = np.sum((mean + sd * rng.standard_normal((COUNT, count))) ** 2, axis=1)
    alpha = np.stack([mean, np.full(count, sd)], axis=1).ravel()
    exact = stats.ncx2.logpdf(y / sd**2, count, np.sum(mean**2) / sd**2) - 2.0 * np.log(sd)
    error = []
    for lines in (16, 128):
        of = likelihood(normals(count), lambda _, x: np.sum(x**2, axis=1), y, lines)
        error.append(np.sqrt(np.mean((of.evaluate(alpha).each - exact) ** 2)))
    assert error[1] < 0.02
    assert error[1] < 0.5 * error[0]


def test_a_kink_against_an_integral_over_two_of_the_parameters() -> None:
    """y = |a - c| + b c + max(d, 1/2)."""
    mean, sd = np.array([1.0, 0.3, 0.5]), np.array([0.3, 0.5, 0.2])
    x = mean + sd * np.random.default_rng(5).standard_normal((COUNT, 3))

    def outcome(index: NDArray[np.intp], x: Array) -> Array:
        c = LOADS[index]
        return np.asarray(np.abs(x[:, 0] - c) + x[:, 1] * c + np.maximum(x[:, 2], 0.5))

    y = outcome(np.arange(COUNT), x)
    t = np.linspace(-8.0, 8.0, 401)
    a, d = mean[0] + sd[0] * t[:, None], np.maximum(mean[2] + sd[2] * t, 0.5)
    phi = stats.norm.pdf(t[:, None]) * stats.norm.pdf(t) * (t[1] - t[0]) ** 2
    exact = [
        np.log(np.sum(phi * stats.norm.pdf((y1 - np.abs(a - c) - d) / c, mean[1], sd[1]) / c))
        for y1, c in zip(y, LOADS, strict=True)
    ]
    of = likelihood(normals(3), outcome, y, 128)
    found = of.evaluate(np.stack([mean, sd], axis=1).ravel()).each
    assert abs(np.mean(found - exact)) < 5e-3
    assert np.std(found - exact) < 0.05


def test_a_law_whose_support_moves_and_its_score() -> None:
    """y = c a with a uniform: the density is 1/(c width)."""
    inputs = Inputs({"a": Uniform(Free(0.0, 3.0), Free(0.5, 3.0))})
    y = LOADS * np.random.default_rng(6).uniform(0.6, 2.4, COUNT)
    found = likelihood(inputs, lambda index, x: LOADS[index] * x[:, 0], y)(np.array([1.5, 1.0]))
    np.testing.assert_allclose(found.each, -np.log(LOADS * 2.0 * np.sqrt(3.0)), atol=1e-5)
    np.testing.assert_allclose(found.scores[:, 0], 0.0, atol=1e-4)
    np.testing.assert_allclose(found.scores[:, 1], -1.0, atol=1e-4)


@pytest.mark.parametrize("both", [False, True])
def test_a_constant_that_is_identified_beside_what_scatters(both: bool) -> None:
    """y = c a (+ b) + k c^2 is normal, and its score by k is in closed form."""
    laws = {"a": Normal(Free(-1.0, 3.0), Free(0.05, 1.0))}
    laws |= {"b": Normal(Free(-1.0, 3.0), Free(0.05, 1.0))} if both else {}
    inputs = Inputs({**laws, "k": Constant(Free(0.0, 2.0))})
    z = np.random.default_rng(7).standard_normal((2, COUNT))
    b, of_b = (0.5 + 0.2 * z[1], 0.2) if both else (0.0, 0.0)
    y = LOADS * (1.0 + 0.3 * z[0]) + b + 0.7 * LOADS**2

    def outcome(index: NDArray[np.intp], x: Array) -> Array:
        c = LOADS[index]
        return np.asarray(c * x[:, 0] + (x[:, 1] if both else 0.0) + x[:, -1] * c**2)

    alpha = np.array([1.0, 0.3, 0.5, 0.2, 0.7] if both else [1.0, 0.3, 0.7])
    found = likelihood(inputs, outcome, y)(alpha)
    center, sd = LOADS + (0.5 if both else 0.0) + 0.7 * LOADS**2, np.hypot(0.3 * LOADS, of_b)
    np.testing.assert_allclose(found.each, stats.norm.logpdf(y, center, sd), atol=1e-8)
    exact = (y - center) / sd**2 * LOADS**2
    np.testing.assert_allclose(found.scores[:, -1], exact, atol=1e-5 * np.abs(exact).max())


def test_a_skew_product_of_four_parameters() -> None:
    """The logarithm of a product of lognormal parameters is normal."""
    inputs = Inputs({f"x{i}": LogNormal(Free(0.1, 10.0), Free(0.01, 5.0)) for i in range(4)})
    alpha = np.array([1.0, 0.3, 1.5, 0.6, 2.0, 1.2, 0.8, 0.2])
    variance = np.log1p((alpha[1::2] / alpha[::2]) ** 2)
    center, sd = np.sum(np.log(alpha[::2]) - 0.5 * variance), np.sqrt(variance.sum())
    y = np.exp(center + sd * np.linspace(-3.0, 3.0, COUNT))
    exact = stats.norm.logpdf(np.log(y), center, sd) - np.log(y)
    found = likelihood(inputs, lambda _, x: np.prod(x, axis=1), y).evaluate(alpha)
    np.testing.assert_allclose(found.each, exact, atol=1e-4)


def test_a_jump_is_no_crossing() -> None:
    """y = a + 2 for a > 0, else a: nothing gives 1, which lies between the branches."""
    inputs = Inputs({"a": Normal(Free(-1.0, 1.0), Free(0.1, 2.0)), "k": Constant(Free(-1.0, 1.0))})
    of = likelihood(
        inputs, lambda _, x: x[:, 0] + 2.0 * (x[:, 0] > 0.0) + x[:, 1], np.array([1.0, 2.5])
    )
    found = of.evaluate(np.array([0.0, 1.0, 0.0]))
    assert of.sets(np.array([0.0, 1.0, 0.0])).empty.tolist() == [True, False]
    assert found.each[1] == pytest.approx(stats.norm.logpdf(0.5), abs=1e-6)
