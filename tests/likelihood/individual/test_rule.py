"""The nodes of the integral over individual parameters, before they are adapted."""

import numpy as np
import pytest

from aleator.likelihood.individual import Direct, GaussHermite
from aleator.likelihood.individual.predictors import Layout


@pytest.mark.parametrize("nodes", [40, 90, 200])
def test_weights_far_out_keep_their_digits(nodes: int) -> None:
    """int sech(t) dt = pi: the weights are multiplied by exp(t^2/2), up to 1e150 and more."""
    t, log_w = GaussHermite(nodes).nodes(1)
    t = t[:, 0]
    assert np.sum(np.exp(log_w + 0.5 * t**2) / np.cosh(t)) == pytest.approx(
        np.pi / np.sqrt(2.0 * np.pi), abs=1e-4
    )


class _Limit:
    """A life that is infinite below the limit x = 1."""

    def straight(self, _: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.where(x > 1.0, 1.0 / np.maximum(x - 1.0, 1e-300), np.inf)


def test_a_life_without_end_has_no_slope() -> None:
    each = np.arange(2)
    block = Layout(2, each, each, np.zeros(2, dtype=np.intp)).blocks(1)[0]
    predictor = Direct(_Limit(), np.array([0]), np.array([[-9.0, 9.0]]))
    eta, slopes = predictor.with_slopes(block, np.array([[[0.5]], [[1.5]]]))
    assert eta.ravel().tolist() == [np.inf, 2.0]
    assert slopes.ravel() == pytest.approx([0.0, -4.0], rel=1e-6)
