"""The test of consistency: whether a fitted model agrees with its experiments.

Replicates, which are data sets drawn from the fitted model, are fitted again by one Newton step.
Statistics of the residuals (`residual_statistics.py`) that are improbable among those of the
replicates contradict the model; each becomes a sentence with a remedy.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice

import numpy as np
from scipy import special

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags
from aleator.errors import setting
from aleator.inference.fit import Fit, stepped
from aleator.inference.residual_statistics import (
    ALIKE,
    COLUMN,
    OUTCOMES,
    RELATED,
    SAME,
    SCATTER,
    SHAPES,
    SHARES,
    Battery,
    Residuals,
    Subject,
    apart,
    points_of,
    residuals_of,
)
from aleator.inference.table_columns import (
    COLUMNS,
    ORDER,
    RESPONSE,
    Column,
    classes_of,
    columns_of,
    copies_of,
    without_order,
)
from aleator.observations.experiments import Experiments
from aleator.results.values import REPORTED, Consistency, Discrepancy, Outlier, Statistic


@dataclass(frozen=True)
class ConsistencySettings:
    """Settings of the consistency test. The values are chosen by judgement.

    observations: least number of observations; with fewer nothing is tested.
    stages: numbers of replicates, each with two probabilities. So many replicates are enough where
    p is then below the first probability or above the second.
    values: largest number of simulated values of all replicates together; it may be exceeded for
    the first `least` replicates.
    large: number of observations above which there are at most `large_replicates` replicates.
    unknown: share of the observations' probabilities that may be missing before more points are
    taken, because missing probabilities are not a random part (crack growth: mean square of the
    residuals 0.59 with 13 % missing, 1.00 when computed exactly).
    lost: share of probabilities, or of replicates, that may be missing before the test is given up.
    discrepancies: largest number of discrepancies that are reported.
    covariate: largest probability, corrected for the number of pairs of a parameter and a column,
    with which such a relation is told though all tests together do not contradict the model
    (of 420 right models of `python -m benchmarks findings`, seeds from 7000, 13 had it).
    stream: number of the random stream for replicates.
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
    covariate: float = 0.05
    stream: int = 11


CONSISTENCY = ConsistencySettings()


def consistency_of(
    fit: Fit,
    sound: bool,
    seed: int,
    progress: Progress,
    requested: Collection[str] = (),
    settings: ConsistencySettings = CONSISTENCY,
) -> Consistency:
    """Test whether the experiments look like data drawn from the fitted model.

    Replicates of the experiments are drawn from the model, alpha is fitted to each by one Newton
    step, and the same statistics are computed as for the experiments. More replicates are drawn
    where p is near the limit of the decision (Besag and Clifford, 1991). `sound` False means that
    the fit cannot be tested. `requested` are the columns that the simulator or a law uses: they are
    never taken for copies of the outcome. Cost: some hundredths of a second for each of 40 to 200
    replicates; no simulator runs.
    """
    if not sound:
        return Consistency.untested("the answer was not computed soundly")
    fit = fit.for_replicates()
    table, count = fit.table, len(fit.table.observations)
    if count < settings.observations:
        return Consistency.untested(f"there are only {count} observations")
    points = points_of(fit, 1.0 - settings.unknown)
    observed = residuals_of(fit, points)
    if np.mean(observed.finite) < 1.0 - settings.lost:
        return Consistency.untested("too many observations have no predicted probability")
    columns = columns_of(table)
    copies = copies_of(columns, table, requested, observed.normal)
    columns = tuple(column for column in columns if column not in copies)
    names, pairs = _scattering(fit)
    # Experiments without observations are left out.
    experiment = np.unique(table.observations.experiment, return_inverse=True)[1]
    battery = Battery.of(
        without_order(columns, experiment, _rising(table, observed.normal), observed.means),
        experiment,
        tuple(fit.hyperparameters[k].name for k in fit.inference.free),
        names,
        apart(observed.means, pairs),
        fit.inputs.levels,
    )
    with np.errstate(all="ignore"):
        subjects, statistics = battery.tests(observed)
        source = replicated(fit, battery, points, np.random.default_rng([seed, settings.stream]))
        most = max(settings.least, settings.values // (count * points))
        if count > settings.large:
            most = min(most, settings.large_replicates)
        found = _enough(subjects, statistics, source, most, progress, settings)
    if found is None:
        return Consistency.untested("too many replicates of the experiments have no statistics")
    against = sorted(
        (t for t in found.tests if t.corrected < REPORTED.level), key=lambda t: t.corrected
    )
    within = {column.name for column in columns if not column.by_experiment} - {RESPONSE, ORDER}
    # Columns may be results if they have many values, or sort the outcomes into classes, and
    # neither the simulator nor a law uses them.
    measured = {column.name for column in columns if column.count > COLUMNS.levels}
    measured = (measured | classes_of(columns, table.observations)) - {ORDER, *requested}
    causes = _causes(against, within, settings)
    covariate = _covariate(found.tests, columns, {test.column for test in causes}, settings)
    told = [*causes, *([covariate] if covariate else [])]
    said = [discrepancy_of(test, battery.several, within, measured) for test in told]
    return Consistency(
        found.together >= REPORTED.level,
        found.together,
        found.replicates,
        tuple(said[: len(causes)]),
        outliers_of(observed, table),
        found.tests,
        relations=battery.relations.correlations(
            observed.means, [t for t in found.tests if t.kind in RELATED]
        ),
        copies=tuple(name for column in copies for name in (column.name, *column.alike)),
        covariate=said[-1] if covariate else None,
    )


def _covariate(
    tests: Sequence[Statistic],
    columns: Sequence[Column],
    told: Collection[str | None],
    settings: ConsistencySettings,
) -> Statistic | None:
    """The strongest relation to a column that may be a covariate, if chance does not explain it.

    These tests are a family of their own: of each parameter with each column of the conditions or
    the table, by `relation` for numbers and `alike` for names. With one observation for each
    experiment it is the trend of the outcomes along each column, or each name against the others.
    `corrected` is 1 - (1 - p)^m of the m tests of the family, an upper bound for normal statistics
    whatever their correlations (Sidak, 1967). Columns already `told` are left out.
    """
    placed = {c.name: c for c in columns if c.by_experiment and c.name not in {ORDER, RESPONSE}}
    family = [t for t in tests if t.kind in {COLUMN, ALIKE} and t.column in placed] or [
        t
        for t in tests
        if (t.kind, t.of) == ("contrast", OUTCOMES)
        and t.column in placed
        and (t.where is None or placed[t.column].ranks is None)
    ]
    least = min(family, key=lambda test: test.p, default=None)
    if least is None or least.column in told:
        return None
    p = float(corrected(np.array(least.p), len(family)))
    return replace(least, corrected=p) if p <= settings.covariate else None


def _rising(table: Experiments, normal: Array) -> Array:
    """The values (M,) along which a table is tested for having been sorted.

    These are the normal scores. With one observation for each experiment they are the observed
    values themselves, since the normal score of a censored observation is partly random.
    """
    seen = table.observations
    if len(seen) > len(table.ids):
        return normal
    return np.where(np.isfinite(seen.lower), seen.lower, seen.upper)


def _scattering(fit: Fit) -> tuple[tuple[str, ...], tuple[tuple[int, int], ...]]:
    """The names of the scattering parameters, and the pairs that the law takes as independent."""
    inputs = fit.inputs
    names, tied = inputs.names, inputs.correlation
    known = {frozenset((tied.members[i], tied.members[j])) for i, j in tied.pairs}
    places = combinations(range(inputs.scattering), 2)
    free = tuple(pair for pair in places if frozenset(pair) not in known)
    return tuple(names[i] for i in inputs.scattered), free


def _enough(
    subjects: tuple[Subject, ...],
    statistics: Array,
    source: Iterator[Array],
    most: int,
    progress: Progress,
    settings: ConsistencySettings,
) -> Assessment | None:
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
        found = assessed(subjects, np.where(exists, statistics, 0.0), np.array(replicates))
        if count == most or found.together < low or found.together > high:
            break
    return found


def _causes(
    tests: list[Statistic], within: Collection[str], settings: ConsistencySettings
) -> list[Statistic]:
    """The tests that contradict the model, without those that follow from another one.

    The strongest test is kept, and one test for each column along which outcomes deviate. Left out
    are: scatter within experiments, if the overall scale is wrong; unequal scatter, if groups have
    different means; far values, if the tails or the skewness are wrong; all columns together, if
    one column is enough; and the shape of all residuals, if a column explains it.
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


@dataclass(frozen=True)
class AssessmentSettings:
    """Settings of p values from a small number of replicates, checked by the unit tests."""

    flattest: float = 1e-12
    """Relative scatter of a statistic's replicates below which the statistic is not used."""
    straight: float = 1e-3
    """Absolute skewness below which a statistic is treated as symmetric."""
    shrunk: float = 20.0
    """Shrinkage s of skewness: the skewness of B replicates is multiplied by B/(B + s)."""
    large: int = 200
    """Number of experiments from which one Newton step is enough to fit a replicate."""
    farthest: float = 1.01
    """Limit c of standardized replicates: a replicate is at most sqrt(B - c) standard deviations
    from the mean. The largest possible distance of one of B values is sqrt(B - 1).
    """
    certain: float = 1e-15
    """Distance from one that all probabilities keep."""
    named: int = 5
    """Largest number of outliers that are named."""


ASSESSMENT = AssessmentSettings()


def probabilities(
    observed: Array,
    replicates: Array,
    skewed: Flags,
    one_sided: Flags,
    least: Array,
    settings: AssessmentSettings = ASSESSMENT,
) -> tuple[Array, Array, Array]:
    """p values of the observed statistics (T,) and of the replicates (B, T), and z values (T,).

    The normal law is used, or, where `skewed`, the Pearson type III law with the skewness of the
    replicates (by Wilson and Hilferty, 1931). Student's t with B - 1 degrees of freedom accounts
    for the estimated mean and scatter, so that some dozens of replicates are enough for small p
    values. The variance of the replicates is increased by `least`^2 (T,). p is one where they do
    not scatter. z is the observed statistic as a standard normal value.
    """
    count = len(replicates)
    mean = replicates.mean(axis=0)
    sd = np.hypot(replicates.std(axis=0, ddof=1), least)
    flat = ~(sd > settings.flattest * (1.0 + np.abs(mean)))
    scale = np.where(flat, 1.0, sd)
    third = np.mean(((replicates - mean) / scale) ** 3, axis=0)
    skewness = np.where(skewed, third, 0.0) * count / (count + settings.shrunk)
    z = _normal((observed - mean) / scale, skewness, settings) / np.sqrt(1.0 + 1.0 / count)
    own = _normal((replicates - mean) / scale, skewness, settings)
    most = np.sqrt(count - settings.farthest)
    r = np.clip(own / np.sqrt(1.0 - 1.0 / count), -most, most)
    left_out = r * np.sqrt((count - 2.0) / (count - 1.0 - r**2))
    p = np.where(flat, 1.0, _tail(z, count - 1.0, one_sided))
    return p, np.where(flat, 1.0, _tail(left_out, count - 2.0, one_sided)), np.where(flat, 0.0, z)


def effective(smallest: Array) -> float:
    """The effective number m of tests: the smallest p of B replicates has the law 1 - (1 - p)^m.

    m maximizes the likelihood of the replicates below the median; those above only count as larger,
    because only small p values matter.
    """
    limit = float(np.median(smallest))
    low = smallest[smallest < limit]
    told = -np.log1p(-low).sum() - (smallest.size - low.size) * np.log1p(-limit)
    return low.size / told if told > 0.0 else 1.0


def corrected(p: Array, tests: float) -> Array:
    """The probability that the smallest p of this number of independent tests is at most `p`."""
    return np.asarray(-np.expm1(tests * np.log1p(-np.minimum(p, 1.0 - ASSESSMENT.certain))))


def _normal(z: Array, skewness: Array, settings: AssessmentSettings) -> Array:
    """Standardized values of a skewed law, transformed to normal ones.

    Only values on the side of the long tail are transformed. The end of the short tail depends on
    the skewness, which a small number of replicates hardly determines.
    """
    straight = (np.abs(skewness) < settings.straight) | (z * skewness < 0.0)
    g = np.where(straight, 1.0, skewness)
    inside = np.cbrt(np.maximum(0.5 * g * z + 1.0, 0.0))
    return np.where(straight, z, 6.0 / g * (inside - 1.0) + g / 6.0)


def _tail(z: Array, freedom: float, one_sided: Flags) -> Array:
    upper = special.stdtr(freedom, -z)
    return np.asarray(np.where(one_sided, upper, 2.0 * special.stdtr(freedom, -np.abs(z))))


@dataclass(frozen=True, eq=False)
class Assessment:
    """The tests, the p value of all tests `together`, and the number of replicates."""

    tests: tuple[Statistic, ...]
    together: float
    replicates: int


def assessed(
    subjects: tuple[Subject, ...],
    observed: Array,
    replicates: Array,
    settings: AssessmentSettings = ASSESSMENT,
) -> Assessment:
    """p values of observed statistics (T,) among B replicates (B, T), corrected for their number.

    Each p is divided by the weight of its test. The smallest of each group of tests is corrected
    for the group, then for the number of groups. Each group keeps its share of false alarms,
    however many columns and hyperparameters there are.
    """
    skewed = np.array([s.skewed for s in subjects])
    one_sided = np.array([s.one_sided for s in subjects])
    least, weight = np.array([[s.least, s.weight] for s in subjects]).T
    p, own, z = probabilities(observed, replicates, skewed, one_sided, least, settings=settings)
    groups = np.array([s.group for s in subjects])
    found, smallest = np.ones(p.size), []
    for name in dict.fromkeys(groups.tolist()):
        inside = groups == name
        strongest = np.min(own[:, inside] / weight[inside], axis=1)
        tests = effective(strongest) / SHARES[name]
        found[inside] = corrected(p[inside] / weight[inside], tests)
        smallest.append(corrected(strongest, tests))
    found = corrected(found, effective(np.min(smallest, axis=0)))
    rows = zip(subjects, z.tolist(), p.tolist(), found.tolist(), strict=True)
    tests_found = tuple(Statistic(s.kind, s.of, s.column, s.where, *values) for s, *values in rows)
    return Assessment(tests_found, float(found.min()), len(replicates))


def replicated(
    fit: Fit,
    battery: Battery,
    points: int,
    rng: np.random.Generator,
    settings: AssessmentSettings = ASSESSMENT,
) -> Iterator[Array]:
    """An endless stream of statistics (T,) of data drawn from the fitted model and refitted.

    With a small number of experiments alpha takes a second Newton step. After only one, the
    replicates are so far from their maxima that the experiments, which are at theirs, look
    improbable (10 % instead of 5 % false alarms at N = 15).
    """
    while True:
        other = stepped(fit.drawn(rng))
        fitted = stepped(other) if fit.count < settings.large else other
        yield battery.tests(residuals_of(fitted, points))[1]


def outliers_of(
    residuals: Residuals, table: Experiments, settings: AssessmentSettings = ASSESSMENT
) -> tuple[Outlier, ...]:
    """Observations that are improbably far out even for the farthest of M, the farthest first."""
    seen = table.observations
    p = np.where(residuals.finite, 2.0 * special.ndtr(-np.abs(residuals.normal)), 1.0)
    among = corrected(p, float(p.size))
    return tuple(
        Outlier(
            table.ids[seen.experiment[i]], int(seen.row[i]) + 1, seen.names[seen.response[i]],
            float(p[i]), float(among[i]),
        )
        for i in np.argsort(p, kind="stable")[: settings.named]
        if among[i] < REPORTED.level
    )  # fmt: skip


LIGHT = "fewer outcomes lie in the middle and far out than the law says: it may have two modes"
HEAVY_TAILED = "heavy-tailed noise: " + setting(
    '[noise] kind = "student_t"', "Noise(sd, StudentError(df=5))"
)
CORRELATED = setting('[noise] correlation = "ar1"', "Noise(sd, correlation=AR1())")
HEAVY = "more outcomes lie far out, and more in the middle, than the law says"


def discrepancy_of(
    test: Statistic, several: bool, within: Collection[str], measured: Collection[str] = ()
) -> Discrepancy:
    """A test that contradicts the model, as a sentence with a remedy.

    `several` says whether experiments have several observations. `within` are the columns that vary
    within an experiment, which no law can follow. `measured` are columns that may be results of the
    experiments rather than conditions.
    """
    if test.kind == "contrast":
        message, remedy = _contrast(test), (_curved if test.column in within else _mended)(test)
    else:
        message, remedy = _other(test, several)
    if test.column in measured and test.kind in ("contrast", "relation"):
        remedy += f"; or, if {test.column} is a result of the experiments, take it out of the table"
    return Discrepancy(test, message, remedy)


def _contrast(test: Statistic) -> str:
    if test.where is not None:
        place = f"at {test.where}"
    elif test.column == ORDER:
        place = "late in the table"
    else:
        place = f"under high `{test.column}`"
    up = test.z > 0.0
    if test.of == OUTCOMES:
        return f"outcomes {place} are {'larger' if up else 'smaller'} than the law says"
    if test.of == SCATTER:
        return f"outcomes {place} scatter {'more' if up else 'less'} than the law says"
    return f"experiments {place} ask for a {'larger' if up else 'smaller'} {test.of}"


def _followed(what: str, formula: str | None) -> str:
    """How the mean or the sd of a law follows a column."""
    return setting(f'{what} = "1 + {formula}"', f'{what}=By("1 + {formula}", lower, upper)')


def _named(column: str | None) -> str:
    """How the column is named that says which rows are one experiment."""
    return setting(f'[experiments] id = "{column}"', f'id="{column}"')


def _of_level(parameter: str, column: str | None) -> str:
    """How a shift of a parameter is shared by the experiments with one name in a column."""
    shared = f'Inputs(..., levels={{"{parameter}_shift": "{column}"}})'
    return setting(f'level = "{column}"', shared)


def _mended(test: Statistic) -> str:
    if test.column == ORDER:
        return (
            "something changed while the experiments were made: look for it, and give it a column "
            "that the simulator or a law follows"
        )
    if test.column == RESPONSE:
        return "give each response a noise of its own, or mend what the simulator says of it"
    formula = test.column if test.where is None else f"C({test.column})"
    if test.of == SCATTER:
        return (
            "let a noise that is fixed be identified, or differ with "
            f"{test.column} (a column of standard deviations), or the sd of a law follow it: "
            + _followed("sd", formula)
        )
    of = "the mean of a parameter" if test.of == OUTCOMES else test.of
    return (
        f"let {of} follow {test.column}: {_followed('mean', formula)}; or mend how the simulator "
        "depends on it"
    )


def _curved(test: Statistic) -> str:
    if test.of == SCATTER:
        return (
            f"let the noise differ with {test.column} (a column of standard deviations), or be "
            f"relative: {setting('[noise] relative', 'Noise(relative=...)')}"
        )
    return (
        f"the simulator depends on {test.column} in another way than the experiments: mend it, or "
        "let a constant of it be identified"
    )


def _other(test: Statistic, several: bool) -> tuple[str, str]:
    up, of, column = test.z > 0.0, test.of, test.column
    alike = "alike" if up else "opposite"
    match test.kind:
        case "level":
            return (
                f"outcomes are {'larger' if up else 'smaller'} than the law says, by and large",
                "let a mean that is fixed be identified, or mend the simulator, which is biased",
            )
        case "scale":
            return (
                f"outcomes scatter {'more' if up else 'less'} than the law and the noise say",
                "let the noise, or a standard deviation of a law, be identified; where all are, "
                f"let the noise differ by a column of standard deviations, or take {HEAVY_TAILED}",
            )
        case "heavy tails":
            pull = f"more experiments pull far, and more hardly, on {of} than the law says"
            return (
                HEAVY if of == OUTCOMES else pull,
                f"take {HEAVY_TAILED}, a law with heavier tails, or a column that tells apart what "
                "scatters more",
            )
        case "light tails":
            return (
                LIGHT
                if of == OUTCOMES
                else f"experiments pull alike far on {of} than the law says",
                "take a mixture as the law, or a column that tells two groups apart",
            )
        case "skewness":
            skewed = "choose a skewed law (lognormal, gamma, beta), or"
            if of == OUTCOMES:
                side = "above" if up else "below"
                message = f"outcomes lie farther {side} what is expected than the law says"
                return message, f"{skewed} the transform log"
            side = "up" if up else "down"
            message = f"single experiments pull {of} farther {side} than the law says"
            return message, f"{skewed} look at these experiments"
        case "outlier":
            return (
                "an outcome lies farther out than the law says",
                f"look at the outliers named; {HEAVY_TAILED}, or a skewed law, makes them likely",
            )
        case "unequal":
            whose = "experiments" if column == ORDER else f"outcomes of different `{column}`"
            whose = "outcomes under different conditions" if column == SAME else whose
            heavy = f", or take {HEAVY_TAILED}" if column == ORDER else ""
            return (
                f"{whose} scatter unequally, more than the law says",
                f"let the noise differ between them by a column of standard deviations{heavy}",
            )
        case "neighbours" if several:
            return (
                f"observations that follow each other in an experiment err {alike}",
                "the errors are not independent, or the simulator's curve has another shape: let "
                f"errors be correlated ({CORRELATED}), or mend the simulator",
            )
        case "neighbours":
            return (
                f"outcomes next to each other in the table are {alike}",
                "if they are of one subject, name the column that says which "
                f"({_named('...')}); else something changed while the experiments "
                "were made",
            )
        case "groups":
            where = "under the same conditions" if column == SAME else f"with the same `{column}`"
            whose = (
                "observations of the same experiment" if column == ORDER else f"outcomes {where}"
            )
            mended = "mend the simulator, whose curve has another shape than what was measured"
            subject = (
                "if their rows are of one subject, name the column that says which "
                f"({_named('...' if column == SAME else column)}); else mend the simulator, which "
                "is biased there"
            )
            message = f"{whose} err alike (all too high, or all too low), more than the law says"
            return message, mended if several else subject
        case "alike":
            return (
                f"{of} of experiments with the same `{column}` is alike, more than the law says",
                f"let a shift of {of} be shared by them, a parameter of that level "
                f"({_of_level(of, column)}); or let its mean follow the column: "
                + _followed("mean", f"C({column})"),
            )
        case "pair":
            return (
                f"{of} and {column} of single experiments differ "
                f"{'together' if up else 'in opposite directions'}, more than a law says that "
                "takes them as independent",
                "let them be correlated: "
                + setting(
                    f"[correlation] {of}.{column}",
                    f'Inputs(..., correlation={{("{of}", "{column}"): Free(-0.95, 0.95)}})',
                ),
            )
        case _:
            late, size = column == ORDER, "larger" if up else "smaller"
            place = "late in the table" if late else f"under high `{column}`"
            return (
                f"{of} of single experiments is {size} {place} than the law says",
                "look for what changed while the experiments were made"
                if late
                else f"let the mean of {of} follow {column}: {_followed('mean', column)}",
            )
