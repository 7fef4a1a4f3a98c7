"""Whether models were fitted to the same data, without which their likelihoods say nothing."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from aleator.errors import ExperimentsError
from aleator.inference.fit import Fit
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Transform
from aleator.types import Array

SAME = 1e-9
"""Relative difference up to which two measured values are one."""
REMEDY = "compare models of the same table, with the same outcome, bounds and ids"


def require_same_data(fits: Mapping[str, Fit]) -> None:
    """Raise ExperimentsError that names the first difference between the data of two models.

    Ids, transforms, the number of observations, measured values and bounds must be the same, in
    the same order; conditions and the names of responses need not.
    """
    for (one, fit), (other, next_fit) in pairwise(fits.items()):
        _require_same(one, fit.table, other, next_fit.table)


def _require_same(one: str, a: Experiments, other: str, b: Experiments) -> None:
    _require_same_ids(one, a, other, b)
    _require_same_transforms(one, a, other, b)
    seen, met = a.observations, b.observations
    counts = [np.bincount(s.experiment, minlength=len(a.ids)) for s in (seen, met)]
    if (differ := np.flatnonzero(counts[0] != counts[1])).size:
        l = differ[0]
        raise ExperimentsError(
            f"experiment '{a.ids[l]}' has {counts[0][l]} observations in model '{one}' and "
            f"{counts[1][l]} in model '{other}'",
            REMEDY,
        )
    for end in ("lower", "upper"):
        u, v = getattr(seen, end), getattr(met, end)
        if (differ := np.flatnonzero(~np.isclose(u, v, rtol=SAME, atol=0.0))).size:
            k = differ[0]
            raise ExperimentsError(
                f"experiment '{a.ids[seen.experiment[k]]}', {_name(a, k)}: the {end} end is "
                f"{u[k]:g} in model '{one}' and {v[k]:g} in model '{other}'",
                REMEDY,
            )


def _require_same_ids(one: str, a: Experiments, other: str, b: Experiments) -> None:
    for name, ids, stranger, others in ((one, a.ids, other, b.ids), (other, b.ids, one, a.ids)):
        if lacking := sorted(set(ids) - set(others)):
            raise ExperimentsError(
                f"model '{name}' has the experiment '{lacking[0]}', which '{stranger}' has not",
                REMEDY,
            )
    if a.ids != b.ids:
        raise ExperimentsError(
            f"models '{one}' and '{other}' have their experiments in another order",
            "sort the rows of the two tables alike",
        )


def _require_same_transforms(one: str, a: Experiments, other: str, b: Experiments) -> None:
    u, v = a.observations.responses, b.observations.responses
    if len(u) != len(v):
        raise ExperimentsError(
            f"model '{one}' has {len(u)} responses and '{other}' has {len(v)}", REMEDY
        )
    for k, (first, second) in enumerate(zip(u, v, strict=True)):
        if first.transform != second.transform:
            logged = a if first.transform is Transform.LOG else b
            raise ExperimentsError(
                f"'{first.name}' has transform {first.transform} in model '{one}' and "
                f"{second.transform} in '{other}': the likelihood is a density of y in one and of "
                f"log y in the other, {_jacobian(logged, k):.6g} apart by the Jacobian alone",
                "give both models the same transform",
            )


def _jacobian(table: Experiments, response: int) -> Array:
    """sum log y of the values that were measured."""
    seen = table.observations
    measured = (seen.response == response) & (seen.lower == seen.upper)
    return np.asarray(np.sum(seen.lower[measured]))


def _name(table: Experiments, k: int) -> str:
    seen = table.observations
    return f"'{seen.names[seen.response[k]]}'"
