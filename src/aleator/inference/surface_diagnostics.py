"""What the errors of surfaces and level sets leave unknown: under the law, near outcomes, at jumps.

The functions return refusals and warnings, each with a remedy: whether surfaces are exact enough
(`doubt`), which outcomes no law can give, and what a limited budget left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.errors import NOISE, ExperimentsError
from aleator.inference.check import Checked
from aleator.inference.diagnostics import of_experiments
from aleator.inference.information import Inference
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.likelihood.scoring import scoring_step
from aleator.results.values import Diagnostic
from aleator.search.interface import LogLikelihood
from aleator.simulators import Account
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import AdaptiveSurfaces, Surface
from aleator.surrogates.adaptive import Outlook, outlook

SUBJECT = "response surface"


@dataclass(frozen=True)
class SurfaceReviewSettings:
    """Settings of the review of surfaces, by judgement where no measurement is named.

    Errors are those of a surface under the identified law, divided by the standard deviation of the
    outcome.
    """

    error: float = 0.1
    """Relative error of a surface above which a warning is given."""
    useless: float = 0.5
    """Relative error of a surface above which a result is not sound."""
    wrong: float = 0.03
    """Relative error above which an estimate counts as wrong, if the error exceeds `worse` times
    it.
    """
    worse: float = 4.0
    """Factor on the estimated error; correct surfaces had at most 3.3 times their estimated error,
    and most of them a fifth.
    """
    share: float = 0.03
    """Share of experiments with wrongly estimated errors from which a result is not sound."""
    change: float = 0.5
    """Change of the log-likelihood, from surfaces to the simulator, above which a result is
    refused.
    """
    errors: float = 3.0
    """Number of standard errors of the change by which the limit `change` is raised."""
    ids: int = 5
    """Largest number of experiments that are named with their outcomes."""


SURFACES = SurfaceReviewSettings()


def relative_errors(surface: Surface) -> Array:
    """The estimated error of each surface, divided by the outcome's scatter or the noise."""
    return np.asarray(surface.error / np.where(surface.scatter > 0.0, surface.scatter, np.inf))


def surface_report(
    surface: Surface | None, where: str = "under the law", against: str = "the outcome's scatter"
) -> dict[str, Any] | None:
    """The quality of the surfaces, relative to the scatter or the noise; None without surfaces."""
    if surface is None:
        return None
    relative = relative_errors(surface)
    return {
        "converged": int(surface.converged.sum()),
        "experiments": int(surface.converged.size),
        "median_error": float(np.median(relative)),
        "worst_error": float(np.max(relative)),
        "where": where,
        "against": against,
        "runs": int(surface.total_runs),
    }


def worse_than_estimated(
    checked: Checked, estimated: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """A refusal where the estimated errors (M,) of surfaces are far too small to be trusted.

    `ids` (M,) names the experiment of each observation.
    """
    relative = checked.relative
    with np.errstate(invalid="ignore"):
        worse = (relative > SURFACES.wrong) & (checked.typical > SURFACES.worse * estimated)
    if worse.sum() < max(2, SURFACES.share * worse.size):
        return []
    return of_experiments(
        SUBJECT,
        worse,
        ids,
        f"the response surface misses the simulator by more than {SURFACES.worse:.0f} times its "
        f"estimated error, and by up to {relative[worse].max():.1%} of the outcome's scatter under "
        "the identified law",
        "see whether the simulator answers the same for equal parameters; choose a tolerance, such "
        "as 0.005, for surfaces that are exact on all of their region",
    )


def useless(
    problem: Problem, checked: Checked | None, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """A refusal where surfaces are too rough under the identified law."""
    surface = problem.surface
    if surface is None or (checked is None and not problem.model.follows):
        return []
    with np.errstate(invalid="ignore", divide="ignore"):
        estimated = (surface.error / surface.scatter)[problem.condition]
        rough = (estimated if checked is None else surface_error) > SURFACES.useless
    return of_experiments(
        SUBJECT,
        rough,
        ids,
        f"the response surface misses the simulator by more than {SURFACES.useless:.0%} of the "
        "outcome's scatter under the identified law, so that the estimates cannot be trusted",
        "choose a tolerance, such as 0.005, for surfaces that are exact on all of their region "
        'whatever the answer; take transform = "log" where the outcome spans decades; or narrow '
        "the box",
    )


def surface_warnings(
    problem: Problem, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Warnings about surfaces that missed their tolerance, or are too rough for the result."""
    surface, choice = problem.surface, problem.model.surfaces
    if surface is None:
        return []
    assert choice is not None
    missed = ~surface.converged
    if problem.model.follows:
        rough = missed & (surface.error > SURFACES.error * surface.scatter)
        warnings = of_experiments(
            SUBJECT,
            rough[problem.condition],
            ids,
            f"the estimated error of the response surface is above {SURFACES.error:.0%} of the "
            "outcome's scatter under the law; more runs stopped making it smaller, or stopped "
            "changing the estimates",
            "see what the verification says of these experiments; choose a tolerance, such as "
            "0.005, or allow more runs (max_runs)",
        )
    else:
        spent = surface.runs >= choice.max_runs
        warnings = [
            *of_experiments(
                SUBJECT,
                (missed & spent)[problem.condition],
                ids,
                f"the estimated error was still above the tolerance when all {choice.max_runs} "
                "runs were used",
                "allow more runs an experiment (max_runs), or narrow the box",
            ),
            *of_experiments(
                SUBJECT,
                (missed & ~spent)[problem.condition],
                ids,
                "the estimated error stays above the tolerance however many runs are made; usual "
                "causes are the simulator's own numerical error, or an outcome that jumps",
                "make the simulator's own tolerances finer, raise the tolerance of the surface, or "
                "use collocation",
            ),
        ]
    with np.errstate(invalid="ignore"):
        rough = surface_error > SURFACES.error
    return warnings + of_experiments(
        SUBJECT,
        rough,
        ids,
        f"the error of the response surface is above {SURFACES.error:.0%} of the outcome's "
        "standard deviation under the identified law",
        "lower the tolerance of the surface, or narrow the box around the law",
    )


def check_refusals(change: float, error: float) -> list[Diagnostic]:
    """A refusal where the simulator gives another log-likelihood than its surfaces."""
    if not abs(change) > SURFACES.change + SURFACES.errors * error:
        return []
    return [
        Diagnostic(
            "check",
            f"the simulator itself changes the log-likelihood by {change:+.2g} +- {error:.2g}: the "
            "surfaces are not exact enough",
            "lower the surfaces' tolerance (propagation.tolerance), or narrow the limits",
        )
    ]


def exact_density(problem: Problem, alpha: Array) -> LogLikelihood | None:
    """The log-likelihood by level sets where a density from moments was chosen; else None."""
    levels = problem.exactly
    return None if levels is None or problem.levels is not None else levels(alpha)


def density_notes(
    exact: LogLikelihood | None, inference: Inference, problem: Problem
) -> list[Diagnostic]:
    """A note on how far the exact density would move an estimate, by one Fisher scoring step."""
    if exact is None or exact.scores is None or not inference.free.size:
        return []
    free = inference.free
    prior = None if exact.prior_score is None else exact.prior_score[free]
    found = scoring_step(exact.scores[:, free], prior)
    if found is None:
        return []
    steps = found.in_standard_errors
    rows = np.flatnonzero(np.abs(steps) > ACCURACY.move)
    if not rows.size:
        return []
    rows = rows[np.argsort(-np.abs(steps[rows]))]
    names = [problem.model.hyperparameters[free[i]].name for i in rows]
    moves = ", ".join(
        f"{name} would {'rise' if steps[i] > 0 else 'fall'} by "
        + (
            f"about {abs(steps[i]):.2f} standard errors"
            if abs(steps[i]) < 1.0
            else "a standard error or more"
        )
        for name, i in zip(names, rows, strict=True)
    )
    return [
        Diagnostic(
            "density",
            f"the density in use is an approximation: with the exact one {moves}",
            "leave the density out: level sets are exact; or take a higher order, and compare",
            tuple(names),
        )
    ]


# ------------------------------------------------------------------------ near the outcomes


@dataclass(frozen=True)
class Accuracy:
    """Settings of the accuracy of surfaces near outcomes; measured by `benchmarks folds`."""

    log_likelihood: float = 0.1
    """Error of a log-likelihood without noise above which surfaces get more runs near the outcomes.
    """
    rounds: int = 3
    """Largest number of times that surfaces get more runs near the outcomes."""
    move: float = 0.25
    """Error of an estimate, in standard errors, above which surfaces get more runs near the
    outcomes.
    """
    unknown: float = 0.5
    """Error of an estimate, in standard errors, above which the result is refused."""
    farther: float = 3.0
    """Factor on the largest error that was seen, by which a surface may be wrong elsewhere."""


ACCURACY = Accuracy()


@dataclass(frozen=True)
class Doubt:
    """The largest effect of each surface's error near the measured outcome; NaN if unknown.

    `moves` (N,) are changes of an estimate in standard errors. `changes` (N,) are changes of the
    log-density without noise: infinite where the outcome may lie beyond an extreme of the response,
    zero with noise or without surfaces.
    """

    moves: Array
    changes: Array

    def but_for(self, rows: Flags) -> Doubt:
        """The effects, set to unknown for the experiments `rows` (N,)."""
        return Doubt(*(np.where(rows, np.nan, each) for each in (self.moves, self.changes)))

    @property
    def error(self) -> float:
        """The error of the log-likelihood; surfaces' errors are taken as independent."""
        return float(np.linalg.norm(np.nan_to_num(self.changes, nan=0.0, posinf=np.inf)))

    @property
    def size(self) -> float:
        """The larger effect over its admitted value; above one, more runs are useful."""
        move = float(np.nanmax(self.moves, initial=0.0))
        return max(move / ACCURACY.move, self.error / ACCURACY.log_likelihood)

    @property
    def wanting(self) -> Flags:
        """Experiments (N,) whose surfaces must be more exact near the measured outcomes."""
        found: Flags = self.moves > ACCURACY.move
        if self.error > ACCURACY.log_likelihood:
            found |= self.changes > ACCURACY.log_likelihood / np.sqrt(self.changes.size)
        return found


def doubt(problem: Problem, inference: Inference, alpha: Array, checked: Checked | None) -> Doubt:
    """The effect of each surface's error near the measured outcome on estimates and log-density.

    The error is the largest that the runs of the check found there. The outcome is shifted by it;
    the change of the score times H^-1, the inverse information, is the change of the estimates to
    first order. A shifted outcome that no law can give is not counted, since the measured outcome
    did occur. The change is NaN where no run was made near the outcome, or where the estimates have
    no standard errors.
    """
    count = problem.count
    moves, changes = np.full(count, np.nan), np.zeros(count)
    if problem.surface is None or checked is None:
        return Doubt(moves, changes)
    known = np.isfinite(checked.error)
    error = np.where(known, checked.largest, 0.0)
    here = problem.likelihood(alpha)
    if inference.positive:
        moves[known] = 0.0
        steps = inference.covariance / inference.standard_error[inference.free]
        for off in (error, -error):
            there = problem.with_outcomes(problem.outcomes + off).likelihood(alpha)
            assert here.scores is not None
            assert there.scores is not None
            apart = (there.scores - here.scores)[:, inference.free]
            moved = np.abs(apart @ steps).max(axis=1, initial=0.0)
            reached = (there.status == Status.SOLVED) & np.isfinite(there.each)
            moves = np.maximum(moves, np.where(reached, moved, 0.0))
    if problem.levels is not None:
        for off in (ACCURACY.farther * error, -ACCURACY.farther * error):
            beyond = problem.levels.with_outcomes(problem.outcomes + off).evaluate(alpha)
            change = np.abs(beyond.each - here.each)
            changes = np.maximum(changes, np.where(beyond.status == Status.SOLVED, change, np.inf))
        changes[~known] = np.nan
    return Doubt(moves, changes)


def doubt_refusals(doubted: Doubt, ids: Sequence[str]) -> list[Diagnostic]:
    """Refusals for experiments whose surfaces leave an estimate or a density unknown."""
    runs = "choose a tolerance, such as 0.005, or allow more runs (max_runs)"
    largest = np.nanmax(doubted.moves, initial=0.0)
    return [
        *of_experiments(
            SUBJECT,
            doubted.moves > ACCURACY.unknown,
            ids,
            "near the measured outcome the response surface misses the simulator by so much that "
            f"an estimate could move by {largest:.2g} standard errors",
            f"see whether it is an outlier, or whether the simulator has a kink or a step there; "
            f"{runs}",
        ),
        *of_experiments(
            SUBJECT,
            np.isposinf(doubted.changes),
            ids,
            "the measured outcome lies at an extreme of the response surface, nearer than the "
            "surface is exact, so that its density is not known",
            f"add {NOISE}, check these rows; {runs}",
        ),
    ]


def shortfalls(problem: Problem) -> Array:
    """How far outcomes (M,) lie above the possible range, or below it (negative); zero inside."""
    (lower, upper), reach = problem.ends, problem.predictor
    return np.asarray(np.maximum(lower - reach.upper, 0.0) + np.minimum(upper - reach.lower, 0.0))


def unreachable(problem: Problem, ids: Sequence[str]) -> ExperimentsError:
    """The error that names the outcomes outside the range of the surfaces' values.

    `ids` (M,) are the experiments of the outcomes.
    """
    rows, reach = np.flatnonzero(shortfalls(problem)), problem.predictor
    return out_of_reach(rows, problem.outcomes, (reach.lower, reach.upper), ids)


def out_of_reach(
    outside: Indices, y: Array, reach: tuple[Array, Array], ids: Sequence[str]
) -> ExperimentsError:
    """The error that names the outcomes `outside` the range of the simulator's values.

    An outcome that lies far from all others is named first as a possible slip of the table.
    """
    (low, high), most = reach, SURFACES.ids
    # Only the least and the largest value can lie apart.
    apart = [l for l in {int(np.argmin(y)), int(np.argmax(y))} if lies_apart(y, l)]
    outside = np.array(sorted(outside.tolist(), key=lambda l: l not in apart))
    slips = [ids[l] for l in outside.tolist() if l in apart]
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:most]
    )
    more = f"; and {outside.size - most} more" if outside.size > most else ""
    slip = (
        f"look first at experiment {', '.join(slips)}: its value lies farther from all others than "
        "these from each other, as after a slip of the sign, the point or the unit. Else "
        if slips
        else ""
    )
    return ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches, "
        f"so that no law explains them: {named}{more}",
        f"{slip}check these rows and the units, widen the box of the parameters, or add " + NOISE,
    )


def lies_apart(y: Array, l: int) -> bool:
    """Whether outcome `l` of y (M,) lies farther from all others than these from each other.

    >>> values = np.array([48.0, -29.2, 30.8])
    >>> [lies_apart(values, l) for l in range(3)]
    [False, True, False]
    """
    others = np.delete(y, l)
    return bool(others.size > 1 and np.abs(others - y[l]).min() > np.ptp(others))


# --------------------------------------------------------------------------------- level sets


@dataclass(frozen=True)
class Cells:
    """Settings that judge changes by finer level-set grids; measured by `benchmarks folds`."""

    jumped: float = 0.5
    """Loss of a log-density, when grid cells are halved, which shows that no parameters give the
    outcome. The loss is log 2 where the only cells in the level set are those that a jump crosses.
    """
    coarse: float = 0.1
    """Error of the log-likelihood from which there is a warning."""
    margin: float = 2.0
    """Factor on the change over the last two halvings that bounds the remaining error. The largest
    measured factor was 1.4 (random study 25).
    """
    rounding: float = 1e-8
    """Least error of a log-density: the rounding error of a slope over a cell halved eight times.
    """


CELLS = Cells()


def by_finer_cells(problem: Problem, alpha: Array) -> Array:
    """Changes (2, N) of the log-densities by the last two halvings of the level sets' grid cells.

    They are zero without level sets. The change over one halving alone can be zero by chance,
    because the error near a kink of the simulator has either sign.
    """
    if problem.levels is None:
        return np.zeros((2, problem.count))
    sizes = (problem.levels, problem.levels.coarse(), problem.levels.coarse(4))
    return np.asarray(-np.diff([levels.evaluate(alpha).each for levels in sizes], axis=0))


def cells_error(problem: Problem, changed: Array) -> float:
    """The error of the log-likelihood by level sets, from changes (2, N) by finer grid cells."""
    if problem.levels is None:
        return 0.0
    total, rounding = changed.sum(axis=1), CELLS.rounding * np.sqrt(changed.shape[1])
    return float(np.hypot(CELLS.margin * np.sqrt(total @ total + np.sum(changed**2)), rounding))


def level_refusals(changed: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """A refusal of outcomes that lie between the values on either side of a jump."""
    return of_experiments(
        "jump",
        changed[0] < -CELLS.jumped,
        ids,
        "the simulator jumps over the measured outcome, which it reaches for no parameters, so "
        "that no law explains it",
        f"add {NOISE}, check these rows, or see why the simulator jumps",
    )


def unreached_refusals(problem: Problem, alpha: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """A refusal of outcomes at an extreme of the response, or beyond it."""
    what = "the simulator" if problem.surface is None else "the response surface"
    far = "the measured outcome lies at an extreme of it or beyond, where its density is not known"
    if problem.each > 1:
        far = "no parameters were found that give all measured outcomes of an experiment together"
    elif problem.bounds is not None:
        far += ", or no parameters give an outcome within the bounds of a censored one"
    return of_experiments(
        "extreme",
        problem.unreached_at(alpha),
        ids,
        f"{what} does not go so far: {far}",
        f"add {NOISE}, check these rows, or choose a tolerance, such as "
        "0.005, for surfaces that are more exact there",
    )


def level_warnings(changed: Array) -> list[Diagnostic]:
    """A warning where the grid cells of level sets are too coarse for the result."""
    # The remaining error is at most as large as the last change, if the error is of first order.
    error = float(np.sum(changed[0]))
    if abs(error) < CELLS.coarse:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"the cells in which the simulator is looked at may change the log-likelihood by "
            f"{abs(error):.2g}: they are too coarse",
            "narrow the box of the parameters around the law",
        )
    ]


# ------------------------------------------------------------------------- steps and budgets


def step_warnings(surfaces: AdaptiveSurfaces | None, inputs: Inputs) -> list[Diagnostic]:
    """A warning of jumps of the outcome, which surfaces do not follow."""
    if surfaces is None:
        return []
    found = surfaces.steps(np.arange(surfaces.good.size))
    if not found:
        return []
    names = [inputs.names[i] for i in moving_parameters(inputs.box)]
    sharpest = min(found, key=lambda step: float(np.linalg.norm(step.there - step.here)))
    return [
        Diagnostic(
            "jump",
            f"the outcome jumps, or is as steep as a jump, in {len(found)} of "
            f"{surfaces.good.size} surfaces, which more runs hardly make exact: in one of them by "
            f"{sharpest.size:.3g} from {_place(names, sharpest.here)} to "
            f"{_place(names, sharpest.there)}",
            "narrow the box to one side of the jump; or let the simulator take arrays: it is then "
            "integrated over itself, without surfaces",
        )
    ]


def _place(names: Sequence[str], x: Array) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, x, strict=True))


BUDGET = "budget"
UNCHECKED = Diagnostic(
    BUDGET,
    "the budget had no runs left to check the answer on the simulator itself",
    "allow more runs, or hours, and give the same command again: the runs are kept",
)


def budget_warnings(
    account: Account,
    surfaces: AdaptiveSurfaces | None,
    against: str = "the outcome's scatter",
) -> list[Diagnostic]:
    """A warning where the budget stopped runs for the surfaces, with what more runs would achieve.

    `against` is the quantity to which the surfaces' errors are compared.
    """
    if surfaces is None or not account.refused:
        return []
    found = outlook(surfaces)
    if not found.rough:
        return []
    return [
        Diagnostic(
            BUDGET,
            f"the budget of {account.budget} ended the runs of the response surfaces: of "
            f"{found.rough} of {found.surfaces} the estimated error is above {found.level:.0%} of "
            f"{against}, at most {found.worst:.0%}",
            f"give the same command again, the runs are kept: {_bought(found)}",
        )
    ]


def _bought(found: Outlook) -> str:
    if found.needed is None or found.then is None:
        return "how fast the errors fall is known after one more round"
    text = f"about {found.needed:,} more would do, as the errors fell so far"
    if found.needed > found.more:
        text += f", and {found.more:,} more would bring the largest to {found.then:.0%}"
    return text
