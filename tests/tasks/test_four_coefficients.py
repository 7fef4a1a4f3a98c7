"""Four scattering parameters: the answer and its errors are those of the closed form."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Check, Free, GradientMultistart, Inputs, Noise, Normal

N, NOISE = 12, 0.05
TIMES = np.linspace(-1.0, 1.0, 7)
DESIGN = np.stack([TIMES**k for k in range(4)], axis=1)
MEANS, SDS = np.array([1.0, -0.5, 0.8, 0.3]), np.array([0.3, 0.2, 0.4, 0.25])


def cubic(t, a, b, c, d):
    return a + b * t + c * t**2 + d * t**3


def curves() -> np.ndarray:
    rng = np.random.default_rng(11)
    own = MEANS + SDS * rng.standard_normal((N, 4))
    return np.asarray(own @ DESIGN.T + NOISE * rng.standard_normal((N, TIMES.size)))


def negative(p: np.ndarray, y: np.ndarray) -> float:
    """-log L of the normal law that y = Z x + e has, x normal with independent parts."""
    means, sds, noise = p[:4], p[4:8], p[8]
    covariance = (DESIGN * sds**2) @ DESIGN.T + noise**2 * np.eye(TIMES.size)
    return -float(stats.multivariate_normal.logpdf(y, DESIGN @ means, covariance).sum())


def curvature(p: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The Hessian by central differences."""
    steps = 1e-3 * np.eye(p.size)
    return np.array(
        [
            [
                sum(
                    s * u * negative(p + s * a + u * b, y) for s in (1.0, -1.0) for u in (1.0, -1.0)
                )
                / 4e-6
                for b in steps
            ]
            for a in steps
        ]
    )


@pytest.mark.slow
def test_standard_errors_are_those_of_the_exact_information() -> None:
    y = curves()
    rows = pd.DataFrame(
        {"id": np.repeat(np.arange(N), TIMES.size), "t": np.tile(TIMES, N), "y": y.ravel()}
    )
    inputs = Inputs({name: Normal(Free(-2.0, 2.0), Free(0.02, 1.5)) for name in "abcd"})
    found = unjudged(
        cubic, rows, inputs, outcome="y", vectorized=True, noise=Noise(Free(0.01, 0.3)),
        search=GradientMultistart(1), verification=Check(0),
    )  # fmt: skip
    start = np.concatenate([MEANS, SDS, [NOISE]])
    limits = [(-2.0, 2.0)] * 4 + [(0.02, 1.5)] * 4 + [(0.01, 0.3)]
    end = optimize.minimize(negative, start, (y,), bounds=limits, tol=1e-12)
    order = [f"{name}.{part}" for part in ("mean", "sd") for name in "abcd"] + ["noise.sd"]
    exact = np.sqrt(np.diag(np.linalg.inv(curvature(end.x, y))))
    assert found.sound
    assert found.log_likelihood.estimated == pytest.approx(-end.fun, abs=1e-3)
    errors = np.array([found.alpha[name].standard_error for name in order], dtype=np.float64)
    np.testing.assert_allclose(errors, exact, rtol=0.01)
    estimates = np.array([found.alpha[name].estimate for name in order])
    assert np.max(np.abs(estimates - end.x) / exact) < 0.02
