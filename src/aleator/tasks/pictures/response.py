"""What is known of the simulator, over the parameters that scatter: curves and maps, or nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from aleator.inference.fit import Fit
from aleator.laws.individual import drawn as of_law
from aleator.tasks.pictures.numbers import PLACES, drawn
from aleator.types import Array, Indices

DRAWS = 4000
"""Parameters of which the middle and the ends of the charts are taken."""
ENDS = (0.002, 0.5, 0.998)
ALONG, ACROSS = 41, 21
"""Points of a curve, and of a side of a map."""
CURVES = 3
"""Parameters over which there are curves; over the first two there is a map."""
EXPERIMENTS = 9
ROWS = {1: ("last",), 2: ("first", "last")}
"""Which of so many rows of a series are shown; of more the middle one too."""
EVERY = ("first", "middle", "last")
NODES = 200
"""Nodes of collocation that are shown."""
SEED = 11
MOST = 10_000_000
"""Values that are computed for the charts at most."""


def responses(fit: Fit) -> dict[str, Any]:
    """Outcomes over each scattering parameter, the others in their middle, and over two of them.

    `over` has the values of each parameter, `map` those of the two on the grid of the maps;
    `shown` has for some observations `curves` by parameter, and the `map`, in the original unit.
    Of a series they are the first, the middle and the last observation, which `place` tells. With
    collocation there are `nodes` instead: the values of each parameter at those of the law, and
    `shown` has the outcomes of their runs. Empty where no parameter scatters, and of many rows.
    """
    names = [fit.inputs.names[i] for i in fit.inputs.scattered][:CURVES]
    seen = fit.table.observations
    if not names or (len(names) * ALONG + ACROSS**2) * len(seen) > MOST:
        return {}
    low, middle, high = _spread(fit)
    columns = [fit.inputs.names.index(name) for name in names]
    lines = {k: np.linspace(low[k], high[k], ALONG) for k in columns}
    points = [_moved(middle, [k], at[:, None]) for k, at in lines.items()]
    pair = columns[:2] if len(columns) > 1 else []
    sides = [np.linspace(low[k], high[k], ACROSS) for k in pair]
    if pair:
        grid = np.stack([side.ravel() for side in np.meshgrid(*sides, indexing="ij")], axis=1)
        points.append(_moved(middle, pair, grid))
    found = fit.likelihood.simulated(np.concatenate([*points, middle[None]]))
    if found is None:
        return _at_nodes(fit, columns, low, high)
    parts = np.split(found, np.cumsum([len(part) for part in points]), axis=1)
    shown = []
    for m, place in _chosen(fit, parts[-1][:, 0]):
        curves = {n: _original(fit, m, part[m]) for n, part in zip(names, parts, strict=False)}
        plane = {"map": _original(fit, m, parts[-2][m].reshape(ACROSS, ACROSS))} if pair else {}
        shown.append({**_entry(fit, m, place), "curves": curves, **plane})
    return {
        "over": {n: drawn(at, PLACES) for n, at in zip(names, lines.values(), strict=True)},
        "map": {n: drawn(at, PLACES) for n, at in zip(names[: len(pair)], sides, strict=True)},
        "shown": shown,
    }


def _at_nodes(fit: Fit, columns: list[int], low: Array, high: Array) -> dict[str, Any]:
    """Outcomes of the runs of collocation at the nodes of the law, some of those within its ends.

    Nodes of Gauss rules lie farther out than any parameter, where a chart would show nothing else.
    """
    known = fit.likelihood.nodes()
    if known is None:
        return {}
    x, eta = known
    inside = np.all((x >= low) & (x <= high), axis=1)
    kept = np.flatnonzero(inside if inside.any() else np.ones(len(x), dtype=bool))
    if kept.size > NODES:
        kept = np.sort(np.random.default_rng(SEED).choice(kept, NODES, replace=False))
    return {
        "nodes": {fit.inputs.names[k]: drawn(x[kept, k], PLACES) for k in columns},
        "shown": [
            {**_entry(fit, m, place), "values": _original(fit, m, eta[m, kept])}
            for m, place in _chosen(fit, np.median(eta[:, kept], axis=1))
        ],
    }


def _spread(fit: Fit) -> Array:
    """Low ends, middle and high ends (3, n) of the law of all experiments, within the region."""
    inputs, rng = fit.inputs, np.random.default_rng(SEED)
    times = max(1, DRAWS // fit.count)
    alpha = fit.alpha[: inputs.size]
    x = np.concatenate([of_law(inputs, alpha, fit.count, rng) for _ in range(times)])
    return np.asarray(np.clip(np.quantile(x, ENDS, axis=0), *fit.likelihood.region.T))


def _moved(middle: Array, columns: list[int], values: Array) -> Array:
    """Points (J, n) in the middle but for some columns, whose values (J, k) are given."""
    points = np.tile(middle, (len(values), 1))
    points[:, columns] = values
    return points


def _chosen(fit: Fit, middle: Array) -> list[tuple[int, str]]:
    """Some observations of each response, with their places in their series.

    They are the first, the middle and the last one of some experiments, from low to high last
    outcomes. The least probable experiment is among them.
    """
    seen = fit.table.observations
    each, found = np.nan_to_num(fit.scored().each, nan=-np.inf), []
    for response in range(len(seen.responses)):
        rows = np.flatnonzero(seen.response == response)
        of = seen.experiment[rows]
        last = rows[len(rows) - 1 - np.unique(of[::-1], return_index=True)[1]]
        last = last[np.argsort(middle[last], kind="stable")]
        worst = int(np.argmin(each[seen.experiment[last]]))
        evenly = np.linspace(0, len(last) - 1, min(len(last), EXPERIMENTS - 1)).round().astype(int)
        for m in last[np.unique([*evenly, worst])]:
            found += _placed(rows[of == seen.experiment[m]])
    return found


def _placed(rows: Indices) -> list[tuple[int, str]]:
    """Of the observations of a series those that are shown, and where in it each is."""
    places = ROWS.get(len(rows), EVERY)
    at = np.linspace(len(rows) - 1, 0, len(places)).round().astype(int)[::-1]
    return [(int(rows[k]), place) for k, place in zip(at, places, strict=True)]


def _entry(fit: Fit, m: int, place: str) -> dict[str, Any]:
    """What is told of observation m of M."""
    seen = fit.table.observations
    return {
        "id": str(fit.table.ids[int(seen.experiment[m])]),
        "row": int(seen.row[m]) + 1,
        "place": place,
        "response": seen.responses[int(seen.response[m])].name,
        "lower": _original(fit, m, seen.lower[m], PLACES),
        "upper": _original(fit, m, seen.upper[m], PLACES),
    }


def _original(fit: Fit, m: int, values: Array, digits: int | None = None) -> Any:
    """Values of observation m of M in the unit of the table, as they are drawn."""
    seen = fit.table.observations
    response = seen.responses[int(seen.response[m])]
    with np.errstate(over="ignore"):
        shown = np.exp(values) if str(response.transform) == "log" else values
    return drawn(shown) if digits is None else drawn(shown, digits)
