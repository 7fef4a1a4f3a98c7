"""Lines with normal parameters and errors that hang together: a multivariate normal law."""

from __future__ import annotations

import numpy as np
import pytest
from individual_cases import ALPHA, likelihood_of, straight_line, table
from scipy import stats

from aleator import CAR1, CompoundSymmetry, Experiments, Free, GaussianProcess, Noise
from aleator.core.types import Array
from aleator.inference.calibration import sequential_pit
from aleator.likelihood.individual import GaussHermite

FREE = Free(0.01, 5.0)
FRAME = table(straight_line)


def _distances(t: Array) -> Array:
    return np.abs(np.subtract.outer(t, t))


TIES = {
    "CAR(1)": (CAR1("time", FREE), [0.8], lambda v, t: v[0] ** 2 * np.exp(-_distances(t) / v[1])),
    "symmetry": (
        CompoundSymmetry(), [0.4], lambda v, t: v[0] ** 2 * (v[1] + (1.0 - v[1]) * np.eye(t.size)),
    ),
    "process": (
        GaussianProcess("time", FREE, FREE, 0.5), [0.4, 0.9],
        lambda v, t: v[0] ** 2 * np.eye(t.size) + v[1] ** 2 * np.exp(-_distances(t) / v[2]),
    ),
}  # fmt: skip


def _law(tie: str, alpha: Array, t: Array) -> tuple[Array, Array]:
    """Mean and covariance of the values of an experiment at times t."""
    x = np.stack([np.ones_like(t), t], axis=1)
    a, b = alpha[[1, 3]]
    law = np.array([[a**2, alpha[4] * a * b], [alpha[4] * a * b, b**2]])
    return x @ alpha[[0, 2]], x @ law @ x.T + TIES[tie][2](alpha[5:], t)


def _exact(tie: str, alpha: Array) -> Array:
    each = []
    for _, own in FRAME.groupby("id", sort=False):
        law = _law(tie, alpha, own["time"].to_numpy())
        each.append(stats.multivariate_normal.logpdf(own["y"], *law))
    return np.array(each)


@pytest.mark.parametrize("tie", TIES)
def test_likelihood_and_scores_are_exact(tie: str) -> None:
    """Rows are shuffled, which the column puts in order."""
    alpha = np.array([*ALPHA, *TIES[tie][1]])
    likelihood = likelihood_of(
        straight_line, FRAME, nodes=5, noise=Noise(FREE, correlation=TIES[tie][0])
    )
    found = likelihood.adapted(alpha)(alpha)
    np.testing.assert_allclose(found.each, _exact(tie, alpha), atol=1e-9)
    for k in range(alpha.size):
        step = 1e-5 * (np.arange(alpha.size) == k)
        slope = (_exact(tie, alpha + step) - _exact(tie, alpha - step)) / 2e-5
        np.testing.assert_allclose(found.scores[:, k], slope, atol=1e-6)


@pytest.mark.parametrize("tie", TIES)
def test_probabilities_of_observations_are_those_given_the_earlier_ones(tie: str) -> None:
    """Rosenblatt's transform of the normal law, in the order of the times."""
    alpha = np.array([*ALPHA, *TIES[tie][1]])
    noise = Noise(FREE, correlation=TIES[tie][0])
    frame = FRAME if TIES[tie][0].along else FRAME.sort_values(["id", "time"], ignore_index=True)
    likelihood = likelihood_of(straight_line, frame, noise=noise).by(GaussHermite(9), alpha)
    seen = Experiments.from_frame(frame, outcome="y", id="id").observations
    found = sequential_pit(likelihood, alpha, seen)
    for _, own in frame.groupby("id", sort=False):
        own = own.sort_values("time")
        mean, covariance = _law(tie, alpha, own["time"].to_numpy())
        white = np.linalg.solve(np.linalg.cholesky(covariance), own["y"] - mean)
        rows = np.flatnonzero(np.isin(seen.row, own.index))
        rows = rows[np.argsort(frame["time"].to_numpy()[seen.row[rows]])]
        np.testing.assert_allclose(found[rows], stats.norm.cdf(white), atol=0.03)
