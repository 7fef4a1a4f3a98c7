"""Maximize the likelihood on Gaussian processes, with runs until their error hardly moves alpha.

The processes of all outputs (`surrogates.processes`) begin with a few runs of each distinct
condition. Each round makes runs where the parameters agree with the measured values, and maximizes
again. The error of alpha that the processes cause is computed to first order
(`inference.emulator_error`). It is multiplied by how much farther the new values lay from what was
expected than the processes say. Once it is small, a round tests it: its runs lie where alpha
depends most on the simulated values and far from other runs, whatever the processes say of their
error. The rounds end when the error is small after such tests, or when the budget is spent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from aleator.core.progress import RunsAhead, Standing
from aleator.core.types import Array, Indices
from aleator.fit import outcome_range
from aleator.fit.earlier_runs import earlier_runs
from aleator.fit.ledger import SEARCH, SURFACE, Ledger
from aleator.fit.quadrature import (
    NODE_ACCURACY,
    AnyLikelihood,
    Highest,
    Maximum,
    nearest_maximum,
    several_modes,
    with_enough_nodes,
    with_other_optima,
)
from aleator.fit.question import Question, start_point
from aleator.fit.regions import (
    REGIONS,
    agreeing,
    draws,
    hull,
    interval_alphas,
    next_region,
    padded,
    plausible_alphas,
    reaching_out,
    region_of,
    roots_of,
)
from aleator.fit.rounds import (
    EMULATION,
    EXPECTED_RUNS,
    EmulationSettings,
    EmulatorError,
    EmulatorRound,
    RoundsAhead,
    admitted_change,
    confirming,
    enlarged,
    stalled,
    usual,
)
from aleator.fit.search import searched
from aleator.inference import surface_diagnostics
from aleator.inference.emulator_error import (
    Functional,
    InfluentialPoints,
    eased,
    functional,
    near_outcomes,
)
from aleator.inference.information import INTERVALS, Inference, infer
from aleator.inference.profile import Profile
from aleator.likelihood.individual import (
    GaussHermite,
    ImportancePoints,
    IndividualLikelihood,
    OnProcesses,
    OnSurfaces,
    RidgePoints,
)
from aleator.likelihood.problem import Problem, prepare
from aleator.search import SearchResult
from aleator.search.interface import OPTIMA
from aleator.simulators.response_functions import completed, moving_parameters
from aleator.simulators.slope_check import require_slopes
from aleator.surrogates.processes import Processes, least_first_runs
from aleator.surrogates.samples import Sites, features
from aleator.surrogates.surface import Surface


class Emulation:
    """The rounds of runs of Gaussian processes for one question, with the processes.

    `error` is the last error that the processes cause, and `surface` the polynomials in use.
    `itself` says whether the processes themselves are used in place of these. `together` is the
    number of runs of a round if workers enlarge it, or zero. `earlier` is the number of stored runs
    with which the processes began. `told` has the errors of all rounds, and `maxima` the
    log-likelihoods. `dependence` says how alpha depends on the simulated values, with the factor by
    which that is in standard errors.
    """

    def __init__(
        self,
        question: Question,
        ledger: Ledger,
        region: Array,
        reason: str,
        settings: EmulationSettings = EMULATION,
    ) -> None:
        self.question, self.ledger, self.region = question, ledger, region
        self.reason, self.settings = reason, settings
        self.start, runner, self.earlier = region, question.runner, 0
        self.together = enlarged(runner, question.choices.surfaces, settings)
        sites = Sites.seen(runner, question.unit, question.column)
        self.of = sites.of
        self.processes = Processes(
            self._runs,
            region[moving_parameters(region)],
            features(runner.cases.columns, len(runner.cases)),
            runner.cases.condition[sites.unit],
            sites.column,
            _limits(question, settings.far),
            runner.sloped,
        )
        self.error = EmulatorError(np.inf, np.inf, 1.0, np.ones(len(runner.cases)))
        self.distances, self.calm, self.terms, self.itself = np.empty(0), 0, 0, False
        self.told: list[EmulatorRound] = []
        self.maxima: list[float] = []
        self.dependence: tuple[Functional, Array] | None = None
        self.surface: Surface
        self.where: Array

    def answer(self) -> Highest:
        """The maximum, after as many rounds as it needs."""
        with self.ledger.stage(SURFACE):
            self._begin()
            likelihood = self._likelihood(self.processes.spread())
        found = searched(self.question, likelihood, [], self.ledger)
        end, rounds = self._climbed(likelihood, found.alpha), 0
        for _ in range(self.settings.searches):
            end, rounds = self._rounds(end, rounds)
            end, moved = self._in_reach(end)
            if moved:
                continue
            found, end, better = self._highest(found, end)
            if not better:
                break
        return self._finished(found, end)

    def spread(self, end: Maximum, found: SearchResult, profile: Profile) -> Highest | None:
        """The maximum on surfaces that reach to the laws at the ends of the profile intervals.

        Rounds of runs follow where the processes are not exact enough there. None where the
        surfaces reach so far already.
        """
        likelihood, inputs = end.likelihood, end.likelihood.inputs
        ends = interval_alphas(profile)
        wanted = region_of(inputs, [end.alpha], likelihood.count, REGIONS.far)
        if ends:
            wanted = hull(wanted, region_of(inputs, ends, likelihood.count, REGIONS.plausible))
        if not reaching_out(self.region, inputs.box, wanted).any():
            return None
        with self.ledger.stage(SURFACE):
            self._move(hull(self.region, padded(wanted, inputs.box)))
            self.processes.learn()
            made = self._likelihood(self._draws(end, [end.alpha, *ends]))
        self.calm = self._confirmed - 1
        return self._finished(found, self._rounds(self._climbed(made, end.alpha), 1)[0])

    def _runs(self, case: Indices, x: Array) -> tuple[Array, Array]:
        """Values (R, W) of cases (R,) at points x (R, n), and their slopes (R, W, n)."""
        runner, moving = self.question.runner, moving_parameters(self.start)
        unit = runner.cases.first[case]
        values, slopes = runner.with_slopes(unit, completed(self.start, x))
        return values, slopes[..., moving]

    def _begin(self) -> None:
        """The first runs; observations all of whose runs fail are left out."""
        processes, question = self.processes, self.question
        if processes.sloped:
            start = np.clip(start_point(question.inputs), *question.inputs.box.T)
            moving = moving_parameters(self.region)
            require_slopes(question.runner, start, self.region, moving)
        processes.know(*earlier_runs(self.question, self.region))
        self.earlier = len(processes.x)
        if self.earlier:
            self.ledger.progress.update(f"the processes begin with {self.earlier:,} stored runs")
        # Of a budget a round is left that tests the processes.
        each = least_first_runs(processes.sloped * len(processes.box))
        least = max(each * len(processes.conditions) - self.earlier, 0)
        account, reserve = self.question.runner.account, self.settings.fewest
        processes.begin(
            together=self.together, granted=lambda n: max(account.granted(n, reserve), least)
        )
        for _ in range(self.settings.lost):
            if lost := np.unique(processes.case[processes.lost]).tolist():
                processes.begin(lost)
        lost = processes.lost[self.of]
        if not self.question.exact and lost.any() and not lost.all():
            self.question, self.of = self.question.without(lost), self.of[~lost]
        processes.learn()

    def _rounds(self, end: Maximum, rounds: int) -> tuple[Maximum, int]:
        """Rounds of runs, each with a new maximum, until the error of alpha is small enough."""
        question, settings = self.question, self.settings
        while True:
            inference = infer(end.likelihood.followed, end.alpha, end.likelihood.hyperparameters)
            plain = self._draws(end, [end.alpha, *self._likely(end, inference)])
            self.error = self._error(end, inference, plain.std(axis=0))
            small = self.error.enough(len(question.ids), settings)
            calm = self.calm + 1 if (small or self._followed_badly) and rounds else 0
            self._tell(end, calm)
            if self._finer():
                end = self._climbed(self._likelihood(self.where), end.alpha)
                continue
            self.calm = calm
            ended = self.calm >= self._confirmed or stalled(self.told, self.maxima, settings)
            if ended or rounds >= settings.most:
                return end, rounds
            with self.ledger.stage(SURFACE):
                likely = self._likely(end, inference, min(self.error.alpha, settings.largest))
                x = self._draws(end, [end.alpha, *likely], settings.wide, settings.draws)
                near = agreeing(
                    end.likelihood, end.alpha, self.of, x, self.surface.evaluate(x), settings.near
                )
                if not self._made_runs(x, near):
                    return end, rounds
                region = next_region(
                    end.likelihood.inputs, self.region, end.alpha, likely, end.likelihood.count,
                    settings.shrink,
                )  # fmt: skip
                if region is not self.region:
                    self._move(region)
                self.processes.learn()
                # Polynomials are fitted where the laws lie and where the outcomes were measured.
                x = np.clip(x, *self.processes.box.T)
                some = x[near[:, :: settings.near // settings.fitted]].reshape(-1, x.shape[1])
                every = np.vstack([self._draws(end, [end.alpha, *likely]), some])
                likelihood = self._likelihood(np.random.default_rng(0).permutation(every))
            with self.ledger.stage(SEARCH):
                end, rounds = self._climbed(likelihood, end.alpha), rounds + 1

    def _likely(self, end: Maximum, inference: Inference, error: float = 0.0) -> Array:
        """Plausible values (A, K) of alpha, where the processes cause this error of it."""
        if not np.isfinite(inference.information).all():
            return end.alpha[None]
        whole = replace(inference, information=inference.information / (1.0 + error**2))
        return plausible_alphas(end.alpha, whole, end.likelihood.hyperparameters)

    def _finer(self) -> bool:
        """Whether polynomials cause too large an error and something better follows from now on.

        They get more terms. Where more runs would not help because polynomials cannot follow the
        processes, these themselves take their place. Level sets need polynomials.
        """
        least = max(self.settings.missed * self.settings.enough, 0.5 * self.error.alpha)
        if self.error.missed <= least:
            return False
        before, self.terms = self.terms, 2 * max(self.terms, self.processes.terms)
        self.terms = min(self.terms, self.processes.settings.most)
        if self.terms > max(before, self.processes.terms):
            return True
        if self.itself or self.question.exact or not self._followed_badly:
            return False
        self.itself = True
        return True

    @property
    def _followed_badly(self) -> bool:
        """Whether polynomials alone cause more error than is admitted."""
        return self.error.learned <= self.settings.enough < self.error.missed

    @property
    def _confirmed(self) -> int:
        """The number of rounds in succession after which small errors are believed."""
        return confirming(self.processes.sloped, self.settings)

    @property
    def _size(self) -> int:
        """The number of runs of the next round."""
        settings = self.settings
        # What mostly earlier runs have made exact needs a test, but no runs to learn from.
        known = self.earlier > 0.5 * len(self.processes.x)
        tested = known and self.error.enough(len(self.question.ids), settings)
        few = settings.fewest if tested else usual(len(self.processes.conditions), settings)
        return max(self.together, few)

    def expected_runs(self, goal: float, calm: int = 0) -> float:
        """The number of all runs that is expected for an error of the estimates of `goal`.

        It is in standard errors. `calm` rounds in succession have had small errors. Infinite where
        the present error is unknown, and where more rounds are expected than are made.
        """
        change = admitted_change(len(self.question.ids), self.settings)
        ahead = RoundsAhead(self._size, self._confirmed, change, calm)
        error, made = self.error, len(self.processes.x)
        found = ahead.expected(made, error.alpha, error.log_likelihood, goal)
        left = self.settings.most - len(self.told)
        return found if found <= made + self._size * left else np.inf

    def _tell(self, end: Maximum, calm: int) -> None:
        """Record the present errors, and tell them with the runs and hours that are expected."""
        runs, error, runner = len(self.processes.x), self.error, self.question.runner
        if self.told and self.told[-1].runs == runs:
            del self.told[-1], self.maxima[-1]
        self.maxima.append(end.value)
        self.told.append(EmulatorRound(runs, error.alpha, error.log_likelihood))
        ahead = []
        for goal in EXPECTED_RUNS.goals:
            whole = self.expected_runs(goal, calm)
            ahead.append(RunsAhead(goal, whole, runner.seconds * (whole - runs) / runner.workers))
        names = [each.name for each in end.likelihood.hyperparameters]
        alpha = dict(zip(names, end.alpha.tolist(), strict=True))
        admitted = admitted_change(len(self.question.ids), self.settings)
        off = error.log_likelihood if error.log_likelihood > admitted else None
        most = self._most if error.alpha > EXPECTED_RUNS.goals[0] else None
        standing = Standing(runs, end.value, alpha, error.alpha, tuple(ahead), off, most)
        runner.outlook = standing.outlook
        self.ledger.progress.reached(standing)

    @property
    def _most(self) -> str | None:
        """The conditions that cause more than half of the error; None if none do, or are alone."""
        shares, columns = self.error.shares, self.question.runner.cases.columns
        case = int(np.argmax(shares))
        if len(shares) < 2 or not shares[case] > 0.5 * shares.sum():
            return None
        at = {name: column[case] for name, column in columns.items() if np.ndim(column[case]) == 0}
        return (
            ", ".join(
                f"{name} {value:.4g}" if isinstance(value, (int, float)) else f"{name} {value}"
                for name, value in at.items()
            )
            or None
        )

    def _made_runs(self, x: Array, near: Indices) -> bool:
        """Make a round of runs; False if the budget allows none.

        The runs are of the conditions that cause most of the error, at those of the draws x (D, n)
        that agree with the measured values, with the numbers `near` (N, A). After a small error
        they are tests.
        """
        question, processes, settings = self.question, self.processes, self.settings
        shares = self.error.shares
        most = question.choices.surfaces.max_runs if question.choices.surfaces else np.inf
        seen = np.isin(np.arange(len(shares)), processes.case[self.of])
        able = np.flatnonzero(seen & (processes.made < most))
        order = able[np.argsort(-shares[able], kind="stable")]
        if not order.size or not (count := question.runner.account.granted(self._size)):
            return False
        case, experiment = processes.case[self.of], question.table.observations.experiment
        made, points = [], []
        if self.calm and self.dependence:
            found, by = self.dependence
            at = InfluentialPoints.of(found, processes.case, by, self._scatter)
            inside = np.clip(at.x, *processes.box.T)
            weight = at.effect * np.isin(at.case, able)
            some = processes.farthest(at.case, inside, weight, count)
            made, points, count = at.case[some].tolist(), [inside[some]], 0
        for place, one in enumerate(order[:count].tolist()):
            some = x[np.unique(near[np.unique(experiment[case == one])])]
            each = -(-(count - place) // order.size)
            best = processes.best(one, some[:: -(-len(some) // settings.candidates)], each)
            made += [one] * len(best)
            points.append(best)
        z = processes.make(np.array(made), np.vstack(points))
        self.distances = np.append(self.distances, z)
        last = self.distances[-max(z.size, settings.seen) :]
        surprise = max(1.0, float(np.sqrt(np.mean(last**2)))) if last.size else 1.0
        self.error = replace(self.error, surprise=surprise, sloped=processes.sloped)
        return True

    def _error(self, end: Maximum, inference: Inference, spread: Array) -> EmulatorError:
        """The error that the processes cause; `spread` (n,) is that of plausible laws."""
        processes, before = self.processes, self.error
        roots = roots_of(inference, end.likelihood.hyperparameters, self.settings.largest)
        unknown = replace(before, alpha=np.inf, log_likelihood=np.inf,
                          shares=np.ones(len(processes.conditions)))  # fmt: skip
        if roots is None:
            return unknown
        (deviation, root), last = roots, inference.free.size
        found = self._functional(
            end, end.alpha, inference.free, deviation @ deviation.T, spread
        )  # fmt: skip
        if not np.abs(found.weights).max(initial=0.0) < self.settings.largest:
            return unknown
        site, inside = found.site, np.clip(found.x, *processes.box.T)
        total, alone = processes.of_sums(site, inside, found.weights)
        total *= before.surprise**2
        of_fit = self._of_fit(site, inside, found.weights)
        total += of_fit
        of_alpha = float(np.trace(root.T @ total[:last, :last] @ root))
        missed = float(np.trace(root.T @ of_fit[:last, :last] @ root)) ** 0.5
        # Without free hyperparameters, the error of the log-likelihood decides.
        by = root.T if last else np.ones((1, 1))
        shares = np.einsum("ki,cij,kj->c", by, alone[:, : len(by), : len(by)], by)
        self.dependence = found, by
        least = self.settings.search**2
        return replace(
            before, alpha=max(of_alpha, least) ** 0.5,
            log_likelihood=max(total[-1, -1], least) ** 0.5, shares=shares, missed=missed,
        )  # fmt: skip

    def _functional(
        self, end: Maximum, alpha: Array, free: Indices, covariance: Array, spread: Array
    ) -> Functional:
        """How alpha and the log-likelihood at alpha depend on errors of simulated values."""
        likelihood = end.likelihood
        if isinstance(likelihood, Problem):
            predictor = OnSurfaces(self.surface, self.region, self.of)
            near = near_outcomes(likelihood, alpha, predictor)
            held = near.by(self._rule(near), alpha)
        else:
            held = likelihood if alpha is end.alpha else likelihood.adapted(alpha)
        moving = moving_parameters(self.region)
        return functional(held, alpha, free, covariance, moving, spread, self.of, self._scatter)

    @property
    def _scatter(self) -> Array:
        """The scatter of each output under the laws (U,), or one where it has none."""
        return np.where(self.surface.scatter > 0.0, self.surface.scatter, 1.0)

    def _of_fit(self, site: Indices, x: Array, weights: Array) -> Array:
        """Squares and products (K, K) of the polynomials' errors in sums over sites, with weights.

        The polynomials miss the processes differently for each output.
        """
        each = np.zeros((len(self.processes.case), weights.shape[1]))
        if not self.itself:
            off = self.surface.at(site, x) - self.processes.expected(site, x)
            np.add.at(each, site, off[:, None] * weights)
        return each.T @ each

    def of_intervals(self, end: Maximum, points: Array) -> float | None:
        """The largest error of an interval's end that the processes cause, in standard errors.

        `points` (K, 2, K) are the alphas at the ends. The log-likelihood there lies 1.92 below its
        maximum and changes by 1.96 for each standard error, so that an error of their difference
        moves the end by the 1.96th part. None without ends. Cost: an evaluation of the functional
        for each end.
        """
        ends = points.reshape(-1, points.shape[-1])
        ends = ends[np.isfinite(ends).all(axis=1)]
        free, none = np.zeros(0, dtype=np.intp), np.zeros((0, 0))
        spread = self._draws(end, [end.alpha, *ends]).std(axis=0)
        held = _eased(end.likelihood, end.alpha)
        if held is not end.likelihood and isinstance(held, IndividualLikelihood):
            end = replace(end, likelihood=held.by(self._rule(held), end.alpha))
        parts = [self._functional(end, a, free, none, spread) for a in (end.alpha, *ends)]
        box, found = self.processes.box.T, list[float]()
        for part in parts[1:]:
            site = np.append(parts[0].site, part.site)
            x = np.clip(np.vstack([parts[0].x, part.x]), *box)
            weights = np.vstack([-parts[0].weights, part.weights])
            total = self.processes.of_sums(site, x, weights)[0] * self.error.surprise**2
            found.append(float((total + self._of_fit(site, x, weights))[0, 0]))
        steep = float(special.ndtri(INTERVALS.ends[1]))
        return max(found) ** 0.5 / steep if found else None

    def _highest(self, found: SearchResult, end: Maximum) -> tuple[SearchResult, Maximum, bool]:
        """A search from the maximum and the first optima: the highest maximum, and if it is new.

        All are climbed with the same quadrature nodes.
        """
        likelihood = _eased(self._plain(end), end.alpha)
        again = searched(self.question, likelihood, [end.alpha], self.ledger)
        others = [optimum.alpha for optimum in found.optima[1 : 1 + self.settings.others]]
        with self.ledger.stage(SEARCH):
            here = self._nearest(likelihood, end.alpha)
            climbs = [self._nearest(likelihood, alpha) for alpha in (again.alpha, *others)]
        best = max(climbs, key=lambda one: one.value)
        # With few nodes of several modes, the climb from a maximum may end at a lower one.
        moved = not np.allclose(best.alpha, end.alpha)
        if moved and best.value > here.value + OPTIMA.same_value:
            return replace(found, once=True), best, True
        return replace(again, once=found.once and again.once), here, False

    def _finished(self, found: SearchResult, end: Maximum) -> Highest:
        """The maximum with as many quadrature nodes as it needs, on the present surfaces."""
        self.question.runner.outlook = ""
        with self.ledger.stage(SEARCH):
            enough = NODE_ACCURACY.on_surfaces
            return with_other_optima(with_enough_nodes(self._plain(end), end.alpha, enough), found)

    def _in_reach(self, end: Maximum) -> tuple[Maximum, bool]:
        """The maximum where surfaces reach all exact outcomes, and whether runs were made for it.

        Raises ExperimentsError for an outcome that the simulator does not give anywhere.
        """
        likelihood, moved = end.likelihood, False
        for _ in range(outcome_range.OUTCOME_SEARCH.rounds):
            if not isinstance(likelihood, Problem):
                break
            if not surface_diagnostics.shortfalls(likelihood).any():
                break
            with self.ledger.stage(SURFACE):
                reached = outcome_range.reached(self.question, likelihood, self.region)
                if reached is None:
                    break
                case, x, region = reached
                self._move(region)
                self.processes.make(np.array([case]), x[None])
                self.processes.learn()
                likelihood = self._likelihood(self._draws(end, [end.alpha]))
            end, moved = self._climbed(likelihood, end.alpha), True
        return end, moved

    def _likelihood(self, where: Array) -> AnyLikelihood:
        """The likelihood on polynomials that are accurate at points `where` (J, n)."""
        question = self.question
        self.surface, self.where = self.processes.surface(where, self.terms), where
        if question.exact:
            model, y = question.choices.model, question.measured
            own = (self.region, None, self.surface, question.bounds)
            return prepare(question.runner, y, model, *own)
        on = (self.surface, self.region, self.of)
        if self.itself:
            return question.integral(OnProcesses(*on, means=self.processes.means))
        return question.integral(OnSurfaces(*on))

    def _plain(self, end: Maximum) -> AnyLikelihood:
        """The likelihood with few quadrature nodes, on the surfaces of a maximum."""
        likelihood = end.likelihood
        if isinstance(likelihood, IndividualLikelihood):
            return self.question.integral(likelihood.predictor)
        return likelihood

    def _climbed(self, likelihood: AnyLikelihood, alpha: Array) -> Maximum:
        """The maximum reached from alpha (K,), with the nodes and the errors of the rounds."""
        return self._nearest(_eased(likelihood, alpha), alpha)

    def _nearest(self, likelihood: AnyLikelihood, alpha: Array) -> Maximum:
        """The maximum reached from alpha (K,), with the quadrature nodes of the rounds."""
        if isinstance(likelihood, IndividualLikelihood) and likelihood.layout.grouping is None:
            likelihood = likelihood.ruled(self._rule(likelihood))
            if likelihood.inputs.scattering > 1 and several_modes(likelihood, alpha):
                likelihood = likelihood.ruled(ImportancePoints(self.settings.points))
        held, alpha = nearest_maximum(likelihood, alpha)
        coarse = held if isinstance(held, IndividualLikelihood) else None
        return Maximum(held, alpha, 0.0, coarse)

    def _rule(self, likelihood: IndividualLikelihood) -> GaussHermite | RidgePoints:
        nodes, variates = self.settings.nodes, likelihood.inputs.scattering
        return GaussHermite(nodes[variates]) if variates < len(nodes) else RidgePoints()

    def _draws(
        self,
        end: Maximum,
        alphas: Sequence[Array],
        wide: float = 1.0,
        count: int = REGIONS.draws,
    ) -> Array:
        likelihood = end.likelihood
        x = draws(likelihood.inputs, alphas, likelihood.count, wide, count)
        return np.clip(x, *self.region.T)[:, moving_parameters(self.region)]

    def _move(self, region: Array) -> None:
        self.region = region
        self.processes.move(region[moving_parameters(region)])


def _eased(likelihood: AnyLikelihood, alpha: Array) -> AnyLikelihood:
    """The likelihood whose errors do not lie far below what the errors of an emulator reach."""
    return likelihood if isinstance(likelihood, Problem) else eased(likelihood, alpha)


def _limits(question: Question, far: float) -> dict[int, tuple[float, float]]:
    """The limits of simulated values by column, far outside the range of the measured ones."""
    found = {}
    for column in np.unique(question.column).tolist():
        y = question.measured[question.column == column]
        size = far * float(np.ptp(y) or np.abs(y).max() or 1.0)
        found[column] = (float(y.min()) - size, float(y.max()) + size)
    return found
