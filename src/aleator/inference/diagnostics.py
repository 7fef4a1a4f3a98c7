"""What a reader must know before trusting an answer: warnings and refusals, each with a remedy.

Of estimates: too few experiments, limits, directions left open. Of single experiments: no density,
no runs, no observations, coarse level sets. What surfaces leave unknown is in
`surface_diagnostics.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.observations.responses import Observations
from aleator.results.values import Diagnostic, FailureReport
from aleator.search import SearchResult, wide_limits
from aleator.search.interface import LogLikelihood
from aleator.simulators import NoOutcome, Runner, working_box


@dataclass(frozen=True)
class EstimateSettings:
    """When estimates are not at a maximum, too many, or hardly determined; by judgement.

    edm: distance to the maximum, in log-likelihood, that still counts as arrived: 0.1 standard
    errors. experiments: experiments for each free hyperparameter; with fewer, intervals of a normal
    law contain the truth in less than 93 % of all cases: 92 % at four, 91 % at three, by the laws
    of Student and Helmert.
    weak: curvature of a direction over that of each hyperparameter alone; with less it is weak.
    part: share of a direction from which a hyperparameter is named.
    correlation: that of two estimates from which advice on it is a warning.
    distance: the mean of a condition over its standard deviation from which it is far from zero.
    proportional: relative deviation of the ratio of two effects from a condition that counts as
    none, at most the share `spread` of the relative spread of the condition.
    """

    edm: float = 5e-3
    experiments: int = 5
    weak: float = 0.02
    part: float = 0.3
    correlation: float = 0.95
    distance: float = 3.0
    proportional: float = 0.01
    spread: float = 0.2


ESTIMATES = EstimateSettings()


def count_warnings(
    experiments: int, inference: Inference, settings: EstimateSettings = ESTIMATES
) -> list[Diagnostic]:
    """Whether normal theory can be trusted at this number of experiments."""
    free = inference.identified.size
    if experiments >= settings.experiments * free:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{experiments} experiments for {free} free hyperparameters: intervals hold the truth "
            "in less than 93 % of all cases, estimates -+ 1.96 standard errors in less than 90 %, "
            "and estimated standard deviations tend to be too small, by about the ratio of "
            "hyperparameters to experiments",
            "take the intervals, not the standard errors; fix some, or add experiments "
            f"({2 * settings.experiments} for each is a start)",
        )
    ]


def search_refusals(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Whether the answer is a maximum, and the search arrived there."""
    warnings = []
    wide = wide_limits(hyperparameters)
    narrow = f"; narrow the limits of {', '.join(wide)}, many orders of magnitude wide"
    also = narrow if wide else ""
    if not inference.positive:
        warnings.append(
            Diagnostic(
                "search",
                "the information matrix at the answer is not positive definite: it is no maximum, "
                "or a hyperparameter has no effect",
                f"fix a hyperparameter, or search from more starts{also}",
            )
        )
    elif not inference.edm < settings.edm:
        warnings.append(
            Diagnostic(
                "search",
                "the search did not arrive: the maximum is an estimated "
                f"{inference.edm:.2g} higher in log-likelihood",
                f"allow more evaluations a start, search from more starts, or polish{also}",
            )
        )
    return warnings


def once_warnings(found: SearchResult) -> list[Diagnostic]:
    """Whether the maximum is one that no second start came to."""
    if not found.once:
        return []
    return [
        Diagnostic(
            "search",
            f"of {len(found.ascents)} starts of the search not two came to the same best "
            "log-likelihood: there may be a higher maximum",
            "search from more starts, give a hyperparameter a start or narrower limits, or fix one",
        )
    ]


def bound_warnings(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[Diagnostic]:
    """Estimates on a limit, and intervals of which an end was not found."""
    warnings = [
        _on_limit(h, side)
        for h, side in zip(hyperparameters, inference.at_bound, strict=True)
        if side is not None
    ]
    unknown = [hyperparameters[k] for k in profile.unknown(inference.identified)]
    if unknown and inference.positive:
        names = tuple(h.name for h in unknown)
        warnings.append(
            Diagnostic(
                "interval",
                f"no interval is told of {', '.join(names)}: an end of it could not be found, at "
                "which the profile of the log-likelihood has dropped by 1.92",
                "take the standard error for what it is worth, or a bootstrap of the experiments; "
                "see whether the likelihood is rough because the simulator jumps",
                names,
            )
        )
    return warnings


def _on_limit(h: Hyperparameter, side: str) -> Diagnostic:
    if side == "lower" and h.reaches_zero:
        return Diagnostic(
            "bounds",
            f"{h.name} ends at zero: as far as these experiments tell, it is no scatter. It has no "
            "standard error, and those of the others hold with it at zero",
            "take a constant in place of a law that does not scatter, or leave it and say so",
            (h.name,),
        )
    scatter = side == "lower" and h.log and not h.name.startswith("noise.")
    constant = '; if its parameter is the same in all experiments, take law = "constant"'
    return Diagnostic(
        "bounds",
        f"{h.name} ends on its {side} limit {h.lower if side == 'lower' else h.upper:.6g}; "
        "it has no standard error, and those of the others hold with it fixed there",
        "widen the limit if it is not physical, or fix the hyperparameter"
        + (constant if scatter else ""),
        (h.name,),
    )


REMEDY = "fix a hyperparameter, or measure under more varied conditions"


def weak_directions(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """What the experiments hardly determine: pairs, groups, and directions without any effect.

    Pairs and groups are those whose estimates are correlated beyond 0.98. That a single standard
    deviation is uncertain its interval says.
    """
    named = _correlated if inference.positive else _flat
    return [*named(inference, [hyperparameters[k] for k in inference.free], settings)]


def _weakest(correlation: Array, settings: EstimateSettings) -> Array:
    """Of these correlations the eigenvectors, as rows, of eigenvalues near zero."""
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors.T[values <= settings.weak])


def _correlated(
    inference: Inference, free: Sequence[Hyperparameter], settings: EstimateSettings
) -> Iterator[Diagnostic]:
    if inference.free.size < 2:
        return
    names = [h.name for h in free]
    for vector in _weakest(inference.correlation, settings):
        # the small eigenvalue is well determined; what moves along its large parts is not apart
        parts = _large(vector, settings)
        which = [names[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can hardly be told apart: if they change together, the "
            "likelihood hardly changes; well determined is only "
            f"{_combination(vector, parts, names)} (se: standard error)",
            *which,
            remedy=_remedy([free[i] for i in parts]),
        )


def _remedy(which: Sequence[Hyperparameter]) -> str:
    """An intercept far from all experiments is another matter than what they do not tell."""
    terms = [name for h in which if h.beside for name, _ in h.beside.terms]
    if not terms:
        return REMEDY
    covariate = terms[0].partition("[")[2].removesuffix("]")
    return (
        f"write center({covariate}) for {covariate} in the formula: the other coefficient is then "
        "the value at the mean of the covariate, not at zero; nothing else changes"
    )


def _flat(
    inference: Inference, free: Sequence[Hyperparameter], settings: EstimateSettings
) -> Iterator[Diagnostic]:
    """Directions along which the log-likelihood is flat: there is no covariance."""
    names = [h.name for h in free]
    inside = np.isin(inference.identified, inference.free)
    information = inference.information[np.ix_(inside, inside)]
    scale = np.sqrt(np.abs(np.diag(information)))
    if not np.all(np.isfinite(information)):
        return
    acts = scale > 0.0
    for name, act in zip(names, acts, strict=True):
        if not act:
            yield _weak(f"{name} has no effect", name)
    known = [name for name, act in zip(names, acts, strict=True) if act]
    values, vectors = np.linalg.eigh(
        information[np.ix_(acts, acts)] / np.outer(scale[acts], scale[acts])
    )
    for vector in vectors.T[np.abs(values) < settings.weak]:
        parts = _large(vector, settings)
        which = [known[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can change together without effect, along "
            f"{_combination(vector, parts, known)} (se: standard error of each by itself)",
            *which,
        )


def _weak(message: str, *names: str, remedy: str = REMEDY) -> Diagnostic:
    return Diagnostic("identifiability", message, remedy, names)


def _large(vector: Array, settings: EstimateSettings) -> list[int]:
    return [int(i) for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > settings.part]


def _combination(vector: Array, parts: Sequence[int], names: Sequence[str]) -> str:
    return " ".join(
        f"{'+' if vector[i] >= 0 else '-'} {abs(vector[i]):.2f} {names[i]}/se" for i in parts
    )


def centering_advice(
    slope: Array,
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    conditions: pd.DataFrame,
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Advice for pairs of parameters of which one acts as the other times a condition.

    By slopes (M, n) of M simulated values by the parameters; a row of conditions for each.

    In y = a + b T with T far from zero, a and b take each other's place; in a' + b (T - T0) with
    T0 in the middle they do not. None where laws follow covariates: their values are not in alpha.
    """
    if inputs.regressed:
        return []
    far = {
        str(name): column.to_numpy()
        for name, column in conditions.items()
        if pd.api.types.is_float_dtype(column) and _far(column.to_numpy(), settings)
    }
    found = []
    for i, j in _close(inputs, hyperparameters, inference, settings):
        for a, b in ((i, j), (j, i)):
            for name, values in far.items():
                if _times(slope[:, b], slope[:, a], values, settings):
                    found.append(_advice(inputs.names[a], inputs.names[b], name, values))
    return found


def _far(values: Array, settings: EstimateSettings) -> bool:
    spread = float(values.std())
    return bool(
        np.all(np.isfinite(values)) and 0.0 < settings.distance * spread < abs(values.mean())
    )


def _times(effect: Array, other: Array, condition: Array, settings: EstimateSettings) -> bool:
    """Whether one effect is the other times the condition and a constant, over all experiments."""
    wanted = other * condition
    size = float(wanted @ wanted)
    if size == 0.0:
        return False
    off = effect - (effect @ wanted) / size * wanted
    # as close as to the other alone would be no sign of the condition
    spread = float(condition.std() / abs(condition.mean()))
    closeness = min(settings.proportional, settings.spread * spread)
    return bool(np.linalg.norm(off) < closeness * np.linalg.norm(effect))


def _close(
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    settings: EstimateSettings,
) -> Iterator[tuple[int, int]]:
    """Pairs of parameters whose means or values are free, and hardly told apart."""
    where = {
        int(k): i
        for i, part in enumerate(inputs.slices)
        for k in inference.free
        if part.start <= k < part.stop and not hyperparameters[k].log
    }
    rows = [row for row, k in enumerate(inference.free) if int(k) in where]
    for p, q in combinations(rows, 2):
        i, j = where[int(inference.free[p])], where[int(inference.free[q])]
        if not inference.positive or abs(inference.correlation[p, q]) > settings.correlation:
            yield i, j


def _advice(a: str, b: str, name: str, values: Array) -> Diagnostic:
    low, high = values.min(), values.max()
    middle = float(f"{0.5 * (low + high):.3g}")
    return Diagnostic(
        "identifiability",
        f"{b} acts as {a} times {name} does, and {name} ({low:.6g} to {high:.6g}) lies far from "
        f"zero, so that the experiments hardly tell {a} from {b}",
        f"count {name} from its middle: write ({name} - {middle:.6g}) for {name} in the simulator, "
        f"and set the limits of {a} anew, which then belongs to {name} = {middle:.6g}",
        (a, b, name),
    )


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
