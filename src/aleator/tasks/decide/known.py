"""What an identification tells of alpha's uncertainty, in the order of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aleator.errors import InputsError
from aleator.inference.decisions.alpha_draws import Estimated
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.results.values import Estimate, in_order
from aleator.types import Array


def estimated(
    alpha: Mapping[str, Estimate],
    names: Sequence[str],
    correlation: Sequence[Sequence[float]],
    hyperparameters: Sequence[Hyperparameter],
) -> Estimated:
    """Estimates, errors, intervals and the `correlation` (F, F) of those with these `names`.

    Raises InputsError where alpha lacks a hyperparameter or has an unknown one, or the names have.
    """
    at = in_order(alpha, hyperparameters)
    place = {h.name: k for k, h in enumerate(hyperparameters)}
    for name in names:
        if name not in place:
            raise InputsError(
                f"the correlations name '{name}', which is no hyperparameter of this law",
                "run `aleator identify` again to write the result anew",
            )
    own = [alpha[h.name] for h in hyperparameters]
    return Estimated(
        at,
        _numbers([e.standard_error for e in own]),
        np.array([_numbers(e.interval or (None, None)) for e in own]).reshape(-1, 2),
        np.column_stack(limits_of(hyperparameters)),
        np.array([h.free for h in hyperparameters], dtype=bool),
        np.array([h.log for h in hyperparameters], dtype=bool),
        np.array([place[name] for name in names], dtype=np.intp),
        np.array([_numbers(row) for row in correlation]).reshape(len(names), len(names)),
    )


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if v is None else float(v) for v in values])
