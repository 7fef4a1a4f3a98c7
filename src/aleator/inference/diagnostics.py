"""What a reader must know before trusting a result: warnings and refusals, each with a remedy.

A refusal says that the result is not sound. About the estimates: too few experiments, estimates on
limits, a search that did not arrive. About single experiments: no density, no runs, no
observations. What the experiments do not determine is in `identifiability.py`, the errors of
surfaces and level sets are in `surface_diagnostics.py`.
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
from aleator.errors import WORKING_BOX, setting
from aleator.inference.identifiability import flat_profiles
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.observations.responses import Observations
from aleator.results.values import Diagnostic, FailureReport, PlausibleLaws
from aleator.search import SearchResult, wide_limits
from aleator.search.interface import OPTIMA, Hill, LogLikelihood
from aleator.simulators import NoOutcome, Runner, working_box

# ---------------------------------------------------------------------------------- estimates


@dataclass(frozen=True)
class EstimateSettings:
    """Settings of the diagnostics of estimates. The values are chosen by judgement."""

    edm: float = 5e-3
    """Estimated distance to the maximum, in log-likelihood, up to which the search has arrived. It
    corresponds to 0.1 standard errors.
    """
    experiments: int = 5
    """Experiments that are required for each free hyperparameter. With fewer, intervals of a normal
    law contain the truth in less than 93 % of all cases: 92 % with four, 91 % with three, by the
    laws of Student and Helmert.
    """
    correlation: float = 0.95
    """Correlation of two estimates from which advice about the pair is given."""
    distance: float = 3.0
    """Ratio of mean to standard deviation from which the values of a condition are far from zero.
    """
    proportional: float = 0.01
    """Relative deviation up to which one effect counts as proportional to another one times a
    condition.
    """
    spread: float = 0.2
    """Share of the condition's relative spread to which the limit `proportional` is lowered."""


ESTIMATES = EstimateSettings()
SMALL_SAMPLE = setting("[intervals] small_sample = true", "small_sample=True")


def count_warnings(
    experiments: int,
    inference: Inference,
    settings: EstimateSettings = ESTIMATES,
    *,
    adjusted: bool = False,
) -> list[Diagnostic]:
    """A warning where there are too few experiments for normal theory.

    Intervals that are `adjusted` for few experiments are not said to be too short.
    """
    free = inference.identified.size
    if experiments >= settings.experiments * free:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{experiments} experiments for {free} free hyperparameters: "
            + ("" if adjusted else "intervals hold the truth in less than 93 % of all cases, ")
            + "estimates -+ 1.96 standard errors in less than 90 %, "
            "and estimated standard deviations tend to be too small, by about the ratio of "
            "hyperparameters to experiments",
            "take the intervals, not the standard errors; "
            + ("" if adjusted else f"adjust them ({SMALL_SAMPLE}); ")
            + f"fix some, or add experiments ({2 * settings.experiments} for each is a start)",
        )
    ]


def group_warnings(
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Warnings where a level has too few groups for the laws of its parameters."""
    found, grouping = list[Diagnostic](), inputs.grouping
    if grouping is None:
        return found
    moved = [hyperparameters[k].name.partition(".")[0] for k in inference.identified.tolist()]
    for level, labels in zip(grouping.names, grouping.labels, strict=True):
        free = sum(inputs.levels.get(name) == level for name in moved)
        if len(labels) < settings.experiments * free:
            found.append(
                Diagnostic(
                    "experiments",
                    f"level '{level}' has {len(labels)} groups for {free} free "
                    f"hyperparameter{'s' * (free > 1)}: "
                    "their intervals are too short, and standard deviations tend to be too small",
                    f"fix some, or measure more groups ({2 * settings.experiments} for each is a "
                    "start)",
                )
            )
    return found


def search_refusals(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """A refusal where the result is not a maximum, or where the search did not reach it."""
    wide = ", ".join(wide_limits(hyperparameters))
    also = f"; narrow the limits of {wide}, many orders of magnitude wide" if wide else ""
    if not inference.positive:
        message = (
            "the information matrix at the answer is not positive definite: it is no maximum, or a "
            "hyperparameter has no effect"
        )
        remedy = "fix a hyperparameter, or search from more starts"
    elif not inference.edm < settings.edm:
        message = (
            f"the search did not arrive: the maximum is an estimated {inference.edm:.2g} higher in "
            "log-likelihood"
        )
        remedy = "allow more evaluations a start, search from more starts, or polish"
    else:
        return []
    return [Diagnostic("search", message, remedy + also)]


def once_warnings(found: SearchResult, hills: Sequence[Hill]) -> list[Diagnostic]:
    """A warning where only one start of the search reached the best maximum, or one as high.

    The starts are those that the report tells for each of the maxima `hills` (see `hills_of`).
    """
    best = hills[0].log_likelihood
    again = sum(one.starts for one in hills if best - one.log_likelihood < OPTIMA.same_value)
    if not found.once or again > 1:
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
    """Warnings about estimates on a limit, and about intervals of which an end is unknown."""
    sides = zip(hyperparameters, inference.at_bound, strict=True)
    warnings = [_on_limit(h, side) for h, side in sides if side is not None]
    flat = flat_profiles(hyperparameters, inference, profile)
    unknown = tuple(hyperparameters[k].name for k in profile.unknown(inference.identified))
    if unknown and inference.positive:
        names = ", ".join(hyperparameters[k].name for k in flat)
        warnings.append(
            Diagnostic(
                "interval",
                f"no interval is told of {', '.join(unknown)}: an end of it could not be found, at "
                "which the profile of the log-likelihood has dropped by 1.92",
                f"first fix {names}, which these data cannot tell"
                if flat
                else "take the standard error for what it is worth, or a bootstrap of the "
                "experiments; see whether the likelihood is rough because the simulator jumps",
                unknown,
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
        f"widen the limit if it is not physical{_limit_key(h)}, or fix the hyperparameter"
        + (constant if scatter else ""),
        (h.name,),
    )


def _limit_key(h: Hyperparameter) -> str:
    """Where a study states the limits of a mean or sd: as those of its own, or by a box."""
    name, _, key = h.name.rpartition(".")
    if key not in ("mean", "sd") or name == "noise" or name.startswith("noise."):
        return ""
    return f" (box of {name} in the study, or {key} = {{lower = ..., upper = ...}} there)"


def centering_advice(
    slope: Array,
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    conditions: pd.DataFrame,
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Advice on pairs of parameters where one acts like the other one times a condition.

    `slope` (M, n) has the derivatives of M simulated values with respect to the parameters, and
    `conditions` one row for each value. In y = a + b T with T far from zero, the estimates of a and
    b are strongly correlated; in a' + b (T - T0) with T0 in the middle of the T they are not. There
    is no advice where laws follow covariates, because the values of their parameters are not in
    alpha.
    """
    if inputs.regressed:
        return []
    far = {
        str(name): column.to_numpy()
        for name, column in conditions.items()
        if pd.api.types.is_float_dtype(column) and _far(column.to_numpy(), settings)
    }
    return [
        _advice(inputs.names[a], inputs.names[b], name, values)
        for i, j in _close(inputs, hyperparameters, inference, settings)
        for a, b in ((i, j), (j, i))
        for name, values in far.items()
        if _times(slope[:, b], slope[:, a], values, settings)
    ]


def _far(values: Array, settings: EstimateSettings) -> bool:
    spread = float(values.std())
    return bool(
        np.all(np.isfinite(values)) and 0.0 < settings.distance * spread < abs(values.mean())
    )


def _times(effect: Array, other: Array, condition: Array, settings: EstimateSettings) -> bool:
    """Whether an effect is another one times the condition and a constant, over all experiments."""
    product = other * condition
    size = float(product @ product)
    if size == 0.0:
        return False
    off = effect - (effect @ product) / size * product
    # The effect must be much closer to this product than to the other effect alone.
    spread = float(condition.std() / abs(condition.mean()))
    closeness = min(settings.proportional, settings.spread * spread)
    return bool(np.linalg.norm(off) < closeness * np.linalg.norm(effect))


def _close(
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    settings: EstimateSettings,
) -> Iterator[tuple[int, int]]:
    """Pairs of parameters whose means or values are free and strongly correlated."""
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


# --------------------------------------------------------------------------- single experiments


@dataclass(frozen=True)
class ExperimentSettings:
    """Settings of the diagnostics of single experiments. The values are chosen by judgement."""

    gap: float = 0.1
    """Change of the log-likelihood by more integration nodes above which a result is refused."""
    noted_gap: float = 0.01
    """Change of the log-likelihood by more integration nodes above which the change is reported."""
    equal: float = 0.1
    """Difference of log-likelihoods below which two maxima count as equally high."""
    failing: float = 0.02
    """Probability of failed runs under the law of an experiment above which they are reported."""
    censored: float = 0.5
    """Share of censored values (only bounds are known) above which a warning is given."""
    ids: int = 8
    """Largest number of experiments that a message names."""
    points: int = 300
    """Largest number of failed runs whose parameters a result lists."""


EXPERIMENTS = ExperimentSettings()


def named(which: NDArray[np.intp], ids: Sequence[str], most: int = EXPERIMENTS.ids) -> str:
    """The experiments `which` as text with their ids; `most` is the largest number that is named.

    >>> named(np.array([0, 2]), ["a", "b", "c"])
    'experiments a, c'
    """
    shown = ", ".join(ids[l] for l in which[:most])
    more = f" and {which.size - most} more" if which.size > most else ""
    return f"experiment{'s' if which.size > 1 else ''} {shown}{more}"


def of_experiments(
    about: str, which: Flags, ids: Sequence[str], message: str, remedy: str
) -> list[Diagnostic]:
    """A diagnostic that names the experiments `which` (N,); none if there are none."""
    rows = np.flatnonzero(which)
    if not rows.size:
        return []
    names = tuple(ids[l] for l in rows.tolist())
    return [Diagnostic(about, f"{named(rows, ids)}: {message}", remedy, names)]


def statuses(codes: NDArray[np.int64], log_density: Array) -> list[str]:
    """One word for each experiment: solved, outside_support, or why its density failed."""
    outside = (codes == Status.SOLVED) & ~np.isfinite(log_density)
    combined = np.where(outside, int(Status.OUTSIDE_SUPPORT), codes)
    return [Status(int(code)).name.lower() for code in combined]


def density_refusals(honest: LogLikelihood, ids: Sequence[str]) -> list[Diagnostic]:
    """Refusals of a result where the observations of an experiment, or a cluster, have none."""
    words = np.array(statuses(honest.status, honest.each))
    if honest.cluster is not None:
        words = words[honest.cluster]
    refusals = []
    for status in (s for s in Status if s is not Status.SOLVED):
        what, _, remedy = status.explanation.partition(": ")
        refusals += of_experiments("density", words == status.name.lower(), ids, what, remedy)
    return refusals


def limit_warnings(held: Mapping[str, Indices], ids: Sequence[str]) -> list[Diagnostic]:
    """Warnings about experiments whose covariates take the value of a law to its limits."""
    return [
        warning
        for name, which in held.items()
        for warning in of_experiments(
            "bounds",
            np.isin(np.arange(len(ids)), which),
            ids,
            f"the formula of {name} leads beyond the limits of {name}, where it is held",
            f"widen the limits of {name} if they are not physical, or take another formula",
        )
    ]


def review_data(
    seen: Observations, left: Observations, failing: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Warnings about missing data: no observations, no runs, or only bounds.

    `seen` are the observations of the table, `left` those of them for which runs give a value, and
    `failing` (N,) is the probability of failed runs under the law of each experiment.
    """
    count, kept = (np.bincount(part.experiment, minlength=len(ids)) for part in (seen, left))
    lost, share = count - kept, float(np.mean(left.censored)) if len(left) else 0.0
    return [
        *of_experiments(
            "experiments",
            count == 0,
            ids,
            "nothing was observed. It says nothing of the law, and of its parameters only the law "
            "is known",
            "leave it out, or see whether cells are blank that should not be",
        ),
        *of_experiments(
            "simulator",
            lost > 0,
            ids,
            f"no run gives a value of {int(lost.sum()):,} of the {len(seen):,} observations, "
            "wherever the parameters are. They are left out: the likelihood is that of the others, "
            "on condition that what is left out has nothing to do with the parameters",
            "mend the simulator there, or delete these rows of the table",
        ),
        *of_experiments(
            "simulator",
            failing > EXPERIMENTS.failing,
            ids,
            f"runs fail at up to {100 * failing.max():.2g} % of the identified law. These "
            "parameters count as impossible there: the likelihood is that of the observations and "
            "of a run that works",
            "mend the simulator, or give the law a box where it works: " + WORKING_BOX,
        ),
        *(
            [
                Diagnostic(
                    "observations",
                    f"of {100 * share:.0f} % of the values only bounds are known: the answer rests "
                    "on the form of the law beyond what was measured",
                    "see whether another law gives the same answer",
                )
            ]
            if share > EXPERIMENTS.censored
            else []
        ),
    ]


def without_surfaces(lost: Flags, of: Indices, ids: Sequence[str]) -> list[Diagnostic]:
    """A refusal where observations (M,) have no surface; `of` (M,) is the experiment of each."""
    return of_experiments(
        "surface",
        np.bincount(of[lost], minlength=len(ids)) > 0,
        ids,
        "too few runs work near the identified law for a surface",
        "mend the simulator there, or narrow the limits of the law",
    )


@dataclass(frozen=True, eq=False)
class Rival:
    """Another maximum alpha (K,) of the likelihood, lower by `drop` than the maximum `here` (K,).

    `moved` are the hyperparameters that differ by more than a standard error.
    """

    alpha: Array
    here: Array
    drop: float
    moved: tuple[int, ...]

    @property
    def as_high(self) -> bool:
        """Whether the data do not tell which of the two maxima is the higher one."""
        return self.drop < EXPERIMENTS.equal

    def outside(self, intervals: Array) -> bool:
        """Whether a hyperparameter that differs lies outside its interval (a row of (K, 2))."""
        return any(not intervals[k, 0] <= self.alpha[k] <= intervals[k, 1] for k in self.moved)


def rival_warnings(
    rivals: Sequence[Rival], hyperparameters: Sequence[Hyperparameter], intervals: Array
) -> list[Diagnostic]:
    """A warning of another maximum that is as high, or that lies outside the intervals (K, 2)."""
    rivals = [one for one in rivals if one.as_high or one.outside(intervals)]
    if not rivals:
        return []
    best = rivals[0]
    where = ", ".join(
        f"{hyperparameters[k].name} {best.alpha[k]:.4g} (here {best.here[k]:.4g})"
        for k in best.moved
    )
    lower = f"has a log-likelihood lower by {best.drop:.3g}"
    height = "is as high" if best.as_high else lower
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


def plausible_warnings(plausible: PlausibleLaws) -> list[Diagnostic]:
    """A warning where no draws of alpha represent the likelihood."""
    if plausible.status != "poor":
        return []
    share, effective = plausible.agreement, plausible.effective or 0.0
    normal = (
        "without standard errors there are no normal draws of the hyperparameters"
        if share is None
        else f"the likelihood accepts {share:.0%} of normal draws of the hyperparameters"
    )
    return [
        Diagnostic(
            "predictions",
            f"the laws that the experiments leave plausible could not be drawn: {normal}, and "
            f"draws by the likelihood count as {effective:.2g}. Predictions with uncertainty, and "
            "the ranges of laws, may be far too wide, and means and probabilities wrong",
            "compare with predictions at the estimate, or fix a hyperparameter",
        )
    ]


def node_warnings(gap: float, admitted: float) -> list[Diagnostic]:
    """A diagnostic where more nodes change the log-likelihood by more than `admitted`."""
    # An outcome without density has no such change; it is refused for another reason.
    if not np.isfinite(gap) or abs(gap) <= admitted:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"more nodes change the log-likelihood by {gap:.2g}: those that are used are too few "
            "for what the observations leave open of the parameters",
            "let fewer parameters scatter, or see whether the simulator jumps as they change; of a "
            "density of moments, take more nodes of the law, or leave the density out",
        )
    ]


# ------------------------------------------------------------------------------- failed runs


def failure_report(runner: Runner) -> FailureReport | None:
    """What the failed runs of a simulator have in common; None without failed runs.

    The runs are sorted by conditions and parameters, since their own order depends on the store.
    """
    lost, straight = runner.lost
    kept = runner.failures
    if not len(kept) and not lost:
        return None
    said = (kept if len(kept) else straight).frequent_failure()
    case, x = np.concatenate([kept.case, straight.case]), np.concatenate([kept.x, straight.x])
    x = x[np.lexsort((*x.T[::-1], case))]
    ends = zip(x.min(axis=0).tolist(), x.max(axis=0).tolist(), strict=True)
    some = np.unique(np.linspace(0, len(x) - 1, EXPERIMENTS.points).round().astype(int))
    return FailureReport(
        len(kept) + lost,
        runner.runs,
        tuple(runner.ids[k] for k in np.unique(runner.experiment[runner.cases.first[case]])),
        dict(zip(runner.parameters, ends, strict=True)),
        said.message if said else "",
        {name: tuple(x[some, k].tolist()) for k, name in enumerate(runner.parameters)},
    )


def failure_warnings(report: FailureReport | None) -> list[Diagnostic]:
    """A warning of failed runs: where they failed, and what this means for the result."""
    if report is None:
        return []
    where = ", ".join(f"{k} in [{low:.4g}, {high:.4g}]" for k, (low, high) in report.region.items())
    which = named(np.arange(len(report.experiments)), report.experiments)
    return [
        Diagnostic(
            "simulator",
            f"{report.runs:,} of {report.needed:,} runs failed ({which}), with {where}; most "
            f"often: {report.message}. Response surfaces and check leave these runs out; where "
            "they failed a surface extrapolates, and its estimated error is larger",
            "see them with `aleator runs show STUDY.toml --failures`, mend the simulator and "
            f"`aleator runs retry` them, or narrow the box: {WORKING_BOX}",
            report.experiments,
        )
    ]


@contextmanager
def boxes_proposed(runner: Runner, inputs: Inputs) -> Iterator[None]:
    """Add to a failed run's remedy ranges in which runs work, as sections of study.toml.

    Nothing is added where every law has a range already: the remedy then says which one to narrow.
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
        return f"; or let {WORKING_BOX} find the largest box in which every run works"
    if len(worked) < 2:
        return ""
    names = ", ".join(inputs.names[i] for i in reaching)
    box = working_box(worked, error.failed, reaching)
    sections = "".join(
        f'\n    [parameters.{inputs.names[i]}]\n    law = "truncated_normal"\n'
        f"    box = [{box[i, 0]:.4g}, {box[i, 1]:.4g}]"
        for i in reaching
    )
    boxes = ", ".join(
        f'"{inputs.names[i]}": TruncatedNormal(box=({box[i, 0]:.4g}, {box[i, 1]:.4g}))'
        for i in reaching
    )
    return (
        f"; the law of {names} gives weight to values at which the simulator fails: give it a box, "
        f"such as that of the runs that worked so far,{sections}\n    in Python {{{boxes}}}\n  and "
        f"let {WORKING_BOX} find the largest box that works"
    )
