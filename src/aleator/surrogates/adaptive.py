"""The one loop that makes surfaces exact: judge them, run the experiments that are too rough.

Two rules place the runs. With a tolerance they are spread evenly over the region, and errors are
judged all over it. Without one they are placed where a law has its mass, and errors are judged at
draws of that law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import KDTree
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.simulators import Account, Runner
from aleator.simulators.response_functions import Run, attempts, moving_parameters
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.emulator import Emulator, OwnSurfaces, pairs
from aleator.surrogates.fit import PLACES, PlacementSettings
from aleator.surrogates.samples import FEATURES, Samples, features
from aleator.surrogates.shared import SharedSurface
from aleator.surrogates.surface import Axes, Surface

Afforded = Callable[[Flags, Array, Array], Flags]
"""From members (N,), their relative errors (N,) and the runs (N,) of a round: those who may have
it."""


@dataclass(frozen=True)
class RoundSettings:
    """Rounds of runs that make surfaces exact; by judgement."""

    reserved: int = 2
    """Runs of each unit that a budget keeps for the check of the answer."""
    exact: float = 0.005
    """The tolerance of surfaces without a law to follow, where none is chosen."""
    rough: float = 0.05
    """Estimated error of a surface under the law, over the outcome's scatter, that calls for runs.
    """
    shared: float = 2.0
    """Level `rough` of a shared surface over that of others: its estimate is more cautious."""
    growth: float = 0.3
    """Share by which a round increases the runs of the experiments that need more."""
    patience: int = 6
    """Rounds of its own after which an experiment is given up whose error falls by less than a
    fifth: its runs have then grown fivefold, so that what is left is the simulator's own noise, or
    a jump."""
    stall: float = 0.8
    """Error after these rounds, over that before, above which an experiment is given up."""
    alike: float = 0.01
    """The error of the first runs of linear surfaces, over the scatter, that no experiment may be
    above if these are to be enough: one feature that they miss is met by those of another."""
    confirmed: int = 5
    """Experiments that confirm each other's linear surfaces, at least."""
    lost: int = 2
    """Rounds for experiments of which too many runs failed for a surface."""
    first_exact: tuple[int, int] = (5, 10)
    """First runs for each parameter, and beside these, where surfaces are to be exact all over the
    box."""
    first_law: tuple[int, int] = (3, 6)
    """First runs for each parameter, and beside these, of surfaces that will follow a law."""
    beyond_linear: int = 2
    """Runs more than the terms of a linear surface, that are enough for one."""
    slowest: float = 0.5
    """The least power of the number of runs by which errors are taken to fall."""
    fastest: float = 6.0
    """The largest power of the number of runs by which errors are taken to fall."""


ROUNDS = RoundSettings()


def everyone(members: Flags, _relative: Array, _runs: Array) -> Flags:
    """All members: there is no budget."""
    return members


def within(account: Account, unit: Indices, settings: RoundSettings = ROUNDS) -> Afforded:
    """The roughest, as many as the account has runs for; `unit` (N,) are those that run together.

    One run of a unit serves all its surfaces: its price is that of the dearest.
    """
    units, of = np.unique(unit, return_inverse=True)

    def afforded(members: Flags, relative: Array, runs: Array) -> Flags:
        price, need = np.zeros((2, units.size))
        np.maximum.at(price, of[members], runs[members])
        np.maximum.at(need, of[members], relative[members])
        asked = int(price.sum())
        given = account.granted(asked, settings.reserved * units.size)
        if given == asked:
            return members
        order = np.argsort(-need, kind="stable")
        chosen = np.zeros(units.size, dtype=np.bool_)
        chosen[order[np.cumsum(price[order]) <= given]] = True
        return np.asarray(members & chosen[of])

    return afforded


@dataclass(frozen=True)
class JumpSettings:
    """When two runs show that an outcome jumps; by judgement."""

    near: float = 0.1
    """Distance of two runs, over the widths of the region, to which an outcome is looked at."""
    large: float = 0.05
    """Difference of two outcomes, over the range of all of that experiment, that may be a step."""
    close: float = 0.4
    """Share of `near` within which two runs are close."""
    wide: float = 0.8
    """Share of `near` beyond which two runs are wide apart."""
    ratio: float = 1.5
    """How many times as much a smooth outcome differs over the wider distance, at least."""
    bulk: tuple[float, float] = (0.005, 0.995)
    """Probabilities between which a law is looked at for steps."""
    runs: int = 150
    """Runs of its own after which an experiment is given up whose outcome has a step (`steps`)."""


JUMPS = JumpSettings()


@dataclass(frozen=True)
class Jump:
    """The largest difference `size` of two outcomes of `surface` at points (n,) near each other."""

    surface: int
    size: float
    here: Array
    there: Array


def steps(
    samples: Samples, box: Array, members: Indices, settings: JumpSettings = JUMPS
) -> tuple[Jump, ...]:
    """The step of each surface among `members` (A,) that has one, by its runs in the box (n, 2).

    Between runs that are close a smooth outcome differs by less than between those wide apart. One
    that jumps differs as much; so does a front as steep as that. Cost: all pairs of near points,
    for each member.

    >>> x = np.linspace(0.0, 1.0, 201)[:, None]
    >>> made = Samples(x, np.stack([x[:, 0] > 0.5, x[:, 0]]).astype(float), np.ones((2, 201), bool))
    >>> [(step.surface, step.size, step.here.round(3).tolist(), step.there.round(3).tolist())
    ...  for step in steps(made, np.array([[0.0, 1.0]]), np.arange(2))]
    [(0, 1.0, [0.5], [0.505])]
    """
    inside = samples.inside(box)
    z = Axes.plain(box).inward(inside.x)
    pairs = KDTree(z).query_pairs(settings.near, output_type="ndarray")
    distance = np.linalg.norm(z[pairs[:, 0]] - z[pairs[:, 1]], axis=1)
    order = np.argsort(distance)
    pairs, distance = pairs[order], distance[order]
    close, wide = (
        pairs[distance < settings.close * settings.near],
        pairs[distance > settings.wide * settings.near],
    )
    found = (_step(int(member), inside, close, wide, settings) for member in members)
    return tuple(step for step in found if step is not None)


def _step(
    member: int, samples: Samples, close: Indices, wide: Indices, settings: JumpSettings = JUMPS
) -> Jump | None:
    """The step of one surface between close points, pairs (P, 2) with the closest first."""
    y = samples.outcome[member]
    known = np.isfinite(y)
    if not known.any():
        return None
    most = np.zeros(y.size)
    apart = np.nan_to_num(np.abs(y[wide[:, 0]] - y[wide[:, 1]]))
    for end in wide.T:
        np.maximum.at(most, end, apart)
    size = np.abs(y[close[:, 0]] - y[close[:, 1]])
    beyond = np.maximum(most[close[:, 0]], most[close[:, 1]])
    large = size > settings.large * np.ptp(y[known])
    rows = np.flatnonzero(large & (beyond > 0.0) & (beyond < settings.ratio * size))
    if not rows.size:
        return None
    low, high = sorted(close[rows[0]], key=lambda i: tuple(samples.x[i]))
    return Jump(member, abs(float(y[high] - y[low])), samples.x[low], samples.x[high])


Progress = Callable[[int, int, int], None]


class AdaptiveSurfaces:
    """The surfaces of N experiments, their runs, and how well each round of runs did.

    `run(index (R,), x (R, n)) -> (R,)` gives NaN where a run failed; `box` (n, 2) is the region
    that the surfaces cover; `conditions` (N, d) are what experiments may share a surface by, or
    None. `where` (J, n) are the points at which the errors were judged last, or None for all of the
    box. `scale` (N,) takes the place of the scatter where there is one. `past` (P, N) are the
    relative errors before the last P rounds of each experiment: one that no longer falls is given
    up. `afforded` chooses who has a round of runs where a budget does not suffice for all.

    Raises InputsError where `max_runs` is less than the first round, or the user asks for a shared
    surface and there is nothing to share by.
    """

    def __init__(
        self,
        run: Run,
        box: Array,
        experiments: int,
        choice: ResponseSurface,
        conditions: Array | None = None,
        afforded: Afforded = everyone,
        settings: RoundSettings = ROUNDS,
        jumps: JumpSettings = JUMPS,
    ) -> None:
        self.choice, self.afforded, self.settings, self.jumps = choice, afforded, settings, jumps
        self.where = None if choice.tolerance else _points_of(box)
        self.scale: Array | None = None
        self.past = np.full((self.settings.patience, experiments), np.inf)
        self.emulator = _first_emulator(run, box, experiments, choice, conditions, settings)
        self._begin()
        self._complete()

    @property
    def box(self) -> Array:
        """The region that the surfaces cover, (n, 2)."""
        return self.emulator.box

    @property
    def total_runs(self) -> int:
        """Runs of all experiments together."""
        return int(self.emulator.runs.sum())

    @property
    def level(self) -> float:
        """Estimated error over the scatter that makes a surface one that is exact enough."""
        if self.choice.tolerance:
            return self.choice.tolerance
        return self.settings.rough * self.caution

    @property
    def caution(self) -> float:
        """By how much estimated errors of a shared surface are larger than those of a surface for
        each."""
        return self.settings.shared if isinstance(self.emulator, SharedSurface) else 1.0

    @property
    def good(self) -> Flags:
        """Whose surface is exact enough, (N,)."""
        return ~self.emulator.rough(self.level, self.choice.accuracy)

    @property
    def relative(self) -> Array:
        """Estimated errors over the scatter, (N,)."""
        scatter = self.emulator.scatter
        return np.asarray(self.emulator.error / np.where(scatter > 0.0, scatter, 1.0))

    def everywhere(self) -> Array | None:
        """Points of the whole box for `judge` and `sharpen`; None where a tolerance holds there."""
        return None if self.choice.tolerance else _points_of(self.box)

    def move(self, box: Array) -> None:
        """Take the surfaces to another box; the runs inside serve there too."""
        self.emulator.move(box)
        self.past[:] = np.inf
        self._complete()

    def add(self, x: Array) -> None:
        """Runs of all experiments at points x (Q, n) of the box, which the surfaces go through."""
        self.emulator.run_at(x, *pairs(np.arange(self.good.size), len(x)))
        self.move(self.box)

    def judge(self, where: Array | None) -> None:
        """Estimate the errors at points (J, n) of a law, or over the box."""
        self.where = where
        self._judge_again()

    def against(self, scale: Array) -> None:
        """Compare errors with a scale (N,) from now on, and not with the outcome's scatter."""
        self.scale = scale

    def unfinished(self, level: float) -> Flags:
        """Whose error is above `level` of its scatter, where more runs may help and may be made."""
        return self.granted(self._rough(level))

    def granted(self, members: Flags) -> Flags:
        """Of the members (N,) those that may have a round of runs, and where it may help."""
        members = members & ~self._spent
        for step in self._lasting(members):
            members[step.surface] = False
        runs = np.full(
            members.size, self.emulator.round(np.flatnonzero(members), self.settings.growth)
        )
        return self.afforded(members, self.relative, runs)

    def sharpen(self, members: Flags, draws: Array | None) -> None:
        """A round of runs for the members (N,): where draws (D, n) lie, or all over the box."""
        self._remember(members)
        self._run(members, draws)

    def sharpen_each(self, draws: Mapping[int, Array]) -> None:
        """A round of runs for some surfaces, each where its own draws (D, n) lie."""
        members = np.isin(np.arange(self.good.size), [*draws])
        self._remember(members)
        for surface, own in draws.items():
            self.emulator.sharpen(
                np.array([surface]), own, self.settings.growth, self.choice.max_runs
            )
        self._judge_again()

    def refine(self, draws: Array | None, level: float, progress: Progress | None = None) -> None:
        """Rounds of runs until no experiment needs more, judged where they were judged last."""
        while True:
            if progress:
                progress(self.total_runs, int(self.good.sum()), self.good.size)
            members = self.unfinished(level)
            if not members.any():
                return
            self.sharpen(members, draws)

    def surface(self) -> Surface:
        """The surfaces as they are, with the errors that were judged last."""
        return self.emulator.surface(self.good)

    def _rough(self, level: float) -> Flags:
        """Whose error is above `level` of its scatter, where more runs may help."""
        lost = np.isinf(self.emulator.error)
        stalled = self.relative > self.settings.stall * self.past[0]
        rough = self.emulator.rough(level, self.choice.accuracy)
        return np.asarray(rough & ~lost & ~stalled)

    @property
    def stepped(self) -> Flags:
        """Experiments (N,) that are given up because their outcome has a step."""
        found = np.zeros(self.good.size, dtype=np.bool_)
        for step in self._lasting(~self.good):
            found[step.surface] = True
        return found

    @property
    def broken(self) -> bool:
        """Whether there are such experiments."""
        return bool(self.stepped.any())

    def _lasting(self, members: Flags) -> tuple[Jump, ...]:
        """Steps that many runs have left in the surfaces of members (N,)."""
        return self.steps(np.flatnonzero(members & (self.emulator.runs >= self.jumps.runs)))

    def steps(self, members: Indices) -> tuple[Jump, ...]:
        """Where the outcomes of the experiments `members` (A,) have a step, if they do.

        Only the bulk of the law is looked at, by whose points the errors were judged last.
        """
        if not members.size:
            return ()
        law = None if self.where is None else np.quantile(self.where, self.jumps.bulk, axis=0).T
        box = self.box if law is None else law
        return steps(self.emulator.samples, box, members, self.jumps)

    @property
    def _spent(self) -> Flags:
        return np.asarray(self.emulator.runs >= self.choice.max_runs)

    def _begin(self) -> None:
        """The rest of the first runs, unless those of linear surfaces were enough for all
        experiments."""
        surfaces = self.emulator
        if isinstance(surfaces, OwnSurfaces) and surfaces.begun < surfaces.first:
            self._judge_again()
            if surfaces.rough(self.settings.alike, self.choice.accuracy).any():
                surfaces.begin(surfaces.first)

    def _complete(self) -> None:
        """Enough runs for a surface of every experiment, where two rounds suffice for that."""
        self._judge_again()
        for _ in range(self.settings.lost):
            lost = np.isinf(self.emulator.error) & ~self._spent
            if lost.any():
                self._run(lost, self.everywhere())

    def _remember(self, members: Flags) -> None:
        self.past[:, members] = np.roll(self.past[:, members], -1, axis=0)
        self.past[-1, members] = self.relative[members]

    def _run(self, members: Flags, draws: Array | None) -> None:
        self.emulator.sharpen(
            np.flatnonzero(members), draws, self.settings.growth, self.choice.max_runs
        )
        self._judge_again()

    def _judge_again(self) -> None:
        self.emulator.judge(self.where)
        if self.scale is not None:
            self.emulator.scatter = self.scale


def surfaces_of(runner: Runner, region: Array, choice: ResponseSurface) -> AdaptiveSurfaces:
    """First surfaces of a runner's distinct conditions on a region (n, 2)."""
    box, cases = region[moving_parameters(region)], runner.cases
    afforded = within(runner.account, np.arange(len(cases)))
    return AdaptiveSurfaces(
        attempts(runner, region), box, len(cases), choice, features(cases.columns), afforded
    )


def build_surface(
    run: Run,
    box: Array,
    experiments: int,
    choice: ResponseSurface | None = None,
    progress: Progress | None = None,
    settings: RoundSettings = ROUNDS,
) -> Surface:
    """Return surfaces of all experiments that are exact all over a box (n, 2), n from 1 to 10.

    `run(index (R,), x (R, n)) -> (R,)` is called once a round, with all experiments that still need
    runs. `progress(done runs, converged experiments, experiments)` is called before each round.
    Without a tolerance in the choice it is 0.005.

    All experiments share one nested sequence of points; a round adds three tenths. Each surface is
    fitted with the prior of least leave-one-out error (module `fit`). Its error is taken as the
    largest of: what that prior expects; the leave-one-out residuals, weighted by each run's part of
    the box; the misfit of the surface of the round before to the runs of this one; and half the
    estimate of that round. The first round's is taken three times.

    A run that failed has the outcome NaN; a surface is fitted through the runs that worked. In a
    large hole it is an extrapolation, wrong by up to thrice the estimate. With fewer than 2 n + 2
    runs that worked an experiment has no surface: it is a constant with an infinite error.

    Raises InputsError for an inadmissible box or too few runs, SimulatorError for outcomes of the
    wrong shape or infinite. An experiment that does not converge within `max_runs`, or stalls at
    the simulator's noise, is returned with `converged` False and its estimated error. A feature
    smaller than the distance between points can be missed by every estimate.

    Cost besides the runs: 108 experiments of two parameters with up to 500 runs, a few seconds.

    >>> surface = build_surface(lambda i, x: i + x[:, 0] * x[:, 1], np.array([[0, 1], [0, 1]]), 2)
    >>> surface.evaluate(np.array([[0.5, 0.5]]))
    array([[0.25], [1.25]])
    """
    choice = choice or ResponseSurface()
    choice = replace(choice, tolerance=choice.tolerance or settings.exact)
    if experiments < 1:
        raise InputsError(f"surfaces of {experiments} experiments", "pass at least one experiment")
    surfaces = AdaptiveSurfaces(run, _checked_box(box), experiments, choice, settings=settings)
    surfaces.refine(None, surfaces.level, progress)
    return surfaces.surface()


def first_runs(n: int, choice: ResponseSurface, settings: RoundSettings = ROUNDS) -> int:
    """Runs of an experiment in n parameters before its error is judged, unless few are enough.

    Twice the terms of total degree two up to four parameters where the surfaces are to be exact
    all over the box: quadratics then are so at once. Fewer where they will follow a law.

    >>> first_runs(2, ResponseSurface()), first_runs(2, ResponseSurface(tolerance=0.01))
    (12, 20)
    """
    each, more = settings.first_exact if choice.tolerance else settings.first_law
    return each * n + more


def linear_runs(
    n: int, choice: ResponseSurface, experiments: int, settings: RoundSettings = ROUNDS
) -> int:
    """Runs that are enough where every outcome is linear: two more than such a surface has terms.

    With few experiments nothing confirms that.

    >>> linear_runs(2, ResponseSurface(), 20), linear_runs(2, ResponseSurface(tolerance=0.01), 20)
    (5, 20)
    >>> linear_runs(2, ResponseSurface(), 1)
    12
    """
    alone = experiments < settings.confirmed or choice.tolerance
    return first_runs(n, choice, settings) if alone else n + 1 + settings.beyond_linear


def _first_emulator(
    run: Run,
    box: Array,
    experiments: int,
    choice: ResponseSurface,
    conditions: Array | None,
    settings: RoundSettings,
) -> Emulator:
    """A shared surface if the user asks for it, else a surface for each."""
    n = len(box)
    if choice.surfaces == "shared":
        if conditions is None or not SharedSurface.fits(experiments, n):
            raise _nothing_to_share(conditions, experiments)
        shared = SharedSurface(run, box, conditions)
        shared.judge(_points_of(box))
        return shared
    first = first_runs(n, choice, settings)
    if choice.max_runs < first:
        raise InputsError(
            f"response surface: max_runs {choice.max_runs} for {n} parameters",
            f"allow at least {first} runs an experiment",
        )
    return OwnSurfaces(
        run, box, Samples.none(experiments, n), first, linear_runs(n, choice, experiments, settings)
    )


def _nothing_to_share(conditions: Array | None, experiments: int) -> InputsError:
    remedy = 'take surfaces = "own": each experiment then has its own surface'
    if conditions is None:
        return InputsError(
            "experiments cannot share a surface: no condition that the simulator uses varies, or "
            f"one is text with more than {FEATURES.texts} values",
            remedy,
        )
    return InputsError(f"{experiments} experiments are too many to share a surface", remedy)


def _points_of(box: Array, settings: PlacementSettings = PLACES) -> Array:
    """Evenly spread points (J, n) of a box (n, 2), at which errors are judged without a law."""
    u = qmc.Sobol(len(box), rng=0).random_base2(int(np.log2(settings.everywhere)))
    return np.asarray(box[:, 0] + u * (box[:, 1] - box[:, 0]))


def _checked_box(box: Array) -> Array:
    box = np.asarray(box, dtype=np.float64)
    if box.ndim != 2 or box.shape[1] != 2 or not len(box):
        raise InputsError(f"box of shape {box.shape}", "pass one row [lower, upper] a parameter")
    for i, (low, high) in enumerate(box):
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise InputsError(
                f"box: parameter {i}: lower {low} >= upper {high}, or not finite",
                "pass two finite numbers, the smaller one first",
            )
    return box


@dataclass(frozen=True)
class Outlook:
    """Of `surfaces`, `rough` are not exact enough: their largest error is `worst` of the scatter.

    `needed` runs would bring all of them to `level`, and `more` runs the largest error to `then`;
    both are None where no surface has had a round of runs after its first.
    """

    rough: int
    surfaces: int
    worst: float
    level: float
    more: int
    needed: int | None
    then: float | None


def outlook(surfaces: AdaptiveSurfaces, more: int = 1000) -> Outlook:
    """Extrapolate e ~ R^-p, with the median p of the last rounds of the rough surfaces.

    A rough guide: errors fall fast, or hardly, as soon as a surface sees what it has to follow.
    """
    relative, runs = surfaces.relative, surfaces.emulator.runs.astype(np.float64)
    rough = ~surfaces.good & np.isfinite(relative)
    count, level = int(rough.sum()), surfaces.level
    worst = float(relative[rough].max(initial=0.0))
    power = _power(surfaces.past[-1, rough], relative[rough], surfaces.settings)
    if not count or power is None:
        return Outlook(count, rough.size, worst, level, more, None, None)

    def price(goal: float) -> float:
        times = np.maximum(relative[rough] / goal, 1.0) ** (1.0 / power)
        return float(runs[rough] @ (times - 1.0))

    needed = int(np.ceil(price(level)))
    then = level if needed <= more else float(brentq(lambda e: price(e) - more, level, worst))
    return Outlook(count, rough.size, worst, level, more, needed, then)


def _power(before: Array, now: Array, settings: RoundSettings = ROUNDS) -> float | None:
    """By which power of the number of runs the errors fell in the last round; None if unknown."""
    known = np.isfinite(before) & (before > 0.0) & (now > 0.0)
    if not known.any():
        return None
    powers = np.log(before[known] / now[known]) / np.log1p(settings.growth)
    return float(np.clip(np.median(powers), settings.slowest, settings.fastest))
