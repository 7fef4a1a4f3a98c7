"""What is said of single experiments: no density, no runs, no observations, coarse level sets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.observations.responses import Observations
from aleator.results.values import Diagnostic, FailureReport
from aleator.search.interface import LogLikelihood
from aleator.simulators import NoOutcome, Runner, working_box


@dataclass(frozen=True)
class ExperimentSettings:
    """When something is said of single experiments, and how much of it; by judgement.

    gap: change of the log-likelihood with more nodes from which an answer is refused, and
    noted_gap that from which it is reported.
    equal: maxima whose log-likelihoods differ by less are as high as each other.
    failing: share of a law at which runs fail, from which it is reported. censored: share of the
    values of which only bounds are known, from which it is reported.
    ids: experiments that a message names. points: failed runs of which a result says where.
    """

    gap: float = 0.1
    noted_gap: float = 0.01
    equal: float = 0.1
    failing: float = 0.02
    censored: float = 0.5
    ids: int = 8
    points: int = 300


EXPERIMENTS = ExperimentSettings()


def chosen(which: NDArray[np.intp], ids: Sequence[str]) -> tuple[str, ...]:
    """The ids of the experiments `which`."""
    return tuple(ids[l] for l in which)


def named(which: NDArray[np.intp], ids: Sequence[str], most: int = EXPERIMENTS.ids) -> str:
    """The experiments `which`, by their ids, so many of them at most.

    >>> named(np.array([0, 2]), ["a", "b", "c"])
    'experiments a, c'
    """
    shown = ", ".join(ids[l] for l in which[:most])
    more = f" and {which.size - most} more" if which.size > most else ""
    return f"experiment{'s' if which.size > 1 else ''} {shown}{more}"


def statuses(codes: NDArray[np.int64], log_density: Array) -> list[str]:
    """One word for each experiment: solved, outside_support, or why the density failed."""
    outside = (codes == Status.SOLVED) & ~np.isfinite(log_density)
    combined = np.where(outside, int(Status.OUTSIDE_SUPPORT), codes)
    return [Status(int(code)).name.lower() for code in combined]


def density_refusals(honest: LogLikelihood, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose observations have no density."""
    words = np.array(statuses(honest.status, honest.each))
    warnings = []
    for status in (s for s in Status if s is not Status.SOLVED):
        bad = np.flatnonzero(words == status.name.lower())
        if bad.size:
            what, _, remedy = status.explanation.partition(": ")
            warnings.append(
                Diagnostic("density", f"{named(bad, ids)}: {what}", remedy, chosen(bad, ids))
            )
    return warnings


def held_warnings(held: Mapping[str, Indices], ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose covariates would take a value of their law beyond its limits."""
    return [
        Diagnostic(
            "bounds",
            f"{named(which, ids)}: the formula of {name} leads beyond the limits of {name}, "
            "where it is held",
            f"widen the limits of {name} if they are not physical, or take another formula",
            chosen(which, ids),
        )
        for name, which in held.items()
    ]


def review_data(
    seen: Observations, left: Observations, failing: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """What is missing: experiments without observations, values without runs, bounds only.

    `seen` are the observations of the table, `left` those of them that runs give a value of, and
    `failing` (N,) is the share of each experiment's law at which runs fail.
    """
    return [
        *_unobserved(seen, ids),
        *_lost(seen, left, ids),
        *_failing(failing, ids),
        *_censored(left),
    ]


def without_surfaces(lost: Flags, of: Indices, ids: Sequence[str]) -> list[Diagnostic]:
    """A refusal where observations (M,) have no surface in the end; `of` (M,) whose they are."""
    if not np.any(lost):
        return []
    which = np.unique(of[lost])
    return [
        Diagnostic(
            "surface",
            f"{named(which, ids)}: too few runs work near the identified law for a surface",
            "mend the simulator there, or narrow the limits of the law",
            chosen(which, ids),
        )
    ]


def rival_warnings(
    rivals: Sequence[Rival], hyperparameters: Sequence[Hyperparameter], intervals: Array
) -> list[Diagnostic]:
    """That there is another maximum, and where: as high, or outside the intervals (K, 2)."""
    rivals = [
        rival
        for rival in rivals
        if rival.drop < EXPERIMENTS.equal
        or any(not _within(rival.alpha[k], intervals[k]) for k in rival.moved)
    ]
    if not rivals:
        return []
    best = rivals[0]
    where = ", ".join(
        f"{hyperparameters[k].name} {best.alpha[k]:.4g} (here {best.here[k]:.4g})"
        for k in best.moved
    )
    lower = f"has a log-likelihood lower by {best.drop:.3g}"
    height = lower if best.drop > EXPERIMENTS.equal else "is as high"
    more = f" (and {len(rivals) - 1} more)" if len(rivals) > 1 else ""
    return [
        Diagnostic(
            "search",
            f"there are two maxima: another one{more} {height}, at {where}. The higher one need "
            "not be the physical one",
            "judge by what the parameters may be; limits that leave out one of them give the other",
            tuple(hyperparameters[k].name for k in best.moved),
        )
    ]


def _within(value: float, ends: Array) -> bool:
    return bool(ends[0] <= value <= ends[1])


@dataclass(frozen=True, eq=False)
class Rival:
    """Another maximum alpha (K,), lower by `drop`, beside the one `here` (K,).

    `moved` are the hyperparameters that differ by more than a standard error.
    """

    alpha: Array
    here: Array
    drop: float
    moved: tuple[int, ...]


def _unobserved(seen: Observations, ids: Sequence[str]) -> list[Diagnostic]:
    none = np.flatnonzero(np.bincount(seen.experiment, minlength=len(ids)) == 0)
    if not none.size:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{named(none, ids)}: nothing was observed. It says nothing of the law, and of its "
            "parameters only the law is known",
            "leave it out, or see whether cells are blank that should not be",
            chosen(none, ids),
        )
    ]


def _lost(seen: Observations, left: Observations, ids: Sequence[str]) -> list[Diagnostic]:
    count = [np.bincount(part.experiment, minlength=len(ids)) for part in (seen, left)]
    lost = count[0] - count[1]
    which = np.flatnonzero(lost)
    if not which.size:
        return []
    return [
        Diagnostic(
            "simulator",
            f"{named(which, ids)}: no run gives a value of {int(lost.sum()):,} of the "
            f"{len(seen):,} observations, wherever the parameters are. They are left out: the "
            "likelihood is that of the others, on condition that what is left out has nothing to "
            "do with the parameters",
            "mend the simulator there, or delete these rows of the table",
            chosen(which, ids),
        )
    ]


def _failing(failing: Array, ids: Sequence[str]) -> list[Diagnostic]:
    which = np.flatnonzero(failing > EXPERIMENTS.failing)
    if not which.size:
        return []
    return [
        Diagnostic(
            "simulator",
            f"{named(which, ids)}: runs fail at up to {100 * failing.max():.2g} % of the "
            "identified law. These parameters count as impossible there: the likelihood is that of "
            "the observations and of a run that works",
            "mend the simulator, or give the law a box where it works (`aleator box STUDY.toml`)",
            chosen(which, ids),
        )
    ]


def _censored(left: Observations) -> list[Diagnostic]:
    share = float(np.mean(left.censored)) if len(left) else 0.0
    if share <= EXPERIMENTS.censored:
        return []
    return [
        Diagnostic(
            "observations",
            f"of {100 * share:.0f} % of the values only bounds are known: the answer rests on the "
            "form of the law beyond what was measured",
            "see whether another law gives the same answer",
        )
    ]


def too_few_nodes(gap: float, from_where: float) -> list[Diagnostic]:
    """That more nodes change the log-likelihood by as much as that."""
    # of an outcome without density there is no difference, and it is told as such
    if not np.isfinite(gap) or abs(gap) <= from_where:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"more nodes change the log-likelihood by {gap:.2g}: those that are used are too few "
            "for what the observations leave open of the parameters",
            "let fewer parameters scatter, or see whether the simulator jumps as they change; of a "
            "density of moments, raise propagation.nodes, or leave [density] out",
        )
    ]


@dataclass(frozen=True)
class Cells:
    """What cells tell of a log-likelihood by level sets; measured by `benchmarks folds`.

    `jumped` is the loss of a log-density from coarse cells to those of half their size that says
    that the outcome is nowhere reached: it is log 2 where a set is only the cells that a jump
    crosses. `coarse` is the error of the log-likelihood that is worth a warning. `margin` is the
    error that is left, over what the last two halvings changed: 1.4 on random study 25. `rounding`
    is the least error of a log-density: of a slope over a cell that was halved eight times.
    """

    jumped: float = 0.5
    coarse: float = 0.1
    margin: float = 2.0
    rounding: float = 1e-8


CELLS = Cells()


def by_finer_cells(problem: Problem, alpha: Array) -> Array:
    """What cells of half the size changed in each log-density, the last time and before (2, N).

    Nothing without level sets. One halving alone may change nothing by chance: beside a kink the
    error of cells has either sign.
    """
    if problem.levels is None:
        return np.zeros((2, problem.outcomes.size))
    sizes = (problem.levels, problem.levels.coarse(), problem.levels.coarse(4))
    return np.asarray(-np.diff([levels.evaluate(alpha).each for levels in sizes], axis=0))


def cells_error(problem: Problem, changed: Array) -> float:
    """Of the log-likelihood by level sets, of what finer cells changed (2, N); zero without."""
    if problem.levels is None:
        return 0.0
    total, rounding = changed.sum(axis=1), CELLS.rounding * np.sqrt(changed.shape[1])
    return float(np.hypot(CELLS.margin * np.sqrt(total @ total + np.sum(changed**2)), rounding))


def level_refusals(changed: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose outcome lies between the values on either side of a jump."""
    rows = np.flatnonzero(changed[0] < -CELLS.jumped)
    if not rows.size:
        return []
    return [
        Diagnostic(
            "jump",
            f"{named(rows, ids)}: the simulator jumps over the measured outcome, which it reaches "
            "for no parameters, so that no law explains it",
            "add measurement noise ([noise] sd), check these rows, or see why the simulator jumps",
            chosen(rows, ids),
        )
    ]


def unreached_refusals(problem: Problem, alpha: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose outcome is not reached: it lies beyond an extreme of the response."""
    rows = np.flatnonzero(problem.unreached_at(alpha))
    if not rows.size:
        return []
    what = "the simulator" if problem.surface is None else "the response surface"
    return [
        Diagnostic(
            "extreme",
            f"{named(rows, ids)}: {what} does not go so far: the measured outcome lies at an "
            "extreme of it or beyond, where its density is not known",
            "add measurement noise ([noise] sd), check these rows, or choose a tolerance, such as "
            "0.005, for surfaces that are more exact there",
            chosen(rows, ids),
        )
    ]


def level_warnings(changed: Array) -> list[Diagnostic]:
    """Cells that are too coarse for the answer."""
    # what is left is as much at most, if the error is of first order
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


def failure_report(runner: Runner) -> FailureReport | None:
    """What a runner's failures have in common; None without any.

    In the order of conditions and parameters: that of the runs depends on what a store knew.
    """
    lost, straight = runner.lost
    kept = runner.failures
    if not len(kept) and not lost:
        return None
    told = kept if len(kept) else straight
    first = told.failures[int(_in_order(told.case, told.x)[0])]
    case, x = np.concatenate([kept.case, straight.case]), np.concatenate([kept.x, straight.x])
    x = x[_in_order(case, x)]
    lowest, highest = x.min(axis=0).tolist(), x.max(axis=0).tolist()
    return FailureReport(
        len(kept) + lost,
        runner.runs,
        tuple(runner.ids[k] for k in np.unique(runner.experiment[runner.cases.first[case]])),
        dict(zip(runner.parameters, zip(lowest, highest, strict=True), strict=True)),
        first.message,
        _points(runner.parameters, x),
    )


def _in_order(case: Indices, x: Array) -> Indices:
    return np.lexsort((*x.T[::-1], case))


def _points(parameters: Sequence[str], x: Array) -> dict[str, tuple[float, ...]]:
    """Columns of some of the points x (F, n), evenly chosen."""
    chosen = np.unique(np.linspace(0, len(x) - 1, EXPERIMENTS.points).round().astype(int))
    return {name: tuple(x[chosen, k].tolist()) for k, name in enumerate(parameters)}


def failure_warnings(report: FailureReport | None) -> list[Diagnostic]:
    """That runs failed, where, and what that means for the answer."""
    if report is None:
        return []
    where = ", ".join(f"{k} in [{low:.4g}, {high:.4g}]" for k, (low, high) in report.region.items())
    which = named(np.arange(len(report.experiments)), report.experiments)
    return [
        Diagnostic(
            "simulator",
            f"{report.runs:,} of {report.needed:,} runs failed ({which}), with {where}; the first: "
            f"{report.message}. Response surfaces and check leave these runs out; where they "
            "failed a surface extrapolates, and its estimated error is larger",
            "see them with `aleator runs show STUDY.toml --failures`, mend the simulator and "
            "`aleator runs retry` them, or narrow the box (`aleator box STUDY.toml`)",
            report.experiments,
        )
    ]


@contextmanager
def boxes_proposed(runner: Runner, inputs: Inputs) -> Iterator[None]:
    """Add to the remedy of a failed run the sections of a study that keep the law where runs work.

    Nothing is added where every law has a box: the remedy then says which box to narrow.
    """
    try:
        yield
    except NoOutcome as error:
        remedy = f"{error.remedy}{_sections(error, runner, inputs)}"
        raise NoOutcome(error.problem, remedy, error.failed, error.index) from error


def _sections(error: NoOutcome, runner: Runner, inputs: Inputs) -> str:
    laws = inputs.laws.values()
    reaching = [i for i, law in enumerate(laws) if law.scatters and not law.bounded]
    worked = runner.completed.x
    if not reaching:
        return "; or let `aleator box STUDY.toml` find the largest box in which every run works"
    if len(worked) < 2:
        return ""
    names = ", ".join(inputs.names[i] for i in reaching)
    box = working_box(worked, error.failed, reaching)
    sections = "".join(
        f'\n    [parameters.{inputs.names[i]}]\n    law = "truncated_normal"\n'
        f"    box = [{box[i, 0]:.4g}, {box[i, 1]:.4g}]"
        for i in reaching
    )
    return (
        f"; the law of {names} gives weight to values at which the simulator fails: give it a box, "
        f"such as that of the runs that worked so far,{sections}\n  and let `aleator box "
        "STUDY.toml` find the largest box that works"
    )
