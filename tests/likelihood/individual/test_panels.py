"""Panels of one variate: individual laws that one centre does not describe, against fine grids."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import likelihood_of
from scipy import stats

from aleator import Free, Inputs, Normal
from aleator.fit.quadrature import with_enough_nodes
from aleator.likelihood.individual import GaussHermite, Panels

ONE = Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})
ALPHA = np.array([0.3, 0.7, 0.05])
"""Mean and sd of x, and the sd of the noise."""
FINE = np.linspace(-9.0, 9.0, 200_001)


def front(time, x):
    return np.tanh((time - x[0]) / 0.05)


def square(time, x):
    return x[0] ** 2 + time


def clip(time, x):
    return np.clip(x[0] * (1.0 + time), -0.2, 0.9)


def jump(time, x):
    return x[0] * time + (x[0] > 0.4)


def line(time, x):
    return x[0] * (1.0 + time)


def drawn(model, noise: float = 0.05) -> pd.DataFrame:
    rng = np.random.default_rng(2)
    time = rng.uniform(0.0, 1.0, 20)
    y = model(time, ALPHA[0] + ALPHA[1] * rng.standard_normal((1, 20)))
    return pd.DataFrame({"id": range(20), "time": time, "y": y + noise * rng.standard_normal(20)})


def exact(model, frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """By the trapezoidal rule on 200,000 points."""
    weights = stats.norm.pdf(FINE) * (FINE[1] - FINE[0])
    x = (alpha[0] + alpha[1] * FINE)[None]
    return float(
        sum(
            np.log(stats.norm.pdf(y, model(time, x), alpha[2]) @ weights)
            for time, y in zip(frame["time"], frame["y"], strict=True)
        )
    )


@pytest.mark.parametrize("model", [line, front, square, clip, jump])
def test_panels_integrate_what_one_centre_misses(model) -> None:
    frame = drawn(model)
    on_panels = likelihood_of(model, frame, ONE).by(Panels(), ALPHA)
    truth = exact(model, frame, ALPHA)
    assert on_panels.evaluate(ALPHA).total == pytest.approx(truth, abs=1e-3)
    about_modes = on_panels.by(GaussHermite(40), ALPHA).evaluate(ALPHA).total
    assert (abs(about_modes - truth) < 1e-3) == (model is line)


def test_little_noise_is_no_trap() -> None:
    """Two modes a thousandth of the law wide."""
    frame, alpha = drawn(square, 0.0), np.array([0.3, 0.7, 1e-3])
    on_panels = likelihood_of(square, frame, ONE).by(Panels(), alpha)
    truth = exact(square, frame, alpha)
    assert on_panels.evaluate(alpha).total == pytest.approx(truth, abs=1e-3)


def test_the_score_with_panels_held_is_that_of_differences() -> None:
    held = likelihood_of(front, drawn(front), ONE).by(Panels(), ALPHA)
    steps = 1e-5 * np.eye(3)
    differences = [
        (held.evaluate(ALPHA + h).total - held.evaluate(ALPHA - h).total) / 2e-5 for h in steps
    ]
    np.testing.assert_allclose(held(ALPHA).score, differences, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(("model", "kind"), [(line, GaussHermite), (square, Panels)])
def test_an_answer_settles_on_panels_where_they_tell_something_else(model, kind) -> None:
    end = with_enough_nodes(likelihood_of(model, drawn(model), ONE), ALPHA)
    assert isinstance(end.likelihood.rule, kind)
    assert abs(end.gap) < 2e-3
