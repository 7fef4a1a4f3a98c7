"""One experiment far out, where surfaces made exact under the law do not know of a bend.

Its outcome alone bends, in the far tail of the law: the others tell nothing of it.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Budget, Free, Identification, Inputs, Normal
from aleator.core.types import Array

LAW = Inputs({"a": Normal(Free(0.5, 1.5), Free(0.02, 1.0))})
FIRST = 0.6
"""Load below which the outcome bends: that of the first experiment."""
UNLIMITED = Budget(runs=10**9)
"""Of a simulator with a budget surfaces take the place to the end, however fast it is."""


def study(
    height: float, width: float, place: float, count: int = 12
) -> tuple[Callable[..., Array], pd.DataFrame]:
    """A simulator and its experiments, the first of which lies on the bend."""

    def simulator(load: Array, a: Array) -> Array:
        return load * a + height * np.exp(-(((a - place) / width) ** 2)) * (load < FIRST)

    load = np.linspace(0.5, 2.0, count)
    a = 1.0 + 0.2 * np.random.default_rng(0).standard_normal(count)
    a[0] = place + 0.00301
    return simulator, pd.DataFrame({"load": load, "y": simulator(load, a)})


def exact(simulator: Callable[..., Array], table: pd.DataFrame) -> tuple[Array, float]:
    """The maximum of the likelihood, and its value: sums of p/|slope| over the roots."""
    load, y = table["load"].to_numpy(), table["y"].to_numpy()
    grid = np.linspace(-1.0, 4.0, 200_001)
    off = simulator(load[0], grid) - y[0]
    at = np.flatnonzero(np.sign(off[:-1]) != np.sign(off[1:]))
    slope = np.abs(np.diff(off)[at]) / (grid[1] - grid[0])
    root = grid[at] - off[at] / np.diff(off)[at] * (grid[1] - grid[0])

    def loss(alpha: Array) -> float:
        first = np.log(np.sum(stats.norm.pdf(root, *alpha) / slope))
        others = stats.norm.logpdf(y[1:] / load[1:], *alpha) - np.log(load[1:])
        return -float(first + others.sum())

    found = optimize.minimize(loss, [1.0, 0.2], method="Nelder-Mead", options={"xatol": 1e-6})
    return found.x, -found.fun


def identified(simulator: Callable[..., Array], table: pd.DataFrame) -> Identification:
    return unjudged(simulator, table, LAW, outcome="y", vectorized=True, budget=UNLIMITED)


def away(found: Identification, truth: Array) -> float:
    """The largest distance from the exact maximum, in standard errors."""
    estimates = list(found.alpha.values())
    return max(
        abs(e.estimate - t) / e.standard_error for e, t in zip(estimates, truth, strict=True)
    )


@pytest.mark.parametrize(
    "bend", [(-0.1, 0.3, 1.8), (0.1, 0.1, 1.6), (0.1, 0.1, 1.8), (0.2, 0.2, 1.8)]
)
def test_runs_near_an_outlier_make_its_density_exact(bend: tuple[float, float, float]) -> None:
    simulator, table = study(*bend)
    alpha, value = exact(simulator, table)
    found = identified(simulator, table)
    assert found.sound
    assert away(found, alpha) < 0.02
    assert found.log_likelihood.estimated == pytest.approx(value, abs=0.03)
