"""An answer settles where no step and no node gains."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, decay, likelihood_of, table

from aleator import Free, Inputs, Normal
from aleator.fit.quadrature import _gaps, nearest_maximum, with_enough_nodes
from aleator.likelihood.individual.panels import Panels


def test_it_settles_where_no_step_and_no_node_gains() -> None:
    likelihood = likelihood_of(decay, table(decay, experiments=20), nodes=3)
    end = with_enough_nodes(likelihood, ALPHA)
    again, alpha = nearest_maximum(end.likelihood, end.alpha * 1.02)
    assert again.evaluate(alpha).total == pytest.approx(end.value, abs=1e-3)
    finest = end.likelihood.by(replace(end.likelihood.rule, first=41, others=41), end.alpha)
    assert finest.evaluate(end.alpha).total == pytest.approx(end.value, abs=1e-2)
    assert end.gap == pytest.approx(0.0, abs=2e-3)


def test_the_gap_of_many_experiments_is_that_of_all_though_panels_see_a_sample() -> None:
    """Of 1,500 experiments panels are tried on 300, whose mean difference is not that of all."""
    rng, count = np.random.default_rng(5), 1500
    time = rng.uniform(0.5, 2.0, count)
    y = 2.0 * np.exp(rng.normal(0.5, 0.1, count) * time) + 0.1 * rng.standard_normal(count)
    frame = pd.DataFrame({"id": [f"e{l}" for l in range(count)], "time": time, "y": y})
    law = Inputs({"a": Normal(Free(0.0, 1.0), Free(0.01, 0.5))})
    alpha = np.array([0.5, 0.1, 0.1])
    held = likelihood_of(lambda t, x: 2.0 * np.exp(x[0] * t), frame, law).adapted(alpha)
    whole = held.by(Panels(), alpha).evaluate(alpha).total - held.evaluate(alpha).total
    assert _gaps(held, alpha)[-1] == pytest.approx(whole, rel=1e-3)
    sizes = [len(block) for block in held.sampled(300).blocks]
    assert sizes == [30] * 10
