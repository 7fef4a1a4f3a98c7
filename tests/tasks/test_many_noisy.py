"""More than four scattering parameters and noise: the answer is that of the closed form."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Check, Free, GradientMultistart, Inputs, Noise, Normal

NOISE = 0.25


def study(many: int, count: int, bend: float, seed: int):
    """A simulator y = s + bend s^2 of s = c.x, a table, and the exact -log L of (means, last sd).

    With noise, s is normal, and y a smooth function of it: one integral an experiment.
    """
    rng = np.random.default_rng(seed)
    means, sds = rng.uniform(-1.0, 1.0, many), np.linspace(0.15, 0.5, many)
    c = rng.uniform(0.2, 2.0, (count, many)) * rng.choice([-1.0, 1.0], (count, many))
    s = np.sum(c * (means + sds * rng.standard_normal((count, many))), axis=1)
    y = s + bend * s**2 + NOISE * rng.standard_normal(count)
    table = pd.DataFrame({f"c{i}": c[:, i] for i in range(many)} | {"y": y})
    laws = {
        f"x{i}": Normal(Free(-2.0, 2.0), Free(0.02, 1.5) if i == many - 1 else float(sds[i]))
        for i in range(many)
    }
    arguments = ",".join([f"c{i}" for i in range(many)] + [f"x{i}" for i in range(many)])
    total = "+".join(f"c{i}*x{i}" for i in range(many))
    model = eval(f"lambda {arguments}: ({total}) + {bend} * ({total})**2")

    def negative(p: np.ndarray) -> float:
        own, t = np.append(sds[:-1], p[-1]), np.linspace(-8.0, 8.0, 1601)
        middle, spread = c @ p[:-1], np.sqrt(c**2 @ own**2)
        if not bend:
            return -float(stats.norm.logpdf(y, middle, np.hypot(spread, NOISE)).sum())
        at = middle[:, None] + spread[:, None] * t
        f = stats.norm.pdf(y[:, None], at + bend * at**2, NOISE) @ stats.norm.pdf(t)
        return -float(np.log(np.maximum(f * (t[1] - t[0]), 1e-300)).sum())

    limits = [(-2.0, 2.0)] * many + [(0.02, 1.5)]
    start = np.append(means, sds[-1])
    end = optimize.minimize(negative, start, method="L-BFGS-B", bounds=limits, tol=1e-12)
    return model, table, Inputs(laws), end


@pytest.mark.parametrize(
    ("many", "bend", "vectorized"),
    [
        pytest.param(5, 0.0, True, marks=pytest.mark.slow),
        pytest.param(6, 0.03, False, marks=pytest.mark.long),
        pytest.param(10, 0.03, True, marks=pytest.mark.long),
    ],
)
def test_the_maximum_is_that_of_the_closed_form(many: int, bend: float, vectorized: bool) -> None:
    model, table, inputs, end = study(many, 50, bend, seed=many + 30)
    found = unjudged(
        model, table, inputs, outcome="y", vectorized=vectorized, noise=Noise(NOISE),
        search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip
    # a flat standard deviation can be told as not arrived at, by a score of few points
    off = abs(found.log_likelihood.estimated + end.fun)
    assert off < 1e-2
    assert off < max(abs(found.quadrature["gap"]), 2e-3)
    names = [f"x{i}.mean" for i in range(many)] + [f"x{many - 1}.sd"]
    for name, value in zip(names, end.x, strict=True):
        one = found.alpha[name]
        assert one.estimate == pytest.approx(value, abs=0.05 * one.standard_error)
