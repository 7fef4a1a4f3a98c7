"""Maximize the likelihood until neither more quadrature nodes nor more simulator runs move alpha.

The search is made on the simulator itself or on coarse response surfaces. With surfaces, runs are
then made where the identified laws lie, and the likelihood is maximized again, until alpha stays.
All runs are kept. Where polynomials are made, only runs of this identification decide where the
next one is made, so that earlier runs in a store do not change the result. Gaussian processes begin
with earlier runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.fit import outcome_range
from aleator.fit.emulate import Emulation
from aleator.fit.ledger import SEARCH, SURFACE, Ledger
from aleator.fit.quadrature import (
    NODE_ACCURACY,
    AnyLikelihood,
    Highest,
    Maximum,
    highest_maximum,
    with_enough_nodes,
    with_other_optima,
)
from aleator.fit.question import (
    Question,
    failing_observations,
    start_point,
    way_of,
    way_of_outcomes,
)
from aleator.fit.regions import (
    REGIONS,
    draws,
    first_region,
    hull,
    interval_alphas,
    next_region,
    padded,
    plausible_alphas,
    reaching_out,
    region_of,
)
from aleator.fit.search import searched
from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile
from aleator.likelihood.individual import Direct, IndividualLikelihood, OnSurfaces
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Forward, forward, surface_progress
from aleator.search import SearchResult
from aleator.search.interface import OPTIMA
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import AdaptiveSurfaces, surfaces_of
from aleator.surrogates.adaptive import within
from aleator.surrogates.choice import by_process
from aleator.surrogates.samples import Sites


@dataclass(frozen=True)
class Rounds:
    """Settings for the accuracy of response surfaces; the values are chosen by `make judges`.

    Errors of surfaces are relative to the noise, or without noise to the scatter of the outcome
    under the law. The first surfaces have an error of at most `begin` in their whole region. Each
    round then makes up to `together` batches of runs where the laws lie, until the error there is
    below a level. The level begins at `first` and is halved in later rounds, down to `finest`.

    The rounds end at a level of `last` or less, if alpha moves by less than `still` standard errors
    and the log-likelihood by less than `change`, or by `each` for each experiment if that is more.
    At most `most` rounds are made. Runs are drawn from laws `wide` times as wide as the identified
    ones. At the ends of the profile intervals an error of `ends` is admitted, and after `at_ends`
    rounds any error.

    Besides the best optimum of the first surfaces, up to `others` are refined too, if they lie
    `apart` standard errors from each other. A region is narrowed only to less than the share
    `shrink` of its volume. Under a given law the surfaces have an error of at most `fixed_law`.
    """

    begin: float
    first: float
    last: float
    together: int
    change: float
    each: float
    still: float = 0.1
    finest: float = 1e-3
    wide: float = 1.2
    ends: float = 0.1
    at_ends: int = 3
    others: int = 2
    apart: float = 2.0
    shrink: float = 0.8
    fixed_law: float = 0.02
    most: int = 24


WITH_NOISE = Rounds(
    begin=0.1, first=0.2, last=0.0125, together=16, change=0.01, each=1e-4, shrink=0.6
)
EXACT = Rounds(begin=np.inf, first=0.05, last=0.025, together=1, change=0.2, each=1e-3)


@dataclass(frozen=True, eq=False)
class Refined:
    """A maximum, the search that led to it, and the response surfaces that it rests on.

    `question` leaves out observations whose runs all fail. `surfaces` is None where the simulator
    itself was integrated over. `sites` are the distinct outputs that have a surface each, on the
    `region` (n, 2) of the parameters. `others` are lower maxima with surfaces refined for them.
    `possible` are optima (K,) of the search whose log-likelihood is less than 1.92 below the
    maximum. If `spread` is true, the region contains the laws at the ends of the profile intervals
    and is not narrowed. `reason` says why there are surfaces, or none.
    `emulation` has the Gaussian processes, if the likelihood was maximized on them.
    """

    question: Question
    maximum: Maximum
    search_result: SearchResult
    region: Array
    reason: str
    surfaces: AdaptiveSurfaces | None = None
    sites: Sites | None = None
    others: tuple[Maximum, ...] = ()
    possible: tuple[Array, ...] = ()
    spread: bool = False
    emulation: Emulation | None = None

    @property
    def likelihood(self) -> AnyLikelihood:
        """The likelihood, with quadrature nodes adapted to the maximum."""
        return self.maximum.likelihood

    @property
    def alpha(self) -> Array:
        """The values alpha (K,) of the hyperparameters at the maximum."""
        return self.maximum.alpha

    @property
    def direct(self) -> bool:
        """Whether the likelihood used the simulator itself."""
        return self.surfaces is None and self.emulation is None

    @classmethod
    def emulated(cls, emulation: Emulation, top: Highest) -> Refined:
        """The maximum on Gaussian processes."""
        return cls(
            emulation.question, top.maximum, top.search_result, emulation.region,
            emulation.reason, possible=top.others, emulation=emulation,
        )  # fmt: skip


def refined(question: Question, ledger: Ledger) -> Refined:
    """The maximum of the likelihood that more nodes and more runs of the simulator do not move."""
    choices, runner, inputs = question.choices, question.runner, question.inputs
    region = first_region(inputs, choices.hyperparameters, len(question.ids))
    if question.exact:
        way = way_of_outcomes(runner, choices.model)
        direct = way.direct or choices.model.surfaces is None
    else:
        assert choices.surfaces is not None
        way = way_of(runner, choices.surfaces, start_point(inputs), region)
        direct = way.direct
    if direct:
        return _on_simulator(question, region, way.reason, ledger)
    choice = question.choices.surfaces
    moments = question.choices.density is not None
    if choice is not None and by_process(choice, moments):
        emulation = Emulation(question, ledger, region, way.reason)
        return Refined.emulated(emulation, emulation.answer())
    return Refinement(question, ledger).answer(region, way.reason)


def spread(answer: Refined, profile: Profile, ledger: Ledger) -> Refined | None:
    """The maximum on surfaces that are also accurate at the ends of the profile intervals.

    None where the present surfaces are accurate enough there, or where there are none.
    """
    if answer.emulation is not None:
        top = answer.emulation.spread(answer.maximum, answer.search_result, profile)
        return None if top is None else Refined.emulated(answer.emulation, top)
    if answer.surfaces is None:
        return None
    return Refinement(answer.question, ledger).spread(answer, profile)


def _on_simulator(question: Question, region: Array, reason: str, ledger: Ledger) -> Refined:
    """The maximum with the simulator itself, where only the quadrature nodes are refined."""
    runner, inputs = question.runner, question.inputs
    likelihood: AnyLikelihood
    if question.exact:
        with ledger.stage("preparation"):
            likelihood = outcome_range.on_simulator(question, ledger.progress)
    else:
        lost = failing_observations(runner, region, question.unit, question.column)
        question = question.without(lost)
        likelihood = question.integral(Direct(runner, moving_parameters(inputs.box), inputs.box))
    try:
        found = searched(question, likelihood, [], ledger)
    except InputsError:
        runner.require_some_outcome()
        raise
    with ledger.stage(SEARCH):
        top = highest_maximum(with_enough_nodes(likelihood, found.alpha), found)
    return Refined(
        question, top.maximum, top.search_result, likelihood.region, reason, possible=top.others
    )


@dataclass(frozen=True, eq=False)
class Refinement:
    """The refinement of response surfaces, and of the maximum on them, by further runs."""

    question: Question
    ledger: Ledger

    @property
    def rounds(self) -> Rounds:
        """The settings for the accuracy of surfaces: without noise `EXACT`, else `WITH_NOISE`."""
        return EXACT if self.question.exact else WITH_NOISE

    def answer(self, region: Array, reason: str) -> Refined:
        """Refine surfaces for each of the best optima, and return the highest maximum.

        The first surfaces are too coarse to decide which optimum is the highest. Each refinement
        starts from a copy of them, and ends when further runs do not change the maximum.
        """
        first = self._first(region, reason)
        others = self._elsewhere(first)
        again = [deepcopy(first.surfaces) for _ in others]
        ends = [self._finished(self._ended(first))]
        for alpha, surfaces in zip(others, again, strict=True):
            with self.ledger.stage(SEARCH):
                start = with_enough_nodes(self._likelihood(first), alpha, NODE_ACCURACY.rough)
            known = [end.maximum.alpha for end in ends]
            follow = self._refined(replace(first, maximum=start, surfaces=surfaces), known)
            end = follow.maximum
            if not _infer(end).among(end.alpha, known, self.rounds.apart):
                ends.append(self._finished(self._ended(follow)))
        best, *lower = sorted(ends, key=lambda end: -end.maximum.value)
        return replace(best, others=tuple(end.maximum for end in lower))

    def spread(self, answer: Refined, profile: Profile) -> Refined | None:
        """The maximum on surfaces that are also accurate at the ends of the profile intervals.

        None where the present surfaces are accurate enough there.
        """
        surfaces, likelihood, alpha = answer.surfaces, answer.likelihood, answer.alpha
        assert surfaces is not None
        inputs, ends = likelihood.inputs, interval_alphas(profile)
        if not ends:
            return None
        wanted = region_of(inputs, ends, likelihood.count, REGIONS.plausible)
        wider = bool(reaching_out(answer.region, inputs.box, wanted).any())
        region = hull(answer.region, padded(wanted, inputs.box)) if wider else answer.region
        points = np.concatenate([self._draws(likelihood, [one], region) for one in (alpha, *ends)])
        with self.ledger.stage(SURFACE):
            if wider:
                surfaces.move(region[moving_parameters(region)])
            before = surfaces.total_runs
            for _ in range(self.rounds.at_ends):
                surfaces.judge(points)
                rough = surfaces.unfinished(self.rounds.ends)
                surfaces.judge(self._draws(likelihood, [alpha], region))
                here = surfaces.unfinished(self.rounds.first)
                members = self._together(answer, rough | here)
                if not members.any():
                    break
                surfaces.sharpen(members, points)
            if not wider and surfaces.total_runs == before:
                return None
            moved = self._on(replace(answer, region=region, spread=answer.spread or wider))
        return self._finished(moved)

    def sharpened(self, answer: Refined, draws_of: dict[int, Array]) -> Refined:
        """The maximum after new runs for some outputs, made at the points given for each.

        `draws_of` has candidate points (D, moving) by the index of the output.
        """
        surfaces = answer.surfaces
        assert surfaces is not None
        with self.ledger.stage(SURFACE):
            surfaces.sharpen_each(draws_of)
            moved = self._on(answer)
        found = searched(self.question, moved.maximum.likelihood, [answer.alpha], self.ledger)
        start = with_enough_nodes(moved.maximum.likelihood, found.alpha, NODE_ACCURACY.rough)
        found = replace(found, once=answer.search_result.once and found.once)
        return self._finished(replace(moved, maximum=start, search_result=found))

    def _first(self, region: Array, reason: str) -> Refined:
        """The first surfaces, coarse or to the user's tolerance, and the best optimum on them."""
        question, runner = self.question, self.question.runner
        choice = question.choices.surfaces
        assert choice is not None
        with self.ledger.stage(SURFACE):
            sites = Sites.seen(runner, question.unit, question.column)
            surfaces = AdaptiveSurfaces(
                sites.run(runner, region), region[moving_parameters(region)], len(sites), choice,
                within(runner.account, sites.unit),
            )  # fmt: skip
            if choice.tolerance is None and np.isfinite(self.rounds.begin):
                tell = surface_progress(self.ledger.progress)
                surfaces.refine(surfaces.everywhere(), self.rounds.begin, tell)
            if not question.exact:
                lost = np.isinf(surfaces.emulator.error)[sites.of]
                question, sites = question.without(lost), replace(sites, of=sites.of[~lost])
            likelihood, region = self._made(question, surfaces, region, sites)
        found = searched(question, likelihood, [], self.ledger)
        with self.ledger.stage(SEARCH):
            start = with_enough_nodes(likelihood, found.alpha, NODE_ACCURACY.rough)
        return Refined(question, start, found, region, reason, surfaces, sites)

    def _made(
        self, question: Question, surfaces: AdaptiveSurfaces, region: Array, sites: Sites
    ) -> tuple[AnyLikelihood, Array]:
        """The likelihood on the present surfaces, and the region (n, 2) of the surfaces.

        If the user set a tolerance, the surfaces are first refined to it.
        """
        progress = self.ledger.progress
        if surfaces.choice.tolerance is not None:
            surfaces.judge(None)
            surfaces.refine(None, surfaces.level, surface_progress(progress))
        if question.exact:
            problem = outcome_range.on_surfaces(question, surfaces, region, progress)
            return problem, problem.region
        return question.integral(OnSurfaces(surfaces.surface(), region, sites.of)), region

    def _on(self, answer: Refined) -> Refined:
        assert answer.surfaces is not None
        assert answer.sites is not None
        made, region = self._made(answer.question, answer.surfaces, answer.region, answer.sites)
        before = answer.likelihood
        if isinstance(made, IndividualLikelihood) and isinstance(before, IndividualLikelihood):
            # Begin with as many nodes as the last round needed.
            made = replace(made, rule=before.rule)
        return replace(answer, maximum=replace(answer.maximum, likelihood=made), region=region)

    def _likelihood(self, answer: Refined) -> AnyLikelihood:
        """The likelihood with few quadrature nodes, on the surfaces of a maximum."""
        likelihood = answer.likelihood
        if isinstance(likelihood, IndividualLikelihood):
            return answer.question.integral(likelihood.predictor)
        return likelihood

    def _ended(self, answer: Refined) -> Refined:
        """Refine surfaces and maximum until they stay, and a new search finds no higher one."""
        while True:
            answer = self._refined(answer)
            before, likelihood = answer.maximum, self._likelihood(answer)
            found = searched(answer.question, likelihood, [before.alpha], self.ledger)
            with self.ledger.stage(SEARCH):
                again = with_enough_nodes(likelihood, found.alpha, NODE_ACCURACY.rough)
            if again.value < before.value + OPTIMA.same_value:
                once = answer.search_result.once and found.once
                return replace(answer, search_result=replace(found, once=once))
            answer = replace(answer, maximum=again, search_result=found)

    def _finished(self, answer: Refined) -> Refined:
        """The maximum with as many quadrature nodes as it needs, on the present surfaces."""
        with self.ledger.stage(SEARCH):
            end = with_enough_nodes(self._likelihood(answer), answer.alpha)
            top = with_other_optima(end, answer.search_result)
        return replace(
            answer, maximum=top.maximum, search_result=top.search_result, possible=top.others
        )

    def _refined(self, answer: Refined, known: Sequence[Array] = ()) -> Refined:
        """Make runs where the laws lie and maximize again, until alpha and log-likelihood stay.

        It also ends where alpha comes close to one of the `known` maxima (K,).
        """
        rounds, surfaces = self.rounds, answer.surfaces
        assert surfaces is not None
        level, calm = rounds.first, False
        for _ in range(rounds.most):
            inference = _infer(answer.maximum)
            if inference.among(answer.alpha, known, rounds.apart):
                break
            with self.ledger.stage(SURFACE):
                moved, done = self._sharpened(answer, inference, level)
            with self.ledger.stage(SEARCH):
                after = with_enough_nodes(
                    moved.maximum.likelihood, answer.alpha, NODE_ACCURACY.rough
                )
            calm = self._calm(answer.maximum, after, inference)
            answer = replace(moved, maximum=after)
            if calm and level <= rounds.last:
                break
            if calm or done:
                level = max(0.5 * level, rounds.finest)
        return answer

    def _sharpened(
        self, answer: Refined, inference: Inference, level: float
    ) -> tuple[Refined, bool]:
        """Refine all surfaces whose error exceeds a level; the bool says whether none is left."""
        likelihood, alpha, surfaces = answer.likelihood, answer.alpha, answer.surfaces
        assert surfaces is not None
        likely = plausible_alphas(alpha, inference, likelihood.hyperparameters)
        region = answer.region
        if isinstance(likelihood, IndividualLikelihood):
            assert answer.sites is not None
            surfaces.against(_noise(likelihood, alpha, answer.sites))
        surfaces.judge(self._draws(likelihood, [alpha], region))
        if not (answer.spread or self.question.runner.account.refused):
            narrower = bool(np.any(surfaces.relative > level))
            region = next_region(
                likelihood.inputs, region, alpha, likely, likelihood.count,
                self.rounds.shrink if narrower else 0.0,
            )  # fmt: skip
        if region is not answer.region:
            surfaces.move(region[moving_parameters(region)])
            surfaces.judge(self._draws(likelihood, [alpha], region))
        fresh = self._draws(likelihood, [*likely], region, self.rounds.wide)
        for _ in range(self.rounds.together):
            members = self._together(answer, surfaces.unfinished(level))
            if not members.any():
                break
            surfaces.sharpen(members, fresh)
        done = not surfaces.unfinished(level).any()
        if tell := surface_progress(self.ledger.progress):
            tell(surfaces.total_runs, int(surfaces.good.sum()), surfaces.good.size)
        return self._on(replace(answer, region=region)), done

    def _draws(
        self, likelihood: AnyLikelihood, alphas: Sequence[Array], region: Array, wide: float = 1.0
    ) -> Array:
        x = np.clip(draws(likelihood.inputs, alphas, likelihood.count, wide), *region.T)
        return x[:, moving_parameters(region)]

    def _together(self, answer: Refined, members: Flags) -> Flags:
        """The selected outputs, and all others that the same simulator runs give."""
        assert answer.sites is not None
        return answer.sites.together(members)

    def _elsewhere(self, first: Refined) -> list[Array]:
        """Other optima (K,) of the first search that may be the highest on accurate surfaces.

        They lie apart from each other, and no location hyperparameter, such as a mean, is on its
        limit. Their log-likelihood is lower than that of the best by at most one for each
        observation: that is what a noise e times larger costs.
        """
        found, likelihood = first.search_result, first.maximum.likelihood
        inference = _infer(first.maximum)
        limits = np.array(
            [(h.lower, h.upper) if h.free and not h.log else (-np.inf, np.inf)
             for h in likelihood.hyperparameters]
        )  # fmt: skip
        known, size = [found.alpha], first.question.measured.size
        for optimum in found.optima[1:]:
            alpha = optimum.alpha
            if (
                len(known) <= self.rounds.others
                and np.all((limits[:, 0] < alpha) & (alpha < limits[:, 1]))
                and found.log_likelihood - optimum.log_likelihood < size
                and not inference.among(alpha, known, self.rounds.apart)
            ):
                known.append(alpha)
        return known[1:]

    def _calm(self, before: Maximum, after: Maximum, inference: Inference) -> bool:
        """Whether alpha and the log-likelihood have changed so little that the rounds may end."""
        step = (after.alpha - before.alpha)[inference.identified]
        length = float(step @ inference.information @ step)
        change = abs(after.value - before.value)
        none = max(self.rounds.change, self.rounds.each * after.likelihood.count)
        return length < self.rounds.still**2 and change < none


def under_law(
    runner: Runner, model: Model, alpha: Array, progress: Progress | None = None
) -> Forward:
    """The distribution of the outcomes under a given law alpha (K,), without an identification.

    If the user set a tolerance, response surfaces are refined to it in the whole region of the
    law. Otherwise they are refined where the law has its mass (see `Rounds`).
    """
    inputs, choice = model.inputs, model.surfaces
    region = padded(region_of(inputs, [alpha], 1, REGIONS.far), inputs.box)
    if choice is None:
        return forward(runner, model, region, progress)
    surfaces = surfaces_of(runner, region, choice)
    if choice.tolerance is not None:
        surfaces.refine(None, surfaces.level, surface_progress(progress))
    else:
        moving = moving_parameters(region)
        surfaces.judge(np.clip(draws(inputs, [alpha], 1), *region.T)[:, moving])
        wide = np.clip(draws(inputs, [alpha], 1, EXACT.wide), *region.T)[:, moving]
        surfaces.refine(wide, EXACT.fixed_law, surface_progress(progress))
    return forward(runner, model, region, progress, surfaces.surface())


def _noise(likelihood: IndividualLikelihood, alpha: Array, sites: Sites) -> Array:
    """The smallest scale (U,) of the measurement error of each output (if normal, its sd)."""
    least = np.full(len(sites), np.inf)
    of_errors = alpha[likelihood.inputs.size :]
    for block in likelihood.blocks:
        eta = likelihood.at(alpha, block, likelihood.nodes.mode[block.experiments]).eta
        scale = likelihood.errors.scale(of_errors, eta, block.rows).min(axis=1)
        np.minimum.at(least, sites.of[block.rows], scale)
    # An output all of whose observations are left out has no noise to compare with.
    return np.where(np.isfinite(least), least, 1.0)


def _infer(answer: Maximum) -> Inference:
    likelihood = answer.likelihood
    return infer(likelihood.followed, answer.alpha, likelihood.hyperparameters)
