"""One value that is asked for, as a function of standard normal variates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.likelihood.individual import Direct, Layout, OnSurfaces, Predictor
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.problem import told
from aleator.progress import Progress
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.responses import moving_parameters
from aleator.surrogates.sites import Sites
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.points import (
    Parameters,
    Points,
    law_points,
    measured,
    normal_points,
    parameters,
    simulated,
)
from aleator.tasks.decide.predictors import LEAST, LEVEL, MOST, PAD, ends_of
from aleator.tasks.region import hull, padded
from aleator.types import Array, Indices

STEP = 1e-4
"""Step of differences by an error's score, and of a simulated value over its size."""
REACH = 6.5
"""Standard normal variates that a surface of a rare event reaches to: 4e-11 lie beyond."""
ZERO = np.zeros(1, dtype=np.intp)


class OneSurface:
    """A surface of one value, made exact where it is asked; the runs that it has are kept."""

    def __init__(
        self, ground: Ground, place: int, x: Array, ends: Array, progress: Progress | None
    ) -> None:
        runner = ground.runner
        self.box, self.progress = ground.inputs.box, progress
        self.region = padded(ends, self.box, PAD, LEAST)
        where = slice(place, place + 1)
        self.sites = Sites.seen(runner, runner.unit[where], runner.column[where])
        moving = moving_parameters(self.region)
        self.surfaces = AdaptiveSurfaces(
            self.sites.run(runner, self.region), self.region[moving], 1, ground.surfaces
        )
        self._sharpened(x)

    @property
    def error(self) -> float:
        """The estimated error, where it was asked last."""
        return float(self.surfaces.emulator.error[0])

    def predictor(self) -> Predictor:
        """As it is now."""
        return OnSurfaces(self.surfaces.surface(), self.region, ZERO)

    def follow(self, x: Array) -> None:
        """Make it exact at points x (D, n) too, on a region that holds them."""
        wanted = hull(self.region, padded(ends_of(x), self.box, PAD, LEAST))
        if np.any(wanted != self.region):
            self.region = wanted
            self.surfaces.move(wanted[moving_parameters(wanted)])
        self._sharpened(x)

    def _sharpened(self, x: Array) -> None:
        where = x[:: max(1, len(x) // MOST)][:, moving_parameters(self.region)]
        self.surfaces.judge(where)
        self.surfaces.refine(where, LEVEL, told(self.progress))


@dataclass(frozen=True, eq=False)
class Near:
    """Value number `place` of a ground, by the simulator or a surface of its own."""

    ground: Ground
    place: int
    block: Block
    surface: OneSurface | None
    direct: Predictor | None

    @classmethod
    def of(
        cls, ground: Ground, place: int, draws: AlphaDraws, progress: Progress | None = None
    ) -> Near:
        """With a surface about the laws of all draws, unless the simulator itself is asked."""
        runner, where = ground.runner, slice(place, place + 1)
        layout = Layout(1, ZERO, runner.unit[where], runner.column[where])
        x, ends = law_points(ground, draws, ground.experiment(place))
        moving = moving_parameters(ground.inputs.box)
        if ground.on_simulator or not moving_parameters(ends).size:
            runner.takes_arrays(ends)
            return cls(ground, place, layout.alone(0), None,
                       Direct(runner, moving, ground.inputs.box))  # fmt: skip
        surface = OneSurface(ground, place, x, ends, progress)
        return cls(ground, place, layout.alone(0), surface, None)

    @property
    def experiment(self) -> int:
        """The experiment that it is of."""
        return self.ground.experiment(self.place)

    @property
    def predictor(self) -> Predictor:
        """What answers for the simulator."""
        if self.surface is not None:
            return self.surface.predictor()
        assert self.direct is not None
        return self.direct

    def outcomes(self, alphas: Array, points: Points) -> tuple[Array, Parameters]:
        """Outcomes (A, J) at the points under each law, and the parameters there."""
        found = parameters(self.ground, alphas, self.experiment, points)
        eta = simulated(self.predictor, self.block, found.x)
        rows = slice(self.place, self.place + 1)
        return measured(self.ground, alphas, eta, found.score, rows)[0], found

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

    def response(self, alpha: Array, kind: int) -> _Response:
        """The outcome under one law, and in one of its classes, with its gradient."""
        return _Response(self, self.predictor, alpha, kind)

    def wide(self, alphas: Array, far: float, count: int) -> Array:
        """Parameters (D, n) that are `far` times as far out as the laws say, and the farthest."""
        s = self.ground.inputs.scattering
        axes = REACH * np.concatenate([np.eye(s), -np.eye(s)])
        xi = np.concatenate([far * normal_points(count, max(s, 1), 5)[:, :s], axes])
        points = Points(xi, np.zeros(len(xi)), np.ones(len(xi)))
        return parameters(self.ground, alphas, self.experiment, points).x.reshape(
            -1, len(self.ground.inputs.names)
        )


@dataclass(frozen=True, eq=False)
class _Response:
    """The outcome at variates u (D, s + 1), the last of which is the error's, and its gradient."""

    near: Near
    predictor: Predictor
    alpha: Array
    kind: int

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """Outcomes (D,) and gradients (D, s + 1)."""
        near, ground = self.near, self.near.ground
        inputs, s, count = ground.inputs, ground.inputs.scattering, len(u)
        classes, one = len(inputs.classes), slice(near.experiment, near.experiment + 1)
        xi = np.tile(u[None, :, :s], (1, classes, 1))
        own = slice(self.kind * count, (self.kind + 1) * count)
        found = inputs.individual(ground.law(self.alpha), xi, one)
        with np.errstate(all="ignore"):
            eta, slopes = self.predictor.with_slopes(near.block, found.x[:, own])
        by_xi = np.einsum("nd,dns->ds", slopes[:, 0], found.by_variates()[0, own])
        y, by_eta, by_score = self._error(eta, u[:, s])
        gradient = np.concatenate([by_eta[:, None] * by_xi, by_score[:, None]], axis=1)
        return y, np.nan_to_num(gradient, posinf=0.0, neginf=0.0)

    def _error(self, eta: Array, score: Array) -> tuple[Array, Array, Array]:
        """What is measured (D,), and its derivatives by eta (1, D) and by the score (D,)."""
        rows = slice(self.near.place, self.near.place + 1)

        def at(eta: Array, score: Array) -> Array:
            return np.asarray(self.near.ground.values(self.alpha, eta, score, rows)[0])

        y = at(eta, score)
        if self.near.ground.errors is None:
            return y, np.ones_like(y), np.zeros_like(y)
        step = STEP * np.maximum(np.abs(eta), 1e-6)
        with np.errstate(invalid="ignore"):
            by_eta = (at(eta + step, score) - at(eta - step, score)) / (2.0 * step[0])
            by_score = (at(eta, score + STEP) - at(eta, score - STEP)) / (2.0 * STEP)
        return y, by_eta, by_score


def some_of(draws: AlphaDraws, count: int) -> Indices:
    """So many draws that are spread along the sequence."""
    return np.unique(np.linspace(0, len(draws.alpha) - 1, count).astype(np.intp))
