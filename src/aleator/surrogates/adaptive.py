"""The loop that makes surfaces exact: estimate their errors, run experiments with large errors.

With a tolerance the runs are spread evenly over the region of the parameters, and errors are
estimated all over it. Without one the runs are placed where a law of the parameters has its mass,
and errors are estimated at draws of that law.
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
from aleator.simulators.response_functions import Run, moving_parameters
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.emulator import OwnSurfaces, pairs
from aleator.surrogates.fit import PLACES, PlacementSettings
from aleator.surrogates.samples import Samples, Sites
from aleator.surrogates.surface import Axes, Surface

Afforded = Callable[[Flags, Array, Array], Flags]
"""A function that selects experiments for a round of runs, where the budget limits their number.

It takes which experiments ask for the round (N,), their relative errors (N,) and the runs that it
costs each (N,), and returns which of them may have it (N,).
"""


@dataclass(frozen=True)
class RoundSettings:
    """Settings of the rounds of runs that make surfaces exact.

    The values are chosen by judgement.
    """

    reserved: int = 2
    """The number of runs that a budget keeps for the check of the result, for each group of
    surfaces that share their runs."""
    exact: float = 0.005
    """The default tolerance of surfaces that are exact all over their region."""
    rough: float = 0.05
    """A surface gets further runs if its estimated error under the law exceeds this share of the
    outcome's standard deviation."""
    growth: float = 0.3
    """The share by which a round increases the runs of an experiment that needs more."""
    patience: int = 6
    """After this number of rounds an experiment gets no further runs if they have reduced its error
    by less than a fifth. Its runs have then grown fivefold, so that the rest of the error comes
    from noise of the simulator or from a jump of the outcome."""
    stall: float = 0.8
    """An experiment gets no further runs if its last `patience` rounds have left more than this
    share of its error."""
    alike: float = 0.01
    """The few first runs of linear surfaces are enough if no experiment has a larger error than
    this share of its standard deviation. A feature that the runs of one experiment miss would show
    in those of another."""
    confirmed: int = 5
    """The least number of experiments for which few first runs may be enough: their linear surfaces
    confirm each other."""
    lost: int = 2
    """The number of extra rounds for experiments that have too few successful runs for a surface.
    """
    first_exact: tuple[int, int] = (5, 10)
    """The number of first runs where surfaces are to be exact all over the box: the first number
    for each parameter, plus the second."""
    first_law: tuple[int, int] = (3, 6)
    """The number of first runs where surfaces are to be exact under a law: the first number for
    each parameter, plus the second."""
    beyond_linear: int = 2
    """A linear surface takes this number of runs more than it has terms."""
    slowest: float = 0.5
    """The least p of the law that errors fall like R^-p with the number of runs R."""
    fastest: float = 6.0
    """The largest p of the law that errors fall like R^-p with the number of runs R."""


ROUNDS = RoundSettings()


def everyone(members: Flags, _relative: Array, _runs: Array) -> Flags:
    """Select all experiments that ask for a round of runs, because there is no budget."""
    return members


def within(account: Account, unit: Indices, settings: RoundSettings = ROUNDS) -> Afforded:
    """A function that selects the experiments with the largest errors, as the budget allows.

    `unit` (N,) says which surfaces share their runs: one run of the simulator gives values of all
    surfaces of a unit, so that a unit needs as many runs as its surface with most runs.
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
    """Settings of the search for jumps of an outcome between two runs.

    The values are chosen by judgement.
    """

    near: float = 0.1
    """The largest distance of two runs that are compared, in coordinates of the region from -1 to
    1."""
    large: float = 0.05
    """A difference of two outcomes can be a jump if it exceeds this share of the range of all
    outcomes of the experiment."""
    close: float = 0.4
    """Two runs are close if their distance is below this share of `near`."""
    wide: float = 0.8
    """Two runs are wide apart if their distance is above this share of `near`."""
    ratio: float = 1.5
    """The outcome is smooth if it differs at least this many times as much between runs wide apart
    as between close runs."""
    bulk: tuple[float, float] = (0.005, 0.995)
    """Jumps are sought between the quantiles of the law at these probabilities."""
    runs: int = 150
    """The number of runs from which on an experiment gets no further runs if its outcome jumps
    (`steps`)."""


JUMPS = JumpSettings()


@dataclass(frozen=True)
class Jump:
    """A jump of one experiment's outcome between two runs near each other.

    `surface` is the number of the experiment, `size` the difference of the outcomes, and `here` and
    `there` (n,) are the points of the runs.
    """

    surface: int
    size: float
    here: Array
    there: Array


def steps(
    samples: Samples, box: Array, members: Indices, settings: JumpSettings = JUMPS
) -> tuple[Jump, ...]:
    """The jump of each experiment in `members` (A,) whose outcome has one in the box (n, 2).

    A smooth outcome differs less between runs that are close than between runs wide apart. An
    outcome that jumps differs by as much, and so does one with a very steep front. Cost: all pairs
    of near points, for each member.

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
    """The jump of one experiment between its closest runs that show one, or None.

    `close` and `wide` (P, 2) are pairs of runs, sorted by their distance.
    """
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
    """The surfaces of N experiments with their runs, which rounds of runs improve.

    `run(index (R,), x (R, n)) -> (R,)` runs the simulator and gives NaN where a run failed. `box`
    (n, 2) is the region of the parameters that the surfaces cover. `where` (J, n) are the points at
    which errors were last estimated, or None for the whole box. `scale` (N,), if given, replaces
    the standard deviation to which errors are compared. `past` (P, N) are the relative errors
    before each of the last P rounds; an experiment whose error no longer falls gets no further
    runs. `afforded` selects the experiments of a round where the budget does not suffice for
    all.

    Raises InputsError where `max_runs` is less than the first round.
    """

    def __init__(
        self,
        run: Run,
        box: Array,
        experiments: int,
        choice: ResponseSurface,
        afforded: Afforded = everyone,
        settings: RoundSettings = ROUNDS,
        jumps: JumpSettings = JUMPS,
    ) -> None:
        self.choice, self.afforded, self.settings, self.jumps = choice, afforded, settings, jumps
        self.where = None if choice.tolerance else _points_of(box)
        self.scale: Array | None = None
        self.past = np.full((self.settings.patience, experiments), np.inf)
        self.emulator = _first_emulator(run, box, experiments, choice, settings)
        self._begin()
        self._complete()

    @property
    def box(self) -> Array:
        """The region of the parameters that the surfaces cover, lower and upper limits (n, 2)."""
        return self.emulator.box

    @property
    def total_runs(self) -> int:
        """The number of runs of all experiments together."""
        return int(self.emulator.runs.sum())

    @property
    def level(self) -> float:
        """The relative error up to which a surface is exact enough; see `relative`."""
        if self.choice.tolerance:
            return self.choice.tolerance
        return self.settings.rough

    @property
    def good(self) -> Flags:
        """Which experiments have a surface that is exact enough, (N,)."""
        return ~self.emulator.rough(self.level, self.choice.accuracy)

    @property
    def relative(self) -> Array:
        """Estimated error of each surface over the standard deviation of its outcome, (N,)."""
        scatter = self.emulator.scatter
        return np.asarray(self.emulator.error / np.where(scatter > 0.0, scatter, 1.0))

    def everywhere(self) -> Array | None:
        """Points (J, n) spread over the box for `judge` and `sharpen`; None with a tolerance.

        With a tolerance these methods cover the whole box anyway.
        """
        return None if self.choice.tolerance else _points_of(self.box)

    def move(self, box: Array) -> None:
        """Change the region to another box; runs inside it are used again."""
        self.emulator.move(box)
        self.past[:] = np.inf
        self._complete()

    def add(self, x: Array) -> None:
        """Run all experiments at further points x (Q, n) of the box, and fit the surfaces again."""
        self.emulator.run_at(x, *pairs(np.arange(self.good.size), len(x)))
        self.move(self.box)

    def judge(self, where: Array | None) -> None:
        """Estimate the errors of all surfaces at points (J, n) of a law, or (None) over the box."""
        self.where = where
        self._judge_again()

    def against(self, scale: Array) -> None:
        """Divide errors by `scale` (N,) from now on, not by the outcome's standard deviation."""
        self.scale = scale

    def unfinished(self, level: float) -> Flags:
        """Which experiments have a relative error above `level` and may have further runs, (N,)."""
        return self.granted(self._rough(level))

    def granted(self, members: Flags) -> Flags:
        """Which of the experiments `members` (N,) may have another round of runs.

        Left out are experiments without runs left, those with a jump that many runs have not
        resolved, and those that the budget does not allow.
        """
        members = members & ~self._spent
        for step in self._lasting(members):
            members[step.surface] = False
        runs = np.full(
            members.size, self.emulator.round(np.flatnonzero(members), self.settings.growth)
        )
        return self.afforded(members, self.relative, runs)

    def sharpen(self, members: Flags, draws: Array | None) -> None:
        """Make a round of runs of the members (N,), placed where draws (D, n) of a law are dense.

        Without draws the runs are spread over the box.
        """
        self._remember(members)
        self._run(members, draws)

    def sharpen_each(self, draws: Mapping[int, Array]) -> None:
        """Make a round of runs of some experiments, each placed by its own draws (D, n)."""
        members = np.isin(np.arange(self.good.size), [*draws])
        self._remember(members)
        for surface, own in draws.items():
            self.emulator.sharpen(
                np.array([surface]), own, self.settings.growth, self.choice.max_runs
            )
        self._judge_again()

    def refine(self, draws: Array | None, level: float, progress: Progress | None = None) -> None:
        """Make rounds of runs until no experiment has an error above `level` and may have more.

        Errors are estimated at the points of the last call of `judge`.
        """
        while True:
            if progress:
                progress(self.total_runs, int(self.good.sum()), self.good.size)
            members = self.unfinished(level)
            if not members.any():
                return
            self.sharpen(members, draws)

    def surface(self) -> Surface:
        """The present surfaces, with the errors of the last call of `judge`."""
        return self.emulator.surface(self.good)

    def _rough(self, level: float) -> Flags:
        """Which experiments have a relative error above `level` that still falls with more runs."""
        lost = np.isinf(self.emulator.error)
        stalled = self.relative > self.settings.stall * self.past[0]
        rough = self.emulator.rough(level, self.choice.accuracy)
        return np.asarray(rough & ~lost & ~stalled)

    @property
    def stepped(self) -> Flags:
        """Which experiments get no further runs because their outcome jumps, (N,)."""
        found = np.zeros(self.good.size, dtype=np.bool_)
        for step in self._lasting(~self.good):
            found[step.surface] = True
        return found

    @property
    def broken(self) -> bool:
        """Whether any experiment gets no further runs because its outcome jumps."""
        return bool(self.stepped.any())

    def _lasting(self, members: Flags) -> tuple[Jump, ...]:
        """The jumps of those members (N,) that already have many runs."""
        return self.steps(np.flatnonzero(members & (self.emulator.runs >= self.jumps.runs)))

    def steps(self, members: Indices) -> tuple[Jump, ...]:
        """The jumps of the outcomes of the experiments `members` (A,).

        If errors were last estimated at points of a law, only the central part of that law is
        searched.
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
        """Make the rest of the first runs, unless linear surfaces are exact for all experiments."""
        surfaces = self.emulator
        if surfaces.begun < surfaces.first:
            self._judge_again()
            if surfaces.rough(self.settings.alike, self.choice.accuracy).any():
                surfaces.begin(surfaces.first)

    def _complete(self) -> None:
        """Make up to two more rounds of runs of experiments that have too few for a surface."""
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
    """The surfaces of a runner's distinct values on a region (n, 2), after the first runs."""
    box, sites = region[moving_parameters(region)], Sites.seen(runner, runner.unit, runner.column)
    afforded = within(runner.account, sites.unit)
    return AdaptiveSurfaces(sites.attempts(runner, region), box, len(sites), choice, afforded)


def build_surface(
    run: Run,
    box: Array,
    experiments: int,
    choice: ResponseSurface | None = None,
    progress: Progress | None = None,
    settings: RoundSettings = ROUNDS,
) -> Surface:
    """Return surfaces of all experiments that are exact all over a box (n, 2), n from 1 to 10.

    `run(index (R,), x (R, n)) -> (R,)` is called once per round, with all experiments that still
    need runs. `progress(done runs, converged experiments, experiments)` is called before each
    round. If `choice` gives no tolerance, it is 0.005.

    All experiments share one nested sequence of points; a round increases the points by three
    tenths. Each surface is fitted with the prior of least leave-one-out error (module `fit`). Its
    error estimate is the largest of four: the error that the prior expects; the leave-one-out
    residuals, weighted by the part of the box nearest to each run; the misfit of the previous
    round's surface to the runs of this round; and half the estimate of the previous round. The
    estimate of the first round is multiplied by three.

    A run that failed has the outcome NaN; a surface is fitted to the successful runs. In a large
    hole between them it is an extrapolation, wrong by up to three times the estimate. With fewer
    than 2 n + 2 successful runs an experiment has no surface, but a constant with an infinite
    error.

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
    """The number of first runs of an experiment in n parameters, before its error is estimated.

    Where surfaces are to be exact all over the box it is, in up to four parameters, at least twice
    the number of terms of a quadratic polynomial, so that quadratic outcomes need no further round.
    Where they are to be exact under a law it is smaller.

    >>> first_runs(2, ResponseSurface()), first_runs(2, ResponseSurface(tolerance=0.01))
    (12, 20)
    """
    each, more = settings.first_exact if choice.tolerance else settings.first_law
    return each * n + more


def linear_runs(
    n: int, choice: ResponseSurface, experiments: int, settings: RoundSettings = ROUNDS
) -> int:
    """The number of runs that are enough if every outcome is linear in n parameters.

    It is two more than a linear surface has terms. With a tolerance, or with too few experiments to
    confirm that outcomes are linear, it is that of `first_runs`.

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
    settings: RoundSettings,
) -> OwnSurfaces:
    """The surfaces after the first runs."""
    n = len(box)
    first = first_runs(n, choice, settings)
    if choice.max_runs < first:
        raise InputsError(
            f"response surface: max_runs {choice.max_runs} for {n} parameters",
            f"allow at least {first} runs an experiment",
        )
    return OwnSurfaces(
        run, box, Samples.none(experiments, n), first, linear_runs(n, choice, experiments, settings)
    )


def _points_of(box: Array, settings: PlacementSettings = PLACES) -> Array:
    """Evenly spread points (J, n) of a box (n, 2), at which errors are estimated without a law."""
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
    """A forecast of the runs that surfaces need to become exact.

    `rough` of the `surfaces` are not exact enough, and `worst` is their largest relative error.
    `needed` further runs would bring all relative errors to `level`. `more` further runs would
    bring the largest one to `then`. `needed` and `then` are None where no surface has had a round
    of runs after its first.
    """

    rough: int
    surfaces: int
    worst: float
    level: float
    more: int
    needed: int | None
    then: float | None


def outlook(surfaces: AdaptiveSurfaces, more: int = 1000) -> Outlook:
    """Forecast the runs that the surfaces still need, from how errors fell in the last round.

    Relative errors e are assumed to fall like R^-p with the number of runs R, with the median p of
    the surfaces that are not exact enough. It is only a rough guide: once the runs resolve a
    feature of the outcome, errors can fall much faster.
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
    """The power p with which errors fell like R^-p in the last round; None if unknown."""
    known = np.isfinite(before) & (before > 0.0) & (now > 0.0)
    if not known.any():
        return None
    powers = np.log(before[known] / now[known]) / np.log1p(settings.growth)
    return float(np.clip(np.median(powers), settings.slowest, settings.fastest))
