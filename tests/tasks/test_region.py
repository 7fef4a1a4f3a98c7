"""Where surfaces begin for laws without a box: by a few experiments, and off the law's own end."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import Experiments, Free, Inputs, LogNormal, ResponseSurface
from aleator.core.types import Array
from aleator.fit.regions import padded

COUNT = 60


def test_a_region_is_padded_by_half_of_the_way_to_the_box_at_most() -> None:
    box, region = np.tile([0.0, 100.0], (3, 1)), np.array([[0.4, 20.0], [30.0, 60.0], [0.0, 99.0]])
    found = padded(region, box)
    assert found == pytest.approx(np.array([[0.2, 20.98], [28.5, 61.5], [0.0, 99.5]]))


def test_a_quotient_takes_few_runs_and_none_where_the_law_ends() -> None:
    """y = c / a: the logarithms of y / c are normal, and their mean and sd tell those of a."""
    random = np.random.default_rng(4)
    c = np.exp(random.uniform(0.0, 4.0, COUNT))
    normal = 0.3 + 0.4 * random.standard_normal(COUNT)
    asked: list[Array] = []

    def quotient(c: Array, a: Array) -> Array:
        asked.append(a)
        return np.asarray(c / a)

    table = pd.DataFrame({"c": c, "y": c / np.exp(normal)})
    found = unjudged(
        quotient, Experiments.from_frame(table, outcome="y"),
        Inputs({"a": LogNormal(Free(0.3, 4.0), Free(0.01, 2.0))}), vectorized=True,
        propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    mean = np.exp(normal.mean() + 0.5 * normal.var())
    sd = mean * np.sqrt(np.expm1(normal.var()))
    assert found.alpha["a.mean"].estimate == pytest.approx(mean, rel=1e-3)
    assert found.alpha["a.sd"].estimate == pytest.approx(sd, rel=1e-3)
    assert found.sound
    assert np.concatenate(asked).min() > 0.0
    assert found.runs <= 15 * COUNT
