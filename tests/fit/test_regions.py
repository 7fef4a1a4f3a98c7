"""Regions of surfaces: alphas that are likely, and room about what the law reaches."""

import numpy as np
import pytest

from aleator.fit.regions import padded, plausible_alphas
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter


def test_likely_alphas_follow_the_information_within_the_limits() -> None:
    information = np.array([[400.0, 380.0], [380.0, 400.0]])
    nothing = np.zeros(3)
    inference = Inference(
        nothing, nothing, nothing, nothing, np.arange(2), np.linalg.inv(information), 0.0,
        (None, None, None), True, np.arange(2), information,
    )  # fmt: skip
    limits = tuple(Hyperparameter(name, 0.0, 2.0, 1.0, True) for name in ("a", "b", "c"))
    alphas = plausible_alphas(np.array([1.0, 1.0, 0.7]), inference, limits)
    assert (alphas[:, 2] == 0.7).all()
    assert np.corrcoef(alphas[:, :2].T)[0, 1] < -0.9
    assert np.abs(alphas[:, :2].mean(axis=0) - 1.0).max() < 0.05
    expected = 1.5 * np.sqrt(np.diag(np.linalg.inv(information)))
    assert alphas[:, :2].std(axis=0) == pytest.approx(expected, rel=0.15)


def test_a_region_is_padded_by_half_of_the_way_to_the_box_at_most() -> None:
    box, region = np.tile([0.0, 100.0], (3, 1)), np.array([[0.4, 20.0], [30.0, 60.0], [0.0, 99.0]])
    found = padded(region, box)
    assert found == pytest.approx(np.array([[0.2, 20.98], [28.5, 61.5], [0.0, 99.5]]))
