"""What is known of the simulator, over the parameters that scatter: curves and maps."""

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
SEED = 11
MOST = 10_000_000
"""Values that are computed for the charts at most."""


def responses(fit: Fit) -> dict[str, Any]:
    """Outcomes over each scattering parameter, the others in their middle, and over two of them.

    `over` has the values of each parameter, `map` those of the two on the grid of the maps;
    `shown` has for some observations `curves` by parameter, and the `map`, in the original unit.
    Of a series it is the last observation. Empty where nothing is known but nodes.
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
    found = fit.simulated(np.concatenate([*points, middle[None]]))
    if found is None:
        return {}
    parts = np.split(found, np.cumsum([len(part) for part in points]), axis=1)
    shown = [
        _entry(fit, int(m), dict(zip(names, parts, strict=False)), parts[-2] if pair else None)
        for m in _chosen(fit, parts[-1][:, 0])
    ]
    return {
        "over": {n: drawn(at, PLACES) for n, at in zip(names, lines.values(), strict=True)},
        "map": {n: drawn(at, PLACES) for n, at in zip(names[: len(pair)], sides, strict=True)},
        "shown": shown,
    }


def _spread(fit: Fit) -> Array:
    """Low ends, middle and high ends (3, n) of the law of all experiments, within the region."""
    inputs, rng = fit.inputs, np.random.default_rng(SEED)
    times = max(1, DRAWS // fit.count)
    alpha = fit.alpha[: inputs.size]
    x = np.concatenate([of_law(inputs, alpha, fit.count, rng) for _ in range(times)])
    return np.asarray(np.clip(np.quantile(x, ENDS, axis=0), *fit.region.T))


def _moved(middle: Array, columns: list[int], values: Array) -> Array:
    """Points (J, n) in the middle but for some columns, whose values (J, k) are given."""
    points = np.tile(middle, (len(values), 1))
    points[:, columns] = values
    return points


def _chosen(fit: Fit, middle: Array) -> Indices:
    """The last observation of each response of some experiments, from low to high outcomes.

    The least probable experiment is among them.
    """
    seen = fit.table.observations
    key = seen.experiment * len(seen.responses) + seen.response
    last = len(key) - 1 - np.unique(key[::-1], return_index=True)[1]
    each, found = np.nan_to_num(fit.scored().each, nan=-np.inf), []
    for response in range(len(seen.responses)):
        own = last[seen.response[last] == response]
        own = own[np.argsort(middle[own], kind="stable")]
        worst = int(np.argmin(each[seen.experiment[own]]))
        evenly = np.linspace(0, len(own) - 1, min(len(own), EXPERIMENTS - 1)).round().astype(int)
        found.append(own[np.unique([*evenly, worst])])
    return np.concatenate(found)


def _entry(fit: Fit, m: int, curves: dict[str, Array], plane: Array | None) -> dict[str, Any]:
    """One observation m of M."""
    seen = fit.table.observations
    response = seen.responses[int(seen.response[m])]
    shown = np.exp if str(response.transform) == "log" else np.asarray
    with np.errstate(over="ignore"):
        entry = {
            "id": str(fit.table.ids[int(seen.experiment[m])]),
            "row": int(seen.row[m]) + 1,
            "response": response.name,
            "lower": drawn(shown(seen.lower[m]), PLACES),
            "upper": drawn(shown(seen.upper[m]), PLACES),
            "curves": {name: drawn(shown(part[m])) for name, part in curves.items()},
        }
        if plane is not None:
            entry["map"] = drawn(shown(plane[m]).reshape(ACROSS, ACROSS))
    return entry
