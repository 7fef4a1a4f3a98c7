"""The pictures of an identification: what is drawn of it, computed once and kept beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.inference.fit import Fit
from aleator.progress import Progress, Silent
from aleator.results.values import QUANTILES
from aleator.tasks.pictures.laws import law_bands, law_contours
from aleator.tasks.pictures.likelihood import likelihood_shapes
from aleator.tasks.pictures.numbers import PLACES, drawn
from aleator.tasks.pictures.response import responses

if TYPE_CHECKING:
    from aleator.tasks.identification import Identification

DRAWS = 256
"""Plausible laws whose densities make a band."""
STAGE = "pictures"


def pictured(found: Identification, progress: Progress | None = None) -> Identification:
    """The identification with what its report draws: `pictures`, by its fit, without runs.

    `conditions` of each experiment, `laws` with the uncertainty of alpha, `contours` of two
    parameters, `profiles` of the likelihood and its `surface` over the two estimates that are told
    apart worst, the simulator's `response` over the parameters and the `roughness` of its
    surfaces, and `predicted` quantiles of each observation under the law. Cost: seconds.
    Raises AleatorError where the identification was read from a file.

    >>> import pandas as pd
    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  verification=Check(0))
    >>> sorted(pictured(found).pictures)
    ['conditions', 'contours', 'laws', 'predicted', 'profiles', 'response', 'roughness', 'surface']
    """
    progress = progress or Silent()
    fit = found.fit
    progress.stage(STAGE)
    return replace(
        found,
        pictures={
            "conditions": _conditions(fit),
            "laws": law_bands(fit.inputs, found.draws(DRAWS), fit.count),
            "contours": law_contours(fit.inputs, fit.alpha),
            **likelihood_shapes(fit, found.alpha, progress.update),
            "response": responses(fit),
            "roughness": []
            if fit.likelihood.roughness is None
            else drawn(fit.likelihood.roughness),
            "predicted": _predicted(fit) if found.observations else {},
        },
    )


def _conditions(fit: Fit) -> dict[str, list[Any]]:
    """What is the same in all rows of an experiment, by its name: (N,) numbers or texts."""
    table = fit.table.table.reset_index(drop=True)
    owner = pd.Series(fit.table.experiment)
    found = {}
    for name in table.columns:
        column = table[name]
        if column.groupby(owner).nunique(dropna=False).max() > 1:
            continue
        first = column.groupby(owner).first().reindex(range(fit.count))
        found[str(name)] = (
            drawn(first.to_numpy(), PLACES)
            if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)
            else [str(value) for value in first]
        )
    return found


def _predicted(fit: Fit) -> dict[str, list[float]]:
    quantiles = fit.likelihood.quantiles(np.array(QUANTILES))
    return {str(p): drawn(q, PLACES) for p, q in zip(QUANTILES, quantiles.T, strict=True)}
