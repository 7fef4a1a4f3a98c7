"""What a result file says of alpha, read again."""

from __future__ import annotations

import pytest

from aleator import Free, Inputs, Normal
from aleator.errors import InputsError
from aleator.inference.alpha_draws import estimated
from aleator.results.values import Estimate

INPUTS = Inputs({"x": Normal(Free(0.0, 2.0), Free(0.1, 1.0))})


def test_a_correlation_of_a_name_that_is_no_hyperparameter_is_told() -> None:
    alpha = {
        name: Estimate(0.5, 0.1, 0.1, (0.3, 0.7), None, fixed=False) for name in ("x.mean", "x.sd")
    }
    found = estimated(alpha, ["x.sd", "x.mean"], [[1.0, 0.2], [0.2, 1.0]], INPUTS.hyperparameters)
    assert found.which.tolist() == [1, 0]
    with pytest.raises(InputsError, match="2147483648"):
        estimated(alpha, ["2147483648"], [[1.0]], INPUTS.hyperparameters)
