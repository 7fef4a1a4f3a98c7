"""The second verdict of an identification: is the model consistent with the experiments?"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from aleator.core.progress import Progress
from aleator.core.types import Array
from aleator.inference.consistency.battery import (
    RELATED,
    SAME,
    SCATTER,
    SHAPES,
    Battery,
    apart,
    points_of,
    residuals_of,
)
from aleator.inference.consistency.columns import (
    COLUMNS,
    ORDER,
    RESPONSE,
    classes_of,
    columns_of,
    copies_of,
    without_order,
)
from aleator.inference.consistency.judged import Judgement, judged, outliers_of, replicated
from aleator.inference.consistency.sentences import told
from aleator.inference.fit import Fit
from aleator.observations.experiments import Experiments
from aleator.results.values import REPORTED, Consistency, Statistic


@dataclass(frozen=True)
class ConsistencySettings:
    """When the model is tested and by how many replicates; by judgement.

    observations: observations; with fewer nothing is tested.
    stages: numbers of replicates, each with two probabilities: so many are enough where p is then
    below the first or above the second. values: simulated values of all replicates, at most, but
    for `least` replicates. large: observations; with more there are no more than
    `large_replicates` replicates.
    unknown: share of probabilities that may be missing before more points are taken: the missing
    are no random ones (crack growth had a mean square of 0.59 with 13 % missing, exact 1.00).
    lost: share of probabilities or replicates that may be missing.
    discrepancies: those that are reported. stream: the stream of random numbers for replicates.
    """

    observations: int = 5
    stages: tuple[tuple[int, float, float], ...] = (
        (40, 0.001, 0.3), (100, 0.01, 0.12), (200, 0.0, 0.0),
    )  # fmt: skip
    values: int = 150_000_000
    least: int = 40
    large: int = 3000
    large_replicates: int = 100
    unknown: float = 0.02
    lost: float = 0.2
    discrepancies: int = 3
    stream: int = 11


CONSISTENCY = ConsistencySettings()


def consistency_of(
    fit: Fit,
    sound: bool,
    seed: int,
    progress: Progress,
    asked: Collection[str] = (),
    settings: ConsistencySettings = CONSISTENCY,
) -> Consistency:
    """Whether the experiments look as they do under the fitted model.

    Replicates of the experiments are drawn from it, alpha is fitted to each by one step, and the
    same statistics are computed. There are more of them where p is near the decision (Besag and
    Clifford, 1991). `asked` are the columns that the simulator or a law takes: what orders the
    experiments as they came out is no condition else. Cost: some hundredths of a second a
    replicate, 40 to 200 of them; no run.
    """
    if not sound:
        return Consistency.untested("the answer was not computed soundly")
    fit = fit.for_replicates()
    table, count = fit.table, len(fit.table.observations)
    if count < settings.observations:
        return Consistency.untested(f"there are only {count} observations")
    points = points_of(fit, 1.0 - settings.unknown)
    observed = residuals_of(fit, points)
    if np.mean(observed.known) < 1.0 - settings.lost:
        return Consistency.untested("too many observations have no predicted probability")
    columns = columns_of(table)
    copies = copies_of(columns, table, asked, observed.normal)
    columns = tuple(column for column in columns if column not in copies)
    names, pairs = _scattering(fit)
    # experiments of which nothing was observed have no say
    experiment = np.unique(table.observations.experiment, return_inverse=True)[1]
    battery = Battery.of(
        without_order(columns, experiment, _rising(table, observed.normal), observed.means),
        experiment,
        tuple(fit.hyperparameters[k].name for k in fit.inference.free),
        names,
        apart(observed.means, pairs),
    )
    with np.errstate(all="ignore"):
        statistics = battery.values(observed)
        source = replicated(fit, battery, points, np.random.default_rng([seed, settings.stream]))
        most = max(settings.least, settings.values // (count * points))
        if count > settings.large:
            most = min(most, settings.large_replicates)
        found = _enough(battery, statistics, source, most, progress, settings)
    if found is None:
        return Consistency.untested("too many replicates of the experiments have no statistics")
    against = sorted(
        (t for t in found.tests if t.corrected < REPORTED.level), key=lambda t: t.corrected
    )
    within = {column.name for column in columns if not column.own} - {RESPONSE, ORDER}
    # of many values, or classes of the outcome, which neither the simulator nor a law takes
    measured = {column.name for column in columns if column.count > COLUMNS.levels}
    measured = (measured | classes_of(columns, table.observations)) - {ORDER, *asked}
    return Consistency(
        found.together >= REPORTED.level,
        found.together,
        found.replicates,
        tuple(
            told(test, battery.several, within, measured)
            for test in _causes(against, within, settings)
        ),
        outliers_of(observed, table),
        found.tests,
        relations=battery.relations.told(
            observed.means, [t for t in found.tests if t.kind in RELATED]
        ),
        copies=tuple(name for column in copies for name in (column.name, *column.alike)),
    )


def _rising(table: Experiments, normal: Array) -> Array:
    """What rises or falls along a table (M,) that was sorted by its outcomes.

    The normal scores of a bound are drawn at random within it. One value an experiment is therefore
    taken as the table tells it, bounds too.
    """
    seen = table.observations
    if len(seen) > len(table.ids):
        return normal
    return np.where(np.isfinite(seen.lower), seen.lower, seen.upper)


def _scattering(fit: Fit) -> tuple[tuple[str, ...], tuple[tuple[int, int], ...]]:
    """The parameters that scatter, and the places of pairs of them that the law does not tie."""
    inputs = fit.inputs
    names, tied = inputs.names, inputs.correlation
    known = {frozenset((tied.members[i], tied.members[j])) for i, j in tied.pairs}
    places = combinations(range(inputs.scattering), 2)
    free = tuple(pair for pair in places if frozenset(pair) not in known)
    return tuple(names[i] for i in inputs.scattered), free


def _enough(
    battery: Battery,
    statistics: Array,
    source: Iterator[Array],
    most: int,
    progress: Progress,
    settings: ConsistencySettings,
) -> Judgement | None:
    replicates: list[Array] = []
    exists, made, found = np.isfinite(statistics), 0, None
    for stage, low, high in settings.stages:
        count = min(stage, most)
        for values in islice(source, count - made):
            made += 1
            progress.update(f"replicate {made} of {count}", made, count)
            if np.all(np.isfinite(values[exists])):
                replicates.append(np.where(exists, values, 0.0))
        if len(replicates) < (1.0 - settings.lost) * made:
            return None
        found = judged(battery.subjects, np.where(exists, statistics, 0.0), np.array(replicates))
        if count == most or found.together < low or found.together > high:
            break
    return found


def _causes(
    tests: list[Statistic], within: Collection[str], settings: ConsistencySettings
) -> list[Statistic]:
    """What is told of the tests that contradict the model, of which each explains others.

    The strongest, and what differs between experiments by a column of them, each column once. A
    scale that is wrong makes the scatter within experiments odd; groups that differ scatter alike;
    tails and skewness bring far values; what one column tells, all together tell again; and what
    differs by a column makes the shape of all residuals odd. None of it is so the other way round.
    """
    found = {(test.kind, test.column) for test in tests}
    inside = {SAME, *within}
    if ("scale", None) in found:
        tests = [t for t in tests if t.of != SCATTER or t.column not in inside]
    if {("skewness", None), ("heavy tails", None)} & found:
        tests = [t for t in tests if t.kind != "outlier"]
    tests = [t for t in tests if t.kind != "unequal" or ("groups", t.column) not in found]
    if any(t.column not in (None, ORDER, SAME) for t in tests):
        tests = [t for t in tests if t.column != SAME]
    placed = [t for t in tests if t.column is not None and t.column not in inside]
    told = (placed if placed and tests[0].kind in SHAPES else tests)[:1]
    for test in placed:
        if test.column not in {ORDER, *(t.column for t in told)}:
            told.append(test)
    return told[: settings.discrepancies]
