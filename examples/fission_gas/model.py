"""The release of fission gas in 31 irradiation tests, by a Gaussian process for each."""

from pathlib import Path

import numpy as np
import pandas as pd

from aleator.core.types import Array

FOLDER = Path(__file__).parent
PROCESSES = pd.read_csv(FOLDER / "kriging.csv", index_col="experiment")
TRAINING = pd.read_csv(FOLDER / "training.csv")
POINTS = TRAINING[["diff", "crack"]].to_numpy()
SCALES = PROCESSES[["scale_diff", "scale_crack"]].to_numpy()
TREND = PROCESSES["trend"].to_numpy()


def kernel(x: Array, scales: Array) -> Array:
    """exp(-|(x - x')/scales|^2/2) of points x (R, 2) with the training points, (R, 225)."""
    gap = (x[:, None] - POINTS) / scales
    return np.exp(-0.5 * np.sum(gap**2, axis=2))


def coefficients(name: str, scales: Array) -> Array:
    """(K + nugget I)^-1 (y - trend) of one test, (225,)."""
    process = PROCESSES.loc[name]
    matrix = kernel(POINTS, scales) + process["nugget_factor"] * np.eye(len(POINTS))
    return np.linalg.solve(matrix, TRAINING[name].to_numpy() - process["trend"])


WEIGHTS = np.array([coefficients(*test) for test in zip(PROCESSES.index, SCALES, strict=True)])


def release(experiment: Array, diff: Array, crack: Array) -> Array:
    """The fraction of the gas that is released: the mean of each test's Gaussian process.

    `experiment` is the number of the test. `diff` multiplies the gas diffusion, `crack` is a
    calibration parameter of grain-boundary micro-cracking.
    """
    test = experiment.astype(int)
    near = kernel(np.stack([diff, crack], axis=1), SCALES[test][:, None])
    return TREND[test] + np.sum(near * WEIGHTS[test], axis=1)
