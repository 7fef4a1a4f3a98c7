"""Statistics of the residuals of a fit: one number for each test of consistency.

Residuals are normal scores of observations and scores of experiments. A `Battery` asks for their
shape, for what they depend on (`Contrasts` by column, `Relations` of individual parameters), and
for how alike neighbours and groups are.
"""

from __future__ import annotations

from collections.abc import Iterator
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
    """How statistics are made and weighted: by judgement, held against `benchmarks findings`."""

    nearest: float = 1e-15
    """Probabilities stay so far from zero and one: normal scores stay below eight."""
    values: int = 200_000
    """Simulated values by which all probabilities are computed, about."""
    least_points: int = 64
    """Points of an experiment, at least."""
    points: int = 256
    """Points of an experiment, at most, at first."""
    more: int = 4
    """Times as many points where too few probabilities are known."""
    times: int = 3
    """How often there are more points."""
    main: float = 3.0
    """The weight of the likeliest form of dependence on a column, its trend, among its parts."""
    hidden: float = 0.5
    """Shrinkage above which two parameters are not held against each other (Savic and Karlsson,
    2009).

    A standard deviation of nearly zero is estimated as zero in many replicates and not in others.
    The products of two parameters then scatter otherwise in these than where it was not.
    """
    least: float = 0.05
    """Sums over a column are taken to scatter at least so much: one that the law follows pins them.
    """
    scatter_least: float = 1e-9
    """Means that scatter less than this have no correlation."""
    pinned: float = 0.05
    """What the maximum itself pins is taken to scatter at least so much: mean, scale and contrasts.

    Where the standard deviation is identified the mean square of all residuals is nearly one, and
    where a law follows a column its scores add up to nothing in each part of it.
    """
    heavy: float = 4.0
    """The weight of heavy tails among the tests of shape: nothing else sees all of them."""
    squares: float = 1e-12
    """A mean square of an experiment below this is as large."""
    repeated: float = 0.7
    """A column is no sign of repeated subjects where it has more distinct values a row."""


BATTERY = BatterySettings()


@dataclass(frozen=True)
class AlarmShares:
    """The share of each group of tests in the false alarms, chosen by `benchmarks findings`.

    The groups are the shape of all residuals, their outcomes, their scatter, all together, and the
    individual parameters.
    """

    shape: float = 0.32
    outcomes: float = 0.30
    scatter: float = 0.28
    together: float = 0.06
    individual: float = 0.1


ALARMS = AlarmShares()


@dataclass(frozen=True, eq=False)
class Residuals:
    """The normal scores (M,) of observations, and the scores (N, K) of experiments by alpha.

    w = Phi^-1(P(below what was measured | earlier ones of the same experiment)): independent and
    standard normal under the right model. `finite` (M,) tells where the probability is one; w is
    zero elsewhere. `scores` are those of the hyperparameters that were identified; zero where an
    experiment has none. `means` (N, s) and `products` (N, s, s) are those of the variates of the
    individual parameters; s is zero where there is no noise. Experiments of which nothing was
    observed are left out.
    """

    normal: Array
    finite: Flags
    scores: Array
    means: Array
    products: Array


def points_of(fit: Fit, enough: float, settings: BatterySettings = BATTERY) -> int:
    """The points of each experiment by which a share `enough` of the probabilities is known."""
    each = settings.values // len(fit.table.observations)
    points = int(np.clip(each, settings.least_points, settings.points))
    for _ in range(settings.times):
        if np.mean(np.isfinite(fit.probabilities(points))) >= enough:
            break
        points *= settings.more
    return points


def residuals_of(fit: Fit, points: int, settings: BatterySettings = BATTERY) -> Residuals:
    """The residuals of a fit; one evaluation of its probabilities and one of its scores."""
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
    """Values of mean zero and mean square one; zeros where they do not scatter.

    A sum of products of independent ones scatters alike then, whatever their scale and tails.
    """
    left = values - values.mean()
    size = np.sqrt(np.mean(left**2))
    return np.asarray(left / size if size > 0.0 else left)


def scatter(w: Array) -> Array:
    """The measure of scatter log(1 + u^2) of each value, with u the standardized values.

    It sees scatter that differs as well as |u| does, and one far value counts little in it.
    """
    return np.asarray(np.log1p(standardized(w) ** 2))


def moments(w: Array) -> tuple[float, float, float]:
    """Skewness, and a measure of heavy tails with both signs: the negative one is of light tails.

    With u, the values but the farthest one over their size, skewness is the mean of u log(1 + u^2),
    and the tails are the cube root of log 2 - mean of log(1 + u^2), which is never negative. It
    sees Student's t as well as the likelihood ratio to a t law does
    (docs/statistics/consistency.md); two modes lower it. Of 11 to 300 normal values the root is
    normal down to p = 0.001, while without it p = 0.001 came four times as often of 27. One gross
    error is neither a skewed law nor heavy tails: the farthest value has a test of its own.
    """
    nearer = np.delete(w, np.argmax(np.abs(standardized(w))))
    u, far = standardized(nearer), scatter(nearer)
    heavy = float(np.cbrt(np.log(2.0) - np.mean(far)))
    return float(np.mean(u * far)), heavy, -heavy


@dataclass(frozen=True)
class Subject:
    """What a test is about: its group, the kind of statistic, and the part of the table.

    `of` is "outcomes", "scatter", or a hyperparameter. `column` is None where a test is about all
    observations; `where` names the part of the column, and is None for a trend along it. `weight`
    says how many times as many of the false alarms it may have as another test of its group, and
    `least` how far a right model's statistic is taken to scatter at least.
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
    """Weights (T, M) of observations, each of mean zero and length one, of these columns and parts.

    The sum of independent values of variance one has then the variance one. `main` tells those
    that weigh more: the trend along a condition, and the one contrast of a column of two values.
    """

    column: tuple[Column, ...]
    where: tuple[str | None, ...]
    main: tuple[bool, ...]
    weights: Array


def contrasts_of(columns: tuple[Column, ...], count: int) -> Contrasts:
    """Contrasts of all columns: trends of numbers, and each part against the rest.

    `count` is M, of a table without a column too.
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
    """How alike values of variance one are within groups.

    Only groups of two and more count; the mean is zero, whatever the sizes.
    """
    count = np.bincount(group)
    total, square = np.bincount(group, values), np.bincount(group, values**2)
    many = count > 1
    within = count[many] * (count[many] - 1.0)
    return float(np.sum(total[many] ** 2 - square[many]) / np.sqrt(2.0 * within.sum()))


INDIVIDUAL = "individual"
PAIR, COLUMN = "pair", "relation"
RELATED = (PAIR, COLUMN)
"""The kinds of its tests."""


@dataclass(frozen=True, eq=False)
class Relations:
    """Tests of the individual parameters: pairs of them, and each against the columns.

    `pairs` (P,) are the places of two that the law does not tie. `columns` (t,) are those that are
    one in each experiment, with centered ranks `ranks` (t, N) of length one.
    """

    names: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]
    columns: tuple[str, ...]
    ranks: Array
    settings: BatterySettings = BATTERY

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        pairs: tuple[tuple[int, int], ...],
        columns: tuple[Column, ...],
        first: Indices,
    ) -> Relations:
        """The tests of these parameters; `first` (N,) is an observation of each experiment."""
        own = [c for c in columns if c.by_experiment and c.ranks is not None]
        ranks = np.array([c.ranks[first] for c in own if c.ranks is not None])
        ranks = ranks.reshape(len(own), len(first))
        ranks = ranks - ranks.mean(axis=1, keepdims=True)
        return cls(names, pairs, tuple(c.name for c in own), ranks / _length(ranks))

    def tests(self, means: Array, products: Array) -> Iterator[tuple[Subject, float]]:
        """Each test with its statistic, of means (N, s) and mean products (N, s, s)."""
        main, least = self.settings.main, self.settings.least
        for i, j in self.pairs:
            subject = Subject(INDIVIDUAL, PAIR, self.names[i], self.names[j], weight=main)
            yield subject, products[:, i, j].mean()
        against = of_size_one(means).T @ self.ranks.T
        for name, values in zip(self.names, against, strict=False):
            for column, value in zip(self.columns, values, strict=True):
                yield Subject(INDIVIDUAL, COLUMN, name, column, least=least), value

    def correlations(self, means: Array, tests: list[Statistic]) -> tuple[Relation, ...]:
        """The correlations of individual means, each with the p of its test."""
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
    """Those of the pairs whose two parameters the observations determine.

    None where there are no such means (s = 0): outcomes without noise tell no single parameter.

    >>> means = np.array([[1.0, 0.2, 1.0], [-1.0, -0.2, 1.0], [1.0, 0.2, -1.0], [-1.0, -0.2, -1.0]])
    >>> apart(means, ((0, 1), (0, 2)))
    ((0, 2),)
    """
    if not means.shape[1]:
        return ()
    told = 1.0 - np.std(means, axis=0) <= settings.hidden
    return tuple((i, j) for i, j in pairs if told[i] and told[j])


def of_size_one(values: Array) -> Array:
    """Values (N, ...) over their root mean square.

    So it is where its law hardly scatters, and each individual parameter is nearly the mean.
    """
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


def _length(rows: Array, settings: BatterySettings = BATTERY) -> Array:
    """The lengths of the rows, as a column; one where a row is zero."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(length > settings.scatter_least, length, 1.0)


SHAPE, OUTCOMES, SCATTER, TOGETHER = "shape", "outcomes", "scatter", "together"
SHARES = {
    SHAPE: ALARMS.shape, OUTCOMES: ALARMS.outcomes, SCATTER: ALARMS.scatter,
    TOGETHER: ALARMS.together, INDIVIDUAL: ALARMS.individual,
}  # fmt: skip
"""Share of each group of tests, by its name, in the false alarms."""
SAME = "the same conditions"
SHAPES = ("level", "scale", "skewness", "heavy tails", "light tails", "outlier")
"""The kinds of tests that are about all residuals, or all scores, together."""


@dataclass(frozen=True, eq=False)
class Battery:
    """All tests of a table with these columns.

    `experiment` (M,) is that of each observation. `names` (F,) are the hyperparameters of the
    scores. `groups` are those by which observations may be repeated, by the name of their column.
    `ordered` tells whether neighbours mean anything: those of an experiment, or of a table that was
    not sorted.
    `relations` are asked of experiments with several observations.
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
    ) -> Battery:
        """The battery of a table; no law ties the `pairs` of scattering `parameters`."""
        first = np.unique(experiment, return_index=True)[1]
        several = len(first) < len(experiment)
        ordered = any(c.name == ORDER for c in columns) or several
        contrasts = contrasts_of(columns, experiment.size)
        asked = (parameters, pairs) if several else ((), ())
        relations = Relations.of(*asked, columns, first)
        return cls(contrasts, experiment, names, _groups(columns), ordered, relations)

    @cached_property
    def several(self) -> bool:
        """Whether experiments have several observations."""
        return bool(self.experiment.size > self.experiment[-1] + 1)

    def tests(self, residuals: Residuals) -> tuple[tuple[Subject, ...], Array]:
        """The subjects of all tests and their statistics (T,), NaN where one is undefined."""
        level = standardized(residuals.normal)
        spread = standardized(scatter(residuals.normal))
        found = [*self._shape(residuals), *self._along_columns(residuals, level, spread)]
        found += self._together(level, spread)
        found += self.relations.tests(residuals.means, residuals.products)
        return tuple(subject for subject, _ in found), np.array([value for _, value in found])

    def _shape(self, residuals: Residuals) -> Iterator[tuple[Subject, float]]:
        """The shape of all residuals, and of the scores of location hyperparameters."""
        w, pinned = residuals.normal[residuals.finite], self.settings.pinned
        yield Subject(SHAPE, "level", OUTCOMES, least=pinned), w.mean()
        yield Subject(SHAPE, "scale", SCATTER, least=pinned), np.log(np.mean(w**2))
        yield from self._moments(OUTCOMES, w)
        # as far as the model says: the outliers that are named are those of this test
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
        """Scores by contrasts of whole experiments, levels by all others, scatter by all."""
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
        """Contrasts of some columns; those of scatter are skewed, and have no main form."""
        skewed, pinned = group == SCATTER, self.settings.pinned
        for i, value in zip(np.flatnonzero(which), values, strict=True):
            column, where = self.contrasts.column[i].name, self.contrasts.where[i]
            weight = self.settings.main if self.contrasts.main[i] and not skewed else 1.0
            yield (
                Subject(group, "contrast", of, column, where, skewed, weight=weight, least=pinned),
                value,
            )

    def _together(self, level: Array, spread: Array) -> Iterator[tuple[Subject, float]]:
        """How alike neighbours and members of each group are, in level and in scatter."""
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
        """Which contrasts are of whole experiments, and are held against scores."""
        own = [self.several and column.by_experiment for column in self.contrasts.column]
        return np.array(own, dtype=np.bool_)

    @cached_property
    def _rows(self) -> Array:
        """The contrasts (t, M) of single observations."""
        return self.contrasts.weights[~self._whole]

    @cached_property
    def _own(self) -> Array:
        """The contrasts (t, N) of whole experiments."""
        first = np.unique(self.experiment, return_index=True)[1]
        weights = self.contrasts.weights[self._whole][:, first]
        return np.asarray(weights - weights.mean(axis=1, keepdims=True))

    def _unequal(self, level: Array) -> float:
        """How unequal experiments scatter (after Bartlett, 1937)."""
        count = np.bincount(self.experiment)
        square = np.bincount(self.experiment, level**2)[count > 1] / count[count > 1]
        size = np.log(np.maximum(square, self.settings.squares))
        return -float(np.average(size, weights=count[count > 1]))


def is_scale(name: str) -> bool:
    """Whether a hyperparameter says how far values scatter, by its name.

    >>> is_scale("x.sd"), is_scale("noise.torque.sd"), is_scale("x.mean")
    (True, True, False)
    """
    return name.startswith("noise.") or any(part.startswith("sd") for part in name.split("."))


def _groups(columns: tuple[Column, ...], settings: BatterySettings = BATTERY) -> dict[str, Indices]:
    """Groups of rows with the same value of a column, or of all numbers together."""
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
