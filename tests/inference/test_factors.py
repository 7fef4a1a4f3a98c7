"""Differences between the levels of a factor, against their closed form."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import By, Experiments, Free, Inputs, Noise, Normal, identify

MEANS = {"a": 1.0, "b": 2.5, "c": 1.4}
SD, NOISE = 0.5, 0.3


def test_levels_of_a_linear_model_with_known_errors() -> None:
    """y = x + e, x ~ N(m[by], SD^2): Wald's statistic is that of means with a known variance."""
    rng = np.random.default_rng(2)
    by = np.repeat([*MEANS], [5, 6, 9])
    y = np.array([MEANS[name] for name in by]) + np.hypot(SD, NOISE) * rng.standard_normal(len(by))
    frame = pd.DataFrame({"y": y, "by": by})
    table = Experiments.from_frame(frame, outcome="y")
    law = Normal(By("1 + C(by)", -9.0, 9.0), SD)
    found = identify(
        lambda x: x, table, Inputs({"x": law}), noise=Noise(NOISE), consistency=False,
        best_law=False,
    )  # fmt: skip
    variance = SD**2 + NOISE**2
    mean, n = (frame.groupby("by")["y"].agg(one) for one in ("mean", "count"))
    wald = float((n * (mean - np.average(mean, weights=n)) ** 2).sum() / variance)
    (effect,) = found.factors
    assert (effect.hyperparameter, effect.factor, effect.between) == ("x.mean", "by", ("b", "a"))
    assert effect.wald == pytest.approx(wald, rel=1e-4)
    assert (effect.df, effect.pairs) == (2, 3)
    assert effect.p == pytest.approx(stats.chi2.sf(wald, 2), rel=1e-3)
    error = np.sqrt(variance * (1.0 / n["a"] + 1.0 / n["b"]))
    assert effect.difference == pytest.approx(mean["b"] - mean["a"], rel=1e-4)
    assert effect.standard_error == pytest.approx(error, rel=1e-4)
    # The profile's ends are within 0.01 standard errors.
    reach = stats.norm.isf(0.025 / 3) * error
    assert np.subtract(effect.interval, effect.difference) == pytest.approx([-reach, reach], 6e-3)


def test_a_difference_that_is_one_coefficient_has_its_interval() -> None:
    """Of six experiments the profile's interval is wider than the estimate -+ 1.96 errors."""
    table = pd.DataFrame({"y": [0.2, 1.1, 0.7, 2.4, 1.9, 3.0], "by": [*"aaabbb"]})
    law = Normal(By("1 + C(by)", 0.0, 3.0), Free(0.1, 9.0))
    found = identify(
        lambda x: x, table, Inputs({"x": law}), outcome="y", noise=Noise(NOISE), consistency=False,
        best_law=False,
    )  # fmt: skip
    (effect,) = found.factors
    assert effect.interval == pytest.approx(found.alpha["x.mean[by=b]"].interval)
    assert effect.interval[1] > effect.difference + 2.2 * effect.standard_error
