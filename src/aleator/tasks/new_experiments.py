"""New experiments, and what makes their outcomes: what every decision about them stands on.

A `Ground` has the experiments under their laws. `parameters` are points of these under plausible
laws, and `predictor_for` is what answers for the simulator there: itself, or surfaces of it. `Near`
is one value of them, by a surface of its own that is made exact where an event may be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import special
from scipy.spatial import cKDTree
from scipy.stats import qmc

from aleator.core.blocks import blocks
from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.fit.regions import hull, padded
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
from aleator.surrogates.samples import Samples, Sites
from aleator.surrogates.shared import PROCESS, SHARING, Covariance, ProcessPosterior, learned


def simulator_itself(runner: Runner, box: Array, region: Array) -> Predictor:
    """The simulator itself as predictor, with arrays where it takes them."""
    runner.takes_arrays(region)
    return Direct(runner, moving_parameters(box), box)


def local_surfaces(
    runner: Runner,
    box: Array,
    x: Array,
    choice: ResponseSurface,
    ends: Array | None = None,
    tell: Callable[[int, int, int], None] | None = None,
) -> Predictor:
    """Surfaces that are exact at points x (D, n) of the law, and reach to `ends` (n, 2)."""
    region = padded(ends_of(x) if ends is None else ends, box)
    moving, sites = moving_parameters(region), Sites.seen(runner, runner.unit, runner.column)
    if not moving.size:
        return simulator_itself(runner, box, region)
    where = x[:: max(1, len(x) // CONTEXT.places)][:, moving]
    run = sites.run(runner, region)
    surfaces = AdaptiveSurfaces(run, region[moving], len(sites), choice)
    surfaces.judge(where)
    surfaces.refine(where, CONTEXT.level, tell)
    return OnSurfaces(surfaces.surface(), region, sites.of)


def ends_of(x: Array) -> Array:
    """The smallest region (n, 2) that holds points x (D, n)."""
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)


@dataclass(frozen=True)
class ContextSettings:
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
    places: int = 512
    """Points of a law by which runs are placed and errors judged."""
    points: int = 512
    """Points of the law for each alpha."""
    largest: int = 4_000_000
    """Simulated values that are held at once."""
    reach: float = 6.5
    """Standard normal variates that a surface of a rare event reaches to: 4e-11 of the law lie
    beyond."""
    seed: int = 5
    """Seed of the points by which such a surface is placed."""


CONTEXT = ContextSettings()


@dataclass(frozen=True, eq=False)
class MeasuredExperiments:
    """B measured experiments, whose places in a likelihood are `which` (B,).

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
class PredictionContext:
    """B experiments with m values to be predicted, under laws `inputs` of their own.

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
    settings: ContextSettings = CONTEXT

    @property
    def count(self) -> int:
        """The number B of experiments."""
        return len(self.conditions.ids)

    @cached_property
    def seen(self) -> Observations:
        """The places of the values to be predicted."""
        return self.conditions.observations

    @cached_property
    def layout(self) -> Layout:
        """The run that gives each value, and its experiment."""
        return Layout(self.count, self.seen.experiment, self.runner.unit, self.runner.column)

    def experiment(self, place: int) -> int:
        """The experiment of the value at a place."""
        return int(self.seen.experiment[place])

    def taken(self, draws: AlphaDraws) -> AlphaDraws:
        """The draws; for measured experiments 64 at most, since nodes are adapted to each."""
        return draws if self.measured is None else draws.fewer(self.settings.most)

    def law(self, alpha: Array) -> Array:
        """The hyperparameters of the laws, without those of the errors."""
        return alpha[: self.inputs.size]

    def values(self, alpha: Array, eta: Array, score: Array, rows: slice) -> Array:
        """Measured values (m, J) of the observations `rows` for simulated ones eta (m, J).

        `score` (J,) are the standard normal variates of the errors, which make y increase.
        """
        if self.errors is None:
            return eta
        share = np.broadcast_to(_below(score), eta.shape)
        with np.errstate(all="ignore"):
            y = self.errors.quantile(alpha[self.inputs.size :], share, eta, rows)
        return np.where(np.isfinite(eta), y, eta)


def _below(score: Array, settings: ContextSettings = CONTEXT) -> Array:
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
        """`count` of the points, evenly along the sequence."""
        step = max(1, len(self.score) // count)
        return Points(self.xi[::step], self.score[::step], self.weights[::step])

    @classmethod
    def joined(cls, parts: Sequence[Points]) -> Points:
        """The points of all parts."""
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
    return np.asarray(special.ndtri(np.clip(uniform, CONTEXT.edge, 1.0 - CONTEXT.edge)))


def parameters(
    context: PredictionContext, alphas: Array, experiment: int, points: Points
) -> DrawnParameters:
    """Parameters of one experiment at the same points under each of the laws (A, K)."""
    if context.measured is not None:
        return _of_measured(context, alphas, experiment, points)
    inputs, one = context.inputs, slice(experiment, experiment + 1)
    classes = len(inputs.classes)
    xi = np.tile(points.xi, (1, classes, 1))
    found = [inputs.individual(context.law(alpha), xi, one) for alpha in alphas]
    own = np.tile(points.weights, classes) / len(points.weights)
    weights = np.stack([np.exp(part.log_weight[0]) * own for part in found])
    x = np.stack([part.x[0] for part in found])
    return DrawnParameters(x, weights, np.tile(points.score, classes))


def _of_measured(
    context: PredictionContext, alphas: Array, experiment: int, points: Points
) -> DrawnParameters:
    """Points about the individual law given the observations, with weights."""
    assert context.measured is not None
    which, count = int(context.measured.which[experiment]), len(points.score)
    x, weights = [], []
    for alpha in alphas:
        likelihood = context.measured.at(alpha)
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
    for rows in blocks(laws, points * size, CONTEXT.largest):
        part = x[rows]
        with np.errstate(all="ignore"):
            eta = values(block, part.reshape(1, -1, n))
        found[:, rows] = eta.reshape(size, len(part), points)
    return found


def measured(
    context: PredictionContext, alphas: Array, eta: Array, score: Array, rows: slice
) -> Array:
    """Measured values (m, A, J) for simulated ones eta (m, A, J), under each alpha's errors."""
    if context.errors is None:
        return eta
    parts = [context.values(a, eta[:, k], score, rows) for k, a in enumerate(alphas)]
    return np.stack(parts, axis=1)


def predictor_for(
    context: PredictionContext,
    draws: AlphaDraws,
    progress: Progress | None = None,
    settings: ContextSettings = CONTEXT,
) -> Predictor:
    """The simulator, or surfaces of it that are exact under the laws of all draws."""
    x, ends = law_points(context, draws, settings=settings)
    if context.on_simulator:
        return simulator_itself(context.runner, context.inputs.box, ends)
    return local_surfaces(
        context.runner, context.inputs.box, x, context.surfaces, ends, surface_progress(progress)
    )


def law_points(
    context: PredictionContext,
    draws: AlphaDraws,
    only: int | None = None,
    settings: ContextSettings = CONTEXT,
) -> tuple[Array, Array]:
    """Parameters (D, n) of experiments under all draws, and the region (n, 2) of their laws.

    Of all experiments, or `only` one. The region holds variates four out, one at a time.
    """
    inputs, s = context.inputs, context.inputs.scattering
    alphas = np.concatenate([draws.estimate[None], draws.alpha])
    if context.measured is not None:
        few = Points.standard(settings.placed, s)
        x = np.concatenate(
            [
                parameters(context, alphas[:: 1 + len(alphas) // settings.placing], l, few).x
                for l in (range(context.count) if only is None else [only])
            ]
        ).reshape(-1, len(inputs.names))
        return x, ends_of(x)
    xi = normal_points(settings.placed, max(s, 1), 3)[:, :s]
    axes = settings.far * np.concatenate([np.eye(s), -np.eye(s)])
    first = only if only is not None and inputs.regressed else 0
    last = context.count if only is None and inputs.regressed else first + 1

    def image(variates: Array) -> Array:
        whole = np.tile(variates, (last - first, len(inputs.classes), 1))
        found = [inputs.individual(context.law(a), whole, slice(first, last)).x for a in alphas]
        return np.concatenate([x.reshape(-1, len(inputs.names)) for x in found])

    x = image(xi)
    return x, ends_of(np.concatenate([x, image(axes)]))


ZERO = np.zeros(1, dtype=np.intp)


@dataclass(frozen=True)
class Exploration:
    """How a surface is tested and made exact where an event may be; chosen by trials.

    `benchmarks limit_states` measures it. A polynomial has at most `runs` runs. Each round then
    makes `runs` fresh ones, half of them by the law and half evenly over a ball, so large that
    `beyond` of the probability lies farther, and at most as many in batches of `batch`, where
    kriging doubts on which side of the event's ends the outcome is: until the expected
    probability of its mistakes is at most `doubt` of that of the event. A fresh run contradicts
    the surface that misses it by more than kriging leaves possible and `share` of its distance from
    the event's end and the outcome's standard deviation together: then there is another round, as
    there is where the round changes the probability by more than `share` of itself. Rounds end
    where the next might need more than the surface's `max_runs`.
    """

    runs: int = 96
    batch: int = 8
    beyond: float = 0.1
    share: float = 0.1
    doubt: float = 0.05


@dataclass(frozen=True, eq=False)
class Kriged:
    """A polynomial surface of one value, with kriging of its errors at the runs."""

    trend: OnSurfaces
    missed: ProcessPosterior

    def values(self, block: Block, x: Array) -> Array:
        """Values (1, J) at points x (1, J, n), which go through the runs."""
        found, z = self.trend.values(block, x), self.trend.inward(x[0])
        for part in blocks(len(z), len(self.missed.u), CONTEXT.largest):
            found[0, part] += self.missed.mean(_alike(z[part]), z[part])
        return found

    def deviation(self, x: Array) -> Array:
        """Kriging standard deviations (D,) of the values at points x (D, n).

        As many times larger as the nearest runs surprise the others, once left out: one
        covariance serves all of the region, and a hill in it is not expected.
        """
        z = self.trend.inward(x)
        _, nearest = cKDTree(self.missed.u).query(z, 1 + z.shape[1])
        surprise = np.abs(self.missed.surprise)[nearest].max(axis=1)
        return np.asarray(self.missed.deviation(_alike(z), z) * np.maximum(surprise, 1.0))

    def joint(self, x: Array) -> Array:
        """Kriging covariances (D, D) of the values at points x (D, n)."""
        z = self.trend.inward(x)
        return self.missed.joint(_alike(z), z)


class OneSurface:
    """A surface of one value that is made exact step by step; its runs are kept.

    It is a polynomial of at most `most` runs, until it is `kriged`; then kriging corrects it.
    `further` are runs that the polynomial does not go through.
    """

    def __init__(
        self, context: PredictionContext, place: int, x: Array, ends: Array,
        progress: Progress | None, most: int,
    ) -> None:  # fmt: skip
        runner = context.runner
        self.box, self.progress = context.inputs.box, progress
        self._trend: OnSurfaces | None = None
        self._kriged: Kriged | None = None
        self.settings = context.settings
        self.region = padded(ends, self.box)
        where = slice(place, place + 1)
        self.sites = Sites.seen(runner, runner.unit[where], runner.column[where])
        moving = moving_parameters(self.region)
        choice = replace(context.surfaces, max_runs=min(most, context.surfaces.max_runs))
        self.run = self.sites.run(runner, self.region)
        self.surfaces = AdaptiveSurfaces(self.run, self.region[moving], 1, choice)
        self.further = Samples.none(1, moving.size)
        self.covariance = Covariance.first(moving.size, moving.size, PROCESS.none)
        self._sharpened(x)

    def predictor(self) -> OnSurfaces | Kriged:
        """The present surface."""
        return self._kriged or self._polynomial()

    def _polynomial(self) -> OnSurfaces:
        if self._trend is None:
            self._trend = OnSurfaces(self.surfaces.surface(), self.region, ZERO)
        return self._trend

    def follow(self, x: Array) -> None:
        """Make the surface exact at points x (D, n) too, on a region that holds them."""
        self._reach(x)
        self._sharpened(x)

    def _reach(self, x: Array) -> None:
        self._trend = self._kriged = None
        wanted = hull(self.region, padded(ends_of(x), self.box))
        if np.any(wanted != self.region):
            self.region = wanted
            self.surfaces.move(wanted[moving_parameters(wanted)])

    def learn(self, x: Array) -> None:
        """Run at points x (R, n) and refit the surface, on a region that holds them."""
        self._reach(x)
        self.surfaces.add(x[:, moving_parameters(self.region)])

    @property
    def runs(self) -> int:
        """The number of runs of the surface."""
        return self.surfaces.total_runs + len(self.further.x)

    @property
    def kriged(self) -> Kriged:
        """The surface with kriging, which corrects it from now on."""
        if self._kriged is None:
            self._kriged = self._through_runs(SHARING.steps[0])
        return self._kriged

    def correct(self, x: Array) -> None:
        """Run at points x (R, n) within the region, which kriging alone goes through."""
        where = np.clip(x, *self.region.T)[:, moving_parameters(self.region)]
        self.further = self.further.joined(
            where, _alike(where), np.arange(len(x)), self.run(_alike(where), where)
        )
        self._kriged = self._through_runs(SHARING.steps[1])

    def _through_runs(self, steps: int) -> Kriged:
        """Kriging of the polynomial's errors at all runs; its covariance is learned on."""
        trend = self._polynomial()
        both = (self.surfaces.emulator.samples.inside(self.surfaces.box), self.further)
        x, y = (np.concatenate(part) for part in zip(*(s.listed[1:] for s in both), strict=True))
        z = trend.surface.axes.inward(x)
        missed = y - trend.surface.evaluate(x)[0]
        self.covariance = learned(self.covariance, _alike(z), z, missed, steps)
        return Kriged(trend, ProcessPosterior.of(self.covariance, _alike(z), z, missed))

    def _sharpened(self, x: Array) -> None:
        self._trend = self._kriged = None
        where = x[:: max(1, len(x) // self.settings.places)][:, moving_parameters(self.region)]
        self.surfaces.judge(where)
        self.surfaces.refine(where, self.settings.level, surface_progress(self.progress))


def _alike(z: Array) -> Indices:
    return np.zeros(len(z), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class PredictedValue:
    """Value number `place` of a context, by the simulator or a surface of its own."""

    context: PredictionContext
    place: int
    block: Block
    surface: OneSurface | None
    direct: Predictor | Kriged | None

    @classmethod
    def of(
        cls,
        context: PredictionContext,
        place: int,
        draws: AlphaDraws,
        progress: Progress | None = None,
        most: int = Exploration.runs,
    ) -> PredictedValue:
        """The value with a surface about the laws of all draws, unless the simulator is used.

        The surface is a polynomial of at most `most` runs.
        """
        runner, where = context.runner, slice(place, place + 1)
        layout = Layout(1, ZERO, runner.unit[where], runner.column[where])
        x, ends = law_points(context, draws, context.experiment(place))
        moving = moving_parameters(context.inputs.box)
        if context.on_simulator or not moving_parameters(ends).size:
            runner.takes_arrays(ends)
            return cls(context, place, layout.alone(0), None,
                       Direct(runner, moving, context.inputs.box))  # fmt: skip
        surface = OneSurface(context, place, x, ends, progress, most)
        return cls(context, place, layout.alone(0), surface, None)

    @property
    def fixed(self) -> PredictedValue:
        """The value with its present surface, which then stays."""
        return replace(self, surface=None, direct=self.predictor)

    @property
    def experiment(self) -> int:
        """The experiment of the value."""
        return self.context.experiment(self.place)

    @property
    def predictor(self) -> Predictor | Kriged:
        """The simulator, or the surface in its place."""
        if self.surface is not None:
            return self.surface.predictor()
        assert self.direct is not None
        return self.direct

    def outcomes(self, alphas: Array, points: Points) -> tuple[Array, DrawnParameters]:
        """Outcomes (A, J) at the points under each law, with the parameters there."""
        found = parameters(self.context, alphas, self.experiment, points)
        eta = simulated(self.predictor.values, self.block, found.x)
        rows = slice(self.place, self.place + 1)
        return measured(self.context, alphas, eta, found.score, rows)[0], found

    def possible(self, alphas: Array, points: Points) -> tuple[Array, Array, DrawnParameters]:
        """Outcomes (A, J) by a surface, with their kriging standard deviations."""
        assert self.surface is not None
        surface = self.surface.kriged
        found = parameters(self.context, alphas, self.experiment, points)
        eta = simulated(surface.values, self.block, found.x)
        apart = surface.deviation(found.x.reshape(-1, found.x.shape[2])).reshape(eta.shape)
        rows = slice(self.place, self.place + 1)
        y, moved = (
            measured(self.context, alphas, part, found.score, rows)[0]
            for part in (eta, eta + apart)
        )
        return y, np.abs(moved - y), found

    def at_runs(self, alphas: Array, x: Array, score: Array) -> Array:
        """Outcomes (R,) by runs of the simulator at x (R, n), each under its own alpha."""
        unit = np.repeat(self.context.runner.unit[self.place], len(x))
        eta = self.context.runner.values(unit, x)[:, self.context.runner.column[self.place]]
        rows = slice(self.place, self.place + 1)
        found = [
            self.context.values(a, e[None, None], z[None], rows)[0, 0]
            for a, e, z in zip(alphas, eta, score, strict=True)
        ]
        return np.array(found)

    def wide(self, alphas: Array, far: float, count: int) -> Array:
        """Parameters (D, n) of variates `far` times as far out, and of the farthest ones."""
        s = self.context.inputs.scattering
        axes = CONTEXT.reach * np.concatenate([np.eye(s), -np.eye(s)])
        xi = np.concatenate([far * normal_points(count, max(s, 1), CONTEXT.seed)[:, :s], axes])
        points = Points(xi, np.zeros(len(xi)), np.ones(len(xi)))
        return parameters(self.context, alphas, self.experiment, points).x.reshape(
            -1, len(self.context.inputs.names)
        )


def some_of(draws: AlphaDraws, count: int) -> Indices:
    """Places of `count` draws, evenly along the sequence."""
    return np.unique(np.linspace(0, len(draws.alpha) - 1, count).astype(np.intp))
