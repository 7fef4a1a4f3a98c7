"""New experiments, and what makes their outcomes: what every decision about them stands on.

A `Ground` has the experiments under their laws. `parameters` are points of these under plausible
laws, and `predictor_for` is what answers for the simulator there: itself, or surfaces of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.blocks import blocks
from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.fit.regions import padded
from aleator.inference.alpha_draws import AlphaDraws
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    Direct,
    IndividualLikelihood,
    Layout,
    OnSurfaces,
    Predictor,
    individual_points,
)
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.problem import surface_progress
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.responses import Observations
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface
from aleator.surrogates.samples import Sites


def direct(runner: Runner, box: Array, region: Array) -> Predictor:
    """The simulator itself, with arrays where it takes them."""
    runner.takes_arrays(region)
    return Direct(runner, moving_parameters(box), box)


def about(
    runner: Runner,
    box: Array,
    x: Array,
    choice: ResponseSurface,
    ends: Array | None = None,
    tell: Callable[[int, int, int], None] | None = None,
) -> Predictor:
    """Surfaces that are exact where points x (D, n) of the law lie, and reach to `ends` (n, 2)."""
    region = padded(ends_of(x) if ends is None else ends, box)
    moving, sites = moving_parameters(region), Sites.seen(runner, runner.unit, runner.column)
    if not moving.size:
        return direct(runner, box, region)
    where = x[:: max(1, len(x) // GROUND.places)][:, moving]
    run = sites.run(runner, region)
    surfaces = AdaptiveSurfaces(run, region[moving], len(sites), choice)
    surfaces.judge(where)
    surfaces.refine(where, GROUND.level, tell)
    return OnSurfaces(surfaces.surface(), region, sites.of)


def ends_of(x: Array) -> Array:
    """The smallest region (n, 2) that holds points x (D, n)."""
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)


@dataclass(frozen=True)
class GroundSettings:
    """Points of laws, and surfaces that are exact there; by judgement."""

    most: int = 64
    """Draws of alpha for experiments that were measured."""
    certain: float = 7.9
    """Scores beyond which the probability of a smaller one is one, as numbers are kept."""
    placed: int = 8
    """Points of the law of each alpha and experiment by which surfaces are placed."""
    placing: int = 16
    """Laws that surfaces about a measured experiment are placed by."""
    far: float = 4.0
    """Standard normal variates that surfaces reach to, for every alpha."""
    level: float = 0.02
    """Estimated error of a surface over the scatter of its outcome."""
    edge: float = 1e-12
    """Uniform numbers stay so far from zero and one."""
    pad: float = 0.05
    """Share of its width by which a region is widened on either side."""
    least: float = 1e-3
    """Width of a region over that of the box, at least."""
    places: int = 512
    """Points of a law by which runs are placed and errors judged."""
    points: int = 512
    """Points of the law for each alpha."""
    largest: int = 4_000_000
    """Simulated values that are held at once."""


GROUND = GroundSettings()


@dataclass(frozen=True, eq=False)
class MeasuredExperiments:
    """Experiments that were measured already: `which` (B,) of those of a likelihood each is.

    Nodes are adapted to each alpha once: given its observations the variates of an experiment move
    far with alpha.
    """

    likelihood: IndividualLikelihood
    which: Indices
    _adapted: dict[bytes, IndividualLikelihood] = field(default_factory=dict, repr=False)

    def at(self, alpha: Array) -> IndividualLikelihood:
        """The likelihood with nodes adapted to alpha (K,)."""
        key = alpha.tobytes()
        if key not in self._adapted:
            self._adapted[key] = self.likelihood.adapted(alpha)
        return self._adapted[key]


@dataclass(frozen=True, eq=False)
class Ground:
    """B experiments with m values that are asked for, under laws `inputs` of their own.

    `errors` are those of a measurement; without them the values are the simulated ones.
    `on_simulator` says whether the simulator itself is asked, or surfaces of it. Experiments are
    new ones unless they were `measured`. `tested` are those that the laws were identified from.
    """

    conditions: Conditions
    inputs: Inputs
    errors: MeasurementErrors | None
    runner: Runner
    on_simulator: bool
    surfaces: ResponseSurface
    measured: MeasuredExperiments | None = None
    tested: Experiments | None = None
    settings: GroundSettings = GROUND

    @property
    def count(self) -> int:
        """B."""
        return len(self.conditions.ids)

    @cached_property
    def seen(self) -> Observations:
        """The values that are asked for."""
        return self.conditions.observations

    @cached_property
    def layout(self) -> Layout:
        """Which run gives which of them."""
        return Layout(self.count, self.seen.experiment, self.runner.unit, self.runner.column)

    def experiment(self, place: int) -> int:
        """The experiment that a value is of."""
        return int(self.seen.experiment[place])

    def taken(self, draws: AlphaDraws) -> AlphaDraws:
        """The draws; of measured experiments 64 at most, for each of which nodes are adapted."""
        return draws if self.measured is None else draws.fewer(self.settings.most)

    def law(self, alpha: Array) -> Array:
        """The law's part of alpha (K,)."""
        return alpha[: self.inputs.size]

    def values(self, alpha: Array, eta: Array, score: Array, rows: slice) -> Array:
        """What is measured (m, J) of the observations `rows` where eta (m, J) is simulated.

        `score` (J,) are the standard normal variates of the errors, which make y increase.
        """
        if self.errors is None:
            return eta
        share = np.broadcast_to(_below(score), eta.shape)
        with np.errstate(all="ignore"):
            y = self.errors.quantile(alpha[self.inputs.size :], share, eta, rows)
        return np.where(np.isfinite(eta), y, eta)


def _below(score: Array, settings: GroundSettings = GROUND) -> Array:
    return np.asarray(special.ndtr(np.clip(score, -settings.certain, settings.certain)))


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
class DrawnParameters:
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
    return np.asarray(special.ndtri(np.clip(uniform, GROUND.edge, 1.0 - GROUND.edge)))


def parameters(ground: Ground, alphas: Array, experiment: int, points: Points) -> DrawnParameters:
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
    return DrawnParameters(x, weights, np.tile(points.score, classes))


def _of_measured(ground: Ground, alphas: Array, experiment: int, points: Points) -> DrawnParameters:
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
    return DrawnParameters(np.stack(x), np.stack(weights), score)


def simulated(values: Callable[[Block, Array], Array], block: Block, x: Array) -> Array:
    """Simulated `values` (m, A, J) of one experiment at x (A, J, n)."""
    laws, points, n = x.shape
    size = block.owner.size
    found = np.empty((size, laws, points))
    for rows in blocks(laws, points * size, GROUND.largest):
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


def predictor_for(
    ground: Ground,
    draws: AlphaDraws,
    progress: Progress | None = None,
    settings: GroundSettings = GROUND,
) -> Predictor:
    """The simulator, or surfaces of it that are exact where the laws of all draws lie."""
    x, ends = law_points(ground, draws, settings=settings)
    if ground.on_simulator:
        return direct(ground.runner, ground.inputs.box, ends)
    return about(
        ground.runner, ground.inputs.box, x, ground.surfaces, ends, surface_progress(progress)
    )


def law_points(
    ground: Ground, draws: AlphaDraws, only: int | None = None, settings: GroundSettings = GROUND
) -> tuple[Array, Array]:
    """Parameters (D, n) of experiments under all draws, and the region (n, 2) of their laws.

    Of all experiments, or `only` one. The region holds variates four out, one at a time.
    """
    inputs, s = ground.inputs, ground.inputs.scattering
    alphas = np.concatenate([draws.estimate[None], draws.alpha])
    if ground.measured is not None:
        few = Points.standard(settings.placed, s)
        x = np.concatenate(
            [
                parameters(ground, alphas[:: 1 + len(alphas) // settings.placing], l, few).x
                for l in (range(ground.count) if only is None else [only])
            ]
        ).reshape(-1, len(inputs.names))
        return x, ends_of(x)
    xi = normal_points(settings.placed, max(s, 1), 3)[:, :s]
    axes = settings.far * np.concatenate([np.eye(s), -np.eye(s)])
    first = only if only is not None and inputs.regressed else 0
    last = ground.count if only is None and inputs.regressed else first + 1

    def image(variates: Array) -> Array:
        whole = np.tile(variates, (last - first, len(inputs.classes), 1))
        found = [inputs.individual(ground.law(a), whole, slice(first, last)).x for a in alphas]
        return np.concatenate([x.reshape(-1, len(inputs.names)) for x in found])

    x = image(xi)
    return x, ends_of(np.concatenate([x, image(axes)]))
