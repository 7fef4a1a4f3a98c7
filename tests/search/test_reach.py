"""A likelihood that knows how far a step may go."""

import numpy as np

from aleator.core.types import Array
from aleator.laws import Hyperparameter
from aleator.search.interface import LogLikelihood
from aleator.search.newton import ASCENT, ascended


class Near:
    """-(a - 10)^2/2, whose steps go no farther than one."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked.append(float(alpha[0]))
        away = alpha - 10.0
        return LogLikelihood(-0.5 * away**2, -away[None], np.zeros(1, dtype=np.int64))

    def values(self, alphas: Array) -> Array:
        return np.array([self(alpha).total for alpha in alphas])

    def reach(self, alpha: Array, ahead: Array) -> float:
        return float(min(1.0, 1.0 / np.abs(ahead - alpha).max()))


def test_an_ascent_arrives_by_steps_no_longer_than_they_may_be() -> None:
    """But where little is left to gain: the last ones are as long as the curvature says."""
    objective, limits = Near(), [Hyperparameter("a", -20.0, 20.0, 0.0, free=True)]
    end = ascended(objective, np.zeros(1), limits, np.array([0]), np.eye(1))
    np.testing.assert_allclose(end.alpha, 10.0)
    assert np.abs(np.diff(objective.asked)).max() <= np.sqrt(2.0 * ASCENT.believed) + 1e-12
