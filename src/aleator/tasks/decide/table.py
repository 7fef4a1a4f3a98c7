"""The table of a prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.likelihood.individual import Predictor
from aleator.progress import Progress
from aleator.tasks.decide.beyond import beyond
from aleator.tasks.decide.forecast import LOST, Draws, forecast
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.points import predictor_for
from aleator.tasks.decide.prediction import widened
from aleator.tasks.decide.predictors import about, direct, ends_of
from aleator.types import Array, Indices


def tabled(
    ground: Ground,
    draws: AlphaDraws,
    quantiles: tuple[float, ...],
    progress: Progress | None,
) -> pd.DataFrame:
    """A row for each row of the conditions and response, in the order of the rows.

    With draws of alpha, their mixture, and columns ``q<p>.lower`` and ``q<p>.upper`` with 95 %
    intervals of the quantiles.
    """
    draws, probabilities = ground.taken(draws), np.array(quantiles)
    own = _own(ground, draws.estimate)
    predictor = _about(ground, own) if draws.certain else predictor_for(ground, draws, progress)
    found = forecast(
        own, predictor, ground.layout, ground.errors,
        draws.estimate[ground.inputs.size :], probabilities,
    )  # fmt: skip
    ends = None
    if not draws.certain:
        found, ends = widened(ground, predictor, draws, probabilities, found)
    columns = heads(ground)
    columns["mean"], columns["standard_deviation"] = found.mean, found.sd
    columns["skewness"], columns["kurtosis"] = found.skewness, found.kurtosis
    columns |= {f"q{p:g}": found.quantiles[:, i] for i, p in enumerate(quantiles)}
    if ends is not None:
        for i, p in enumerate(quantiles):
            columns[f"q{p:g}.lower"], columns[f"q{p:g}.upper"] = ends[:, i].T
    columns |= tails(ground)
    columns["status"] = np.where(found.lost > LOST, "runs_failed", "solved")
    return in_rows(ground, columns)


def heads(ground: Ground, asked: Indices | None = None) -> dict[str, Any]:
    """The columns that say which row and response each value is, or those that are `asked`."""
    conditions, seen = ground.conditions, ground.seen
    which = np.arange(len(seen)) if asked is None else asked
    columns: dict[str, Any] = {"id": [conditions.ids[l] for l in seen.experiment[which]]}
    if len(conditions.ids) < len(conditions.conditions):
        columns["row"] = seen.row[which] + 1
    if len(seen.responses) > 1:
        columns["response"] = [seen.responses[k].name for k in seen.response[which]]
    return columns


def tails(ground: Ground, asked: Indices | None = None) -> dict[str, Array]:
    """How far each value is `beyond` the tested conditions, in tested ranges."""
    found, row = beyond(ground), ground.seen.row
    return {} if found is None else {"beyond": found.distance[row if asked is None else row[asked]]}


def in_rows(ground: Ground, columns: dict[str, Any], asked: Indices | None = None) -> pd.DataFrame:
    """The columns in the order of the rows; the responses of a row one below the other."""
    which = np.arange(len(ground.seen)) if asked is None else asked
    order = np.lexsort((ground.seen.response[which], ground.seen.row[which]))
    return pd.DataFrame(columns).iloc[order].reset_index(drop=True)


def _own(ground: Ground, alpha: Array) -> Draws:
    """Points of each new experiment, or of the measured one that it is, under one alpha."""
    if ground.measured is None:
        return Draws.new(ground.inputs, alpha, ground.count)
    likelihood, which = ground.measured.likelihood, ground.measured.which.tolist()
    each = {k: Draws.old(likelihood, alpha, k) for k in dict.fromkeys(which)}
    return Draws.joined([each[k] for k in which])


def _about(ground: Ground, own: Draws) -> Predictor:
    """The simulator, or surfaces about the law of the estimate."""
    x, box = own.x.reshape(-1, own.x.shape[2]), ground.inputs.box
    if ground.on_simulator:
        return direct(ground.runner, box, ends_of(x))
    return about(ground.runner, box, x, ground.surfaces)
