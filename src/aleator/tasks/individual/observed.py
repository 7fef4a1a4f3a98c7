"""What is told of each observation: its prediction, its residual, where it stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.likelihood.individual import IndividualLikelihood, IndividualParameters
from aleator.observations.experiments import Experiments
from aleator.results.values import ObservationReport
from aleator.tasks.session import varying_conditions
from aleator.types import Array


def observation_reports(
    table: Experiments,
    likelihood: IndividualLikelihood,
    alpha: Array,
    found: IndividualParameters,
    asked: Sequence[str],
    pit: Array,
) -> tuple[ObservationReport, ...]:
    """A report for each of M observations; of the `asked` conditions those that vary are told.

    `pit` (M,) are their probabilities, see `sequential_pit`.
    """
    seen, predicted = table.observations, found.predicted
    every = slice(0, len(seen))
    scale = likelihood.errors.scale(alpha[likelihood.inputs.size :], predicted[:, None], every)
    scale = np.broadcast_to(scale, (len(seen), 1))[:, 0]
    nearest = np.clip(predicted, seen.lower, seen.upper)
    with np.errstate(invalid="ignore"):
        # a prediction without end lies within every bound below it
        residual = np.where(nearest == predicted, 0.0, (nearest - predicted) / scale)
    names = varying_conditions(table, asked)
    columns = {name: table.conditions[name].to_numpy()[seen.row].tolist() for name in names}
    return tuple(
        ObservationReport(
            id=table.ids[seen.experiment[k]],
            row=int(seen.row[k]) + 1,
            response=seen.responses[seen.response[k]].name,
            lower=_finite(seen.lower[k]),
            upper=_finite(seen.upper[k]),
            predicted=float(predicted[k]),
            scale=float(scale[k]),
            residual=float(residual[k]),
            conditions={name: column[k] for name, column in columns.items()},
            pit=_finite(pit[k]),
        )
        for k in range(len(seen))
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
