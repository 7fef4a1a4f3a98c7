"""A scale whose lower limit is zero: laws there are their own limit, with finite derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from aleator.laws import (
    Beta,
    Free,
    Gamma,
    Law,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)

SD = Free(0.0, 0.5)
LAWS: dict[str, Law] = {
    "normal": Normal(Free(0.5, 2.0), SD),
    "lognormal": LogNormal(Free(0.5, 2.0), SD),
    "uniform": Uniform(Free(0.5, 2.0), SD),
    "gamma": Gamma(Free(0.5, 2.0), SD, lower=0.1),
    "beta": Beta((0.0, 3.0), Free(0.5, 2.0), SD),
    "truncated": TruncatedNormal((0.4, 2.2), Free(0.5, 2.0), SD),
    "scipy": ScipyLaw(stats.logistic(), Free(0.5, 2.0), SD),
}
THETA = np.array([-3.0, -0.5, 0.0, 1.0, 3.0])


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_next_to_zero_every_law_is_its_mean_and_moves_with_it(law: Law) -> None:
    sd = law.hyperparameters[1]
    assert 0.0 < sd.lower <= 1e-3 * sd.upper
    found = law.standard(np.array([1.2, sd.lower]), THETA)
    np.testing.assert_allclose(found.x, 1.2, atol=20.0 * sd.lower)
    np.testing.assert_allclose(found.dvalues[:, 0], 1.0, atol=1e-2)
    # by the sd: the standardized variate, which for all of these is about theta
    slope = found.dvalues[:, 1]
    assert np.all(np.isfinite(slope))
    assert np.all(np.diff(slope) > 0.0)
    assert abs(slope[2]) < 0.01


def test_a_truncated_law_whose_mean_is_outside_ends_on_its_box() -> None:
    law = TruncatedNormal((0.0, 1.0), Free(-1.0, 2.0), Free(0.0, 0.5))
    found = law.standard(np.array([1.5, law.hyperparameters[1].lower]), THETA)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-9)
    assert np.all(np.isfinite(found.dvalues))


def test_a_start_is_not_next_to_zero() -> None:
    assert Normal(Free(0.0, 1.0), SD).hyperparameters[1].start == pytest.approx(0.5 * 1e-1**1.5)
