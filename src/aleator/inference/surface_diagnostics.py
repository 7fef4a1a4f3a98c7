"""What response surfaces leave unknown: under the law, near the outcomes, at steps, by a budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError
from aleator.inference.check import Checked
from aleator.inference.diagnostics import chosen, named
from aleator.inference.information import Inference
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.likelihood.scoring import scoring_step
from aleator.results.values import Diagnostic
from aleator.search.interface import LogLikelihood
from aleator.simulators import Account
from aleator.surrogates import AdaptiveSurfaces, Surface
from aleator.surrogates.adaptive import Outlook, outlook
from aleator.surrogates.responses import moving_parameters


@dataclass(frozen=True)
class SurfaceReviewSettings:
    """When surfaces are too rough for an answer; by judgement but where a measurement is named.

    Errors are those of a surface under the identified law, over the sd of the outcome.

    error: one that is worth a warning. useless: one with which an answer is not sound.
    wrong, worse, share: nor is it where errors are above `wrong` and `worse` times the estimated
    ones in such a share of the experiments. Right surfaces were at most 3.3 times as rough as
    estimated, and most a fifth.
    change: of the log-likelihood by the simulator, beyond `errors` standard errors of it, with
    which an answer is refused. ids: experiments that are named with their outcomes.
    """

    error: float = 0.1
    useless: float = 0.5
    wrong: float = 0.03
    worse: float = 4.0
    share: float = 0.03
    change: float = 0.5
    errors: float = 3.0
    ids: int = 5


SURFACES = SurfaceReviewSettings()


def surface_report(problem: Problem) -> dict[str, Any] | None:
    """How good the surfaces are, relative to the outcome's scatter under the law or on the box."""
    if problem.surface is None:
        return None
    return judged(problem.surface, "under the law" if problem.model.follows else "on the box")


def relative_errors(surface: Surface) -> Array:
    """The estimated error of each surface, over the scatter or the noise that it is judged by."""
    return np.asarray(surface.error / np.where(surface.scatter > 0.0, surface.scatter, np.inf))


def judged(
    surface: Surface, where: str = "under the law", against: str = "the outcome's scatter"
) -> dict[str, Any]:
    """How good surfaces are, relative to what they were judged against."""
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
    """Surfaces whose estimated errors (M,) are far too small: what rests on them is not known.

    `ids` (M,) are the experiments of the observations.
    """
    relative = checked.relative
    with np.errstate(invalid="ignore"):
        worse = (relative > SURFACES.wrong) & (checked.typical > SURFACES.worse * estimated)
    rows = np.flatnonzero(worse)
    if rows.size < max(2, SURFACES.share * worse.size):
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(rows, ids)}: the response surface misses the simulator by more than "
            f"{SURFACES.worse:.0f} times its estimated error, and by up to "
            f"{relative[rows].max():.1%} of the outcome's scatter under the identified law",
            "see whether the simulator answers the same for equal parameters; choose a tolerance, "
            "such as 0.005, for surfaces that are exact on all of their region",
            chosen(rows, ids),
        )
    ]


def useless(
    problem: Problem, checked: Checked | None, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces that are rough under the law."""
    surface = problem.surface
    if surface is None:
        return []
    with np.errstate(invalid="ignore", divide="ignore"):
        if checked is not None:
            relative = surface_error
        elif problem.model.follows:
            relative = (surface.error / surface.scatter)[problem.condition]
        else:
            return []
        useless = np.flatnonzero(relative > SURFACES.useless)
    if not useless.size:
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(useless, ids)}: the response surface misses the simulator by more than "
            f"{SURFACES.useless:.0%} of the outcome's scatter under the identified law, so that "
            "the estimates cannot be trusted",
            "choose a tolerance, such as 0.005, for surfaces that are exact on all of their region "
            'whatever the answer; take transform = "log" where the outcome spans decades; or '
            "narrow the box",
            chosen(useless, ids),
        )
    ]


def surface_warnings(
    problem: Problem, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces that did not reach their tolerance, and surfaces too rough for the answer."""
    if problem.surface is None:
        return []
    unexact = _unexact if problem.model.follows else _unconverged
    warnings = unexact(problem, problem.surface, ids)
    with np.errstate(invalid="ignore"):
        rough = np.flatnonzero(surface_error > SURFACES.error)
    if rough.size:
        warnings.append(
            Diagnostic(
                "response surface",
                f"{named(rough, ids)}: the error of the response surface is above "
                f"{SURFACES.error:.0%} of the outcome's standard deviation under the "
                "identified law",
                "lower the tolerance of the surface, or narrow the box around the law",
                chosen(rough, ids),
            )
        )
    return warnings


def _unexact(problem: Problem, surface: Surface, ids: Sequence[str]) -> list[Diagnostic]:
    """Surfaces that are rough under the law: more runs did not help, or did not move the answer."""
    rough = surface.error > SURFACES.error * surface.scatter
    rows = np.flatnonzero((rough & ~surface.converged)[problem.condition])
    if not rows.size:
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(rows, ids)}: the estimated error of the response surface is above "
            f"{SURFACES.error:.0%} of the outcome's scatter under the law; more runs "
            "stopped making it smaller, or stopped changing the estimates",
            "see what the verification says of these experiments; choose a tolerance, such as "
            "0.005, or allow more runs (max_runs)",
            chosen(rows, ids),
        )
    ]


def _unconverged(problem: Problem, surface: Surface, ids: Sequence[str]) -> list[Diagnostic]:
    """Two reasons: the runs were used up, or more runs stopped helping."""
    choice = problem.model.surfaces
    assert choice is not None
    missed = ~surface.converged[problem.condition]
    spent = surface.runs[problem.condition] >= choice.max_runs
    warnings = []
    for which, what, remedy in (
        (
            missed & spent,
            f"the estimated error was still above the tolerance when all {choice.max_runs} runs "
            "were used",
            "allow more runs an experiment (max_runs), or narrow the box",
        ),
        (
            missed & ~spent,
            "the estimated error stays above the tolerance however many runs are made; usual "
            "causes are the simulator's own numerical error, or an outcome that jumps",
            "make the simulator's own tolerances finer, raise the tolerance of the surface, or use "
            "collocation",
        ),
    ):
        rows = np.flatnonzero(which)
        if rows.size:
            message = f"{named(rows, ids)}: {what}"
            warnings.append(Diagnostic("response surface", message, remedy, chosen(rows, ids)))
    return warnings


def check_refusals(change: float, error: float) -> list[Diagnostic]:
    """Whether the simulator itself gives another log-likelihood than its surfaces."""
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
    """By the level sets of the same surfaces, where a density of moments was chosen; else None."""
    levels = problem.exactly
    return None if levels is None or problem.levels is not None else levels(alpha)


def density_notes(
    exact: LogLikelihood | None, inference: Inference, problem: Problem
) -> list[Diagnostic]:
    """How far the density of the outcome itself would move an estimate, by one step of scoring."""
    if exact is None or exact.scores is None or not inference.free.size:
        return []
    free = inference.free
    prior = None if exact.prior_score is None else exact.prior_score[free]
    found = scoring_step(exact.scores[:, free], prior)
    if found is None:
        return []
    steps = found.in_standard_errors
    names = [problem.model.hyperparameters[k].name for k in free]
    rows = np.flatnonzero(np.abs(steps) > ACCURACY.move)
    if not rows.size:
        return []
    rows = rows[np.argsort(-np.abs(steps[rows]))]
    moves = ", ".join(
        f"{names[i]} would {'rise' if steps[i] > 0 else 'fall'} by {_size(abs(steps[i]))}"
        for i in rows
    )
    return [
        Diagnostic(
            "density",
            f"the density in use is an approximation: with the exact one {moves}",
            "leave [density] out: level sets are exact; or take a higher order, and compare",
            tuple(names[i] for i in rows),
        )
    ]


def _size(step: float) -> str:
    return f"about {step:.2f} standard errors" if step < 1.0 else "a standard error or more"


@dataclass(frozen=True)
class Accuracy:
    """How exact surfaces are to be at the measured outcomes; measured by `benchmarks folds`.

    `log_likelihood` is the error of a log-likelihood without noise above which surfaces have more
    runs near the outcomes, up to `rounds` times.
    `move` is the same of an estimate, in standard errors, and `unknown` the one that refuses the
    answer. A surface is taken to be off by up to `farther` times the largest error that was seen.
    """

    log_likelihood: float = 0.1
    rounds: int = 3
    move: float = 0.25
    unknown: float = 0.5
    farther: float = 3.0


ACCURACY = Accuracy()


@dataclass(frozen=True)
class Doubt:
    """What each surface's error near the outcome does at most: NaN where it is not known.

    `moves` (N,) are standard errors of an estimate, `changes` (N,) of the log-density without
    noise; infinite where the outcome may be beyond an extreme, zero with noise or without surfaces.
    """

    moves: Array
    changes: Array

    def but_for(self, rows: Flags) -> Doubt:
        """The same, not known of some experiments (N,)."""
        moves, changes = (np.where(rows, np.nan, each) for each in (self.moves, self.changes))
        return Doubt(moves, changes)

    @property
    def error(self) -> float:
        """Of the log-likelihood: surfaces of different experiments err independently."""
        return float(np.linalg.norm(np.nan_to_num(self.changes, nan=0.0, posinf=np.inf)))

    @property
    def size(self) -> float:
        """The larger of both, over what is admitted: above one more runs are worth while."""
        move = float(np.nanmax(self.moves, initial=0.0))
        return max(move / ACCURACY.move, self.error / ACCURACY.log_likelihood)

    @property
    def wanting(self) -> Flags:
        """Experiments (N,) whose surfaces are to be more exact near the measured outcomes."""
        found: Flags = self.moves > ACCURACY.move
        if self.error > ACCURACY.log_likelihood:
            found |= self.changes > ACCURACY.log_likelihood / np.sqrt(self.changes.size)
        return found


def doubt(problem: Problem, inference: Inference, alpha: Array, checked: Checked | None) -> Doubt:
    """How far the error of each surface near the outcome moves an estimate and a log-density.

    The error is the largest that the runs of the check saw there. An outcome that is off by it has
    another score, and H^-1 times the difference is the step of the estimates, to first order. An
    outcome that is then out of every law's reach tells nothing of them: it was measured. A move is
    not known where no run came near, or the estimates have no standard errors.
    """
    count = problem.condition.size
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
            there = problem.given(problem.outcomes + off).likelihood(alpha)
            assert here.scores is not None
            assert there.scores is not None
            apart = (there.scores - here.scores)[:, inference.free]
            moved = np.abs(apart @ steps).max(axis=1, initial=0.0)
            reached = (there.status == Status.SOLVED) & np.isfinite(there.each)
            moves = np.maximum(moves, np.where(reached, moved, 0.0))
    if problem.levels is not None:
        for off in (ACCURACY.farther * error, -ACCURACY.farther * error):
            beyond = problem.levels.given(problem.outcomes + off).evaluate(alpha)
            reached = beyond.status == Status.SOLVED
            changes = np.maximum(
                changes, np.where(reached, np.abs(beyond.each - here.each), np.inf)
            )
        changes[~known] = np.nan
    return Doubt(moves, changes)


def doubt_refusals(doubted: Doubt, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose surfaces leave an estimate or a density unknown."""
    return [
        *_refused(
            doubted.moves > ACCURACY.unknown,
            "near the measured outcome the response surface misses the simulator by so much that "
            f"an estimate could move by {np.nanmax(doubted.moves, initial=0.0):.2g} standard "
            "errors",
            "see whether it is an outlier, or whether the simulator has a kink or a step there; ",
            ids,
        ),
        *_refused(
            np.isposinf(doubted.changes),
            "the measured outcome lies at an extreme of the response surface, nearer than the "
            "surface is exact, so that its density is not known",
            "add measurement noise ([noise] sd), check these rows; ",
            ids,
        ),
    ]


def _refused(rows: Flags, what: str, remedy: str, ids: Sequence[str]) -> list[Diagnostic]:
    where = np.flatnonzero(rows)
    if not where.size:
        return []
    remedy += "choose a tolerance, such as 0.005, or allow more runs (max_runs)"
    what = f"{named(where, ids)}: {what}"
    return [Diagnostic("response surface", what, remedy, chosen(where, ids))]


def shortfalls(problem: Problem) -> Array:
    """How far outcomes (N,) lie above what is reached, or below it (negative); zero inside."""
    y, reach = problem.outcomes, problem.predictor
    return np.asarray(np.maximum(y - reach.upper, 0.0) + np.minimum(y - reach.lower, 0.0))


def unreachable(problem: Problem, ids: Sequence[str]) -> ExperimentsError:
    """What names the experiments outside the reachable range."""
    rows, reach = np.flatnonzero(shortfalls(problem)), problem.predictor
    return out_of_reach(rows, problem.outcomes, (reach.lower, reach.upper), ids)


def out_of_reach(
    outside: Indices, y: Array, reach: tuple[Array, Array], ids: Sequence[str]
) -> ExperimentsError:
    """What names the experiments `outside`, of outcomes y (N,), and the ends (N,) of the reach."""
    (low, high), most = reach, SURFACES.ids
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:most]
    )
    more = f"; and {outside.size - most} more" if outside.size > most else ""
    return ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches, "
        f"so that no law explains them: {named}{more}",
        "check these rows and the units, widen the box of the parameters, or add measurement noise "
        "([noise] sd)",
    )


def step_warnings(surfaces: AdaptiveSurfaces | None, inputs: Inputs) -> list[Diagnostic]:
    """Outcomes with a step, which surfaces do not follow."""
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


ABOUT = "budget"
UNCHECKED = Diagnostic(
    ABOUT,
    "the budget had no runs left to check the answer on the simulator itself",
    "allow more runs, or hours, and give the same command again: the runs are kept",
)


def budget_warnings(
    account: Account,
    surfaces: AdaptiveSurfaces | None,
    against: str = "the outcome's scatter",
) -> list[Diagnostic]:
    """That the surfaces had fewer runs than they asked for; what is left of the error, and why.

    `against` is what their errors are judged by.
    """
    if surfaces is None or not account.refused:
        return []
    found = outlook(surfaces)
    if not found.rough:
        return []
    return [
        Diagnostic(
            ABOUT,
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
