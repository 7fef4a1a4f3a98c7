"""Gaussian processes over conditions and parameters that learn from the runs of all experiments.

One run of the simulator gives the values of all columns of its output. Each column has a process
(module `kriging`) over the conditions of all experiments. With very many runs, the experiments are
divided into groups of similar conditions; the groups of a column share its covariance, and each is
conditioned on its own runs. For each output a polynomial of the parameters is fitted to the mean of
the process. The polynomials are what a likelihood uses (a `Surface`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Flags, Indices
from aleator.surrogates.fit import clustered, fixed_shift, low_discrepancy, merged, outcome_range
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, learned
from aleator.surrogates.surface import (
    Axes,
    Surface,
    ball,
    logarithms,
    outcomes,
    products,
    widened,
)

Runs = Callable[[Indices, Array], tuple[Array, Array]]
"""A function that returns all values (R, W) of cases (R,) at points x (R, n); NaN for failures. It
also returns their slopes (R, W, n); NaN where they are not known."""


@dataclass(frozen=True)
class ProcessesSettings:
    """Settings of the processes of all outputs. The values are chosen by judgement."""

    first: int = 3
    """The number of first runs of each case."""
    least: int = 6
    """The first runs of all cases together are at least this many for each input of a process, and
    for its mean."""
    decade: float = 10.0
    """Logarithms of values are tried where the largest exceeds the smallest by this factor."""
    beyond: float = 3.0
    """An outcome counts as impossible only if it lies beyond the range of its polynomial by more
    than this many errors."""
    together: int = 1600
    """The largest number of runs of one group of experiments, when the groups are made."""
    values: int = 2400
    """The largest number of values and slopes of the runs of one group. The slopes of the earliest
    runs are left out."""
    compared: int = 30
    """The number of last new values that are compared with what is expected with slopes and without
    them."""
    agreeing: float = 0.33
    """Slopes are left out if fewer than this share of these values lie as near to what is expected
    with them."""
    expected: int = 12
    """The number of runs of each experiment that is expected when the groups are made."""
    near: float = 2.0
    """Runs count within this many times the half width of the region about its middle."""
    most: int = 500
    """The largest number of terms of the polynomials."""
    missed: float = 0.2
    """The number of terms is doubled until a polynomial misses the mean of its process by less than
    this share of the process' standard deviation."""
    slowest: float = 0.3
    """The degree of polynomials in a parameter is at least this share of the largest degree."""
    exact: float = 1e-3
    """A misfit below this share of the scatter of the outcome does not count."""
    points: float = 2.5
    """The number of points for each term, to which a polynomial is fitted."""
    ridge: float = 1e-3
    """Weight of the penalty on the size of a polynomial's terms, relative to one point of the fit.
    """
    again: float = 1.2
    """Covariances are fitted again when the number of runs in the region has grown by this factor.
    With fits after a fall, too, which rest on few runs, the series of two compartments took twice
    as many runs (`python -m benchmarks.emulators`)."""
    block: int = 4_000_000
    """The largest number of covariances that are computed at a time: 32 MB."""
    judged: int = 16
    """The number of points at which the error of each output is estimated."""


PROCESSES = ProcessesSettings()


@dataclass(frozen=True)
class _Grouped:
    """The outputs of one column for experiments of similar conditions, with their process.

    If `logarithm` is true, the process is that of the logarithms of the values. If runs have
    slopes, `plain` is the process that learns from the values alone.
    """

    sites: Indices
    column: int
    cases: Indices
    posterior: ProcessPosterior
    logarithm: bool
    plain: ProcessPosterior | None = None

    def transformed(self, y: Array) -> Array:
        """The values y (R,) on the scale of the process; NaN where they have no logarithm."""
        return np.asarray(np.log(np.where(y > 0.0, y, np.nan))) if self.logarithm else y

    def of_sums(
        self, case: Indices, u: Array, weights: Array, part: Indices
    ) -> tuple[Array, Array]:
        """Posterior covariance of sums of values at u (R, D) times weights (R, K).

        Returns that of all values (K, K), and those of each part of them (P, K, K).
        """
        if self.logarithm:
            weights = weights * np.exp(self.posterior.mean(case, u))[:, None]
        return self.posterior.of_sums(case, u, weights, part)


@dataclass(frozen=True)
class ProcessMeans:
    """The expected values of all outputs as functions of the parameters.

    `case` (U,) is the case of each output, and `conditions` (C, d) are the conditions of the cases.
    """

    groups: tuple[_Grouped, ...]
    case: Indices
    conditions: Array
    axes: Axes
    settings: ProcessesSettings = PROCESSES

    def values(self, site: Indices, x: Array) -> Array:
        """Expected values (A, J) of outputs (A,) at points x (A, J, n); O(A J M) for M runs."""
        out = np.empty(x.shape[:2])
        for group, part, case, u in self._parts(site, x):
            value = group.posterior.mean(case, u)
            if group.logarithm:
                value = outcomes(value[None], np.array([True]))[0]
            out[part] = value.reshape(part.size, -1)
        return out

    def with_slopes(self, site: Indices, x: Array) -> tuple[Array, Array]:
        """Expected values (A, J) of outputs (A,) at points x (A, J, n), and slopes (n, A, J).

        Cost: O(A J M) for M runs of a group of experiments.
        """
        values, slopes = np.empty(x.shape[:2]), np.empty(x.shape)
        for group, part, case, u in self._parts(site, x):
            value, slope = group.posterior.with_slope(case, u)
            if group.logarithm:
                value = outcomes(value[None], np.array([True]))[0]
                slope *= value[:, None]
            values[part] = value.reshape(part.size, -1)
            slopes[part] = slope.reshape(part.size, *x.shape[1:])
        return values, np.moveaxis(slopes * self.axes.rates(x), 2, 0)

    def _parts(self, site: Indices, x: Array) -> Iterator[tuple[_Grouped, Indices, Indices, Array]]:
        """Outputs of a group that fit into memory: numbers, and cases and inputs of points."""
        z, (nodes, n) = self.axes.inward(x), x.shape[1:]
        for group in self.groups:
            rows = np.flatnonzero(np.isin(site, group.sites))
            width = nodes * len(group.posterior.dual)
            for some in blocks(rows.size, width, self.settings.block):
                part = rows[some]
                case = np.repeat(self.case[site[part]], nodes)
                yield group, part, case, np.hstack([self.conditions[case], z[part].reshape(-1, n)])


class Processes:
    """The processes of U outputs with their runs; every run is kept.

    `run` makes runs of cases (distinct conditions). `conditions` (C, d) are the conditions of the
    cases in [-1, 1]. Output u is the value of column[u] under the conditions of case[u]. `box`
    (n, 2) is the region of the parameters. Values of a column beyond its `limits` count as these.
    `sloped` says whether runs give slopes; they are left out once they contradict the values
    (`contradicted`).
    """

    def __init__(
        self,
        run: Runs,
        box: Array,
        conditions: Array,
        case: Indices,
        column: Indices,
        limits: Mapping[int, tuple[float, float]] | None = None,
        sloped: bool = False,
        settings: ProcessesSettings = PROCESSES,
    ) -> None:
        self.run, self.axes, self.conditions = run, Axes.plain(box), conditions
        self.limits, self.sloped = limits or {}, sloped
        self.case, self.column, self.settings = case, column, settings
        self.of_run, self.x = np.empty(0, dtype=np.intp), np.empty((0, len(box)))
        self.y, self.slopes = np.empty((0, 0)), np.empty((0, 0, len(box)))
        self.clusters = _clusters(conditions, settings.together // settings.expected)
        n, inputs = len(box), conditions.shape[1] + len(box)
        first = tuple(Covariance.first(inputs, n, kind) for kind in (False, True))
        self.columns = np.unique(column).tolist()
        self.covariances = {
            (scaled, c, log): first
            for scaled in (False, True) for c in self.columns for log in (False, True)
        }  # fmt: skip
        self.scaled, self.logarithm = False, dict.fromkeys(self.columns, False)
        self.steps = PROCESS.steps[0]
        self.terms, self.fitted = 0, 0
        self.missed, self.contradicted = np.empty((0, 2)), False
        self.alone: dict[int, Covariance] = {}
        self.groups: list[_Grouped] = []

    @property
    def box(self) -> Array:
        """The region of the parameters, lower and upper limits (n, 2)."""
        return self.axes.box

    @property
    def runs(self) -> Indices:
        """The number of runs of each output, (U,)."""
        return self.made[self.case]

    @property
    def made(self) -> Indices:
        """The number of runs of each case, (C,)."""
        return np.bincount(self.of_run, minlength=len(self.conditions))

    @property
    def failed(self) -> Indices:
        """The number of failed runs of each output, (U,)."""
        return np.asarray(self.runs - self._worked, dtype=np.intp)

    @property
    def lost(self) -> Flags:
        """Which outputs have no successful run, (U,)."""
        return np.asarray(self._worked == 0)

    @property
    def _worked(self) -> Indices:
        out = np.zeros(len(self.case), dtype=np.intp)
        for column in self.logarithm:
            fine, here = np.isfinite(self.y[:, column]), self.column == column
            count = np.bincount(self.of_run[fine], minlength=len(self.conditions))
            out[here] = count[self.case[here]]
        return out

    def spread(self, count: int = 512) -> Array:
        """Points (J, n) that are evenly spread over the region."""
        n = len(self.box)
        return np.asarray(self.axes.outward(low_discrepancy(count, n, fixed_shift(n))))

    def know(self, case: Indices, x: Array) -> None:
        """Begin with runs of cases (R,) at points x (R, n) that were made earlier.

        Of very many runs of a case some are chosen, evenly over their order.
        """
        some = list[int]()
        for cases in self.clusters:
            most = self.settings.together // len(cases)
            for one in cases:
                rows = np.flatnonzero(case == one)
                some += rows[evenly(len(rows), most)].tolist()
        if some:
            kept = np.sort(some)
            self.make(case[kept], x[kept])

    def begin(
        self,
        cases: Sequence[int] | None = None,
        together: int = 0,
        granted: Callable[[int], int] = int,
    ) -> None:
        """Make the first runs of the cases, by default of all: pieces of one Sobol' sequence.

        If they are of all cases, they are `together` runs or more, and those are left out that an
        earlier run of their case lies as near to as evenly spread runs lie to each other. Of this
        number `granted` may admit a part, which is chosen evenly.
        """
        n, before = len(self.box), len(self.x)
        every, inputs = self.conditions.shape
        some = np.arange(every) if cases is None else np.array(cases)
        each = first_process_runs(every, inputs + n, together, n * self.sloped, self.settings)
        even = low_discrepancy(before + len(some) * each, n, fixed_shift(n))[before:]
        order = np.random.default_rng(0).permutation(some)
        case, z = np.repeat(order, each), clustered(even)
        if cases is None:
            lacking = np.flatnonzero(self._nearest(case, z) > 2.0 * each ** (-1.0 / n))
            case, z = case[lacking], z[lacking]
        few = evenly(len(case), granted(len(case)))
        if few.size:
            self.make(case[few], self.axes.outward(z[few]))

    def _nearest(self, case: Indices, z: Array) -> Array:
        """The distance (R,) of the nearest run of each case from z (R, n), in any parameter."""
        out = np.full(len(z), np.inf)
        with np.errstate(invalid="ignore", divide="ignore"):
            there = np.nan_to_num(self.axes.inward(self.x), nan=np.inf)
        for one in np.unique(self.of_run):
            rows, own = case == one, there[self.of_run == one]
            apart = np.abs(z[rows, None] - own).max(axis=2)
            out[rows] = apart.min(axis=1)
        return out

    def make(self, case: Indices, x: Array) -> Array:
        """Make runs of cases (R,) at points x (R, n).

        Returns how far the new values lie from those expected, in standard deviations (S,).
        """
        y, slopes = self.run(case, x)
        for column, (low, high) in self.limits.items():
            slopes[(y[:, column] < low) | (y[:, column] > high), column] = np.nan
            y[:, column] = np.clip(y[:, column], low, high)
        surprises = self._surprises(case, x, y)
        self.y = np.vstack([self.y.reshape(-1, y.shape[1]), y])
        self.slopes = np.vstack([self.slopes.reshape(-1, *slopes.shape[1:]), slopes])
        self.of_run, self.x = np.append(self.of_run, case), np.vstack([self.x, x])
        return surprises

    def move(self, box: Array) -> None:
        """Change the region of the parameters to another box."""
        before, after = _axes(self.box), _axes(box)
        ratios = [new.wider_than(old) for old, new in zip(before, after, strict=True)]
        self.axes = after[self.scaled]
        self.covariances = {
            key: tuple(one.stretched(ratios[key[0]]) for one in both)
            for key, both in self.covariances.items()
        }
        self.alone = {c: one.stretched(ratios[self.scaled]) for c, one in self.alone.items()}

    def learn(self) -> None:
        """Fit the covariance of each column, and condition its processes on the runs.

        Slopes are used until they contradict the values.
        """
        if self.sloped and self._misled:
            self.sloped, self.contradicted, self.fitted = False, True, 0
        if not self.sloped:
            self.slopes[:] = np.nan
        near = self._near(self.axes)
        if len(near) >= self.settings.again * self.fitted:
            self._fit()
            near = self._near(self.axes)
            self.fitted = len(near)
        self.groups = []
        for column in self.columns:
            data = self._data(self.axes, near, column)
            log = self.logarithm[column] and bool(np.all(data.y > 0.0))
            data = data.logarithms if log else data
            best = self.covariances[self.scaled, column, log][0]
            for cases in self.clusters:
                some = np.flatnonzero(np.isin(data.experiment, cases))
                sites = np.flatnonzero((self.column == column) & np.isin(self.case, cases))
                if sites.size:
                    own = data.take(some).with_last_slopes(self.settings.values)
                    posterior = ProcessPosterior.of(best, own)
                    plain = None
                    if own.sloped.size:
                        values = own.with_last_slopes(0)
                        plain = ProcessPosterior.of(self.alone.get(column, best), values)
                    self.groups.append(_Grouped(sites, column, cases, posterior, log, plain))
        self.steps = PROCESS.steps[1]

    def _near(self, axes: Axes) -> Indices:
        """The runs within a region or not far outside."""
        with np.errstate(invalid="ignore", divide="ignore"):
            inside = np.abs(axes.inward(self.x)) <= self.settings.near
        return np.flatnonzero(inside.all(axis=1))

    def _data(self, axes: Axes, near: Indices, column: int) -> Data:
        """The runs `near` that have a value of the column."""
        rows = near[np.isfinite(self.y[near, column])]
        x = self.x[rows]
        inputs = self._inputs(self.of_run[rows], axes.inward(x))
        slopes = self.slopes[rows, column] / axes.rates(x)
        return Data(*inputs, self.y[rows, column], len(self.box), slopes)

    def _fit(self) -> None:
        """Fit the covariances, with and without logarithms of the parameters.

        Those of the highest densities of the values are used.
        """
        axes = _axes(self.box)
        near = np.intersect1d(self._near(axes[0]), self._near(axes[1]))
        found = []
        for scaled in (False, True) if axes[1].logarithmic.any() else (False,):
            each = [self._fit_column(scaled, c, axes[scaled], near) for c in self.columns]
            found.append((sum(loss for loss, _ in each), scaled, [log for _, log in each]))
        _, self.scaled, logs = min(found)
        self.axes = axes[self.scaled]
        self.logarithm = dict(zip(self.columns, logs, strict=True))
        self.alone = {c: self._fit_alone(c, near) for c in self.columns} if self.sloped else {}

    def _fit_alone(self, column: int, near: Indices) -> Covariance:
        """The covariance of a column by values alone, where slopes count in that of both."""
        data, log = self._data(self.axes, near, column), self.logarithm[column]
        both = self.covariances[self.scaled, column, log]
        if len(data.values) > PROCESS.learned:
            return both[0]
        values = data.with_last_slopes(0)
        return learned(both, values.logarithms if log else values, self.steps)[0][0]

    def _fit_column(
        self, scaled: bool, column: int, axes: Axes, near: Indices
    ) -> tuple[float, bool]:
        """Fit the covariance of a column, and that of its logarithm if it varies by decades.

        Slopes count while there are few. Returns minus the logarithm of the higher density of
        values, and of slopes by the parameters, and whether it is that of the logarithm.
        """
        data = self._data(axes, near, column)
        if len(data.values) > PROCESS.learned:
            data = data.with_last_slopes(0)
        by = float(np.log(axes.rates(axes.outward(data.z[data.sloped]))).sum())
        y, key = data.y, (scaled, column)
        self.covariances[*key, False], loss = learned(
            self.covariances[*key, False], data, self.steps
        )
        if not (y.min() > 0.0 and y.max() > self.settings.decade * y.min()):
            return loss + by, False
        logs = data.logarithms
        self.covariances[*key, True], other = learned(
            self.covariances[*key, True], logs, self.steps
        )
        return min((loss + by, False), (other + logs.values_by_logarithms + by, True))

    def expected(self, site: Indices, x: Array) -> Array:
        """Expected values (R,) of outputs at points x (R, n)."""
        mean = self._of_each(ProcessPosterior.mean, site, x)
        return outcomes(mean, self.logarithmic[site])

    @property
    def logarithmic(self) -> Flags:
        """Which outputs have a process of their logarithm, (U,)."""
        out = np.zeros(len(self.case), dtype=np.bool_)
        for group in self.groups:
            out[group.sites] = group.logarithm
        return out

    @property
    def means(self) -> ProcessMeans:
        """The expected values by the present runs."""
        return ProcessMeans(
            tuple(self.groups), self.case, self.conditions, self.axes, self.settings
        )

    def _of_each(
        self, what: Callable[[ProcessPosterior, Indices, Array], Array], site: Indices, x: Array
    ) -> Array:
        """What the processes say (R,), mean or standard deviation, of outputs at x (R, n)."""
        z, out = self.axes.inward(x), np.empty(len(x))
        for group, rows in self._in_groups(site):
            out[rows] = what(group.posterior, *self._inputs(self.case[site[rows]], z[rows]))
        return out

    def _means(self, x: Array) -> Array:
        """Means (U, J) of the processes of all outputs at common points x (J, n)."""
        z, out = self.axes.inward(x), np.empty((len(self.case), len(x)))
        for group in self.groups:
            for site in group.sites:
                out[site] = group.posterior.mean(*self._inputs(np.full(len(z), self.case[site]), z))
        return out

    def of_sums(self, site: Indices, x: Array, weights: Array) -> tuple[Array, Array]:
        """The posterior covariance of the sums of values times weights (R, K).

        Returns that of all cases (K, K), and those of each case alone (C, K, K).
        """
        z, k = self.axes.inward(x), weights.shape[1]
        total, alone = np.zeros((k, k)), np.zeros((len(self.conditions), k, k))
        for group, rows in self._in_groups(site):
            inputs = self._inputs(self.case[site[rows]], z[rows])
            cases, owner = np.unique(inputs[0], return_inverse=True)
            whole, each = group.of_sums(*inputs, weights[rows], owner)
            total += whole
            alone[cases] += each
        return total, alone

    def best(self, case: int, x: Array, count: int = 1) -> Array:
        """The `count` points of x (J, n) whose runs tell most of the values at all, (count, n)."""
        z, least, chosen = self.axes.inward(x), np.finfo(float).eps, list[int]()
        inputs = self._inputs(np.full(len(z), case), z)
        left = [group.posterior.joint(*inputs) for group in self.groups if case in group.cases]
        left = [one / max(float(np.trace(one)), np.finfo(float).tiny) for one in left]
        for _ in range(min(count, len(x))):
            told = sum((one**2).sum(axis=0) / np.maximum(np.diag(one), least) for one in left)
            assert isinstance(told, np.ndarray)
            told[chosen] = -np.inf
            chosen.append(int(np.argmax(told)))
            columns = [one[:, chosen[-1]] for one in left]
            left = [
                one - np.outer(column, column) / max(column[chosen[-1]], least)
                for one, column in zip(left, columns, strict=True)
            ]
        return np.asarray(x[chosen])

    def farthest(self, case: Indices, x: Array, weight: Array, count: int) -> Indices:
        """The numbers of `count` of the points x (P, n) of cases (P,), farthest from all runs.

        The distance from the nearest run of the same case is multiplied by the weight (P,) of a
        point.
        """
        z, chosen = self.axes.inward(x), list[int]()
        distance = self._nearest(case, z)
        for _ in range(count):
            chosen.append(int(np.argmax(weight * distance)))
            apart = np.abs(z - z[chosen[-1]]).max(axis=1)
            same = case == case[chosen[-1]]
            distance[same] = np.minimum(distance, apart)[same]
        return np.array(chosen, dtype=np.intp)

    def _surprises(self, case: Indices, x: Array, y: Array) -> Array:
        z, found, least = self.axes.inward(x), [np.empty(0)], np.finfo(float).tiny
        for group in self.groups:
            values = group.transformed(y[:, group.column])
            rows = np.flatnonzero(np.isin(case, group.cases) & np.isfinite(values))
            inputs = self._inputs(case[rows], z[rows])
            off = values[rows] - group.posterior.mean(*inputs)
            if group.plain is not None:
                other = values[rows] - group.plain.mean(*inputs)
                both = np.abs([off, other]).T / max(float(group.plain.data.y.std()), least)
                self.missed = np.vstack([self.missed, both])
            sd = group.posterior.deviation(*inputs)
            found.append(off / np.hypot(sd, np.sqrt(group.posterior.noise)))
        return np.concatenate(found)

    @property
    def _misled(self) -> bool:
        """Whether most of the last new values lay nearer to what is expected without slopes."""
        last = self.missed[-self.settings.compared :]
        if len(last) < self.settings.compared:
            return False
        nearer = last[:, 0] <= np.maximum(last[:, 1], self.settings.exact)
        return bool(nearer.mean() < self.settings.agreeing)

    @property
    def sloped_runs(self) -> int:
        """The number of runs whose slopes are used."""
        known = np.all(np.isfinite(self.slopes), axis=2)
        return int(np.count_nonzero(np.any(known, axis=1)))

    def surface(self, where: Array, least: int = 0) -> Surface:
        """The polynomials fitted to the processes, with their errors at points where (J, n).

        They have at least about `least` terms, if no more than the largest number.
        """
        n, settings, sites = len(self.box), self.settings, np.arange(len(self.case))
        some = where[:: max(1, len(where) // settings.judged)][: settings.judged]
        apart = np.repeat(sites, len(some)), np.tile(some, (len(sites), 1))
        sd = self._of_each(ProcessPosterior.deviation, *apart).reshape(len(sites), -1)
        left = np.sqrt((sd**2).mean(axis=1))
        count = max((n + 1) * (n + 2) // 2, min(max(self.terms // 2, least), settings.most))
        while True:
            indices, coefficients, missed, scatter = self._fitted(count, where)
            worst = np.sqrt(np.mean((missed / np.maximum(left, settings.exact * scatter)) ** 2))
            if worst < settings.missed or 2 * count > settings.most:
                break
            count *= 2
        self.terms, off, log = count, np.hypot(left, missed), self.logarithmic
        values = self.expected(*apart).reshape(len(sites), -1)
        error = np.where(log, np.sqrt((values**2).mean(axis=1)), 1.0) * off
        error[self.lost] = np.inf
        listed, groups = merged([(sites, indices, coefficients)], np.zeros(len(sites)))
        made = Surface(
            self.axes, listed, groups, error, values.std(axis=1), np.zeros_like(log), self.runs,
            self.failed, log,
        )  # fmt: skip
        lower, upper = outcome_range(made, np.full((len(sites), 1), np.nan))
        beyond = settings.beyond * off
        return replace(made, lower=widened(lower, -beyond, log), upper=widened(upper, beyond, log))

    def _fitted(self, count: int, where: Array) -> tuple[Indices, Array, Array, Array]:
        """Polynomials of `count` terms: multi-indices, coefficients, misfit and scatter (U,).

        They are fitted to points over the region and, as many, to the first points `where` (J, n).
        """
        n, settings = len(self.box), self.settings
        indices, size = ball(self._scales, 2.0, count)
        even = low_discrepancy(int(settings.points * len(indices)), n, fixed_shift(n))
        over = self.axes.outward(clustered(even))
        x = np.vstack([over, where[: len(over)]])
        basis, y = products(indices, self.axes.inward(x)).T, self._means(x).T
        level = y.mean(axis=0)
        # The penalty keeps coefficients small that the points hardly determine, as those that act
        # in the corners of a box of many parameters.
        ridge = np.diag(settings.ridge * (1.0 + size**2))
        target = np.vstack([y - level, np.zeros((len(size), y.shape[1]))])
        coefficients = np.linalg.lstsq(np.vstack([basis, ridge]), target)[0]
        coefficients[0] += level
        law = slice(len(over), None)
        missed = np.sqrt(((basis[law] @ coefficients - y[law]) ** 2).mean(axis=0))
        return indices, coefficients, missed, y[law].std(axis=0)

    @property
    def _scales(self) -> tuple[float, ...]:
        """How fast the outputs vary with each parameter, over the fastest, (n,)."""
        n = len(self.box)
        rates = [
            np.linalg.norm(both[0].mix[-n:], axis=1) + both[0].individual * both[0].scale
            for both in (self.covariances[self.scaled, *key] for key in self.logarithm.items())
        ]
        most = np.max(rates, axis=0)
        scales = np.clip(most / most.max(), self.settings.slowest, 1.0)
        return tuple(np.round(scales, 1).tolist())

    def _inputs(self, case: Indices, z: Array) -> tuple[Indices, Array]:
        """The inputs of a process: the cases (R,), and their conditions beside z (R, n)."""
        return case, np.hstack([self.conditions[case], z])

    def _in_groups(self, site: Indices) -> Iterator[tuple[_Grouped, Indices]]:
        of = np.full(len(self.case), -1)
        for number, group in enumerate(self.groups):
            of[group.sites] = number
        for number, group in enumerate(self.groups):
            rows = np.flatnonzero(of[site] == number)
            if rows.size:
                yield group, rows


def evenly(count: int, most: int) -> Indices:
    """At most `most` of the numbers from 0 to `count` - 1, evenly chosen.

    >>> evenly(7, 3), evenly(2, 3)
    (array([0, 3, 6]), array([0, 1]))
    """
    return np.linspace(0, count - 1, min(most, count)).round().astype(np.intp)


def first_process_runs(
    cases: int,
    inputs: int,
    together: int = 0,
    slopes: int = 0,
    settings: ProcessesSettings = PROCESSES,
) -> int:
    """The number of first runs of each case, for a process with so many inputs.

    All cases have `together` runs or more. A run that gives `slopes` derivatives of each value
    counts as so many more.

    >>> first_process_runs(108, 7), first_process_runs(5, 7), first_process_runs(5, 7, 200)
    (3, 10, 40)
    >>> first_process_runs(108, 7, slopes=2), first_process_runs(5, 7, slopes=2)
    (1, 4)
    """
    least = max(-(-settings.least * (inputs + 1) // (1 + slopes)), together)
    return max(least_first_runs(slopes, settings), -(-least // cases))


def least_first_runs(slopes: int, settings: ProcessesSettings = PROCESSES) -> int:
    """The least number of first runs of each case, if each gives so many slopes of a value.

    >>> [least_first_runs(slopes) for slopes in (0, 1, 2)]
    [3, 2, 1]
    """
    return -(-settings.first // (1 + slopes))


def _axes(box: Array) -> tuple[Axes, Axes]:
    """Linear coordinates, and those with logarithms of all parameters that may have them."""
    return Axes.plain(box), Axes(box, logarithms(box))


def _clusters(conditions: Array, most: int) -> list[Indices]:
    """The cases in groups of at most `most` with similar conditions (C, d): halves of halves."""
    waiting, done = [np.arange(len(conditions))], []
    while waiting:
        cases = waiting.pop()
        if len(cases) <= most:
            done.append(cases)
            continue
        spread = conditions[cases].std(axis=0)
        widest = conditions[cases, int(np.argmax(spread))] if spread.size else cases
        order = cases[np.argsort(widest, kind="stable")]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    return done
