"""Experiments with several observations whose likelihood is known by other means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator import Experiments, Free, Inputs, Noise, Normal
from aleator.likelihood.individual import Direct, GaussHermite, IndividualLikelihood, Layout
from aleator.observations.errors import MeasurementErrors


@dataclass(frozen=True)
class Function:
    """What a function of the time and the parameters gives for each row of a table."""

    model: Callable[[np.ndarray, np.ndarray], np.ndarray]
    time: np.ndarray

    def straight(self, unit: np.ndarray, x: np.ndarray) -> np.ndarray:
        return self.model(self.time[unit], x.T)[:, None]


def straight_line(time, x):
    return x[0] + x[1] * time


def decay(time, x):
    return x[0] * np.exp(-np.exp(x[1]) * time)


PAIR = Inputs(
    {
        "a": Normal(Free(-10.0, 10.0), Free(0.01, 5.0)),
        "b": Normal(Free(-5.0, 5.0), Free(0.01, 5.0)),
    },
    {("a", "b"): Free(-0.95, 0.95)},
)
ALPHA = np.array([1.5, 0.7, -0.4, 0.5, 0.4, 0.3])
"""Means and sds of a and b, their correlation, and the sd of the noise."""


def table(model, alpha=ALPHA, experiments=7, seed=0) -> pd.DataFrame:
    """Series of 1 to 6 times under the law alpha, in shuffled rows."""
    rng = np.random.default_rng(seed)
    rows = []
    for l in range(experiments):
        theta = rng.standard_normal(2)
        theta[1] = alpha[4] * theta[0] + np.sqrt(1.0 - alpha[4] ** 2) * theta[1]
        x = alpha[[0, 2]] + alpha[[1, 3]] * theta
        for time in np.sort(rng.uniform(0.0, 3.0, 1 + l % 6)):
            y = model(time, x) + alpha[5] * rng.standard_normal()
            rows.append({"id": f"e{l}", "time": time, "y": y})
    return pd.DataFrame(rows).sample(frac=1.0, random_state=seed).reset_index(drop=True)


def likelihood_of(model, frame, inputs=PAIR, nodes=5, noise=None) -> IndividualLikelihood:
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    errors = MeasurementErrors.of(noise or Noise(Free(0.01, 5.0)), experiments)
    seen = experiments.observations
    layout = Layout(len(experiments), seen.experiment, seen.row, np.zeros(len(seen.row), np.intp))
    function = Function(model, frame["time"].to_numpy())
    predictor = Direct(function, np.arange(len(inputs.names)), inputs.box)
    return IndividualLikelihood.of(inputs, errors, predictor, layout, GaussHermite(nodes))
