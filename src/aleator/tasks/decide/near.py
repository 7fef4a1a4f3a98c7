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
        self._fitted: OnSurfaces | None = None
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
        if self._fitted is None:
            self._fitted = OnSurfaces(self.surfaces.surface(), self.region, ZERO)
        return self._fitted

    def follow(self, x: Array) -> None:
        """Make it exact at points x (D, n) too, on a region that holds them."""
        self._reach(x)
        self._sharpened(x)

    def _reach(self, x: Array) -> None:
        self._fitted = None
        wanted = hull(self.region, padded(ends_of(x), self.box, PAD, LEAST))
        if np.any(wanted != self.region):
            self.region = wanted
            self.surfaces.move(wanted[moving_parameters(wanted)])

    def learn(self, x: Array) -> None:
        """Go through runs at points x (R, n) too, on a region that holds them."""
        self._reach(x)
        self.surfaces.add(x[:, moving_parameters(self.region)])

    def _sharpened(self, x: Array) -> None:
        self._fitted = None
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

    def wide(self, alphas: Array, far: float, count: int) -> Array:
        """Parameters (D, n) that are `far` times as far out as the laws say, and the farthest."""
        s = self.ground.inputs.scattering
        axes = REACH * np.concatenate([np.eye(s), -np.eye(s)])
        xi = np.concatenate([far * normal_points(count, max(s, 1), 5)[:, :s], axes])
        points = Points(xi, np.zeros(len(xi)), np.ones(len(xi)))
        return parameters(self.ground, alphas, self.experiment, points).x.reshape(
            -1, len(self.ground.inputs.names)
        )


def some_of(draws: AlphaDraws, count: int) -> Indices:
    """So many draws that are spread along the sequence."""
    return np.unique(np.linspace(0, len(draws.alpha) - 1, count).astype(np.intp))
