"""Surfaces of slow simulators, made exact where the experiments' laws lie and against the noise.

Search on coarse surfaces, look where the laws are and how large the noise is, run there, climb, and
so on until neither alpha nor the log-likelihood moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from aleator.inference.information import Inference, infer
from aleator.likelihood.individual import IndividualLikelihood, OnSurfaces, Predictor
from aleator.likelihood.problem import told
from aleator.progress import Progress
from aleator.search import SearchResult
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface
from aleator.surrogates.afforded import within
from aleator.surrogates.responses import moving_parameters
from aleator.surrogates.sites import Sites
from aleator.tasks.individual.population import (
    FAR,
    LIKELY,
    around,
    draws,
    held_region,
)
from aleator.tasks.individual.rivals import elsewhere, near
from aleator.tasks.individual.settle import Settled, settled
from aleator.tasks.ledger import Ledger
from aleator.tasks.likely import likely_alphas
from aleator.tasks.region import hull
from aleator.types import Array, Flags, Indices

SURFACE = "response surface"
"""What the rounds are called in the account of runs and seconds."""
COARSE = 0.1
"""Estimated error over the outcome's scatter on the region, of the first surfaces."""
LOOSE = 0.2
"""Estimated error over the noise that the first refinement asks for; halved each round."""
TIGHT = 0.0125
"""... that it must come to before the answer may be calm."""
FINEST = 1e-3
ROUNDS = 16
STILL = 0.1
"""A step of alpha, in the metric of the information, that is none."""
CHANGE = 0.01
"""A change of the log-likelihood that is none; a ten-thousandth an experiment if that is more."""
ROUGHLY = 0.05
"""A change of the log-likelihood with more nodes that does not matter while surfaces change."""
WIDER = 1.2
"""Runs are placed so much farther out than the laws say."""
SHRINK = 0.6
"""A region is narrowed only if that makes it smaller than this share of itself."""


@dataclass(frozen=True, eq=False)
class Begun:
    """The first surfaces, on a region (n, 2); `lost` (M,) are observations that have none.

    There is none where fewer runs work than a surface needs.
    """

    surfaces: AdaptiveSurfaces
    region: Array
    sites: Sites
    lost: Flags

    @classmethod
    def on(
        cls,
        runner: Runner,
        region: Array,
        choice: ResponseSurface,
        unit: Indices,
        column: Indices,
        progress: Progress,
    ) -> Begun:
        """Surfaces of all observations; `unit`, `column` (M,) say which runs they are.

        Coarse ones all over the region, unless the user chose a tolerance.
        """
        sites = Sites.seen(runner, unit, column)
        box = region[moving_parameters(region)]
        surfaces = AdaptiveSurfaces(
            sites.run(runner, region),
            box,
            len(sites),
            choice,
            afforded=within(runner.account, sites.unit),
        )
        surfaces.refine(surfaces.everywhere(), choice.tolerance or COARSE, told(progress))
        return cls(surfaces, region, sites, np.isinf(surfaces.emulator.error)[sites.of])

    def without_lost(self) -> Begun:
        """The same for the other observations."""
        sites = replace(self.sites, of=self.sites.of[~self.lost])
        return replace(self, sites=sites, lost=self.lost[~self.lost])


@dataclass(frozen=True, eq=False)
class Surfaced:
    """An answer on surfaces, with these and the region that they know.

    `others` are lower maxima that surfaces of their own were made for.
    """

    settled: Settled
    found: SearchResult
    surfaces: AdaptiveSurfaces
    region: Array
    sites: Sites
    others: tuple[Settled, ...] = ()


@dataclass(frozen=True, eq=False)
class ByResponseSurfaces:
    """How a search on surfaces goes on from one answer to a better one.

    `likelihood` makes one of a predictor, and `search` is the user's from guesses.
    """

    runner: Runner
    likelihood: Callable[[Predictor], IndividualLikelihood]
    search: Callable[[IndividualLikelihood, Sequence[Array]], SearchResult]
    ledger: Ledger

    def answer(self, begun: Begun) -> Surfaced:
        """The answer that further runs do not move.

        The first surfaces are too coarse to tell which optimum is the highest: each of the best is
        followed to its own end. Runs are made anew for each, where they are not the same.
        """
        first = self._first(begun)
        others = elsewhere(first.found, _infer(first.settled), self.likelihood_of(first))
        again = [deepcopy(first.surfaces) for _ in others]
        ends = [self._ended(first)]
        for alpha, surfaces in zip(others, again, strict=True):
            with self.ledger.stage("search"):
                start = settled(self.likelihood_of(first), alpha, ROUGHLY)
            known = [end.settled.alpha for end in ends]
            follow = self._refined(replace(first, settled=start, surfaces=surfaces), known)
            if not _among(follow.settled, _infer(follow.settled), known):
                ends.append(self._ended(follow))
        best, *lower = sorted(ends, key=lambda end: -end.settled.value)
        return replace(best, others=tuple(end.settled for end in lower))

    def likelihood_of(self, surfaced: Surfaced) -> IndividualLikelihood:
        """With few nodes, on the surfaces of an answer."""
        return self.likelihood(surfaced.settled.likelihood.predictor)

    def _ended(self, surfaced: Surfaced) -> Surfaced:
        """Run and climb from an answer until neither moves it."""
        while True:
            surfaced = self._refined(surfaced)
            before = surfaced.settled
            likelihood = self.likelihood_of(surfaced)
            found = self.search(likelihood, [before.alpha])
            found = replace(found, once=surfaced.found.once)
            again = settled(likelihood, found.alpha, ROUGHLY)
            if again.value < before.value + CHANGE:
                with self.ledger.stage("search"):
                    return replace(surfaced, settled=settled(likelihood, before.alpha), found=found)
            surfaced = replace(surfaced, settled=again, found=found)

    def _first(self, begun: Begun) -> Surfaced:
        surfaces, region, sites = begun.surfaces, begun.region, begun.sites
        likelihood = self.likelihood(OnSurfaces(surfaces.surface(), region, sites.of))
        found = self.search(likelihood, [])
        return Surfaced(settled(likelihood, found.alpha, ROUGHLY), found, surfaces, region, sites)

    def _refined(self, surfaced: Surfaced, known: Sequence[Array] = ()) -> Surfaced:
        """Run where the laws are, and climb, until nothing moves, or one comes to what is known."""
        level = LOOSE
        for _ in range(ROUNDS):
            inference = _infer(surfaced.settled)
            if _among(surfaced.settled, inference, known):
                break
            with self.ledger.stage(SURFACE):
                moved = self._sharpened(surfaced, inference, level)
            likelihood = self.likelihood(
                OnSurfaces(moved.surfaces.surface(), moved.region, moved.sites.of)
            )
            with self.ledger.stage("search"):
                # the nodes of the last round will do again
                likelihood = replace(likelihood, rule=surfaced.settled.likelihood.rule)
                after = settled(likelihood, surfaced.settled.alpha, ROUGHLY)
            calm = _calm(surfaced.settled, after, inference)
            surfaced = replace(moved, settled=after)
            if calm and level <= TIGHT:
                break
            level = max(0.5 * level, FINEST)
        return surfaced

    def _sharpened(self, surfaced: Surfaced, inference: Inference, level: float) -> Surfaced:
        """Runs for all sites whose error is above `level` of the noise, where the laws lie."""
        likelihood, alpha = surfaced.settled.likelihood, surfaced.settled.alpha
        inputs, surfaces, region = likelihood.inputs, surfaced.surfaces, surfaced.region
        likely = likely_alphas(alpha, inference, likelihood.hyperparameters)

        def inside(alphas: Sequence[Array], wide: float = 1.0) -> Array:
            x = np.clip(draws(inputs, alphas, likelihood.count, wide), *region.T)
            return x[:, moving_parameters(region)]

        surfaces.against(_noise(surfaced))
        surfaces.judge(inside([alpha]))
        if not self.runner.account.refused:
            region = _next_region(surfaced, likely, narrower=bool(surfaces.wanting(level).any()))
        if region is not surfaced.region:
            surfaces.move(region[moving_parameters(region)])
            surfaces.judge(inside([alpha]))
        fresh = inside([*likely], WIDER)
        for _ in range(ROUNDS):
            members = surfaced.sites.together(surfaces.wanting(level))
            if not members.any():
                break
            surfaces.sharpen(members, fresh)
        return replace(surfaced, region=region)


def _next_region(surfaced: Surfaced, likely: Array, *, narrower: bool) -> Array:
    """One that holds the laws of all that alpha may be, if that is better than the present one.

    A narrower one only where surfaces would be better there.
    """
    likelihood, alpha = surfaced.settled.likelihood, surfaced.settled.alpha
    inputs, region = likelihood.inputs, surfaced.region
    certain = held_region(inputs, [alpha], likelihood.count, FAR)
    possible = held_region(inputs, [*likely], likelihood.count, LIKELY)
    wanted = around(hull(certain, possible), inputs.box)
    moving = moving_parameters(region)
    width = np.diff(region, axis=1)[moving, 0]
    slack = 0.02 * np.diff(region, axis=1)[:, 0]
    beyond = (certain[:, 0] < region[:, 0] - slack) | (certain[:, 1] > region[:, 1] + slack)
    beyond &= np.diff(inputs.box, axis=1)[:, 0] > 0.0
    if np.any(beyond & ~_at_ends(region, inputs.box, certain)):
        reach = np.diff(region, axis=1) * np.array([-1.0, 1.0])
        return np.clip(wanted, region[:, :1] + reach[:, :1], region[:, 1:] + reach[:, 1:])
    share = np.prod(np.diff(wanted, axis=1)[moving, 0] / width)
    return wanted if narrower and share < SHRINK else region


def _at_ends(region: Array, box: Array, certain: Array) -> Flags:
    """Which parameters reach out of the region only where the box ends too."""
    low = (certain[:, 0] >= region[:, 0]) | (region[:, 0] <= box[:, 0])
    high = (certain[:, 1] <= region[:, 1]) | (region[:, 1] >= box[:, 1])
    return np.asarray(low & high)


def _noise(surfaced: Surfaced) -> Array:
    """The smallest scale (U,) of the measurement error at each site."""
    likelihood, alpha = surfaced.settled.likelihood, surfaced.settled.alpha
    least = np.full(len(surfaced.sites), np.inf)
    of_errors = alpha[likelihood.inputs.size :]
    for block in likelihood.blocks:
        eta = likelihood.at(alpha, block, likelihood.nodes.mode[block.experiments]).eta
        scale = likelihood.errors.scale(of_errors, eta, block.rows).min(axis=1)
        np.minimum.at(least, surfaced.sites.of[block.rows], scale)
    # a site of observations that are left out is compared with nothing
    return np.where(np.isfinite(least), least, 1.0)


def _among(answer: Settled, inference: Inference, known: Sequence[Array]) -> bool:
    return any(near(answer.alpha, alpha, inference) for alpha in known)


def _infer(answer: Settled) -> Inference:
    return infer(answer.likelihood.followed, answer.alpha, answer.likelihood.hyperparameters)


def _calm(before: Settled, after: Settled, inference: Inference) -> bool:
    """Whether neither alpha nor the log-likelihood has moved."""
    step = (after.alpha - before.alpha)[inference.identified]
    length = float(step @ inference.information @ step)
    change = abs(after.value - before.value)
    return length < STILL**2 and change < max(CHANGE, 1e-4 * after.likelihood.count)
