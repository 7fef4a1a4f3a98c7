"""The distribution of one outcome by the density of the outcome itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aleator.densities import Status
from aleator.likelihood.model import Model
from aleator.progress import Progress
from aleator.results.values import QUANTILES
from aleator.simulators import Runner
from aleator.tasks.refinement.choice import under_law
from aleator.types import Array


def predicted(
    runner: Runner,
    model: Model,
    alpha: Array,
    quantiles: tuple[float, ...] = QUANTILES,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """The table of `predict` for the conditions of a runner, under the law alpha (K,)."""
    ready = under_law(runner, model, alpha, progress)
    moments, fitted = ready.predictive.moments(alpha), ready.predictive.fitted(alpha)
    if model.open and np.any(fitted.status == Status.TOO_COARSE):
        fitted = ready.by(model.by_moments()).predictive.fitted(alpha)
    found = fitted.quantile(np.array(quantiles))
    columns: dict[str, Any] = {
        "id": list(runner.ids),
        "mean": moments.mean,
        "standard_deviation": moments.sd,
        "skewness": moments.standardized[:, 3],
        "kurtosis": moments.standardized[:, 4],
    }
    columns |= {f"q{p:g}": found[:, i] for i, p in enumerate(quantiles)}
    columns["status"] = [Status(int(code)).name.lower() for code in fitted.status]
    return pd.DataFrame(columns)
