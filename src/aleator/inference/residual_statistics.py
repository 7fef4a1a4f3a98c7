"""Statistics of the residuals of a fit: one number for each test of consistency.

Residuals are the normal scores of observations and the likelihood scores of experiments. A
`Battery` is the set of tests for one table. It tests the shape of the residuals, their dependence
on columns (`Contrasts`), relations of individual parameters (`Relations`), and the similarity of
neighbours and of groups.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags, Indices
from aleator.inference.fit import Fit
from aleator.inference.table_columns import COLUMNS, ORDER, Column
from aleator.results.values import Relation, Statistic


@dataclass(frozen=True)
class BatterySettings:
    """Settings of the test statistics, chosen by judgement and tested by `benchmarks findings`."""

    nearest: float = 1e-15
    """Distance of probabilities from zero and one, so that normal scores stay below eight."""
    values: int = 200_000
    """Approximate number of simulated values by which all probabilities are computed."""
    least_points: int = 64
    """Least number of parameter points by which an experiment's probabilities are computed."""
    points: int = 256
    """Largest number of these parameter points of an experiment, before it is increased."""
    more: int = 4
    """Factor on the number of points where not enough probabilities can be computed."""
    times: int = 3
    """Largest number of times that the number of points is increased."""
    main: float = 3.0
    """Weight of the most probable form of dependence on a column, its trend, among its tests."""
    hidden: float = 0.5
    """Shrinkage above which a parameter is not tested for correlation (Savic and Karlsson, 2009).

    Shrinkage is one minus the standard deviation of the individual means, in units of the law. With
    a standard deviation near zero, the estimate is zero in many replicates but not in others, and
    products of two parameters have different scatter in these cases.
    """
    least: float = 0.05
    """Least standard deviation that is assumed for a sum over a column. Where a law follows the
    column, the fit makes the sum nearly constant.
    """
    scatter_least: float = 1e-9
    """Root mean square below which means have no correlation."""
    pinned: float = 0.05
    """Least standard deviation that is assumed for statistics that the fit makes nearly constant.

    These are mean, scale and contrasts. Where a standard deviation is identified, the mean square
    of all residuals is nearly one. Where a law follows a column, the scores in each part of the
    column sum to nearly zero.
    """
    heavy: float = 4.0
    """Weight of heavy tails among the tests of shape, because no other test detects all of them."""
    squares: float = 1e-12
    """Least mean square of an experiment's residuals; smaller ones are raised to it."""
    repeated: float = 0.7
    """Largest ratio of distinct values to rows for which a column may identify repeated subjects.
    """


BATTERY = BatterySettings()


@dataclass(frozen=True)
class AlarmShares:
    """Settings of false alarms: the share of each group of tests, chosen by `benchmarks findings`.

    The groups test the shape of all residuals, the outcomes and the scatter by columns, the
    similarity of neighbours and groups (`together`), and the individual parameters.
    """

    shape: float = 0.32
    outcomes: float = 0.30
    scatter: float = 0.28
    together: float = 0.06
    individual: float = 0.1


ALARMS = AlarmShares()


@dataclass(frozen=True, eq=False)
class Residuals:
    """The normal scores (M,) of observations, and the likelihood scores (N, K) of experiments.

    The normal scores are w = Phi^-1(P(value below the measured one | earlier ones of its
    experiment)). Under the right model they are independent and standard normal. `finite` (M,) says
    where this probability could be computed; w is zero elsewhere. `scores` belong to the identified
    hyperparameters, and are zero where an experiment has none. `means` (N, s) and `products` (N, s,
    s) are the means and mean products of the normal variates of the individual parameters; s is
    zero without noise. Experiments without observations are left out.
    """

    normal: Array
    finite: Flags
    scores: Array
    means: Array
    products: Array


def points_of(fit: Fit, enough: float, settings: BatterySettings = BATTERY) -> int:
    """Points of each experiment with which the share `enough` of probabilities is known."""
    each = settings.values // len(fit.table.observations)
    points = int(np.clip(each, settings.least_points, settings.points))
    for _ in range(settings.times):
        if np.mean(np.isfinite(fit.probabilities(points))) >= enough:
            break
        points *= settings.more
    return points


def residuals_of(fit: Fit, points: int, settings: BatterySettings = BATTERY) -> Residuals:
    """The residuals of a fit; cost: one evaluation of its probabilities and one of its scores."""
    u = fit.probabilities(points)
    known = np.isfinite(u)
    inside = np.clip(np.where(known, u, 0.5), settings.nearest, 1.0 - settings.nearest)
    scores = fit.scored().scores
    assert scores is not None
    observed = np.unique(fit.table.observations.experiment)
    scores = scores[np.ix_(observed, fit.inference.free)]
    nothing = np.zeros((fit.count, 0)), np.zeros((fit.count, 0, 0))
    means, products = fit.likelihood.variates() or nothing
    scores = np.where(np.isfinite(scores), scores, 0.0)
    return Residuals(special.ndtri(inside), known, scores, means[observed], products[observed])


def standardized(values: Array) -> Array:
    """Values scaled to mean zero and mean square one; zeros where they do not scatter.

    The sum of products of independent standardized values then has the same scatter, whatever the
    original scale and tails.
    """
    left = values - values.mean()
    size = np.sqrt(np.mean(left**2))
    return np.asarray(left / size if size > 0.0 else left)


def scatter(w: Array) -> Array:
    """The measure of scatter log(1 + u^2) of each value, where u are the standardized values.

    It detects differences in scatter as well as |u| does, and is less sensitive to single far
    values.
    """
    return np.asarray(np.log1p(standardized(w) ** 2))


def moments(w: Array) -> tuple[float, float, float]:
    """The skewness, a measure of heavy tails, and the negative of this, a measure of light tails.

    Let u be the standardized values without the farthest one. Skewness is the mean of u log(1 +
    u^2), and the measure of heavy tails is the cube root of log 2 - mean of log(1 + u^2), which is
    largest for heavy tails. It detects Student's t law as well as the likelihood ratio to a t law
    does (docs/statistics/consistency.md); two modes lower it. For 11 to 300 normal values the cube
    root is normal down to p = 0.001; without the root, p = 0.001 occurred four times as often with
    27 values. The farthest value is left out since one gross error is neither a skewed law nor
    heavy tails; it has its own test.
    """
    nearer = np.delete(w, np.argmax(np.abs(standardized(w))))
    u, far = standardized(nearer), scatter(nearer)
    heavy = float(np.cbrt(np.log(2.0) - np.mean(far)))
    return float(np.mean(u * far)), heavy, -heavy


@dataclass(frozen=True)
class Subject:
    """What a test is about: its group, the kind of statistic, and the part of the table.

    `of` is "outcomes", "scatter", or a hyperparameter. `column` is None where a test is about all
    observations. `where` names the part of the column, and is None for a trend along it. `skewed`
    says that the statistic's law is skewed, and `one_sided` that only large values contradict the
    model. `weight` is the test's share of the false alarms, relative to other tests of its group.
    `least` is the least standard deviation that is assumed for the statistic under the right model.
    """

    group: str
    kind: str
    of: str
    column: str | None = None
    where: str | None = None
    skewed: bool = False
    one_sided: bool = False
    weight: float = 1.0
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class Contrasts:
    """Contrasts: weights (T, M) of observations, each of mean zero and length one.

    The weighted sum of independent values of variance one therefore has the variance one. `column`
    and `where` name the column and the part of each contrast. `main` says which contrasts have a
    larger weight among the tests: the trend along a condition, and the contrast of a column of two
    values.
    """

    column: tuple[Column, ...]
    where: tuple[str | None, ...]
    main: tuple[bool, ...]
    weights: Array


def contrasts_of(columns: tuple[Column, ...], count: int) -> Contrasts:
    """Contrasts of all columns: trends of columns of numbers, and each part against the rest.

    `count` is the number M of observations, which is needed where there is no column.
    """
    found = [(column, where, weight) for column in columns for where, weight in _of_column(column)]
    main = [c.name != ORDER and (where is None or c.count == 2) for c, where, _ in found]
    return Contrasts(
        tuple(column for column, _, _ in found),
        tuple(where for _, where, _ in found),
        tuple(main),
        np.array([weight for _, _, weight in found]).reshape(len(found), count),
    )


def _of_column(column: Column) -> Iterator[tuple[str | None, Array]]:
    if column.ranks is not None:
        yield None, column.ranks / np.linalg.norm(column.ranks)
    if column.count == 2 and column.ranks is not None:
        return
    known = column.level >= 0
    parts = range(1, 2) if len(column.labels) == 2 else range(len(column.labels))
    if column.name == ORDER:
        return
    for part in parts:
        inside = column.level == part
        if min(inside.sum(), known.sum() - inside.sum()) < COLUMNS.fewest:
            continue
        weight = np.where(known, inside - inside.sum() / known.sum(), 0.0)
        yield column.labels[part], weight / np.linalg.norm(weight)


def shared(group: Indices, values: Array) -> float:
    """A measure of how similar values of variance one are within groups.

    Only groups of at least two values count. The expected value for independent values is zero,
    whatever the sizes of the groups.
    """
    count = np.bincount(group)
    total, square = np.bincount(group, values), np.bincount(group, values**2)
    many = count > 1
    within = count[many] * (count[many] - 1.0)
    return float(np.sum(total[many] ** 2 - square[many]) / np.sqrt(2.0 * within.sum()))


INDIVIDUAL = "individual"
PAIR, COLUMN, ALIKE = "pair", "relation", "alike"
RELATED = (PAIR, COLUMN)
"""The kinds of tests of individual parameters that are correlations."""


@dataclass(frozen=True, eq=False)
class Relations:
    """Tests of the individual parameters: of pairs, of each along a column, and within groups.

    `pairs` (P,) are the indices of pairs of parameters that are independent under the law.
    `columns` (t,) are columns that are constant within each experiment; their centered ranks
    `ranks` (t, N) have length one. `groups` has the group (N,) of each experiment by columns of
    names, such as those of batches, and `differing` are the parameters that differ within them.
    """

    names: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]
    columns: tuple[str, ...]
    ranks: Array
    groups: Mapping[str, Indices]
    differing: tuple[str, ...]
    settings: BatterySettings = BATTERY

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        pairs: tuple[tuple[int, int], ...],
        columns: tuple[Column, ...],
        first: Indices,
        levels: Collection[str],
    ) -> Relations:
        """The tests of these parameters; `first` (N,) is one observation of each experiment.

        The parameters `levels` are the same within groups, and are not tested for it.
        """
        own = [c for c in columns if c.by_experiment and c.ranks is not None]
        ranks = np.array([c.ranks[first] for c in own if c.ranks is not None])
        ranks = ranks.reshape(len(own), len(first))
        ranks = ranks - ranks.mean(axis=1, keepdims=True)
        groups = {
            c.name: c.group[first] for c in columns
            if c.by_experiment and c.ranks is None and c.count <= BATTERY.repeated * len(first)
        }  # fmt: skip
        differing = tuple(name for name in names if name not in levels)
        unit = ranks / _length(ranks)
        return cls(names, pairs, tuple(c.name for c in own), unit, groups, differing)

    def tests(self, means: Array, products: Array) -> Iterator[tuple[Subject, float]]:
        """Each test with its statistic, from the means (N, s) and mean products (N, s, s)."""
        main, least = self.settings.main, self.settings.least
        for i, j in self.pairs:
            subject = Subject(INDIVIDUAL, PAIR, self.names[i], self.names[j], weight=main)
            yield subject, products[:, i, j].mean()
        scaled = of_size_one(means).T
        for name, values in zip(self.names, scaled @ self.ranks.T, strict=False):
            for column, value in zip(self.columns, values, strict=True):
                yield Subject(INDIVIDUAL, COLUMN, name, column, least=least), value
        differing = [(n, own) for n, own in zip(self.names, scaled, strict=False)
                     if n in self.differing]  # fmt: skip
        for column, group in self.groups.items():
            for name, own in differing:
                subject = Subject(INDIVIDUAL, ALIKE, name, column, skewed=True, one_sided=True,
                                  weight=main, least=least)  # fmt: skip
                yield subject, shared(group, own)

    def correlations(self, means: Array, tests: list[Statistic]) -> tuple[Relation, ...]:
        """The correlations of individual means, each with the p value of its test."""
        if not tests:
            return ()
        centered = means - means.mean(axis=0)
        scaled = centered / _length(centered.T).T
        within, against = scaled.T @ scaled, scaled.T @ self.ranks.T
        found = [within[i, j] for i, j in self.pairs] + against.ravel().tolist()
        return tuple(
            Relation(test.of, str(test.column), test.kind == PAIR, float(value), test.p)
            for value, test in zip(found, tests, strict=True)
        )


def apart(
    means: Array, pairs: tuple[tuple[int, int], ...], settings: BatterySettings = BATTERY
) -> tuple[tuple[int, int], ...]:
    """The pairs of parameters that are both determined by the observations.

    There are none without noise (s = 0): an exact outcome does not determine a single parameter.

    >>> means = np.array([[1.0, 0.2, 1.0], [-1.0, -0.2, 1.0], [1.0, 0.2, -1.0], [-1.0, -0.2, -1.0]])
    >>> apart(means, ((0, 1), (0, 2)))
    ((0, 2),)
    """
    if not means.shape[1]:
        return ()
    told = 1.0 - np.std(means, axis=0) <= settings.hidden
    return tuple((i, j) for i, j in pairs if told[i] and told[j])


def of_size_one(values: Array) -> Array:
    """Values (N, ...) divided by their root mean square.

    Scores and individual means are scaled in this way, because they all become small together where
    a law hardly scatters.
    """
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


def _length(rows: Array, settings: BatterySettings = BATTERY) -> Array:
    """The lengths of the rows as a column; one where a row is zero."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(length > settings.scatter_least, length, 1.0)


SHAPE, OUTCOMES, SCATTER, TOGETHER = "shape", "outcomes", "scatter", "together"
SHARES = {
    SHAPE: ALARMS.shape, OUTCOMES: ALARMS.outcomes, SCATTER: ALARMS.scatter,
    TOGETHER: ALARMS.together, INDIVIDUAL: ALARMS.individual,
}  # fmt: skip
"""The share of each group of tests, by its name, in the false alarms."""
SAME = "the same conditions"
SHAPES = ("level", "scale", "skewness", "heavy tails", "light tails", "outlier")
"""The kinds of tests that concern all residuals, or all scores, together."""


@dataclass(frozen=True, eq=False)
class Battery:
    """The set of all consistency tests for a table with given columns.

    `experiment` (M,) is the experiment of each observation. `names` (F,) are the hyperparameters of
    the scores. `groups` are the groups of rows in which subjects may be repeated, by the name of
    their column. `ordered` says whether neighbouring observations are tested: those of an
    experiment, or of a table that was not sorted. `relations` are tested where experiments have
    several observations.
    """

    contrasts: Contrasts
    experiment: Indices
    names: tuple[str, ...]
    groups: dict[str, Indices]
    ordered: bool
    relations: Relations
    settings: BatterySettings = BATTERY

    @classmethod
    def of(
        cls,
        columns: tuple[Column, ...],
        experiment: Indices,
        names: tuple[str, ...],
        parameters: tuple[str, ...] = (),
        pairs: tuple[tuple[int, int], ...] = (),
        levels: Collection[str] = (),
    ) -> Battery:
        """The set of tests; the law takes these `pairs` of the `parameters` as independent.

        The parameters `levels` are the same in all experiments of a group by the law.
        """
        first = np.unique(experiment, return_index=True)[1]
        several = len(first) < len(experiment)
        ordered = any(c.name == ORDER for c in columns) or several
        contrasts = contrasts_of(columns, experiment.size)
        asked = (parameters, pairs) if several else ((), ())
        relations = Relations.of(*asked, columns, first, levels)
        return cls(contrasts, experiment, names, _groups(columns), ordered, relations)

    @cached_property
    def several(self) -> bool:
        """Whether some experiments have several observations."""
        return bool(self.experiment.size > self.experiment[-1] + 1)

    def tests(self, residuals: Residuals) -> tuple[tuple[Subject, ...], Array]:
        """The subjects of all tests and their statistics (T,); NaN where one is undefined."""
        level = standardized(residuals.normal)
        spread = standardized(scatter(residuals.normal))
        found = [*self._shape(residuals), *self._along_columns(residuals, level, spread)]
        found += self._together(level, spread)
        found += self.relations.tests(residuals.means, residuals.products)
        return tuple(subject for subject, _ in found), np.array([value for _, value in found])

    def _shape(self, residuals: Residuals) -> Iterator[tuple[Subject, float]]:
        """Tests of the shape of all residuals, and of the scores of location hyperparameters."""
        w, pinned = residuals.normal[residuals.finite], self.settings.pinned
        yield Subject(SHAPE, "level", OUTCOMES, least=pinned), w.mean()
        yield Subject(SHAPE, "scale", SCATTER, least=pinned), np.log(np.mean(w**2))
        yield from self._moments(OUTCOMES, w)
        # This test uses the model's own probabilities, like the outliers that are named.
        farthest = -special.log_ndtr(-np.abs(w).max())
        yield Subject(SHAPE, "outlier", OUTCOMES, skewed=True, one_sided=True), farthest
        for name, scores in zip(self.names, residuals.scores.T, strict=True):
            located = name.split(".")[0] in self.relations.names and not is_scale(name)
            if self.several and located:
                yield from self._moments(name, scores[scores != 0.0])

    def _moments(self, of: str, w: Array) -> Iterator[tuple[Subject, float]]:
        skewness, heavy, light = moments(w)
        yield Subject(SHAPE, "skewness", of), skewness
        yield Subject(SHAPE, "heavy tails", of, one_sided=True, weight=self.settings.heavy), heavy
        yield Subject(SHAPE, "light tails", of, one_sided=True), light

    def _along_columns(
        self, residuals: Residuals, level: Array, spread: Array
    ) -> Iterator[tuple[Subject, float]]:
        """Tests of the dependence on columns.

        The scores of experiments are tested against columns that are constant within each
        experiment, the level of observations against all other columns, and the scatter against all
        columns.
        """
        if self.several:
            against = of_size_one(residuals.scores).T @ self._own.T
            for name, values in zip(self.names, against, strict=True):
                group = SCATTER if is_scale(name) else OUTCOMES
                yield from self._contrasts(self._whole, group, name, values)
        yield from self._contrasts(~self._whole, OUTCOMES, OUTCOMES, self._rows @ level)
        every = np.ones_like(self._whole)
        yield from self._contrasts(every, SCATTER, SCATTER, self.contrasts.weights @ spread)

    def _contrasts(
        self, which: Flags, group: str, of: str, values: Array
    ) -> Iterator[tuple[Subject, float]]:
        """Tests of the contrasts `which`; those of scatter are skewed and equally weighted."""
        skewed, pinned = group == SCATTER, self.settings.pinned
        for i, value in zip(np.flatnonzero(which), values, strict=True):
            column, where = self.contrasts.column[i].name, self.contrasts.where[i]
            weight = self.settings.main if self.contrasts.main[i] and not skewed else 1.0
            yield (
                Subject(group, "contrast", of, column, where, skewed, weight=weight, least=pinned),
                value,
            )

    def _together(self, level: Array, spread: Array) -> Iterator[tuple[Subject, float]]:
        """Tests of the similarity of neighbours, and of group members in level and scatter."""
        pinned = self.settings.pinned
        if self.ordered:
            pairs = level[1:] * level[:-1]
            if self.several:
                pairs = pairs[np.diff(self.experiment) == 0]
            alike = np.sum(pairs) / np.sqrt(max(pairs.size, 1))
            yield Subject(TOGETHER, "neighbours", OUTCOMES, skewed=True), alike
        for name, members in self.groups.items():
            for group, kind, of, values in (
                (TOGETHER, "groups", OUTCOMES, level), (SCATTER, "unequal", SCATTER, spread),
            ):  # fmt: skip
                yield (
                    Subject(group, kind, of, name, skewed=True, one_sided=True, least=pinned),
                    shared(members, values),
                )
        if self.several:
            yield Subject(SCATTER, "unequal", SCATTER, ORDER, one_sided=True), self._unequal(level)

    @cached_property
    def _whole(self) -> Flags:
        """Which contrasts belong to columns that are constant within each experiment."""
        own = [self.several and column.by_experiment for column in self.contrasts.column]
        return np.array(own, dtype=np.bool_)

    @cached_property
    def _rows(self) -> Array:
        """The contrasts (t, M) that are applied to single observations."""
        return self.contrasts.weights[~self._whole]

    @cached_property
    def _own(self) -> Array:
        """The contrasts (t, N) that are applied to the scores of experiments."""
        first = np.unique(self.experiment, return_index=True)[1]
        weights = self.contrasts.weights[self._whole][:, first]
        return np.asarray(weights - weights.mean(axis=1, keepdims=True))

    def _unequal(self, level: Array) -> float:
        """A measure of how unequally the experiments scatter (after Bartlett, 1937)."""
        count = np.bincount(self.experiment)
        square = np.bincount(self.experiment, level**2)[count > 1] / count[count > 1]
        size = np.log(np.maximum(square, self.settings.squares))
        return -float(np.average(size, weights=count[count > 1]))


def is_scale(name: str) -> bool:
    """Whether a hyperparameter is a measure of scatter, judged by its name.

    >>> is_scale("x.sd"), is_scale("noise.torque.sd"), is_scale("x.mean")
    (True, True, False)
    """
    return name.startswith("noise.") or any(part.startswith("sd") for part in name.split("."))


def _groups(columns: tuple[Column, ...], settings: BatterySettings = BATTERY) -> dict[str, Indices]:
    """Groups of rows with the same value of a column, or of all columns of numbers together."""
    size = columns[0].group.size if columns else 0
    many = {
        c.name: c.group for c in columns if COLUMNS.levels < c.count <= settings.repeated * size
    }
    rows = [c.group for c in columns if c.ranks is not None and c.name != ORDER]
    if len(rows) > 1:
        together = np.unique(np.stack(rows, axis=1), axis=0, return_inverse=True)[1].ravel()
        if COLUMNS.levels < together.max() + 1 <= settings.repeated * size:
            many[SAME] = together
    return many
