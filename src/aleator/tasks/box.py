"""The feasible box: the largest box of the parameters in which every experiment has an outcome.

A box is a range for each parameter. The paper chooses the box so that "a feasible solution can be
obtained for all experiments" and so that it is as large as possible. Here it is computed from runs
of the simulator, some of which fail.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags
from aleator.errors import SimulatorError
from aleator.simulators import Runner
from aleator.tasks.arguments import Laws, inputs_of
from aleator.tasks.runs import AnySimulator, AnyTable, runner_on


@dataclass(frozen=True)
class BoxSettings:
    """Settings of the search for the feasible box; the values are chosen by judgement."""

    points: int = 32
    """The number of parameter points that are run in a round, under experiment after experiment
    until one fails."""
    quiet: int = 3
    """The number of successive rounds without a failure after which the box is accepted."""
    rounds: int = 100
    """The largest number of rounds of the search."""
    seeds: int = 6
    """The number of valid points around each of which the largest box is searched for."""
    nodes: int = 4000
    """The number of boxes examined around each such point before the search is shortened."""
    fine: float = 0.005
    """The accuracy of a boundary between valid and failing points, as a share of the limits'
    width."""
    retreat: float = 0.01
    """The distance of a side from the failures that limit it, as a share of the limits' width."""
    narrowed: float = 0.1
    """The largest step of a side inward from a failure, as a share of the box's width."""
    first: int = 8
    """The number of experiments that failed last and are run before all others."""
    again: int = 8
    """The factor by which the number of points grows if no first point is valid."""
    patience: int = 30
    """The number of rounds after which `retreat` has doubled. Without this the search would not end
    where several boxes are nearly equally large.
    """


BOX = BoxSettings()


@dataclass(frozen=True)
class Side:
    """One side of the box: the `upper` or lower end of a parameter, and the failure beyond it.

    `experiment` is the id of the experiment that fails beyond the side, at the parameters `at`
    (n,). Both are None where the side is on a limit of the study.
    """

    parameter: str
    upper: bool
    value: float
    experiment: str | None
    at: Array | None


@dataclass(frozen=True)
class FeasibleBox:
    """The largest box (n, 2) found, its sides, and the number of runs made.

    `share` is its volume divided by that of the limits. `tested` is the number of points inside it
    that were run under every experiment without a failure. `confirmed` is true if the last rounds
    had no failure. `without` has, for each experiment that limits a side, the share of the box if
    that experiment were left out, by the failures of the others seen so far.
    """

    names: tuple[str, ...]
    box: Array
    limits: Array
    sides: tuple[Side, ...]
    share: float
    runs: int
    tested: int
    confirmed: bool
    without: Mapping[str, float]


@dataclass
class _Known:
    """The points of the unit cube that failed, the experiment of each failure, and valid points."""

    failed: list[Array]
    culprit: list[int]
    valid: list[Array]

    def worst_first(self, groups: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        """The experiments in two batches: first those that failed last, then all others."""
        seen = [l for l in dict.fromkeys(reversed(self.culprit)) if l in set(groups.tolist())]
        first = np.array(seen[: BOX.first], dtype=np.intp)
        rest = np.setdiff1d(groups, first)
        return [part for part in (first, rest) if part.size]


def feasible_box(
    simulator: AnySimulator,
    experiments: AnyTable,
    inputs: Laws,
    *,
    vectorized: bool | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    executor: Executor | None = None,
    settings: BoxSettings = BOX,
) -> FeasibleBox:
    """Find the largest box within the inputs' limits in which every experiment has an outcome.

    `simulator` and `experiments` are those of `identify`; measured outcomes are not used. Points
    are run under the experiments that failed before, then under all others. From each failure
    bisection finds the boundary to the valid points. The largest box without any failure seen so
    far is computed exactly by best-first search. The box is accepted after three rounds of points
    inside it and on its sides without a failure. It is then probably valid, but not proven.

    Raises SimulatorError if no point is valid for all experiments; it names the experiment that
    fails most. Cost: some hundred points times the number of distinct experiments.

    >>> import pandas as pd
    >>> from aleator.laws import TruncatedNormal
    >>> table = pd.DataFrame({"id": ["a"], "load": [1.0]})
    >>> def model(load, x):
    ...     return load / x if x < 1.5 else float("nan")
    >>> found = feasible_box(model, table, {"x": TruncatedNormal(box=(1.0, 3.0))})
    >>> found.box.round(1).tolist(), found.sides[1].experiment
    ([[1.0, 1.5]], 'a')
    """
    inputs = inputs_of(inputs)
    runner = runner_on(simulator, experiments, inputs.names, vectorized, executor)
    limits = inputs.box
    moving = np.flatnonzero(limits[:, 1] > limits[:, 0])
    search = _BoxSearch(
        runner, limits, moving, np.random.default_rng(seed), progress or Silent(), settings
    )
    unit, confirmed, tested = search.find()
    box = limits.copy()
    low, width = limits[moving, 0], np.ptp(limits[moving], axis=1)
    box[moving] = low[:, None] + width[:, None] * unit
    sides = []
    for k, i in enumerate(moving):
        for end in (0, 1):
            culprit = search.limiting(unit, k, end)
            sides.append(
                Side(
                    inputs.names[i],
                    bool(end),
                    float(box[i, end]),
                    None if culprit is None else search.experiment(culprit),
                    None if culprit is None else search.point(search.known.failed[culprit]),
                )
            )
    limiting = dict.fromkeys(side.experiment for side in sides if side.experiment is not None)
    return FeasibleBox(
        inputs.names, box, limits, tuple(sides), _volume(unit), runner.runs, tested, confirmed,
        {name: search.share_without(name) for name in limiting},
    )  # fmt: skip


class _BoxSearch:
    def __init__(
        self,
        runner: Runner,
        limits: Array,
        moving: NDArray[np.intp],
        rng: np.random.Generator,
        progress: Progress,
        settings: BoxSettings,
    ) -> None:
        self.settings = settings
        self.runner, self.limits, self.moving = runner, limits, moving
        self.groups = runner.cases.first
        self.sobol = qmc.Sobol(moving.size, rng=rng)
        self.rng, self.progress = rng, progress
        self.known = _Known([], [], [])

    def find(self) -> tuple[Array, bool, int]:
        """The box in the unit cube; whether fresh runs confirmed it; its valid runs."""
        n = self.moving.size
        corners = self.rng.integers(0, 2, (min(2**n, self.settings.points), n)).astype(float)
        first = np.vstack(
            [np.full((1, n), 0.5), self.sobol.random(2 * self.settings.points), corners]
        )
        self._look(first)
        if not self.known.valid:
            self._look(self.sobol.random(self.settings.again * self.settings.points))
        if not self.known.valid:
            raise self._hopeless()
        quiet = 0
        for number in range(self.settings.rounds):
            box = _retreated(
                self._largest(), self.settings.retreat * (1.0 + number / self.settings.patience)
            )
            before = len(self.known.failed)
            self._look(self._inside(box))
            quiet = quiet + 1 if len(self.known.failed) == before else 0
            text = f"round {number + 1}: {self.runner.runs} runs, {len(self.known.failed)} failures"
            self.progress.update(text, number + 1, self.settings.rounds)
            if quiet == self.settings.quiet:
                break
        valid = np.array(self.known.valid)
        tested = int(np.sum(np.all((valid >= box[:, 0]) & (valid <= box[:, 1]), axis=1)))
        return box, quiet == self.settings.quiet, tested

    def point(self, unit: Array) -> Array:
        """The parameters (n,) of a point in the unit cube of the non-constant parameters."""
        x = self.limits[:, 0].copy()
        x[self.moving] += unit * np.ptp(self.limits[self.moving], axis=1)
        return x

    def limiting(self, box: Array, k: int, end: int) -> int | None:
        """The index of the failure next beyond a side of the box; None if there is none."""
        if box[k, end] in (0.0, 1.0):
            return None
        failed = np.array(self.known.failed)
        beyond = (failed[:, k] - box[k, end]) * (1.0 if end else -1.0)
        others = np.delete(np.arange(box.shape[0]), k)
        inside = np.all(
            (failed[:, others] >= box[others, 0]) & (failed[:, others] <= box[others, 1]), axis=1
        )
        distance = np.where(inside & (beyond >= 0.0), beyond, np.inf)
        return int(np.argmin(distance)) if np.isfinite(distance).any() else None

    def _look(self, points: Array) -> None:
        """Run points (P, n) under every experiment until one fails, and locate the failures."""
        alive = np.arange(len(points))
        fresh: list[tuple[Array, int]] = []
        for batch in self.known.worst_first(self.groups):
            failing = self._failing(points[alive], batch)
            fresh += [(points[p], int(l)) for p, l in zip(alive, failing, strict=True) if l >= 0]
            alive = alive[failing < 0]
        self.known.valid += list(points[alive])
        if fresh:
            failed, culprits = np.stack([point for point, _ in fresh]), [l for _, l in fresh]
            self.known.failed += list(self._followed(failed, np.array(culprits)))
            self.known.culprit += culprits

    def _failing(self, points: Array, batch: NDArray[np.intp]) -> NDArray[np.int64]:
        """The index, for each point, of an experiment of the batch that fails there, or -1."""
        if not len(points):
            return np.zeros(0, dtype=np.int64)
        x = np.repeat(np.stack([self.point(p) for p in points]), batch.size, axis=0)
        bad = ~self._works(np.tile(batch, len(points)), x).reshape(len(points), batch.size)
        return np.where(bad.any(axis=1), batch[np.argmax(bad, axis=1)], -1)

    def _followed(self, failed: Array, culprits: NDArray[np.int64]) -> Array:
        """The failures (F, n), moved by bisection to the boundary of the valid points."""
        if not self.known.valid:
            return failed
        valid = np.array(self.known.valid)
        apart = np.abs(valid[None, :, :] - failed[:, None, :]).max(axis=2)
        good, bad = valid[np.argmin(apart, axis=1)], failed
        while np.abs(bad - good).max() > self.settings.fine:
            middle = 0.5 * (good + bad)
            x = np.stack([self.point(p) for p in middle])
            works = self._works(culprits, x)[:, None]
            good, bad = np.where(works, middle, good), np.where(works, bad, middle)
        return bad

    def _inside(self, box: Array) -> Array:
        """New points inside the box, on its sides and in its corners."""
        n = len(box)
        points = self.sobol.random(self.settings.points)
        onto = np.arange(self.settings.points) % 4
        which = self.rng.integers(0, n, self.settings.points)
        ends = self.rng.integers(0, 2, (self.settings.points, n)).astype(float)
        # A quarter of the points lies inside, a half on one side, a quarter in the corners.
        rows = np.flatnonzero((onto == 1) | (onto == 2))
        points[rows, which[rows]] = ends[rows, which[rows]]
        points[onto == 3] = ends[onto == 3]
        return np.asarray(box[:, 0] + points * np.diff(box, axis=1)[:, 0])

    def _works(self, unit: NDArray[np.int64], x: Array) -> Flags:
        """Which runs succeed, that is have a finite value."""
        return np.asarray(np.isfinite(self.runner.values(unit, x, most=1.0)).any(axis=1))

    def experiment(self, failure: int) -> str:
        """The id of the experiment whose run failed."""
        return str(self.runner.ids[self.runner.experiment[self.known.culprit[failure]]])

    def share_without(self, experiment: str) -> float:
        """The volume of the largest box in the unit cube without the failures of an experiment."""
        failures = range(len(self.known.failed))
        others = np.array([self.experiment(k) != experiment for k in failures])
        return _volume(_retreated(self._largest(others), self.settings.retreat))

    def _largest(self, counted: Flags | None = None) -> Array:
        """The largest box of the unit cube without failures; `counted` selects some of them."""
        failed = np.array(self.known.failed).reshape(-1, self.moving.size)
        failed = failed if counted is None else failed[counted]
        valid = np.array(self.known.valid)
        middle = np.abs(valid - 0.5).max(axis=1)
        seeds = [valid[int(np.argmin(middle))]]
        while len(seeds) < min(self.settings.seeds, len(valid)):
            apart = np.min([np.abs(valid - s).max(axis=1) for s in seeds], axis=0)
            seeds.append(valid[int(np.argmax(apart))])
        boxes = [largest_box(failed, s) for s in seeds]
        return max(boxes, key=_volume)

    def _hopeless(self) -> SimulatorError:
        failures = [self.experiment(k) for k in range(len(self.known.failed))]
        names, counts = np.unique(failures, return_counts=True)
        worst = names[np.argmax(counts)]
        return SimulatorError(
            f"the simulator failed in at least one experiment at each of the "
            f"{len(self.known.failed)} points tried; experiment '{worst}' fails most often",
            "widen the box, or check the conditions of that experiment",
        )


def _volume(box: Array) -> float:
    return float(np.prod(np.diff(box, axis=1)))


def _retreated(box: Array, retreat: float) -> Array:
    """The box with each side moved inward, except sides on the limits of the unit cube."""
    step = np.minimum(retreat, BOX.narrowed * np.diff(box, axis=1)[:, 0])
    low = np.where(box[:, 0] > 0.0, box[:, 0] + step, 0.0)
    high = np.where(box[:, 1] < 1.0, box[:, 1] - step, 1.0)
    return np.stack([low, high], axis=1)


def largest_box(failed: Array, seed: Array, settings: BoxSettings = BOX) -> Array:
    """The largest box of the unit cube that contains the seed (n,) but no failure (F, n).

    Best-first search: a box with a failure inside is cut between that failure and the seed, along
    each parameter in turn. Cuts only reduce the volume, so that the first box without a failure is
    the largest. After `settings.nodes` boxes the search goes on depth-first, and the box found is
    large but perhaps not the largest.

    >>> largest_box(np.array([[0.75, 0.9]]), np.array([0.5, 0.5])).tolist()
    [[0.0, 1.0], [0.0, 0.9]]
    """
    n = seed.size
    whole = np.stack([np.zeros(n), np.ones(n)], axis=1)
    heap: list[tuple[float, int, Array]] = [(-1.0, 0, whole)]
    count = 0
    while True:
        _, _, box = heapq.heappop(heap)
        inside = np.all((failed > box[:, 0]) & (failed < box[:, 1]), axis=1)
        if not inside.any():
            return box
        held = failed[inside]
        point = held[int(np.argmin(np.abs(held - seed).max(axis=1)))]
        children = []
        for k in np.flatnonzero(point != seed):
            cut = box.copy()
            cut[k, 1 if point[k] > seed[k] else 0] = point[k]
            count += 1
            children.append((-float(np.prod(np.diff(cut, axis=1))), count, cut))
        if count > settings.nodes:
            heap = [min(children)]
        else:
            for child in children:
                heapq.heappush(heap, child)
