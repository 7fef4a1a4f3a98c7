"""Parameters of experiments under all laws that are plausible, and what is simulated there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.blocks import blocks
from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.likelihood.individual import Predictor, individual_points
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.problem import told
from aleator.progress import Progress
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.predictors import about, direct, ends_of
from aleator.types import Array

POINTS = 512
"""Points of the law for each alpha."""
PLACED = 8
"""Points of the law of each alpha and experiment by which surfaces are placed."""
LAWS = 16
"""Laws that surfaces about a measured experiment are placed by."""
FAR = 4.0
"""Standard normal variates that surfaces reach to, for every alpha."""
LARGEST = 4_000_000
"""Simulated values that are held at once."""


@dataclass(frozen=True, eq=False)
class Points:
    """Standard normal variates (J, s) of the law, `score` (J,) of the error, and weights (J,).

    The weights have the mean one: they are densities over those that the points were drawn by.
    """

    xi: Array
    score: Array
    weights: Array

    @classmethod
    def standard(cls, count: int, variates: int, seed: int = 0) -> Points:
        """Scrambled Sobol' points of the standard normal law."""
        u = normal_points(count, variates + 1, seed)
        return cls(u[:, :variates], u[:, variates], np.ones(count))

    def thinned(self, count: int) -> Points:
        """So many of them, evenly along."""
        step = max(1, len(self.score) // count)
        return Points(self.xi[::step], self.score[::step], self.weights[::step])

    @classmethod
    def joined(cls, parts: Sequence[Points]) -> Points:
        """All of them."""
        return cls(
            np.concatenate([part.xi for part in parts]),
            np.concatenate([part.score for part in parts]),
            np.concatenate([part.weights for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters x (A, J, n) of one experiment under A laws, with weights (A, J) summing to one.

    `score` (J,) are those of the errors that go with them.
    """

    x: Array
    weights: Array
    score: Array


def normal_points(count: int, dimensions: int, seed: int) -> Array:
    """Scrambled Sobol' points (count, dimensions) of the standard normal law."""
    power = int(np.ceil(np.log2(count)))
    uniform = qmc.Sobol(dimensions, rng=seed).random_base2(power)[:count]
    return np.asarray(special.ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12)))


def parameters(ground: Ground, alphas: Array, experiment: int, points: Points) -> Parameters:
    """Those of one experiment at the same points under the laws alphas (A, K)."""
    if ground.measured is not None:
        return _of_measured(ground, alphas, experiment, points)
    inputs, one = ground.inputs, slice(experiment, experiment + 1)
    classes = len(inputs.classes)
    xi = np.tile(points.xi, (1, classes, 1))
    found = [inputs.individual(ground.law(alpha), xi, one) for alpha in alphas]
    own = np.tile(points.weights, classes) / len(points.weights)
    weights = np.stack([np.exp(part.log_weight[0]) * own for part in found])
    x = np.stack([part.x[0] for part in found])
    return Parameters(x, weights, np.tile(points.score, classes))


def _of_measured(ground: Ground, alphas: Array, experiment: int, points: Points) -> Parameters:
    """Given the observations: points about the individual law, weighted by the likelihood."""
    assert ground.measured is not None
    which, count = int(ground.measured.which[experiment]), len(points.score)
    x, weights = [], []
    for alpha in alphas:
        likelihood = ground.measured.at(alpha)
        own, share = individual_points(likelihood, alpha, likelihood.layout.alone(which), count)
        x.append(own[0])
        weights.append(share[0])
    # the points are in the order of a sequence: errors must not go along with them
    score = np.random.default_rng(count).permutation(normal_points(x[0].shape[0], 1, 0)[:, 0])
    return Parameters(np.stack(x), np.stack(weights), score)


def simulated(values: Callable[[Block, Array], Array], block: Block, x: Array) -> Array:
    """Simulated `values` (m, A, J) of one experiment at x (A, J, n)."""
    laws, points, n = x.shape
    size = block.owner.size
    found = np.empty((size, laws, points))
    for rows in blocks(laws, points * size, LARGEST):
        part = x[rows]
        with np.errstate(all="ignore"):
            eta = values(block, part.reshape(1, -1, n))
        found[:, rows] = eta.reshape(size, len(part), points)
    return found


def measured(ground: Ground, alphas: Array, eta: Array, score: Array, rows: slice) -> Array:
    """What is measured (m, A, J) where eta (m, A, J) is simulated, under the errors of alphas."""
    if ground.errors is None:
        return eta
    parts = [ground.values(a, eta[:, k], score, rows) for k, a in enumerate(alphas)]
    return np.stack(parts, axis=1)


def predictor_for(ground: Ground, draws: AlphaDraws, progress: Progress | None = None) -> Predictor:
    """The simulator, or surfaces of it that are exact where the laws of all draws lie."""
    x, ends = law_points(ground, draws)
    if ground.on_simulator:
        return direct(ground.runner, ground.inputs.box, ends)
    return about(ground.runner, ground.inputs.box, x, ground.surfaces, ends, told(progress))


def law_points(ground: Ground, draws: AlphaDraws, only: int | None = None) -> tuple[Array, Array]:
    """Parameters (D, n) of experiments under all draws, and the region (n, 2) of their laws.

    Of all experiments, or `only` one. The region holds variates four out, one at a time.
    """
    inputs, s = ground.inputs, ground.inputs.scattering
    alphas = np.concatenate([draws.estimate[None], draws.alpha])
    if ground.measured is not None:
        few = Points.standard(PLACED, s)
        x = np.concatenate(
            [
                parameters(ground, alphas[:: 1 + len(alphas) // LAWS], l, few).x
                for l in (range(ground.count) if only is None else [only])
            ]
        ).reshape(-1, len(inputs.names))
        return x, ends_of(x)
    xi = normal_points(PLACED, max(s, 1), 3)[:, :s]
    axes = FAR * np.concatenate([np.eye(s), -np.eye(s)])
    first = only if only is not None and inputs.regressed else 0
    last = ground.count if only is None and inputs.regressed else first + 1

    def image(variates: Array) -> Array:
        whole = np.tile(variates, (last - first, len(inputs.classes), 1))
        found = [inputs.individual(ground.law(a), whole, slice(first, last)).x for a in alphas]
        return np.concatenate([x.reshape(-1, len(inputs.names)) for x in found])

    x = image(xi)
    return x, ends_of(np.concatenate([x, image(axes)]))
