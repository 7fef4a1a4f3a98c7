"""The predicted distribution of new observations, in a new or in a measured experiment.

`forecast` computes it under one law. `widened` computes it for a mixture of plausible laws, with
intervals of its quantiles. `tabled` returns a table of both. `compared` computes how far new
conditions lie outside those that were tested.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import optimize

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.information import INTERVALS
from aleator.laws.inputs import Inputs
from aleator.laws.law import invert
from aleator.likelihood.individual import IndividualLikelihood, Layout, Predictor, individual_points
from aleator.likelihood.individual.rules import standard_points
from aleator.observations.errors import MeasurementErrors
from aleator.observations.responses import Transform
from aleator.tasks.new_experiments import (
    CONTEXT,
    DrawnParameters,
    Points,
    PredictionContext,
    ends_of,
    local_surfaces,
    measured,
    parameters,
    predictor_for,
    simulated,
    simulator_itself,
)


@dataclass(frozen=True)
class PredictionSettings:
    """Settings of predictions and of distances from tested conditions; chosen by judgement."""

    law_points: int = 4096
    """The number of points that represent the law of an experiment."""
    edge: float = 1e-12
    """The distance that probabilities keep from zero and one."""
    step: float = 1e-4
    """The step of the numerical derivative of a distribution function, in error scales."""
    quantiles: tuple[float, ...] = (0.025, 0.5, 0.975)
    """The probabilities of the quantiles of a prediction: its median and its 95 % range."""
    lost: float = 1e-3
    """The probability of failing runs above which a prediction has the status "runs_failed"."""
    hull: int = 2000
    """The largest number of distinct tested points whose convex hull is used for distances."""
    rounding: float = 1e-9
    """The distance below which a point counts as inside the tested ones."""


PREDICTION = PredictionSettings()


def beyond_range(tested: Array, new: Array) -> Array:
    """Signed distances (Q, d) of new points (Q, d) from the range of the tested ones (R, d).

    The unit is the width of the tested range: 0.5 is half of the width above the highest value,
    and zero is inside the range. A new value of a column that was never varied is infinitely far.

    >>> beyond_range(np.array([[0.0], [2.0]]), np.array([[1.0], [3.0], [-1.0]])).ravel().tolist()
    [0.0, 0.5, -0.5]
    """
    low, high = tested.min(axis=0), tested.max(axis=0)
    width = np.where(high > low, high - low, 0.0)
    away = np.maximum(new - high, 0.0) - np.maximum(low - new, 0.0)
    size = np.maximum(np.abs(low), np.abs(high))
    away = np.where(np.abs(away) > PREDICTION.rounding * np.maximum(width, size), away, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(away == 0.0, 0.0, away / width))


def beyond_hull(tested: Array, new: Array) -> Array:
    """Distances (Q,) of new points (Q, d) from the convex hull of the tested ones (R, d).

    The distance is the least t such that a weighted mean of tested points is within t tested ranges
    of the new point in every coordinate. It solves the linear program min t with
    |sum_r w_r x_r - x| <= t, w >= 0, sum w = 1. It is zero for a point between tested points, and
    never less than the largest `beyond_range`. With more than 2000 distinct tested points it is
    this largest value. Cost: some milliseconds for each point.

    >>> corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    >>> beyond_hull(corners, np.array([[0.2, 0.2], [1.0, 1.0]])).round(3).tolist()
    [0.0, 0.5]
    """
    single = np.abs(beyond_range(tested, new)).max(axis=1, initial=0.0)
    low = tested.min(axis=0)
    width = tested.max(axis=0) - low
    varied = width > 0.0
    points = np.unique((tested[:, varied] - low[varied]) / width[varied], axis=0)
    if varied.sum() < 2 or len(points) > PREDICTION.hull:
        return np.asarray(single)
    scaled = (new[:, varied] - low[varied]) / width[varied]
    found = [
        own if np.isinf(own) else max(own, _from_hull(points, x))
        for own, x in zip(single.tolist(), scaled, strict=True)
    ]
    return np.array(found)


def _from_hull(points: Array, x: Array) -> float:
    count, d = points.shape
    slack = np.ones((d, 1))
    rows = np.vstack([np.hstack([points.T, -slack]), np.hstack([-points.T, -slack])])
    total = np.append(np.ones(count), 0.0)[None]
    cost = np.append(np.zeros(count), 1.0)
    found = optimize.linprog(
        cost, A_ub=rows, b_ub=np.concatenate([x, -x]), A_eq=total, b_eq=np.ones(1), method="highs"
    )
    distance = float(found.fun) if found.success else float("nan")
    return distance if distance > PREDICTION.rounding else 0.0


@dataclass(frozen=True, eq=False)
class Beyond:
    """The distances (R,) of R new rows from the tested conditions, with the reasons in words.

    The unit is the tested range. A distance is zero inside the convex hull of the tested
    conditions. It is infinite for an untested level, or a new value of a condition that was never
    varied. `why` is "" for rows inside.
    """

    distance: Array
    why: tuple[str, ...]


def compared(tested: pd.DataFrame, new: pd.DataFrame) -> Beyond:
    """The distances of new conditions from the tested ones, with the column that causes each.

    >>> tested = pd.DataFrame({"load": [1.0, 3.0], "oil": ["a", "b"]})
    >>> compared(tested, pd.DataFrame({"load": [2.0, 4.0, 2.0], "oil": ["a", "a", "c"]})).why
    ('', 'load is 0.5 tested ranges above the highest', "oil 'c' was never tested")
    """
    numbers = [str(n) for n in tested if _is_number(tested[n]) and _is_number(new[n])]
    texts = [name for name in tested if name not in numbers]
    here, there = (frame[numbers].to_numpy(dtype=float) for frame in (tested, new))
    each = beyond_range(here, there) if numbers else np.zeros((len(new), 0))
    distance = beyond_hull(here, there) if numbers else np.zeros(len(new))
    words = [_words(numbers, row, far) for row, far in zip(each, distance.tolist(), strict=True)]
    for name in texts:
        known = set(map(str, tested[name]))
        for row, cell in enumerate(map(str, new[name])):
            if cell not in known:
                distance[row] = np.inf
                words[row] = f"{name} '{cell}' was never tested"
    return Beyond(distance, tuple(words))


def _is_number(column: pd.Series[Any]) -> bool:
    return bool(pd.api.types.is_numeric_dtype(column))


def _words(names: Sequence[str], each: Array, distance: float) -> str:
    if not distance > 0.0:
        return ""
    if not np.any(each):
        return f"{' and '.join(names)} were never tested together so: {distance:.2g} tested ranges"
    parts = []
    for name, away in zip(names, each.tolist(), strict=True):
        side = "above the highest" if away > 0.0 else "below the lowest"
        if np.isinf(away):
            parts.append(f"{name} was never varied")
        elif away:
            parts.append(f"{name} is {abs(away):.2g} tested ranges {side}")
    return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class Draws:
    """Points x (B, J, n) of the parameters of B experiments, with weights (B, J) of sum one."""

    x: Array
    weights: Array

    @classmethod
    def new(cls, inputs: Inputs, alpha: Array, experiments: int) -> Draws:
        """Points of the parameters of new experiments, distributed as their laws at alpha (K,)."""
        points = standard_points(PREDICTION.law_points, inputs.scattering)
        xi = np.tile(points, (experiments, len(inputs.classes), 1))
        found = inputs.individual(alpha[: inputs.size], xi, slice(0, experiments))
        weights = np.exp(found.log_weight) / len(points)
        return cls(found.x, np.broadcast_to(weights, found.x.shape[:2]))

    @classmethod
    def old(cls, likelihood: IndividualLikelihood, alpha: Array, which: int) -> Draws:
        """Points of the parameters of one measured experiment, given its observations."""
        block = likelihood.layout.alone(which)
        x, share = individual_points(likelihood, alpha, block, PREDICTION.law_points)
        own = slice(which - block.experiments.start, which - block.experiments.start + 1)
        return cls(x[own], share[own])

    @classmethod
    def joined(cls, parts: Sequence[Draws]) -> Draws:
        """The points of several groups of experiments together, in this order."""
        return cls(
            np.concatenate([part.x for part in parts]),
            np.concatenate([part.weights for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class Forecast:
    """The moments (M,) and quantiles (M, P) of M predicted values.

    `lost` (M,) is the probability that a run fails. `kurtosis` is 3 for a normal value. If some
    simulated values are infinite, the mean and the outer quantiles are infinite too, and all other
    moments are NaN.
    """

    mean: Array
    sd: Array
    skewness: Array
    kurtosis: Array
    quantiles: Array
    lost: Array


def forecast(
    draws: Draws,
    predictor: Predictor,
    layout: Layout,
    errors: MeasurementErrors | None,
    of_errors: Array,
    probabilities: Array,
    settings: PredictionSettings = PREDICTION,
) -> Forecast:
    """The distribution of measured values, or without `errors` of simulated values.

    Its distribution function is F(y) = sum_j w_j F(y | eta_j, scale_j) over the points j of the
    draws, and quantiles are its inverse. Points whose runs fail are left out. Cost: one simulated
    value for each point and value.
    """
    size = layout.experiment.size
    mean, sd, skewness, kurtosis, lost = np.empty((5, size))
    found = Forecast(mean, sd, skewness, kurtosis, np.empty((size, len(probabilities))), lost)
    for block in layout.blocks(draws.x.shape[1]):
        rows = block.rows
        with np.errstate(all="ignore"):
            eta = predictor.values(block, draws.x[block.experiments])
        every = draws.weights[block.experiments][block.owner]
        found.lost[rows] = np.sum(every, axis=1, where=np.isnan(eta))
        known = np.isfinite(eta)
        weights = np.where(known, every, 0.0)
        endless = _Endless.of(eta, every)
        with np.errstate(all="ignore"):
            weights = weights / weights.sum(axis=1, keepdims=True)
        eta = np.where(known, eta, 0.0)
        of_each = (
            (eta, *np.zeros((3, *eta.shape)))
            if errors is None
            else errors.moments(of_errors, eta, rows)
        )
        moments = _moments(weights, *of_each)
        among = endless.among_finite(probabilities)
        found.quantiles[rows] = endless.quantiles(
            probabilities,
            np.array([quantiles(*row) for row in zip(eta, weights, among, strict=True)])
            if errors is None
            else _inverted(errors, of_errors, eta, weights, rows, among, settings),
        )
        finite = endless.mean == 0.0
        found.mean[rows] = np.where(finite, moments[0], endless.mean)
        for moment, own in zip(
            moments[1:], (found.sd, found.skewness, found.kurtosis), strict=True
        ):
            own[rows] = np.where(finite, moment, np.nan)
    return found


@dataclass(frozen=True, eq=False)
class _Endless:
    """The probabilities (m,) that a simulated value is minus infinity or plus infinity."""

    below: Array
    above: Array

    @classmethod
    def of(cls, eta: Array, weights: Array) -> _Endless:
        """The shares of infinite values among weighted values (m, J); NaN does not count."""
        whole = np.sum(weights, axis=1, where=~np.isnan(eta))
        with np.errstate(all="ignore"):
            below, above = (
                np.sum(weights, axis=1, where=eta == end) / whole for end in (-np.inf, np.inf)
            )
        return cls(below, above)

    @property
    def mean(self) -> Array:
        """The mean (m,) due to infinite values: infinite, NaN with both signs, zero without any."""
        low, high = (np.where(share > 0.0, np.inf, 0.0) for share in (self.below, self.above))
        with np.errstate(invalid="ignore"):
            return np.asarray(high - low)

    def among_finite(self, probabilities: Array) -> Array:
        """The probabilities (m, P) conditional on a finite value that give the same quantiles."""
        finite = 1.0 - self.below - self.above
        with np.errstate(all="ignore"):
            among = (probabilities - self.below[:, None]) / finite[:, None]
        return np.clip(np.nan_to_num(among, nan=0.5), PREDICTION.edge, 1.0 - PREDICTION.edge)

    def quantiles(self, probabilities: Array, finite: Array) -> Array:
        """The quantiles (m, P) of all values, from those of the finite values."""
        low = probabilities < self.below[:, None]
        return np.where(
            low, -np.inf, np.where(probabilities > 1.0 - self.above[:, None], np.inf, finite)
        )


def _moments(
    weights: Array, mean: Array, second: Array, third: Array, fourth: Array
) -> tuple[Array, Array, Array, Array]:
    """The mean, sd, skewness and kurtosis (m,) of a mixture of J parts.

    The parts have means and second to fourth central moments (m, J).
    """
    middle = np.sum(weights * mean, axis=1)
    away = mean - middle[:, None]
    sd = np.sqrt(np.sum(weights * (away**2 + second), axis=1))
    cubes = away**3 + 3.0 * away * second + third
    squares = away**4 + 6.0 * away**2 * second + 4.0 * away * third + fourth
    with np.errstate(divide="ignore", invalid="ignore"):
        skewness = np.sum(weights * cubes, axis=1) / sd**3
        kurtosis = np.sum(weights * squares, axis=1) / sd**4
    return middle, sd, skewness, kurtosis


def _inverted(
    errors: MeasurementErrors,
    of_errors: Array,
    eta: Array,
    weights: Array,
    rows: slice,
    probabilities: Array,
    settings: PredictionSettings,
) -> Array:
    """The quantiles (m, P) of a mixture of measurement errors around simulated values eta (m, J).

    They are searched for between the least and the largest quantile of the parts.
    """
    scale = np.broadcast_to(errors.scale(of_errors, eta, rows), eta.shape)
    step = settings.step * np.sum(weights * scale, axis=1, keepdims=True)
    counted = weights > 0.0

    def cdf(y: Array) -> Array:
        columns = [errors.cdf(of_errors, column[:, None], eta, rows) for column in y.T]
        return np.stack([np.sum(weights * column, axis=1) for column in columns], axis=1)

    def pdf(y: Array) -> Array:
        return np.asarray((cdf(y + step) - cdf(y - step)) / (2.0 * step))

    ends = [errors.quantile(of_errors, p[:, None], eta, rows) for p in probabilities.T]
    low = np.stack([np.min(np.where(counted, end, np.inf), axis=1) for end in ends], axis=1)
    high = np.stack([np.max(np.where(counted, end, -np.inf), axis=1) for end in ends], axis=1)
    lost = ~np.isfinite(low) | ~np.isfinite(high)
    low, high = np.where(lost, 0.0, low), np.where(lost, 1.0, high)
    return np.where(lost, np.nan, invert(cdf, pdf, probabilities, low, high))


def widened(
    context: PredictionContext,
    predictor: Predictor,
    draws: AlphaDraws,
    probabilities: Array,
    found: Forecast,
) -> tuple[Forecast, Array]:
    """The forecast of a mixture over draws of alpha, and 95 % intervals (M, P, 2) of its quantiles.

    `found` is the accurate forecast at the estimate of alpha. To it are added the differences
    between the mixture and the estimate, computed with the same 512 points for every alpha, so that
    most of the points' error cancels. Cost: one simulated value for each draw, point and value.
    """
    size = len(context.seen)
    moments_of, quantiles_of = np.empty((4, size)), np.empty((size, len(probabilities)))
    ends = np.empty((size, len(probabilities), 2))
    points = Points.standard(CONTEXT.points, context.inputs.scattering)
    alphas = np.concatenate([draws.estimate[None], draws.alpha])
    known: DrawnParameters | None = None
    for l in range(context.count):
        if known is None or context.inputs.regressed or context.measured is not None:
            known = parameters(context, alphas, l, points)
        block = context.layout.alone(l)
        eta = simulated(predictor.values, block, known.x)
        y = measured(context, alphas, eta, known.score, block.rows)
        for k, own in enumerate(y, block.rows.start):
            values = _PointValues.of(own, known.weights, draws, probabilities)
            at = np.array([found.mean[k], found.sd[k], found.skewness[k], found.kurtosis[k]])
            moments_of[:, k] = np.where(np.isnan(at), np.nan, _moved(at, *values.moments))
            quantiles_of[k] = _moved(found.quantiles[k], *values.quantiles)
            ends[k] = values.ends(found.quantiles[k])
    mean, sd, skewness, kurtosis = moments_of
    return Forecast(mean, sd, skewness, kurtosis, quantiles_of, found.lost), ends


def _moments_of(values: Array, weights: Array) -> Array:
    """The mean, sd, skewness and kurtosis (4,) of weighted values (J,); NaN does not count."""
    known = ~np.isnan(values)
    with np.errstate(all="ignore"):
        share = weights[known] / weights[known].sum()
        point = values[known][None]
        return np.array(_moments(share[None], point, *np.zeros((3, *point.shape))))[:, 0]


@dataclass(frozen=True, eq=False)
class _PointValues:
    """Moments (4,) and quantiles (P,) of one predicted value, computed from sample points.

    Each is a pair: for the mixture over draws of alpha, and for the estimate. `each` (A, P) are
    the quantiles under each draw, with `weights` (A,).
    """

    moments: tuple[Array, Array]
    quantiles: tuple[Array, Array]
    each: Array
    weights: Array

    @classmethod
    def of(cls, y: Array, weights: Array, draws: AlphaDraws, probabilities: Array) -> _PointValues:
        """The moments and quantiles of values y (1 + A, J).

        The first row is under the estimate of alpha, the others under its draws.
        """
        each = quantiles(y, weights, probabilities)
        whole = (draws.weights[:, None] * weights[1:]).ravel()
        mixed = y[1:].ravel()
        return cls(
            (_moments_of(mixed, whole), _moments_of(y[0], weights[0])),
            (quantiles(mixed, whole, probabilities), each[0]),
            each[1:],
            draws.weights,
        )

    def ends(self, at: Array) -> Array:
        """The 95 % intervals (P, 2) of quantiles over the draws of alpha.

        They are shifted so that the estimate's quantiles become the accurate ones `at` (P,).
        """
        own = self.quantiles[1]
        finite = np.isfinite(self.each).all(axis=0) & np.isfinite(own) & np.isfinite(at)
        shift = np.where(finite, at, 0.0) - np.where(finite, own, 0.0)
        return np.asarray(
            quantiles(self.each.T, self.weights, np.array(INTERVALS.ends)) + shift[:, None]
        )


def _moved(at: Array, mixed: Array, own: Array) -> Array:
    """The value `at` plus the difference mixed - own; `mixed` if one of them is not finite."""
    finite = np.isfinite(at) & np.isfinite(mixed) & np.isfinite(own)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(finite, at + (mixed - own), mixed))


def tabled(
    context: PredictionContext,
    draws: AlphaDraws,
    quantiles: tuple[float, ...],
    progress: Progress | None,
    settings: PredictionSettings = PREDICTION,
) -> pd.DataFrame:
    """The table of predictions, with a row for each row of the conditions and each response.

    With several draws of alpha the prediction is their mixture, and columns ``q<p>.lower`` and
    ``q<p>.upper`` have 95 % intervals of the quantiles.
    """
    draws, probabilities = context.taken(draws), np.array(quantiles)
    own = _own(context, draws.estimate)
    predictor = _about(context, own) if draws.certain else predictor_for(context, draws, progress)
    found = forecast(
        own, predictor, context.layout, context.errors,
        draws.estimate[context.inputs.size :], probabilities,
    settings=settings)  # fmt: skip
    ends = None
    if not draws.certain:
        found, ends = widened(context, predictor, draws, probabilities, found)
    columns = {**scales(context), "mean": found.mean, "standard_deviation": found.sd}
    columns["skewness"], columns["kurtosis"] = found.skewness, found.kurtosis
    columns |= {f"q{p:g}": found.quantiles[:, i] for i, p in enumerate(quantiles)}
    if ends is not None:
        for i, p in enumerate(quantiles):
            columns[f"q{p:g}.lower"], columns[f"q{p:g}.upper"] = ends[:, i].T
    lost = found.lost > settings.lost
    return in_rows(context, columns, ["runs_failed" if each else "solved" for each in lost])


def beyond(context: PredictionContext) -> Beyond | None:
    """The distances of the simulator's conditions and the laws' covariates from the tested ones.

    None if the context does not have the measured experiments.
    """
    if context.tested is None:
        return None
    new, tested = context.conditions.table, context.tested.table
    columns = dict.fromkeys([*context.runner.cases.columns, *context.inputs.covariates])
    names = [name for name in columns if name in new and name in tested]
    return compared(tested[names], new[names])


def scales(context: PredictionContext) -> dict[str, Any]:
    """The column ``scale``: "log" where a row is of the logarithm of its outcome, else "linear".

    Empty if no outcome has a transform.
    """
    words = ["log" if r.transform is Transform.LOG else "linear" for r in context.seen.responses]
    return {"scale": [words[k] for k in context.seen.response]} if "log" in words else {}


def condition_columns(context: PredictionContext, rows: Indices) -> dict[str, Any]:
    """The columns that say of what each value is: ids, conditions and groups of the user's table.

    They are the id, if the table has one, what the simulator, the laws and the noise take, and the
    groups of levels: "new" where the table does not name the group, and "b9 (new)" where no
    experiment was of it.
    """
    conditions, table = context.conditions, context.conditions.table
    levels = [*dict.fromkeys(context.inputs.levels.values())]
    taken = [*context.runner.cases.columns, *context.inputs.columns, *context.noise_columns]
    if context.measured is not None and context.measured.further:
        levels = []  # Each value belongs to the groups of its experiment.
    found: dict[str, Any] = {}
    if conditions.id is not None:
        found[conditions.id] = [conditions.ids[l] for l in conditions.experiment[rows]]
    for name in dict.fromkeys(taken):
        if name in table and name not in levels:
            found[name] = table[name].to_numpy()[rows]
        elif name in levels:
            found[name] = [_group(context, name, row) for row in rows.tolist()]
    return found


def _group(context: PredictionContext, level: str, row: int) -> object:
    """The group of a level to which a row of the conditions belongs, marked where it is new."""
    if level not in context.conditions.table:
        return "new"
    cell = context.conditions.table[level].iloc[row]
    known = context.tested is None or bool((context.tested.table[level] == cell).any())
    whole = isinstance(cell, float) and cell.is_integer()
    return cell if known else f"{int(cell) if whole else cell} (new)"


def in_rows(
    context: PredictionContext,
    values: dict[str, Any],
    status: Sequence[str] | None = None,
    places: Indices | None = None,
) -> pd.DataFrame:
    """The table of predicted values, or of those at `places`: conditions, outcome, values, status.

    It is sorted by rows of the conditions, then by outcomes. A column of the conditions that has
    the name of a column of the prediction is called "mean (condition)". ``attrs["beyond"]`` has, by
    the place of a row, which conditions lie outside those of the experiments, and how far.
    """
    seen = context.seen
    which = np.arange(len(seen)) if places is None else places
    row, away = seen.row[which], beyond(context)
    columns = {"outcome": [seen.responses[k].name for k in seen.response[which]], **values}
    columns |= {} if away is None else {"beyond": away.distance[row]}
    columns |= {} if status is None else {"status": status}
    conditions = {
        f"{name} (condition)" if name in columns else name: cells
        for name, cells in condition_columns(context, row).items()
    }
    order = np.lexsort((seen.response[which], row))
    table = pd.DataFrame({**conditions, **columns}).iloc[order].reset_index(drop=True)
    told = [] if away is None else zip(context.conditions.places, away.why, strict=True)
    table.attrs["beyond"] = {place: why for place, why in told if why}
    return table


def _own(context: PredictionContext, alpha: Array) -> Draws:
    """Points of the parameters of each experiment, given its observations if it was measured."""
    if context.measured is None:
        return Draws.new(context.inputs, alpha, context.count)
    likelihood, which = context.measured.likelihood, context.measured.which.tolist()
    each = {k: Draws.old(likelihood, alpha, k) for k in dict.fromkeys(which)}
    return Draws.joined([each[k] for k in which])


def _about(context: PredictionContext, own: Draws) -> Predictor:
    x, box = own.x.reshape(-1, own.x.shape[2]), context.inputs.box
    if context.on_simulator:
        return simulator_itself(context.runner, box, ends_of(x))
    return local_surfaces(context.runner, box, x, context.surfaces)
