"""One value that is asked for, as a function of standard normal variates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from aleator.core.blocks import blocks
from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.fit.regions import hull, padded
from aleator.inference.alpha_draws import AlphaDraws
from aleator.likelihood.individual import Direct, Layout, OnSurfaces, Predictor
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.problem import surface_progress
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.samples import Samples, Sites
from aleator.surrogates.shared import PROCESS, SHARING, Covariance, ProcessPosterior, learned
from aleator.tasks.decide.ground import (
    GROUND,
    DrawnParameters,
    Ground,
    Points,
    ends_of,
    law_points,
    measured,
    normal_points,
    parameters,
    simulated,
)

ZERO = np.zeros(1, dtype=np.intp)


@dataclass(frozen=True)
class NearSettings:
    """How far a surface of a rare event reaches; by judgement.

    reach: standard normal variates; 4e-11 of the law lie beyond. seed: that of the points by which
    a surface is placed.
    """

    reach: float = 6.5
    seed: int = 5


NEAR = NearSettings()


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
    """A polynomial surface of one value, and kriging of what it misses at the runs."""

    trend: OnSurfaces
    missed: ProcessPosterior

    def values(self, block: Block, x: Array) -> Array:
        """Values (1, J) at points x (1, J, n): those of the runs, where they were made."""
        found, z = self.trend.values(block, x), self.trend.inward(x[0])
        for part in blocks(len(z), len(self.missed.u), GROUND.largest):
            found[0, part] += self.missed.mean(_alike(z[part]), z[part])
        return found

    def deviation(self, x: Array) -> Array:
        """Standard deviations (D,) of the values at points x (D, n) that the runs leave possible.

        As many times larger as the nearest runs surprise the others, once left out: one
        covariance serves all of the region, and a hill in it is not expected.
        """
        z = self.trend.inward(x)
        _, nearest = cKDTree(self.missed.u).query(z, 1 + z.shape[1])
        surprise = np.abs(self.missed.surprise)[nearest].max(axis=1)
        return np.asarray(self.missed.deviation(_alike(z), z) * np.maximum(surprise, 1.0))

    def joint(self, x: Array) -> Array:
        """Their covariances (D, D)."""
        z = self.trend.inward(x)
        return self.missed.joint(_alike(z), z)


class OneSurface:
    """A surface of one value, made exact where it is asked; the runs that it has are kept.

    It is a polynomial of at most `most` runs, until it is `kriged`; then kriging corrects it.
    `further` are runs that the polynomial does not go through.
    """

    def __init__(
        self, ground: Ground, place: int, x: Array, ends: Array, progress: Progress | None,
        most: int,
    ) -> None:  # fmt: skip
        runner = ground.runner
        self.box, self.progress = ground.inputs.box, progress
        self._trend: OnSurfaces | None = None
        self._kriged: Kriged | None = None
        self.settings = ground.settings
        self.region = padded(ends, self.box)
        where = slice(place, place + 1)
        self.sites = Sites.seen(runner, runner.unit[where], runner.column[where])
        moving = moving_parameters(self.region)
        choice = replace(ground.surfaces, max_runs=min(most, ground.surfaces.max_runs))
        self.run = self.sites.run(runner, self.region)
        self.surfaces = AdaptiveSurfaces(self.run, self.region[moving], 1, choice)
        self.further = Samples.none(1, moving.size)
        self.covariance = Covariance.first(moving.size, moving.size, PROCESS.none)
        self._sharpened(x)

    def predictor(self) -> OnSurfaces | Kriged:
        """As it is now."""
        return self._kriged or self._polynomial()

    def _polynomial(self) -> OnSurfaces:
        if self._trend is None:
            self._trend = OnSurfaces(self.surfaces.surface(), self.region, ZERO)
        return self._trend

    def follow(self, x: Array) -> None:
        """Make it exact at points x (D, n) too, on a region that holds them."""
        self._reach(x)
        self._sharpened(x)

    def _reach(self, x: Array) -> None:
        self._trend = self._kriged = None
        wanted = hull(self.region, padded(ends_of(x), self.box))
        if np.any(wanted != self.region):
            self.region = wanted
            self.surfaces.move(wanted[moving_parameters(wanted)])

    def learn(self, x: Array) -> None:
        """Go through runs at points x (R, n) too, on a region that holds them."""
        self._reach(x)
        self.surfaces.add(x[:, moving_parameters(self.region)])

    @property
    def runs(self) -> int:
        """Runs that it has been made of."""
        return self.surfaces.total_runs + len(self.further.x)

    @property
    def kriged(self) -> Kriged:
        """As it is, corrected by kriging from now on."""
        if self._kriged is None:
            self._kriged = self._through_runs(SHARING.steps[0])
        return self._kriged

    def correct(self, x: Array) -> None:
        """Go through runs at points x (R, n) too, moved into the region, by kriging alone."""
        where = np.clip(x, *self.region.T)[:, moving_parameters(self.region)]
        self.further = self.further.joined(
            where, _alike(where), np.arange(len(x)), self.run(_alike(where), where)
        )
        self._kriged = self._through_runs(SHARING.steps[1])

    def _through_runs(self, steps: int) -> Kriged:
        """Kriging of what the polynomial misses at all runs; its covariance is learned on."""
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
    """Runs at points z (R, n) are all of one experiment."""
    return np.zeros(len(z), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Near:
    """Value number `place` of a ground, by the simulator or a surface of its own."""

    ground: Ground
    place: int
    block: Block
    surface: OneSurface | None
    direct: Predictor | Kriged | None

    @classmethod
    def of(
        cls,
        ground: Ground,
        place: int,
        draws: AlphaDraws,
        progress: Progress | None = None,
        most: int = Exploration.runs,
    ) -> Near:
        """With a surface about the laws of all draws, unless the simulator itself is asked.

        The surface is a polynomial of at most `most` runs.
        """
        runner, where = ground.runner, slice(place, place + 1)
        layout = Layout(1, ZERO, runner.unit[where], runner.column[where])
        x, ends = law_points(ground, draws, ground.experiment(place))
        moving = moving_parameters(ground.inputs.box)
        if ground.on_simulator or not moving_parameters(ends).size:
            runner.takes_arrays(ends)
            return cls(ground, place, layout.alone(0), None,
                       Direct(runner, moving, ground.inputs.box))  # fmt: skip
        surface = OneSurface(ground, place, x, ends, progress, most)
        return cls(ground, place, layout.alone(0), surface, None)

    @property
    def fixed(self) -> Near:
        """With its surface as it is now."""
        return replace(self, surface=None, direct=self.predictor)

    @property
    def experiment(self) -> int:
        """The experiment that it is of."""
        return self.ground.experiment(self.place)

    @property
    def predictor(self) -> Predictor | Kriged:
        """What answers for the simulator."""
        if self.surface is not None:
            return self.surface.predictor()
        assert self.direct is not None
        return self.direct

    def outcomes(self, alphas: Array, points: Points) -> tuple[Array, DrawnParameters]:
        """Outcomes (A, J) at the points under each law, and the parameters there."""
        found = parameters(self.ground, alphas, self.experiment, points)
        eta = simulated(self.predictor.values, self.block, found.x)
        rows = slice(self.place, self.place + 1)
        return measured(self.ground, alphas, eta, found.score, rows)[0], found

    def possible(self, alphas: Array, points: Points) -> tuple[Array, Array, DrawnParameters]:
        """Outcomes (A, J) by a surface, and their standard deviations that its runs leave."""
        assert self.surface is not None
        surface = self.surface.kriged
        found = parameters(self.ground, alphas, self.experiment, points)
        eta = simulated(surface.values, self.block, found.x)
        apart = surface.deviation(found.x.reshape(-1, found.x.shape[2])).reshape(eta.shape)
        rows = slice(self.place, self.place + 1)
        y, moved = (
            measured(self.ground, alphas, part, found.score, rows)[0] for part in (eta, eta + apart)
        )
        return y, np.abs(moved - y), found

    def at_runs(self, alphas: Array, x: Array, score: Array) -> Array:
        """Outcomes (R,) of runs of the simulator at x (R, n), each under an alpha of its own."""
        unit = np.repeat(self.ground.runner.unit[self.place], len(x))
        eta = self.ground.runner.values(unit, x)[:, self.ground.runner.column[self.place]]
        rows = slice(self.place, self.place + 1)
        found = [
            self.ground.values(a, e[None, None], z[None], rows)[0, 0]
            for a, e, z in zip(alphas, eta, score, strict=True)
        ]
        return np.array(found)

    def wide(self, alphas: Array, far: float, count: int) -> Array:
        """Parameters (D, n) that are `far` times as far out as the laws say, and the farthest."""
        s = self.ground.inputs.scattering
        axes = NEAR.reach * np.concatenate([np.eye(s), -np.eye(s)])
        xi = np.concatenate([far * normal_points(count, max(s, 1), NEAR.seed)[:, :s], axes])
        points = Points(xi, np.zeros(len(xi)), np.ones(len(xi)))
        return parameters(self.ground, alphas, self.experiment, points).x.reshape(
            -1, len(self.ground.inputs.names)
        )


def some_of(draws: AlphaDraws, count: int) -> Indices:
    """So many draws that are spread along the sequence."""
    return np.unique(np.linspace(0, len(draws.alpha) - 1, count).astype(np.intp))
