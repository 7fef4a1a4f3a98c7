"""Ten uncertain parameters at once, where the exact likelihood is known."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize

from aleator import Check, Free, GradientMultistart, Inputs, Normal

COUNT, TEN, BEND = 80, 10, 0.03
MEANS, SDS = np.linspace(-1.0, 1.0, TEN), np.linspace(0.1, 0.5, TEN)
FREE_SDS = (8, 9)


def experiments() -> tuple[np.ndarray, np.ndarray]:
    """Conditions c (N, 10) and outcomes y = s + BEND s^2 of s = c.x."""
    rng = np.random.default_rng(5)
    c = rng.uniform(0.2, 2.0, (COUNT, TEN)) * rng.choice([-1.0, 1.0], (COUNT, TEN))
    s = np.sum(c * (MEANS + SDS * rng.standard_normal((COUNT, TEN))), axis=1)
    return c, s + BEND * s**2


def model(c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, x0, x1, x2, x3, x4, x5, x6, x7, x8, x9):
    c = (c0, c1, c2, c3, c4, c5, c6, c7, c8, c9)
    x = (x0, x1, x2, x3, x4, x5, x6, x7, x8, x9)
    s = sum(a * b for a, b in zip(c, x, strict=True))
    return s + BEND * s**2


def exact_maximum(c: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The maximum of the exact likelihood: s is normal, and y a monotone function of it."""
    s = (np.sqrt(1.0 + 4.0 * BEND * y) - 1.0) / (2.0 * BEND)

    def negative(p: np.ndarray) -> float:
        sd = SDS.copy()
        sd[list(FREE_SDS)] = p[TEN:]
        variance = c**2 @ sd**2
        each = -0.5 * (np.log(2.0 * np.pi * variance) + (s - c @ p[:TEN]) ** 2 / variance)
        return -float(np.sum(each - np.log1p(2.0 * BEND * s)))

    start = np.concatenate([MEANS, SDS[list(FREE_SDS)]])
    bounds = [(-2.0, 2.0)] * TEN + [(0.02, 1.0)] * len(FREE_SDS)
    end = optimize.minimize(negative, start, method="L-BFGS-B", bounds=bounds, tol=1e-12)
    return end.x, -float(end.fun)


@pytest.mark.long
def test_a_law_of_ten_parameters_is_identified_from_few_runs() -> None:
    c, y = experiments()
    table = pd.DataFrame({f"c{i}": c[:, i] for i in range(TEN)} | {"y": y})
    laws = {
        f"x{i}": Normal(Free(-2.0, 2.0), Free(0.02, 1.0) if i in FREE_SDS else SDS[i])
        for i in range(TEN)
    }
    found = unjudged(
        model, table, Inputs(laws), outcome="y", vectorized=True,
        search=GradientMultistart(1), verification=Check(0),
    )  # fmt: skip
    assert found.runs / COUNT <= 2000
    truth, largest = exact_maximum(c, y)
    # what the surfaces that follow the law may leave, and four moments of a slightly bent normal
    assert found.log_likelihood.estimated == pytest.approx(largest, abs=0.2)
    names = [f"x{i}.mean" for i in range(TEN)] + [f"x{i}.sd" for i in FREE_SDS]
    for name, value in zip(names, truth, strict=True):
        estimate = found.alpha[name]
        assert estimate.standard_error is not None
        assert abs(estimate.estimate - value) < 0.1 * estimate.standard_error
    assert found.sound
