"""Expansions and Sobol' indices against OpenTURNS: same runs, same terms, same law."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable

import numpy as np

from aleator.core.types import Array
from aleator.laws import Uniform
from aleator.moments.expansion import Basis, ExpansionDesign, TotalDegree, sobol_indices
from aleator.moments.projection import Regression
from benchmarks.row import Row

EXPERIMENTS = 50
DEGREE = 8


def ishigami(x: Array, a: Array) -> Array:
    """Outcomes (N, J) of sin x_1 + a sin^2 x_2 + 0.1 x_3^4 sin x_1 for N values of a."""
    one, two, three = x.T
    rest = np.sin(one) * (1.0 + 0.1 * three**4)
    return np.asarray(rest + a[:, None] * np.sin(two) ** 2)


def exact_first(a: Array, b: float = 0.1) -> Array:
    """First-order indices (N, 3) in closed form (Ishigami and Homma, 1990)."""
    first = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2
    second = a**2 / 8.0
    whole = second + b * np.pi**4 / 5.0 + b**2 * np.pi**8 / 18.0 + 0.5
    return np.stack([first / whole, second / whole, 0.0 * a], axis=1)


def expansion_rows() -> list[Row]:
    """Fifty experiments by least squares on the same 330 runs each; nothing without OpenTURNS."""
    if importlib.util.find_spec("openturns") is None:
        return []
    basis = Basis((Uniform.between(-np.pi, np.pi),) * 3, (np.array([0.0, np.pi / 3**0.5]),) * 3)
    way = Regression(TotalDegree(DEGREE), adaptive=False)
    design = way.design(basis)
    a = np.linspace(5.0, 9.0, EXPERIMENTS)
    outcomes, truth = ishigami(design.x, a), exact_first(a)
    ours, seconds = timed(lambda: own_first(way, basis, design, outcomes))
    found, theirs = timed(lambda: openturns_first(design, outcomes))
    what = f"Sobol' indices of {EXPERIMENTS} experiments, degree {DEGREE}, {len(design)} runs each"
    errors = [float(np.abs(first - truth).max()) for first in (ours, found)]
    return [
        Row(f"{what} / OpenTURNS", f"{seconds * 1e3:.1f} ms", f"{theirs * 1e3:.0f} ms",
            seconds / theirs),
        Row("largest error of these indices / OpenTURNS", f"{errors[0]:.1e}", f"{errors[1]:.1e}",
            errors[0] / errors[1]),
    ]  # fmt: skip


def own_first(way: Regression, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Array:
    """First-order indices (N, 3) by this library."""
    expansion = way.fit(basis, design, outcomes)
    return sobol_indices(expansion.indices, expansion.coefficients).first


def openturns_first(design: ExpansionDesign, outcomes: Array) -> Array:
    """The same by OpenTURNS: all experiments are outputs of one functional chaos."""
    import openturns as ot

    ot.Log.Show(ot.Log.NONE)
    law = ot.JointDistribution([ot.Uniform(-np.pi, np.pi)] * 3)
    enumerate_terms = ot.LinearEnumerateFunction(3)
    family = ot.OrthogonalProductPolynomialFactory([ot.LegendreFactory()] * 3, enumerate_terms)
    count = enumerate_terms.getStrataCumulatedCardinal(DEGREE)
    algorithm = ot.FunctionalChaosAlgorithm(
        ot.Sample(design.x), ot.Point(design.weights), ot.Sample(outcomes.T), law,
        ot.FixedStrategy(family, count), ot.LeastSquaresStrategy(),
    )  # fmt: skip
    algorithm.run()
    indices = ot.FunctionalChaosSobolIndices(algorithm.getResult())
    return np.array([[indices.getSobolIndex(i, l) for i in range(3)] for l in range(len(outcomes))])


def timed(work: Callable[[], Array]) -> tuple[Array, float]:
    """The answer, and the seconds of a second call."""
    work()
    began = time.perf_counter()
    answer = work()
    return answer, time.perf_counter() - began
