"""An answer settles where no step and no node gains."""

from dataclasses import replace

import pytest
from individual_cases import ALPHA, decay, likelihood_of, table

from aleator.fit.quadrature import nearest_maximum, with_enough_nodes


def test_it_settles_where_no_step_and_no_node_gains() -> None:
    likelihood = likelihood_of(decay, table(decay, experiments=20), nodes=3)
    end = with_enough_nodes(likelihood, ALPHA)
    again, alpha = nearest_maximum(end.likelihood, end.alpha * 1.02)
    assert again.evaluate(alpha).total == pytest.approx(end.value, abs=1e-3)
    finest = end.likelihood.by(replace(end.likelihood.rule, first=41, others=41), end.alpha)
    assert finest.evaluate(end.alpha).total == pytest.approx(end.value, abs=1e-2)
    assert end.gap == pytest.approx(0.0, abs=2e-3)
