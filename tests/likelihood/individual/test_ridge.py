"""Points along a ridge: many variates, few observations, and integrals in closed form."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import likelihood_of
from scipy import stats

from aleator import Free, Inputs, Noise, Normal
from aleator.likelihood.individual import ImportancePoints, RidgePoints

MANY, NOISE = 10, 0.05
MEANS, SDS = np.linspace(-0.8, 1.1, MANY), np.linspace(0.1, 0.6, MANY)
ALPHA = np.append(np.stack([MEANS, SDS], axis=1).ravel(), NOISE)
INPUTS = Inputs({f"x{i}": Normal(Free(-3.0, 3.0), Free(0.02, 2.0)) for i in range(MANY)})


def factors(time: np.ndarray) -> np.ndarray:
    """(n, M)"""
    return np.stack([np.cos((1.0 + 0.7 * i) * time + i) + 0.3 for i in range(MANY)])


def linear(time, x):
    return np.sum(factors(time) * x, axis=0)


def bent(time, x):
    s = linear(time, x)
    return s + 0.06 * s**2


def frame_of(model, each: int) -> pd.DataFrame:
    rng, rows = np.random.default_rng(21), []
    for l in range(8):
        x = MEANS + SDS * rng.standard_normal(MANY)
        time = rng.uniform(0.0, 3.0, each)
        y = model(time, x[:, None]) + NOISE * rng.standard_normal(each)
        rows += [{"id": f"e{l}", "time": t, "y": v} for t, v in zip(time, y, strict=True)]
    return pd.DataFrame(rows)


@pytest.mark.parametrize("each", [1, 3, 12])
def test_a_linear_outcome_is_exact_with_the_fewest_points(each: int) -> None:
    """Fewer observations than variates, and more: log L is that of a normal law."""
    frame = frame_of(linear, each)
    likelihood = likelihood_of(linear, frame, INPUTS, nodes=1, noise=Noise(Free(0.01, 1.0)))
    found = likelihood.by(RidgePoints(), ALPHA).evaluate(ALPHA).each
    for own, (_, rows) in zip(found, frame.groupby("id", sort=False), strict=True):
        c, y = factors(rows["time"].to_numpy()), rows["y"].to_numpy()
        spread = (c.T * SDS**2) @ c + NOISE**2 * np.eye(y.size)
        assert own == pytest.approx(
            stats.multivariate_normal(c.T @ MEANS, spread).logpdf(y), abs=1e-4
        )


def exact(frame: pd.DataFrame) -> np.ndarray:
    """One bent observation an experiment: the sum s is normal, and integrated by a fine grid."""
    c, t = factors(frame["time"].to_numpy()), np.linspace(-9.0, 9.0, 20_001)
    s = (c.T @ MEANS)[:, None] + np.sqrt(c.T**2 @ SDS**2)[:, None] * t
    away = stats.norm.pdf(frame["y"].to_numpy()[:, None], s + 0.06 * s**2, NOISE)
    return np.log(away @ stats.norm.pdf(t) * (t[1] - t[0]))


def test_a_bent_outcome_is_as_exact_as_twice_the_points_tell() -> None:
    frame = frame_of(bent, 1)
    likelihood = likelihood_of(bent, frame, INPUTS, nodes=1, noise=Noise(Free(0.01, 1.0)))
    truth = exact(frame)
    few, more, by_modes = (
        likelihood.by(rule, ALPHA).evaluate(ALPHA).each
        for rule in (RidgePoints(), RidgePoints(128), ImportancePoints(600))
    )
    assert np.max(np.abs(few - truth)) < 2e-3
    assert np.max(np.abs(more - truth)) < 1e-3
    # points of a normal law about the mode do not know where the ridge goes
    assert np.max(np.abs(by_modes - truth)) > 10.0 * np.max(np.abs(few - truth))
