"""Refine, identify, refine again: surfaces that are exact where the answer needs them.

A surface costs runs, and an answer looks at it only where the law has its mass. So the first
surfaces are coarse, the law that they lead to says where the next runs are to be, and this goes on
until neither alpha nor the log-likelihood moves. No run is lost on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.inference import diagnostics as findings
from aleator.inference.information import Inference, infer
from aleator.laws import Hyperparameter
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem, prepare, told
from aleator.progress import Progress
from aleator.search import SearchResult, ascend
from aleator.simulators import Runner
from aleator.surrogates import Shared
from aleator.surrogates.responses import moving_parameters
from aleator.surrogates.sharing import first_surfaces, later_surfaces
from aleator.tasks import region as focus
from aleator.types import Array, Flags

Search = Callable[[Problem, list[Array]], SearchResult]

SURFACE = "response surface"
"""What the rounds are called in the account of runs and seconds."""
ROUGH = 0.05
"""Estimated error of a surface under the law, over the outcome's scatter, that asks for runs."""
ROUGH_SHARED = 0.1
"""The same of a shared surface: its estimate is more cautious."""
FINEST = 1e-3
"""The same, below which no error can matter to an answer."""
STILL = 0.1
"""A step of alpha, in the metric of the information (no hyperparameter moves more, in its standard
errors), that is none."""
LEVEL = 0.2
"""A change of the log-likelihood that is none; a thousandth an experiment if that is more."""
GROWTH = 0.3
"""Share by which a round increases the runs of the experiments that need more."""
ROUNDS = 24
"""Rounds after which the answer is taken as it is."""
PATIENCE = 6
"""Rounds of its own after which an experiment is given up whose error falls by less than a fifth:
its runs have then grown fivefold, so that what is left is the simulator's own noise, or a jump."""
STALL = 0.8
SPREAD, TAILS = 1.5, 1.3
"""By how much the draws that place the runs are wider than alpha's uncertainty, and the law."""
ALPHAS, EACH = 32, 16
"""Laws that represent alpha's uncertainty, and draws of each."""


@dataclass
class Concentration:
    """An identification on surfaces that follow it; `search` makes it, `hold` widens it.

    `full` is the user's search from guesses. Only what this identification has run decides where
    the next run is, so that it is the same whether runs come from a store or not.
    """

    runner: Runner
    outcomes: Array
    model: Model
    full: Search
    stage: Callable[[str], AbstractContextManager[None]]
    progress: Progress
    ids: Sequence[str]

    def search(self, seed: int) -> tuple[Problem, SearchResult]:
        """The answer that further runs do not move."""
        assert self.model.surfaces is not None
        self.choice = self.model.surfaces
        with self.stage(SURFACE):
            self._begin(focus.first_region(self.runner, self.model, self.outcomes, seed))
            problem = self._reachable()
        return self._settled(problem, self.full(problem, []), self.state.runs.sum())

    def _begin(self, region: Array) -> None:
        """First surfaces on the region (n, 2), of as few runs as tell anything."""
        self.region, self.held = region, False
        self.where, self.noise_sd = self._everywhere(), 0.0
        self.state = first_surfaces(self.runner, region, self.choice, self.where)
        self.past = np.full((PATIENCE, len(self.runner.cases)), np.inf)
        self._complete()

    def hold(
        self, problem: Problem, found: SearchResult, inference: Inference, intervals: Array
    ) -> tuple[Problem, SearchResult] | None:
        """The answer on surfaces that hold the laws at the ends of the intervals, or None if so."""
        region = focus.interval_region(problem, found.alpha, intervals, generous=False)
        if region is not None:
            self.held = True
            with self.stage(SURFACE):
                self._move(region)
        ends = _ends(found.alpha, inference, intervals, problem.model.hyperparameters)
        draws = np.concatenate([self.where, *(self._law(problem, end) for end in ends)])
        self._judge(draws)
        wanting = self._wanting(2.0 * self.rough)
        if region is None and not wanting.any():
            return None
        with self.stage(SURFACE):
            if wanting.any():
                self.state.sharpen(np.flatnonzero(wanting), draws, GROWTH)
            self._judge(self.where)
            problem = self._reachable()
            found = self._climbed(problem, found, inference)
        return self._settled(problem, found, -1)

    def _settled(
        self, problem: Problem, found: SearchResult, searched: int
    ) -> tuple[Problem, SearchResult]:
        """Refine and climb until nothing moves, and the full search finds nothing else.

        `searched` is the number of runs at which it has been made.
        """
        tolerance, calm = self.rough, False
        for _ in range(ROUNDS):
            inference = self._look(problem, found.alpha)
            wanting = self._wanting(tolerance)
            halved = tolerance < self.rough
            while (calm or not wanting.any()) and not (calm and halved) and tolerance > FINEST:
                tolerance, calm = 0.5 * tolerance, False
                wanting = self._wanting(tolerance)
            if (calm and halved) or not wanting.any():
                if searched == self.state.runs.sum():
                    break
                best, searched = self.full(problem, [found.alpha]), self.state.runs.sum()
                before, found = found, best
                if self._calm(before, best, inference):
                    break
                tolerance, calm = self.rough, False
            else:
                with self.stage(SURFACE):
                    self._refine(problem, found.alpha, inference, tolerance)
                    problem = self._reachable()
                    before, found = found, self._climbed(problem, found, inference)
                calm = self._calm(before, found, inference)
        return problem, found

    def _refine(
        self, problem: Problem, alpha: Array, inference: Inference, tolerance: float
    ) -> None:
        """Move the region to the law, and run the experiments that are rougher than `tolerance`."""
        likely = likely_alphas(alpha, inference, problem.model.hyperparameters)
        region = None if self.held else focus.next_region(problem, alpha, [*likely])
        if region is not None:
            self._move(region)
        self.state = later_surfaces(self.state, self.choice)
        self.state.judge(self.where)
        members = np.flatnonzero(self._wanting(tolerance))
        if members.size:
            self.past[:, members] = np.roll(self.past[:, members], -1, axis=0)
            self.past[-1, members] = self._relative()[members]
            self.state.sharpen(members, self._likely(problem, likely), GROWTH)
            self._judge(self.where)
        tell = told(self.progress)
        if tell:
            good = ~self.state.rough(self.rough, self.choice.accuracy)
            tell(int(self.state.runs.sum()), int(good.sum()), good.size)

    @property
    def rough(self) -> float:
        """Estimated error of a surface under the law, over its scatter, that asks for runs."""
        return ROUGH_SHARED if isinstance(self.state, Shared) else ROUGH

    def _wanting(self, tolerance: float) -> Flags:
        """Whose surface is too rough, where more runs may help."""
        spent = self.state.runs >= self.choice.max_runs
        stalled = self._relative() > STALL * self.past[0]
        rough = self.state.rough(tolerance, self.choice.accuracy)
        return np.asarray(rough & ~spent & ~stalled)

    def _relative(self) -> Array:
        scatter = self.state.scatter
        return np.asarray(self.state.error / np.where(scatter > 0.0, scatter, 1.0))

    def _look(self, problem: Problem, alpha: Array) -> Inference:
        """Judge the surfaces under the law alpha."""
        self.where, self.noise_sd = self._law(problem, alpha), self.model.noise_sd(alpha)
        self._judge(self.where)
        return infer(problem.objective, alpha, problem.model.hyperparameters)

    def _judge(self, where: Array) -> None:
        self.state.judge(where, self.noise_sd)

    def _climbed(self, problem: Problem, found: SearchResult, inference: Inference) -> SearchResult:
        alpha, value = ascend(
            problem.objective, found.alpha, problem.model.hyperparameters,
            inference.identified, inference.information,
        )  # fmt: skip
        return found.improved(alpha, value)

    def _calm(self, before: SearchResult, after: SearchResult, inference: Inference) -> bool:
        step = (after.alpha - before.alpha)[inference.identified]
        length = float(step @ inference.information @ step)
        change = abs(after.log_likelihood - before.log_likelihood)
        return length < STILL**2 and change < max(LEVEL, 1e-3 * self.outcomes.size)

    def _reachable(self) -> Problem:
        """The likelihood, once every outcome lies within reach of the surfaces.

        Raises ExperimentsError where one does not though they are exact on the inputs' box.
        """
        while True:
            problem = self._problem()
            lost = findings.unreachable(problem.likelihood)
            if not lost.size:
                return problem
            self._judge(self._everywhere())
            rough = np.flatnonzero(self._wanting(FINEST))
            members = np.intersect1d(problem.condition[lost], rough)
            box = self.model.inputs.box
            if not np.array_equal(self.region, box):
                self._move(focus.widened(self.region, box))
            elif members.size:
                self.state.sharpen(members, self._everywhere(), GROWTH)
            else:
                findings.refuse_unreachable(problem.likelihood, self.ids)
            self._judge(self.where)

    def _problem(self) -> Problem:
        surface = self.state.surface(~self.state.rough(self.rough, self.choice.accuracy))
        return prepare(self.runner, self.outcomes, self.model, self.region, self.progress, surface)

    def _move(self, region: Array) -> None:
        self.region = region
        self.state.move(self._box(region))
        self.past[:] = np.inf
        self._complete()

    def _complete(self) -> None:
        """Enough runs for a surface of every experiment; it is up to `prepare` to refuse one."""
        self._judge(self.where)
        for _ in range(2):
            few = np.flatnonzero(np.isinf(self.state.error))
            if few.size:
                self.state.sharpen(few, self._everywhere(), GROWTH)
                self._judge(self.where)

    def _box(self, region: Array) -> Array:
        return region[moving_parameters(region)]

    def _everywhere(self) -> Array:
        box = self._box(self.region)
        power = int(np.log2(ALPHAS * EACH))
        u = qmc.Sobol(len(box), rng=0).random_base2(power)
        return np.asarray(box[:, 0] + u * (box[:, 1] - box[:, 0]))

    def _law(self, problem: Problem, alpha: Array) -> Array:
        inputs = problem.model.inputs
        u = qmc.Sobol(len(inputs.names), rng=0).random_base2(int(np.log2(ALPHAS * EACH)))
        return self._inside(inputs.sample(alpha[: inputs.size], u))

    def _likely(self, problem: Problem, alphas: Array) -> Array:
        """Draws (D, n) of the laws of some alphas, with somewhat wider tails."""
        inputs = problem.model.inputs
        u = qmc.Sobol(len(inputs.names), rng=1).random_base2(int(np.log2(ALPHAS * EACH)))
        u = special.ndtr(TAILS * special.ndtri(np.clip(u, 1e-12, 1.0 - 1e-12)))
        parts = zip(alphas, np.split(u, ALPHAS), strict=True)
        return self._inside(np.concatenate([inputs.sample(a[: inputs.size], v) for a, v in parts]))

    def _inside(self, x: Array) -> Array:
        return np.clip(x, *self.region.T)[:, moving_parameters(self.region)]


def likely_alphas(
    alpha: Array, inference: Inference, hyperparameters: tuple[Hyperparameter, ...]
) -> Array:
    """Values (32, K) of alpha that its uncertainty leaves open: normal, within the limits.

    1.5 times as wide as the information says, and no wider than the limits in any direction.
    """
    free = inference.identified
    limits = np.array([[h.lower, h.upper] for h in hyperparameters])
    u = qmc.Sobol(max(free.size, 1), rng=2).random_base2(int(np.log2(ALPHAS)))[:, : free.size]
    width = (limits[:, 1] - limits[:, 0])[free]
    # a direction that the experiments leave open ends at the limits: information of 4 / width^2
    scaled = inference.information * np.outer(width, width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    root = vectors / np.sqrt(np.maximum(values, 4.0))
    out = np.tile(alpha, (ALPHAS, 1))
    out[:, free] += SPREAD * width * (special.ndtri(np.clip(u, 1e-9, 1.0)) @ root.T)
    return np.clip(out, limits[:, 0], limits[:, 1])


def _ends(
    alpha: Array,
    inference: Inference,
    intervals: Array,
    hyperparameters: tuple[Hyperparameter, ...],
) -> list[Array]:
    """alpha at both ends of every interval (K, 2), the others gone along as the covariance says."""
    free = inference.free.tolist()
    out = []
    for k in free:
        column = inference.covariance[:, free.index(k)]
        if not (inference.positive and column[free.index(k)] > 0.0):
            continue
        for end in intervals[k][np.isfinite(intervals[k])]:
            moved = alpha.copy()
            moved[inference.free] += column / column[free.index(k)] * (end - alpha[k])
            out.append(
                np.clip(
                    moved, [h.lower for h in hyperparameters], [h.upper for h in hyperparameters]
                )
            )
    return out
