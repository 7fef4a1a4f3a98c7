"""The distribution of one outcome by the density of the outcome itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aleator.fit.refine import under_law
from aleator.likelihood.model import Model
from aleator.progress import Progress
from aleator.results.values import QUANTILES
from aleator.simulators import Runner
from aleator.status import Status
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
    outcomes = ready.predictor.under(alpha)
    found = outcomes.quantile(np.array(quantiles))
    columns: dict[str, Any] = {
        "id": list(runner.ids),
        "mean": outcomes.mean,
        "standard_deviation": outcomes.sd,
        "skewness": outcomes.standardized[:, 3],
        "kurtosis": outcomes.standardized[:, 4],
    }
    columns |= {f"q{p:g}": found[:, i] for i, p in enumerate(quantiles)}
    columns["status"] = [Status(int(code)).name.lower() for code in outcomes.status]
    return pd.DataFrame(columns)
