"""The data of the charts of an identification: curves, bands, contours, maps, quantiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.inference.alpha_draws import DRAWING, AlphaDraws, quantiles
from aleator.inference.factors import LawsByLevel
from aleator.inference.fit import Fit
from aleator.inference.information import INTERVALS
from aleator.inference.likelihood_shape import (
    curve_points,
    likelihood_curve,
    likelihood_surface,
    weakest_pair,
)
from aleator.laws import Law, Mixture
from aleator.laws.covariates import Table
from aleator.laws.inputs import Inputs
from aleator.laws.inputs import drawn as of_law
from aleator.observations.experiments import covariates
from aleator.results.result import Result
from aleator.results.values import REPORTED, Estimate
from aleator.search.interface import Scored


@dataclass(frozen=True)
class PictureSettings:
    """Settings of the charts of a report: numbers of points, curves and digits, chosen by eye."""

    digits: int = 5
    """Significant digits of a value."""
    places: int = 10
    """Significant digits of a position; more, since an interval may be narrow and far from zero."""
    curve: int = 80
    """Points of a profile's curve."""
    band_points: int = 101
    """Points of the density curve of a law."""
    laws_averaged: int = 40
    """Experiments whose laws are averaged, where each experiment has its own law."""
    steps: int = 5
    """Steps between two neighbouring points of a drawn surface."""
    band_ends: tuple[float, float] = (0.002, 0.998)
    """Probabilities of the quantiles of a law between which its density is drawn."""
    wide: tuple[float, float] = (0.25, 0.75)
    """Quantiles, over the plausible laws, of the ends of their ranges; the drawn range includes
    these.
    """
    contour: int = 73
    """Points of a contour."""
    masses: tuple[float, float] = (0.5, 0.95)
    """Probabilities that are enclosed by the contours of the joint law of two parameters."""
    contours: tuple[float, float, float] = (0.5, 0.8, 0.95)
    """Confidence levels of the contours of the likelihood of two hyperparameters."""
    pairs: int = 6
    """Largest number of pairs of parameters whose contours are drawn."""
    side: int = 11
    """Points along each side of the likelihood surface."""
    profiles: int = 8
    """Largest number of hyperparameters with a profile; the first ones are taken."""
    observations: int = 3000
    """Largest number of observations for which profiles are computed; they then take seconds."""
    spread: int = 4000
    """Number of drawn parameter vectors from which the ranges of the charts are computed."""
    spread_ends: tuple[float, float, float] = (0.002, 0.5, 0.998)
    """Probabilities of the quantiles that are the low end, the middle and the high end of a chart.
    """
    along: int = 41
    """Points of a curve of the simulator."""
    map_side: int = 21
    """Points along each side of a map of the simulator."""
    curves: int = 3
    """Largest number of parameters with curves of the simulator; the first two also have a map."""
    experiments: int = 9
    """Largest number of experiments whose curves are drawn, for each response."""
    nodes: int = 200
    """Largest number of collocation nodes that are shown."""
    seed: int = 11
    """Seed of the drawn parameters and of the choice of nodes."""
    map_values: int = 10_000_000
    """Largest number of simulated values that are computed for the charts."""
    laws: int = 1024
    """Number of plausible laws whose densities form the band. A band that 256 laws form has ragged
    edges, because six of them lie beyond each edge.
    """
    densities: int = 10_240
    """Largest number of densities that form a band: where the densities of several experiments are
    averaged, there are fewer laws.
    """
    depth: float = 6.0
    """How far a profile is drawn below the drop of 1.92 at the ends of the 95 % interval."""


PICTURES = PictureSettings()


def drawn(values: ArrayLike, digits: int = PICTURES.digits) -> Any:
    """Numbers as nested lists, rounded to significant digits; NaN and infinity become None.

    >>> drawn([1.23456789, float("inf"), 0.0]), drawn([1000000.25], 10)
    ([1.2346, None, 0.0], [1000000.25])
    """
    return _shortest(np.asarray(values, dtype=np.float64).tolist(), digits)


def _shortest(values: Any, digits: int) -> Any:
    if isinstance(values, list):
        return [_shortest(value, digits) for value in values]
    return float(f"{values:.{digits}g}") if np.isfinite(values) else None


def law_bands(
    inputs: Inputs, draws: AlphaDraws, count: int, settings: PictureSettings = PICTURES
) -> dict[str, dict[str, Any]]:
    """The density of each scattering parameter, with a pointwise band of 95 % of plausible laws.

    Each entry has `x`, `density`, and the ends `lower` and `upper` of the band. Where laws follow
    covariates, the densities of some of the `count` experiments are averaged. A mixture with
    discrete points has no density, and no entry.
    """
    here = _values(inputs, draws.estimate, count, settings)
    averaged = max((own.shape[1] for own in here), default=1)
    draws = draws.fewer(min(settings.laws, settings.densities // averaged))
    others = [_values(inputs, alpha, count, settings) for alpha in draws.alpha]
    found = {}
    for i in inputs.scattered:
        band = _band(inputs.law(i), here[i], [own[i] for own in others], draws, settings)
        if band is not None:
            found[inputs.names[i]] = band
    return found


def law_bands_by_level(
    inputs: Inputs, draws: AlphaDraws, covariates: Table, settings: PictureSettings = PICTURES
) -> dict[str, dict[str, dict[str, Any]]]:
    """The entries of `law_bands` for each level of the factor that a law follows.

    They are by the names of the parameters, then by level (see `LawsByLevel`).
    """
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for i in inputs.scattered:
        apart = LawsByLevel.of(inputs, i, covariates)
        if apart is None:
            continue
        here, others = apart.values(draws.estimate), [*map(apart.values, draws.alpha)]
        for e, level in enumerate(apart.levels):
            one = [own[:, e : e + 1] for own in others]
            band = _band(inputs.law(i), here[:, e : e + 1], one, draws, settings)
            if band is not None:
                found.setdefault(inputs.names[i], {})[level] = band
    return found


def _band(
    law: Law, here: Array, others: Sequence[Array], draws: AlphaDraws, settings: PictureSettings
) -> dict[str, Any] | None:
    """The mean density of a law at hyperparameters (k, E), and its band over `others` like it."""
    if isinstance(law, Mixture) and law.points:
        return None
    low, high = _ends(law, here)
    wide = np.array([_ends(law, own) for own in others[: DRAWING.count]])
    low = min(low, float(np.quantile(wide[:, 0], settings.wide[0])))
    high = max(high, float(np.quantile(wide[:, 1], settings.wide[1])))
    x = np.linspace(low, high, settings.band_points)
    density = _density(law, here, x)
    each = np.array([_density(law, own, x) for own in others])
    if not np.all(np.isfinite(x)) or not np.any(np.isfinite(density)):
        return None
    found = {"x": drawn(x, settings.places), "density": drawn(density)}
    if not draws.certain:
        with np.errstate(invalid="ignore"):
            band = quantiles(
                each.T, np.broadcast_to(draws.weights, each.T.shape), np.array(INTERVALS.ends)
            )
        found |= {"lower": drawn(band[:, 0]), "upper": drawn(band[:, 1])}
    return found


def law_contours(
    inputs: Inputs, alpha: Array, settings: PictureSettings = PICTURES
) -> list[dict[str, Any]]:
    """Curves that enclose 50 % and 95 % of the joint law of some pairs of parameters.

    The curves are images of circles in the plane of two standard normal variates, which are
    correlated like the parameters. The most correlated pairs come first. There are no curves where
    laws follow covariates or are mixtures, because these laws are not simple transformations of
    normal variates.
    """
    if inputs.regressed or len(inputs.classes) > 1:
        return []
    matrix = inputs.correlation_matrix(alpha)
    pairs = sorted(combinations(inputs.scattered, 2), key=lambda pair: -abs(matrix[pair]))
    laws = [*inputs.laws.values()]
    angle = np.linspace(0.0, 2.0 * np.pi, settings.contour)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    found = []
    for i, j in pairs[: settings.pairs]:
        r = float(np.clip(matrix[i, j], -1.0, 1.0))
        turned = np.stack([circle[0], r * circle[0] + np.sqrt(1.0 - r * r) * circle[1]])
        curves = {}
        for mass in settings.masses:
            theta = turned * np.sqrt(stats.chi2.ppf(mass, 2))
            x, y = (
                laws[k].standard(alpha[inputs.slices[k]], at).x
                for k, at in zip((i, j), theta, strict=True)
            )
            curves[f"{mass:g}"] = [drawn(x, settings.places), drawn(y, settings.places)]
        found.append({"between": [inputs.names[i], inputs.names[j]], "curves": curves})
    return found


def _values(
    inputs: Inputs, alpha: Array, count: int, settings: PictureSettings
) -> tuple[Array, ...]:
    """The hyperparameters (k, E) of each law for E experiments; E = 1 where all are equal."""
    chosen = np.unique(np.linspace(0, count - 1, settings.laws_averaged).round().astype(int))
    found = inputs.values(alpha[: inputs.size], slice(0, count))
    return tuple(own[:, None] if own.ndim == 1 else own[:, chosen, 0] for own in found)


def _ends(law: Law, values: Array) -> tuple[float, float]:
    ends = np.array([law.quantile(own, np.array(PICTURES.band_ends)) for own in values.T])
    return float(ends.min()), float(ends.max())


def _density(law: Law, values: Array, x: Array) -> Array:
    with np.errstate(all="ignore"):
        each = np.array([np.exp(law.log_density(own, x)) for own in values.T])
        return np.asarray(each.mean(axis=0))


def likelihood_shapes(
    fit: Fit,
    estimates: Mapping[str, Estimate],
    report: Callable[[str], None],
    settings: PictureSettings = PICTURES,
) -> dict[str, Any]:
    """Profiles of the log-likelihood, and its surface over the two most correlated estimates.

    Both are drops below the maximum. A profile includes the ends of the 95 % interval. The result
    is empty where the maximum has no curvature, and for very many observations. Coarse nodes are
    used, since differences of log-likelihoods hardly depend on the number of nodes.
    """
    inference = fit.inference
    if not inference.positive or len(fit.table.observations) > settings.observations:
        return {}
    objective = fit.likelihood.rough().objective()
    profiles = {}
    for k in _shown(fit, estimates, settings):
        h = fit.hyperparameters[k]
        report(h.name)
        estimate = estimates[h.name]
        assert estimate.interval is not None
        assert estimate.drops is not None
        at = curve_points(estimate.interval, float(fit.alpha[k]), h)
        # The drops at the ends of the interval are known.
        told = dict(zip(estimate.interval, estimate.drops, strict=True))
        asked = np.array([value for value in at if value == fit.alpha[k] or value not in told])
        curve = likelihood_curve(objective, fit.alpha, fit.hyperparameters, inference, k, asked)
        found = curve.value[asked == fit.alpha[k]] - curve.value
        known = dict(zip(asked.tolist(), found.tolist(), strict=True)) | told
        below = np.array([known[value] for value in at.tolist()])
        profiles[h.name] = {"at": drawn(at, settings.places), "below": drawn(below)}
    return {"profiles": profiles, "surface": _surface(fit, estimates, objective, report, settings)}


def _shown(fit: Fit, estimates: Mapping[str, Estimate], settings: PictureSettings) -> list[int]:
    known = [
        int(k) for k in fit.inference.identified if estimates[fit.hyperparameters[k].name].interval
    ]
    return known[: settings.profiles]


def _surface(
    fit: Fit,
    estimates: Mapping[str, Estimate],
    objective: Scored,
    report: Callable[[str], None],
    settings: PictureSettings,
) -> dict[str, Any] | None:
    free = [int(k) for k in fit.inference.free]
    rows = [r for r, k in enumerate(free) if estimates[fit.hyperparameters[k].name].interval]
    correlation = fit.inference.correlation[np.ix_(rows, rows)]
    weakest = weakest_pair(correlation)
    if weakest is None:
        return None
    first, second = (free[rows[r]] for r in weakest)
    names = [fit.hyperparameters[k].name for k in (first, second)]
    report(" and ".join(names))
    found = likelihood_surface(
        objective, fit.alpha, fit.hyperparameters, fit.inference, (first, second), settings.side
    )
    return {
        "between": names,
        "correlation": float(correlation[weakest]),
        "first": drawn(found.first, settings.places),
        "second": drawn(found.second, settings.places),
        "below": drawn(np.nanmax(found.value) - found.value),
    }


ROWS = {1: ("last",), 2: ("first", "last")}
"""The places of the observations of a short series that are shown, by the length of the series."""
EVERY = ("first", "middle", "last")


def responses(fit: Fit, settings: PictureSettings = PICTURES) -> dict[str, Any]:
    """The simulator over each scattering parameter, and over two of them; the others at the middle.

    `over` has the values of each parameter, and `map` the grid of the first two. `shown` has, for
    some observations, `curves` by parameter and a `map`, in the original unit. Of a series the
    first, the middle and the last observation are shown; `place` says which. With collocation there
    are `nodes` instead, which are the values of each parameter at the nodes of the law, and `shown`
    has the outcomes of their runs. The result is empty where no parameter scatters, and where there
    are too many observations.
    """
    names = [fit.inputs.names[i] for i in fit.inputs.scattered][: settings.curves]
    seen = fit.table.observations
    if (
        not names
        or (len(names) * settings.along + settings.map_side**2) * len(seen) > settings.map_values
    ):
        return {}
    low, middle, high = _spread(fit, settings)
    columns = [fit.inputs.names.index(name) for name in names]
    lines = {k: np.linspace(low[k], high[k], settings.along) for k in columns}
    points = [_moved(middle, [k], at[:, None]) for k, at in lines.items()]
    pair = columns[:2] if len(columns) > 1 else []
    sides = [np.linspace(low[k], high[k], settings.map_side) for k in pair]
    if pair:
        grid = np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")], axis=1)
        points.append(_moved(middle, pair, grid))
    found = fit.likelihood.simulated(np.concatenate([*points, middle[None]]))
    if found is None:
        return _at_nodes(fit, columns, low, high, settings)
    parts = np.split(found, np.cumsum([len(part) for part in points]), axis=1)
    shown = []
    for m, place in _chosen(fit, parts[-1][:, 0], settings):
        curves = {n: _original(fit, m, part[m]) for n, part in zip(names, parts, strict=False)}
        plane = (
            {"map": _original(fit, m, parts[-2][m].reshape(settings.map_side, settings.map_side))}
            if pair
            else {}
        )
        shown.append({**_entry(fit, m, place, settings), "curves": curves, **plane})
    return {
        "over": {
            n: drawn(at, settings.places) for n, at in zip(names, lines.values(), strict=True)
        },
        "map": {
            n: drawn(at, settings.places) for n, at in zip(names[: len(pair)], sides, strict=True)
        },
        "shown": shown,
    }


def _at_nodes(
    fit: Fit, columns: list[int], low: Array, high: Array, settings: PictureSettings
) -> dict[str, Any]:
    """Outcomes of collocation at some nodes of the law.

    Nodes of Gauss rules that lie beyond all probable parameters are left out.
    """
    known = fit.likelihood.nodes()
    if known is None:
        return {}
    x, eta = known
    inside = np.all((x >= low) & (x <= high), axis=1)
    kept = np.flatnonzero(inside if inside.any() else np.ones(len(x), dtype=bool))
    if kept.size > settings.nodes:
        kept = np.sort(
            np.random.default_rng(settings.seed).choice(kept, settings.nodes, replace=False)
        )
    return {
        "nodes": {fit.inputs.names[k]: drawn(x[kept, k], settings.places) for k in columns},
        "shown": [
            {**_entry(fit, m, place, settings), "values": _original(fit, m, eta[m, kept])}
            for m, place in _chosen(fit, np.median(eta[:, kept], axis=1), settings)
        ],
    }


def _spread(fit: Fit, settings: PictureSettings) -> Array:
    """Low ends, middles and high ends (3, n) of all experiments' parameters, in the region."""
    inputs, rng = fit.inputs, np.random.default_rng(settings.seed)
    times = max(1, settings.spread // fit.count)
    alpha = fit.alpha[: inputs.size]
    x = np.concatenate([of_law(inputs, alpha, fit.count, rng) for _ in range(times)])
    return np.asarray(
        np.clip(np.quantile(x, settings.spread_ends, axis=0), *fit.likelihood.region.T)
    )


def _moved(middle: Array, columns: list[int], values: Array) -> Array:
    """Points (J, n) at the middle of the parameters, with values (J, k) in the k given columns."""
    points = np.tile(middle, (len(values), 1))
    points[:, columns] = values
    return points


def _chosen(fit: Fit, middle: Array, settings: PictureSettings) -> list[tuple[int, str]]:
    """Observations of some experiments for each response, with their places in their series.

    The experiments are spread evenly from low to high outcomes, and include the least probable one.
    Of each, the first, the middle and the last observation are taken.
    """
    seen = fit.table.observations
    each, found = np.nan_to_num(fit.of_experiments(), nan=-np.inf), []
    for response in range(len(seen.responses)):
        rows = np.flatnonzero(seen.response == response)
        of = seen.experiment[rows]
        last = rows[len(rows) - 1 - np.unique(of[::-1], return_index=True)[1]]
        last = last[np.argsort(middle[last], kind="stable")]
        worst = int(np.argmin(each[seen.experiment[last]]))
        evenly = (
            np.linspace(0, len(last) - 1, min(len(last), settings.experiments - 1))
            .round()
            .astype(int)
        )
        for m in last[np.unique([*evenly, worst])]:
            found += _placed(rows[of == seen.experiment[m]])
    return found


def _placed(rows: Indices) -> list[tuple[int, str]]:
    """The observations of a series that are shown, each with its place (first, middle, last)."""
    places = ROWS.get(len(rows), EVERY)
    at = np.linspace(len(rows) - 1, 0, len(places)).round().astype(int)[::-1]
    return [(int(rows[k]), place) for k, place in zip(at, places, strict=True)]


def _entry(fit: Fit, m: int, place: str, settings: PictureSettings) -> dict[str, Any]:
    """The chart entry of observation m of M: its experiment, row, place, response and bounds."""
    seen = fit.table.observations
    return {
        "id": str(fit.table.ids[int(seen.experiment[m])]),
        "row": int(seen.row[m]) + 1,
        "place": place,
        "response": seen.responses[int(seen.response[m])].name,
        "lower": _original(fit, m, seen.lower[m], settings.places),
        "upper": _original(fit, m, seen.upper[m], settings.places),
    }


def _original(fit: Fit, m: int, values: Array, digits: int | None = None) -> Any:
    """Values of observation m of M in the unit of the table, rounded for a chart."""
    seen = fit.table.observations
    response = seen.responses[int(seen.response[m])]
    with np.errstate(over="ignore"):
        shown = np.exp(values) if str(response.transform) == "log" else values
    return drawn(shown) if digits is None else drawn(shown, digits)


def pictures(
    result: Result,
    fit: Fit,
    draws: AlphaDraws,
    progress: Progress,
    settings: PictureSettings = PICTURES,
) -> dict[str, Any]:
    """What the report of a result draws besides its numbers, from its fit; no run is made.

    The entries are: `conditions` of each experiment; `laws` with their uncertainty by the `draws`
    of alpha; `contours` of the laws of two parameters; `profiles` of the likelihood, and its
    `surface` over the two most correlated estimates; the simulator's `response` over the
    parameters; `roughness`, the estimated errors of its surfaces; and `predicted` quantiles of each
    observation under the law. Cost: seconds.
    """
    progress.stage("pictures")
    rough = fit.likelihood.roughness
    return {
        **opening_pictures(result, fit, draws, settings),
        "contours": law_contours(fit.inputs, fit.alpha, settings),
        **likelihood_shapes(fit, result.alpha, progress.update, settings),
        "response": responses(fit, settings),
        "roughness": [] if rough is None else drawn(rough),
    }


def opening_pictures(
    result: Result, fit: Fit, draws: AlphaDraws, settings: PictureSettings = PICTURES
) -> dict[str, Any]:
    """The part of `pictures` that the first screen needs: conditions, laws and predictions."""
    return {
        "conditions": _conditions(fit, settings),
        "laws": law_bands(fit.inputs, draws, fit.count, settings),
        "laws_by_level": law_bands_by_level(
            fit.inputs, draws, covariates(fit.table, fit.inputs.covariates), settings
        ),
        "predicted": _predicted(fit, settings) if result.observations else {},
    }


def _conditions(fit: Fit, settings: PictureSettings) -> dict[str, list[Any]]:
    """Columns (N,) of numbers or texts that are constant within each experiment."""
    table = fit.table.table.reset_index(drop=True)
    owner = pd.Series(fit.table.experiment)
    found = {}
    for name in table.columns:
        column = table[name]
        if column.groupby(owner).nunique(dropna=False).max() > 1:
            continue
        first = column.groupby(owner).first().reindex(range(fit.count))
        found[str(name)] = (
            drawn(first.to_numpy(), settings.places)
            if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)
            else [str(value) for value in first]
        )
    return found


def _predicted(fit: Fit, settings: PictureSettings) -> dict[str, list[float]]:
    quantiles = fit.likelihood.quantiles(np.array(REPORTED.quantiles))
    return {
        str(p): drawn(q, settings.places)
        for p, q in zip(REPORTED.quantiles, quantiles.T, strict=True)
    }
