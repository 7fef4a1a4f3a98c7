"""A function of single numbers under many observations: called with arrays where that is the same.

Synthetic straight lines, whose log-likelihood is a multivariate normal density.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal

from aleator import Experiments, Free, Inputs, Noise, Normal, ResponseSurface, Runner, identify
from aleator.fit.question import way_of

POINTS = 10
REGION = np.array([[-1.0, 3.0], [0.0, 2.0]])
INPUTS = Inputs(
    {
        "a": Normal(Free(-5.0, 5.0), Free(0.01, 3.0)),
        "b": Normal(Free(-5.0, 5.0), Free(0.01, 3.0)),
    }
)


def lines(count: int) -> Experiments:
    rng = np.random.default_rng(31)
    each = np.repeat(np.arange(count), POINTS)
    z = np.tile(np.linspace(-1.0, 1.0, POINTS), count)
    a, b = 1.0 + 0.5 * rng.standard_normal(count), 0.7 + 0.3 * rng.standard_normal(count)
    y = a[each] + b[each] * z + 0.2 * rng.standard_normal(each.size)
    return Experiments.from_frame(pd.DataFrame({"id": each, "z": z, "y": y}), outcome="y", id="id")


MANY = lines(150)


def line(z: float, a: float, b: float) -> float:
    return a + b * z


def rounded(z: float, a: float, b: float) -> float:
    """Like exponentials, whose last bits are other ones in an array."""
    return line(z, a, b) * (1.0 + 1e-13 * np.ndim(a))


def branching(z: float, a: float, b: float) -> float:
    return line(z, a, b) if a > -100.0 else 0.0


def single(z: float, a: float, b: float) -> float:
    return a + b * math.tan(math.atan(z))


def centered(z: Any, a: Any, b: Any) -> Any:
    """The mean of a single number is that number; the mean of an array belongs to no run."""
    return line(z, a, b) + (a - np.mean(a))


def way(function: Callable[..., Any], table: Experiments, chosen: ResponseSurface) -> bool:
    runner = Runner(function, table, ["a", "b"])
    return way_of(runner, chosen, np.array([1.0, 1.0]), REGION).direct


@pytest.mark.parametrize(
    ("function", "direct"),
    [(line, True), (rounded, True), (branching, False), (single, False), (centered, False)],
)
def test_a_function_of_numbers_gets_arrays_where_the_values_are_the_same(
    function: Callable[..., Any], direct: bool
) -> None:
    assert way(function, MANY, ResponseSurface()) is direct


def test_a_few_observations_and_a_choice_of_surfaces_keep_surfaces() -> None:
    assert not way(line, lines(5), ResponseSurface())
    assert not way(line, MANY, ResponseSurface(surfaces="own"))


def test_what_takes_no_arrays_is_called_once_for_the_trial() -> None:
    calls = []

    def counted(z: float, a: float, b: float) -> float:
        calls.append(z)
        return branching(z, a, b)

    assert not way(counted, MANY, ResponseSurface())
    assert len(calls) == 1


@pytest.mark.slow
def test_a_large_table_of_a_function_of_numbers_has_the_exact_log_likelihood() -> None:
    found = identify(line, MANY, INPUTS, noise=Noise(Free(0.01, 2.0)), best_law=False)
    assert found.propagation == "direct"
    assert found.sound
    assert found.consistency is not None
    assert found.consistency.consistent
    at = {name: one.estimate for name, one in found.alpha.items()}
    z = np.linspace(-1.0, 1.0, POINTS)
    covariance = (
        at["a.sd"] ** 2 + at["b.sd"] ** 2 * np.outer(z, z) + at["noise.sd"] ** 2 * np.eye(POINTS)
    )
    exact = multivariate_normal(at["a.mean"] + at["b.mean"] * z, covariance)
    y = MANY.observations.lower.reshape(-1, POINTS)
    assert found.log_likelihood.estimated == pytest.approx(exact.logpdf(y).sum(), abs=1e-2)
