"""Simulated outcomes of new experiments, for predictions, probabilities and tolerance limits.

A `PredictionContext` has the new experiments with their laws, noise and simulator. `parameters`
are points of their parameters under plausible laws. `predictor_for` returns what gives simulated
values there: the simulator itself, or response surfaces of it. A `PredictedValue` is one outcome of
a context, with a surface that is refined where an event (an outcome in an interval) may be.
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
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, learned
from aleator.surrogates.samples import Samples, Sites


def simulator_itself(runner: Runner, box: Array, region: Array) -> Predictor:
    """The simulator itself as the function that gives simulated values."""
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
    """Response surfaces that are accurate at points x (D, n) drawn from the law.

    Their region is `ends` (n, 2), or the range of the points, widened a little.
    """
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
    """The smallest region (n, 2) that contains the points x (D, n)."""
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)


@dataclass(frozen=True)
class ContextSettings:
    """Settings of the points drawn from laws and of response surfaces for new experiments.

    The values are chosen by judgement.
    """

    most: int = 64
    """The largest number of draws of alpha for predictions of measured experiments."""
    certain: float = 7.9
    """The size to which standard normal variates of the error are limited; beyond it their
    probability is one in double precision."""
    placed: int = 8
    """The number of points of each law from which the runs of a surface are placed."""
    placing: int = 16
    """The approximate number of laws from which the runs for a measured experiment are placed."""
    far: float = 4.0
    """The size of standard normal variates that the region of a surface contains for every law."""
    level: float = 0.02
    """The admitted error of a surface, as a share of the scatter of its outcome."""
    edge: float = 1e-12
    """The distance that uniform random numbers keep from zero and one."""
    places: int = 512
    """The largest number of points at which errors of a surface are estimated and runs placed."""
    points: int = 512
    """The number of points drawn from the law for each alpha."""
    largest: int = 2**18
    """The largest number of simulated values in memory at once. With fewer, new memory is not
    taken from the system each time: a probability took 4 s, and 6 s with four million."""
    reach: float = 6.5
    """The size of standard normal variates up to which rare events are searched for; 4e-11 of the
    law lies beyond."""
    seed: int = 5
    """The seed of the points from which the runs for a rare event are placed."""


CONTEXT = ContextSettings()


@dataclass(frozen=True, eq=False)
class MeasuredExperiments:
    """B measured experiments whose next outcomes are predicted from their observations.

    `which` (B,) are their indices in the likelihood. If their outcomes are not `further` ones, they
    are new experiments of groups that were measured. The parameters of an experiment, given its
    observations, depend much on alpha, so that quadrature nodes are adapted to each alpha once.
    """

    likelihood: IndividualLikelihood
    which: Indices
    further: bool = True
    _adapted: dict[bytes, IndividualLikelihood] = field(default_factory=dict, repr=False)

    def at(self, alpha: Array) -> IndividualLikelihood:
        """The likelihood with quadrature nodes adapted to alpha (K,)."""
        key = alpha.tobytes()
        if key not in self._adapted:
            self._adapted[key] = self.likelihood.adapted(alpha)
        return self._adapted[key]


@dataclass(frozen=True, eq=False)
class PredictionContext:
    """B experiments with m values to be predicted, and all that is needed to simulate them.

    `inputs` are the laws of their parameters. `errors` are the measurement errors; without them
    simulated values are predicted. `on_simulator` is true if the simulator itself is evaluated, and
    false if response surfaces are. `measured` has the observations of the experiments, if they are
    not new. `tested` are the experiments from which the laws were identified.
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
    def noise_columns(self) -> tuple[str, ...]:
        """The columns of the conditions that the measurement errors follow."""
        parts = () if self.errors is None else self.errors.parts
        return tuple(name for part in parts for name in part.noise.columns)

    @property
    def count(self) -> int:
        """The number B of experiments."""
        return len(self.conditions.ids)

    @cached_property
    def seen(self) -> Observations:
        """The values to be predicted, as observations without measured values."""
        return self.conditions.observations

    @cached_property
    def layout(self) -> Layout:
        """The simulator run and the experiment of each value to be predicted."""
        return Layout(self.count, self.seen.experiment, self.runner.unit, self.runner.column)

    def experiment(self, place: int) -> int:
        """The index of the experiment to which the value number `place` belongs."""
        return int(self.seen.experiment[place])

    def taken(self, draws: AlphaDraws) -> AlphaDraws:
        """The draws of alpha to be used: all, or 64 for measured experiments to save time."""
        return draws if self.measured is None else draws.fewer(self.settings.most)

    def law(self, alpha: Array) -> Array:
        """The hyperparameters of the laws in alpha, without those of the measurement errors."""
        return alpha[: self.inputs.size]

    def values(self, alpha: Array, eta: Array, score: Array, rows: slice) -> Array:
        """The measured values (m, J) that belong to simulated values eta (m, J).

        `score` (J,) are standard normal variates of the measurement error; the measured value
        increases with them. `rows` are the numbers of the m values.
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
    """J sample points: standard normal variates of parameters and error, and weights (J,).

    `xi` (J, s) are the variates of the s scattering parameters, `score` (J,) those of the
    measurement error. A weight is the density of the law divided by the density from which the
    points were drawn; the mean weight is one.
    """

    xi: Array
    score: Array
    weights: Array

    @classmethod
    def standard(cls, count: int, variates: int, seed: int = 0) -> Points:
        """Scrambled Sobol' points of the standard normal law, with weights of one."""
        u = normal_points(count, variates + 1, seed)
        return cls(u[:, :variates], u[:, variates], np.ones(count))

    def thinned(self, count: int) -> Points:
        """About `count` of the points, chosen evenly along the sequence."""
        step = max(1, len(self.score) // count)
        return Points(self.xi[::step], self.score[::step], self.weights[::step])

    @classmethod
    def joined(cls, parts: Sequence[Points]) -> Points:
        """All points of several samples together."""
        return cls(
            np.concatenate([part.xi for part in parts]),
            np.concatenate([part.score for part in parts]),
            np.concatenate([part.weights for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class DrawnParameters:
    """Parameters x (A, J, n) of one experiment under A laws, with weights (A, J) summing to one.

    `score` (J,) are the standard normal variates of the measurement errors.
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
    """The parameters of one experiment under each of the laws (A, K), from the same variates."""
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
    """Weighted parameters of a measured experiment, distributed as given its observations."""
    assert context.measured is not None
    which, count = int(context.measured.which[experiment]), len(points.score)
    x, weights = [], []
    for alpha in alphas:
        likelihood = context.measured.at(alpha)
        block = likelihood.layout.alone(which)
        own, share = individual_points(likelihood, alpha, block, count)
        x.append(own[which - block.experiments.start])
        weights.append(share[which - block.experiments.start])
    # The points are ordered, so errors are permuted to be independent of them.
    score = np.random.default_rng(count).permutation(normal_points(x[0].shape[0], 1, 0)[:, 0])
    return DrawnParameters(np.stack(x), np.stack(weights), score)


def simulated(values: Callable[[Block, Array], Array], block: Block, x: Array) -> Array:
    """The simulated values (m, A, J) of one experiment at x (A, J, n), by the function `values`."""
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
    """Measured values (m, A, J) for simulated ones eta (m, A, J), with the errors of each alpha."""
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
    """The simulator, or response surfaces that are accurate under the laws of all draws."""
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
    """Parameters (D, n) of experiments under all draws of alpha, and the region (n, 2) of the laws.

    They are those of all experiments, or of `only` one. The region contains standard normal
    variates of size four, one at a time.
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
    """Settings for testing and refining a surface near an event; see `benchmarks limit_states`.

    The first surface is a polynomial of at most `runs` runs. Each round then makes `runs` new runs,
    half drawn from the law and half in a ball of standard normal variates. The ball is so large
    that the share `beyond` of the event's probability lies outside it. Then at most as many runs
    follow in batches of `batch`, where kriging leaves open whether the outcome is in the event.
    They end when the expected probability of mistakes is at most the share `doubt` of that of the
    event.

    A new run contradicts the surface if the surface misses it by more than kriging allows plus a
    tolerance. The tolerance is `share` times the sum of the outcome's distance from the event's end
    and its standard deviation. There is another round if a run contradicts the surface, or if the
    probability changes by more than the share `share`. Rounds end when the next one might exceed
    the surface's `max_runs`.
    """

    runs: int = 96
    batch: int = 8
    beyond: float = 0.1
    share: float = 0.1
    doubt: float = 0.05


@dataclass(frozen=True, eq=False)
class Kriged:
    """A response surface of one value: a polynomial plus kriging of its errors at the runs."""

    trend: OnSurfaces
    missed: ProcessPosterior

    def values(self, block: Block, x: Array) -> Array:
        """The values (1, J) of the surface at points x (1, J, n); at a run it is exact."""
        found, z = self.trend.values(block, x), self.trend.inward(x[0])
        found[0] += self.missed.mean(_alike(z), z)
        return found

    def deviation(self, x: Array) -> Array:
        """The kriging standard deviations (D,) of the surface at points x (D, n).

        They are enlarged by the leave-one-out errors of the nearest runs, in standard deviations.
        One covariance serves the whole region, and would underestimate the error at a local hill.
        """
        z = self.trend.inward(x)
        _, nearest = cKDTree(self.missed.data.u).query(z, 1 + z.shape[1])
        surprise = np.abs(self.missed.surprise)[nearest].max(axis=1)
        return np.asarray(self.missed.deviation(_alike(z), z) * np.maximum(surprise, 1.0))

    def joint(self, x: Array) -> Array:
        """The kriging covariances (D, D) of the surface at points x (D, n)."""
        z = self.trend.inward(x)
        return self.missed.joint(_alike(z), z)


class OneSurface:
    """A response surface of one value that is refined step by step, keeping its runs.

    It begins as a polynomial with at most `most` runs. After `kriged` is used, kriging corrects it.
    `further` are runs that only the kriging uses.
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
        self.covariance = Covariance.first(moving.size, moving.size, gaussian=False)
        self._sharpened(x)

    def predictor(self) -> OnSurfaces | Kriged:
        """The present surface, with kriging if there is one."""
        return self._kriged or self._polynomial()

    def _polynomial(self) -> OnSurfaces:
        if self._trend is None:
            self._trend = OnSurfaces(self.surfaces.surface(), self.region, ZERO)
        return self._trend

    def follow(self, x: Array) -> None:
        """Refine the surface at points x (D, n), on a region widened to contain them."""
        self._reach(x)
        self._sharpened(x)

    def _reach(self, x: Array) -> None:
        self._trend = self._kriged = None
        wanted = hull(self.region, padded(ends_of(x), self.box))
        if np.any(wanted != self.region):
            self.region = wanted
            self.surfaces.move(wanted[moving_parameters(wanted)])

    def learn(self, x: Array) -> None:
        """Run at points x (R, n) and refit the polynomial, on a region widened to contain them."""
        self._reach(x)
        self.surfaces.add(x[:, moving_parameters(self.region)])

    @property
    def runs(self) -> int:
        """The number of runs of the surface."""
        return self.surfaces.total_runs + len(self.further.x)

    @property
    def kriged(self) -> Kriged:
        """The surface corrected by kriging, as `predictor` returns it until the next refit."""
        if self._kriged is None:
            self._kriged = self._through_runs(PROCESS.steps[0])
        return self._kriged

    def correct(self, x: Array) -> None:
        """Run at points x (R, n) within the region, and use the runs for the kriging only."""
        where = np.clip(x, *self.region.T)[:, moving_parameters(self.region)]
        self.further = self.further.joined(
            where, _alike(where), np.arange(len(x)), self.run(_alike(where), where)
        )
        self._kriged = self._through_runs(PROCESS.steps[1])

    def _through_runs(self, steps: int) -> Kriged:
        """The surface with kriging of the polynomial's errors at all runs.

        Its covariance parameters are improved by so many `steps` of a maximization.
        """
        trend = self._polynomial()
        both = (self.surfaces.emulator.samples.inside(self.surfaces.box), self.further)
        x, y = (np.concatenate(part) for part in zip(*(s.listed[1:] for s in both), strict=True))
        z = trend.surface.axes.inward(x)
        missed = y - trend.surface.evaluate(x)[0]
        data = Data(_alike(z), z, missed, z.shape[1], np.full_like(z, np.nan))
        self.covariance = learned((self.covariance,), data, steps)[0][0]
        return Kriged(trend, ProcessPosterior.of(self.covariance, data))

    def _sharpened(self, x: Array) -> None:
        self._trend = self._kriged = None
        where = x[:: max(1, len(x) // self.settings.places)][:, moving_parameters(self.region)]
        self.surfaces.judge(where)
        self.surfaces.refine(where, self.settings.level, surface_progress(self.progress))


def _alike(z: Array) -> Indices:
    return np.zeros(len(z), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class PredictedValue:
    """One predicted value of a new experiment, number `place`, by the simulator or a surface."""

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
        """The value with a surface for the laws of all draws, or with the simulator itself.

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
        """The value with its present surface, which is no longer refined."""
        return replace(self, surface=None, direct=self.predictor)

    @property
    def experiment(self) -> int:
        """The index of the experiment to which the value belongs."""
        return self.context.experiment(self.place)

    @property
    def predictor(self) -> Predictor | Kriged:
        """The simulator, or the surface that replaces it."""
        if self.surface is not None:
            return self.surface.predictor()
        assert self.direct is not None
        return self.direct

    def outcomes(self, alphas: Array, points: Points) -> tuple[Array, DrawnParameters]:
        """The outcomes (A, J) at the points under each law, and the parameters there."""
        found = parameters(self.context, alphas, self.experiment, points)
        eta = simulated(self.predictor.values, self.block, found.x)
        rows = slice(self.place, self.place + 1)
        return measured(self.context, alphas, eta, found.score, rows)[0], found

    def possible(self, alphas: Array, points: Points) -> tuple[Array, Array, DrawnParameters]:
        """The outcomes (A, J) by a surface, their kriging deviations, and the parameters there."""
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
        """The outcomes (R,) of simulator runs at x (R, n), with the errors of alphas (R, K)."""
        unit = np.repeat(self.context.runner.unit[self.place], len(x))
        eta = self.context.runner.values(unit, x)[:, self.context.runner.column[self.place]]
        rows = slice(self.place, self.place + 1)
        found = [
            self.context.values(a, e[None, None], z[None], rows)[0, 0]
            for a, e, z in zip(alphas, eta, score, strict=True)
        ]
        return np.array(found)

    def wide(self, alphas: Array, far: float, count: int) -> Array:
        """Parameters (D, n) that scatter `far` times as much as the laws, and extreme ones.

        The extreme ones have one standard normal variate of size 6.5 and all others zero.
        """
        s = self.context.inputs.scattering
        axes = CONTEXT.reach * np.concatenate([np.eye(s), -np.eye(s)])
        xi = np.concatenate([far * normal_points(count, max(s, 1), CONTEXT.seed)[:, :s], axes])
        points = Points(xi, np.zeros(len(xi)), np.ones(len(xi)))
        return parameters(self.context, alphas, self.experiment, points).x.reshape(
            -1, len(self.context.inputs.names)
        )


def some_of(draws: AlphaDraws, count: int) -> Indices:
    """The indices of at most `count` draws, chosen evenly along the sequence."""
    return np.unique(np.linspace(0, len(draws.alpha) - 1, count).astype(np.intp))
