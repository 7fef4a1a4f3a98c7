"""Observations that the fitted model did not expect."""

from __future__ import annotations

import numpy as np
from scipy import special

from aleator.inference.consistency.calibration import corrected
from aleator.inference.consistency.residuals import Residuals
from aleator.observations.experiments import Experiments
from aleator.results.values import LEVEL, Outlier

MOST = 5
"""Outliers that are named."""


def outliers_of(residuals: Residuals, table: Experiments) -> tuple[Outlier, ...]:
    """The observations that the farthest of M lies beyond once in twenty times, farthest first."""
    seen = table.observations
    p = np.where(residuals.known, 2.0 * special.ndtr(-np.abs(residuals.normal)), 1.0)
    among = corrected(p, float(p.size))
    return tuple(
        Outlier(
            table.ids[seen.experiment[i]],
            int(seen.row[i]) + 1,
            seen.names[seen.response[i]],
            float(p[i]),
            float(among[i]),
        )
        for i in np.argsort(p, kind="stable")[:MOST]
        if among[i] < LEVEL
    )
