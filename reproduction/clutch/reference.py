"""Reference distributions of the wet clutch's outcomes, and the densities that are judged by them.

The paper's reference is 200,000 random samples of the law for each of the 108 experiments and a
spline through the histogram. Here the samples are 2^18 scrambled Sobol' points, whose distribution
functions are more exact. 28 million runs would take twenty minutes, so they are evaluated on
response surfaces that are built where the law is; the error of these is measured on the simulator
at points of the same law and told with every figure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from aleator.core.progress import Progress
from aleator.core.status import Status
from aleator.core.types import Array
from aleator.laws.quadrature import TensorGauss
from aleator.moments.densities import Density, FittedDensity, Gaussian
from aleator.moments.distances import earth_movers_distance
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments, NodeOutcomes, joined, weighted_moments
from aleator.moments.projection import expansion_map
from aleator.surrogates import ResponseSurface, Surface, build_surface
from reproduction.clutch.study import ClutchStudy
from reproduction.sampling.histogram import FittedHistogram, HistogramSpline
from reproduction.two_normals import TwoNormals

SAMPLES = 2**18
REACH = 5.0  # standard deviations of the parameters within which surfaces are built
TOLERANCE = 0.005  # of the surfaces, on their region
CHECKED = 200  # runs an experiment at points of the law, to measure the surfaces' error
ORDER = 6
NODES, DEGREE = 5, 4  # the paper's expansion: 25 runs an experiment

DENSITIES: dict[str, Density | TwoNormals] = {
    "Gaussian": Gaussian(),
    "mixture": TwoNormals(),
    "maximum entropy": MaximumEntropy(order=4),
}


@dataclass(frozen=True)
class Reference:
    """What the samples say of the outcomes of N experiments under alpha (K,).

    `lower` and `upper` (N,) are the range of the outcome, `error` (N,) the root-mean-square error
    of the surfaces under the law over the outcome's standard deviation.
    """

    alpha: Array
    moments: Moments
    histogram: FittedHistogram
    lower: Array
    upper: Array
    error: Array

    def distance(self, fitted: FittedDensity) -> Array:
        """EMD (N,) of fitted densities to the samples, NaN where the fit failed."""
        found = earth_movers_distance(fitted, self.histogram)
        return np.where(fitted.status == Status.SOLVED, found, np.nan)

    @cached_property
    def scale(self) -> Array:
        """Standard deviations (N,) of the outcomes."""
        return self.moments.sd


def surfaces(study: ClutchStudy, alpha: Array, progress: Progress, title: str) -> Surface:
    """Response surfaces where the law alpha is: within five standard deviations, in the box."""
    mean, sd = alpha[::2], alpha[1::2]
    low = np.maximum(study.box[:, 0], mean - REACH * sd)
    high = np.minimum(study.box[:, 1], mean + REACH * sd)

    def tell(runs: int, converged: int, total: int) -> None:
        text = f"{title}: {runs:,} runs, {converged} of {total} surfaces"
        progress.update(text, converged, total)

    choice = ResponseSurface(tolerance=TOLERANCE)
    region = np.stack([low, high], axis=1)
    return build_surface(study.run, region, len(study.outcomes), choice, tell)


def reference(
    study: ClutchStudy, alpha: Array, surface: Surface, seed: int, progress: Progress, title: str
) -> Reference:
    """Sample the law alpha on the surfaces that were built around it."""
    count = len(study.outcomes)
    x = sample(study, alpha, seed)
    progress.update(f"{title}: {SAMPLES:,} samples of {count} experiments")
    y = surface.evaluate(x)
    some = x[:CHECKED]
    index = np.repeat(np.arange(count), CHECKED)
    truth = study.run(index, np.tile(some, (count, 1))).reshape(count, CHECKED)
    error = np.sqrt(np.mean((y[:, :CHECKED] - truth) ** 2, axis=1)) / y.std(axis=1)
    return of_sample(alpha, y, surface.lower, surface.upper, error)


def sample(study: ClutchStudy, alpha: Array, seed: int) -> Array:
    """Scrambled Sobol' points (SAMPLES, 2) of the law."""
    points = qmc.Sobol(2, rng=np.random.default_rng(seed)).random(SAMPLES)
    return study.law().sample(alpha, np.clip(points, 1e-12, 1.0 - 1e-12))


def of_sample(alpha: Array, y: Array, lower: Array, upper: Array, error: Array) -> Reference:
    """The reference from outcomes (N, S); experiment by experiment, for they are many."""
    weights = np.full(y.shape[1], 1.0 / y.shape[1])
    ends = [(row.min(), row.max()) for row in y]
    return Reference(
        alpha=alpha,
        moments=joined([weighted_moments(row[None], weights, ORDER) for row in y]),
        histogram=HistogramSpline().fit_sample(NodeOutcomes(y, weights)),
        lower=np.minimum(lower, [low for low, _ in ends]),
        upper=np.maximum(upper, [high for _, high in ends]),
        error=error,
    )


def expansion_moments(study: ClutchStudy, alpha: Array, experiments: NDArray[np.intp]) -> Moments:
    """Moments as the paper takes them: the clip, Hermite polynomials, d = 4, q = 5, 25 runs."""
    law = study.law("hermite")
    matrix, weights = expansion_map(law, alpha, NODES, DEGREE, ORDER)
    return weighted_moments(node_outcomes(study, alpha, experiments) @ matrix.T, weights, ORDER)


def node_outcomes(study: ClutchStudy, alpha: Array, experiments: NDArray[np.intp]) -> Array:
    """Outcomes (N, 25) at the nodes of the paper's quadrature."""
    nodes = TensorGauss(NODES).nodes(study.law("hermite"), alpha)
    index = np.repeat(experiments, len(nodes.x))
    return study.run(index, np.tile(nodes.x, (len(experiments), 1))).reshape(len(experiments), -1)
