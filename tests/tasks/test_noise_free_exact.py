"""Without noise the default density is that of the outcome itself: skew outcomes are found exactly.

Four moments are a share of a standard error off on each of these, and more where it is told.
"""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import (
    Check,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Noise,
    Normal,
    ResponseSurface,
    predict,
)
from aleator.core.polynomials import gauss_hermite
from aleator.errors import InputsError

# Millions of revolutions to failure of 23 ball bearings: Lieblein and Zelen, J. Res. Nat. Bur.
# Stand. 57 (1956) 273, as in the package surpyval (load_bearing_failures).
BEARINGS = np.array([
    17.88, 28.92, 33.00, 41.52, 42.12, 45.60, 48.40, 51.84, 51.96, 54.12, 55.56, 67.80,
    68.64, 68.64, 68.88, 84.12, 93.12, 98.64, 105.12, 105.84, 127.92, 128.04, 173.40,
])  # fmt: skip
EXPONENT = Inputs({"x": Normal(mean=Free(2.0, 6.0), sd=Free(0.05, 2.0))})


def exponential(x: np.ndarray) -> np.ndarray:
    return np.exp(x)


def identified(y: np.ndarray, **more: object) -> Identification:
    return unjudged(
        exponential, pd.DataFrame({"y": y}), EXPONENT, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(3), **more,
    )  # type: ignore[arg-type]  # fmt: skip


def offset(found: Identification, y: np.ndarray) -> np.ndarray:
    """Estimates from the maximum in closed form, in standard errors."""
    mean, sd, count = np.log(y).mean(), np.log(y).std(), y.size
    law = np.array([found.alpha["x.mean"].estimate, found.alpha["x.sd"].estimate])
    return (law - [mean, sd]) / (sd / np.sqrt([count, 2.0 * count]))


def test_ball_bearings_have_the_lognormal_maximum() -> None:
    found = identified(BEARINGS, propagation=ResponseSurface(surfaces="own"))
    assert found.density == "level sets"
    assert found.sound
    assert np.abs(offset(found, BEARINGS)).max() < 0.05
    assert found.alpha["x.mean"].estimate == pytest.approx(4.1505, abs=0.005)
    assert found.alpha["x.sd"].estimate == pytest.approx(0.5215, abs=0.005)
    log_y = np.log(BEARINGS)
    exact = float(stats.norm.logpdf(log_y, log_y.mean(), log_y.std()).sum() - log_y.sum())
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.01)


def test_four_moments_of_the_bearings_are_a_share_of_a_standard_error_off() -> None:
    found = identified(BEARINGS, density=MaximumEntropy(4))
    assert np.abs(offset(found, BEARINGS)).max() > 0.2


@pytest.mark.parametrize(("extra", "tolerance"), [([], 0.005), ([4.5], 1e-5)])
def test_a_skewness_of_four_and_an_outlier_cost_nothing(
    extra: list[float], tolerance: float
) -> None:
    """The tolerance is relative to the scatter, which an outlier makes large beside the others."""
    rng = np.random.default_rng(2)
    y = np.exp(4.0 + 0.8 * np.append(rng.standard_normal(59), extra))
    found = identified(y, propagation=ResponseSurface(tolerance=tolerance))
    assert found.sound
    assert {e.status for e in found.experiments} == {"solved"}
    assert np.abs(offset(found, y)).max() < 0.1


@pytest.mark.parametrize(
    ("sd", "propagation"), [(0.8, ResponseSurface()), (1.5, ResponseSurface(tolerance=0.005))]
)
def test_no_outcome_is_out_of_reach_of_a_normal_law_without_a_box(
    sd: float, propagation: ResponseSurface
) -> None:
    """A pilot that is linear in x knows little of exp(x) over six decades."""
    y = np.exp(2.0 + sd * np.random.default_rng(0).standard_normal(60))
    wide = Inputs({"x": Normal(mean=Free(-5.0, 10.0), sd=Free(0.02, 3.0))})
    found = unjudged(
        exponential, pd.DataFrame({"y": y}), wide, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(3), propagation=propagation,
    )  # fmt: skip
    assert found.sound
    assert np.abs(offset(found, y)).max() < 0.1


def test_predictions_have_the_quantiles_of_the_skew_outcome() -> None:
    alpha = {"x.mean": 4.0, "x.sd": 0.8}
    table = predict(
        exponential, pd.DataFrame({"z": [1.0]}), EXPONENT, alpha, vectorized=True,
        propagation=ResponseSurface(tolerance=1e-3), quantiles=(0.01, 0.5, 0.99),
    )  # fmt: skip
    exact = stats.lognorm(0.8, scale=np.exp(4.0)).ppf([0.01, 0.5, 0.99])
    np.testing.assert_allclose(table[["q0.01", "q0.5", "q0.99"]].to_numpy()[0], exact, rtol=0.01)


def test_a_noise_of_zero_is_refused() -> None:
    with pytest.raises(InputsError, match="sd = 0"):
        Noise(0.0)


def test_of_two_parameters_the_exact_density_is_taken_where_it_moves_an_estimate() -> None:
    """y = w exp(x) is normal given x, which a Gauss rule integrates."""
    rng, (node, weight) = np.random.default_rng(5), gauss_hermite(60)
    y = (1.0 + 0.1 * rng.standard_normal(25)) * np.exp(0.5 * rng.standard_normal(25))
    law = Inputs(
        {"x": Normal(mean=0.0, sd=Free(0.1, 1.0)), "w": Normal(mean=Free(0.5, 2.0), sd=0.1)}
    )
    found = unjudged(
        lambda x, w: w * np.exp(x), pd.DataFrame({"y": y}), law, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(2),
        propagation=ResponseSurface(tolerance=1e-3),
    )  # fmt: skip
    assert found.density == "level sets"
    assert found.sound

    def exact(p: np.ndarray) -> float:
        factor = np.exp(p[0] * node)
        return -float(
            np.log(stats.norm.pdf(y[:, None] / factor, p[1], 0.1) / factor @ weight).sum()
        )

    end = optimize.minimize(exact, [0.5, 1.0], method="Nelder-Mead")
    for name, value in zip(("x.sd", "w.mean"), end.x, strict=True):
        estimate = found.alpha[name]
        assert estimate.standard_error is not None
        assert abs(estimate.estimate - value) < 0.05 * estimate.standard_error
