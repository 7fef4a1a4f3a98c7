"""Profile intervals of many hyperparameters: right at every end, and at what cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array
from aleator.inference.information import infer
from aleator.inference.profile import ENDS, TARGET, profile_intervals
from aleator.laws import Hyperparameter
from aleator.search import GradientMultistart
from aleator.search.interface import LogLikelihood


@dataclass
class Scatterers:
    """Outcomes y = sum_i z_i x_i + e of normal x_i and noise: a normal law, exact; it counts."""

    z: Array
    y: Array
    asked: int = 0

    @classmethod
    def drawn(cls, n: int, count: int, seed: int) -> Scatterers:
        rng = np.random.default_rng(seed)
        z = 1.0 + 2.0 * rng.random((count, n)) * np.linspace(0.2, 1.0, n)
        mean, sd = np.linspace(1.0, 2.0, n), np.linspace(0.1, 0.3, n)
        x = mean + sd * rng.standard_normal((count, n))
        return cls(z, (z * x).sum(axis=1) + 0.3 * rng.standard_normal(count))

    @property
    def hyperparameters(self) -> list[Hyperparameter]:
        found = []
        for i in range(self.z.shape[1]):
            found.append(Hyperparameter(f"x{i}.mean", -5.0, 8.0, 1.0, free=True))
            found.append(Hyperparameter(f"x{i}.sd", 0.005, 2.0, 0.3, free=True, log=True))
        return [*found, Hyperparameter("noise.sd", 0.01, 2.0, 0.5, free=True, log=True)]

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked += 1
        mean, sd = alpha[0:-1:2], alpha[1:-1:2]
        variance = self.z**2 @ sd**2 + alpha[-1] ** 2
        off = self.y - self.z @ mean
        each = -0.5 * (np.log(2.0 * np.pi * variance) + off**2 / variance)
        by_variance = 0.5 * (off**2 / variance - 1.0) / variance
        scores = np.empty((self.y.size, alpha.size))
        scores[:, 0:-1:2] = (off / variance)[:, None] * self.z
        scores[:, 1:-1:2] = 2.0 * by_variance[:, None] * self.z**2 * sd
        scores[:, -1] = 2.0 * by_variance * alpha[-1]
        return LogLikelihood(each, scores, np.zeros(self.y.size, dtype=np.int64))


def root_at(likelihood: Scatterers, alpha: Array, top: float, k: int, value: float) -> float:
    """The signed root of twice the drop of the profile, by a search from several starts."""
    hyperparameters = likelihood.hyperparameters
    hyperparameters[k] = replace(hyperparameters[k], free=False, start=value)
    guess = alpha.copy()
    guess[k] = value
    search = GradientMultistart(4, evaluations=300)
    found = search.maximize(likelihood, hyperparameters, seed=1, guesses=[guess])
    return float(np.sqrt(max(2.0 * (top - found.log_likelihood), 0.0)))


def test_the_ends_of_eleven_profiles_are_where_they_belong_and_cost_little() -> None:
    likelihood = Scatterers.drawn(5, 60, seed=3)
    hyperparameters = likelihood.hyperparameters
    alpha = GradientMultistart(6, 200).maximize(likelihood, hyperparameters, seed=0).alpha
    inference = infer(likelihood, alpha, hyperparameters)
    top, likelihood.asked = likelihood(alpha).total, 0
    profile = profile_intervals(likelihood, alpha, hyperparameters, inference)
    # 22 ends; 25 evaluations each with the check of each, where climbing anew takes 47
    assert likelihood.asked < 600
    assert profile.better is None
    for k, (h, ends) in enumerate(zip(hyperparameters, profile.intervals, strict=True)):
        for end in ends:
            root = root_at(likelihood, alpha, top, k, float(end))
            if end in (h.lower, h.upper):
                assert root < TARGET + ENDS.close
            else:
                assert abs(root - TARGET) < 1.2 * ENDS.close


def test_an_end_on_its_own_limit_costs_nothing() -> None:
    likelihood = Scatterers.drawn(2, 60, seed=0)
    hyperparameters = likelihood.hyperparameters
    alpha = GradientMultistart(6, 200).maximize(likelihood, hyperparameters, seed=0).alpha
    inference = infer(likelihood, alpha, hyperparameters)
    (k,) = (k for k, side in enumerate(inference.at_bound) if side == "lower")
    likelihood.asked = 0
    profile = profile_intervals(likelihood, alpha, hyperparameters, inference)
    assert profile.intervals[k, 0] == hyperparameters[k].lower
    assert likelihood.asked < 200


@dataclass
class Bent:
    """Sixty residuals: half tell x = 1 -+ 0.5 each, half y = x^2 -+ 0.001; it counts."""

    asked: int = 0

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked += 1
        x, y = alpha
        off = np.linspace(-1.0, 1.0, 30)
        along, across = (x - 1.0) / 0.5 - off, (y - x**2) / 0.001 - off
        scores = np.zeros((60, 2))
        scores[:30, 0] = -along / 0.5
        scores[30:, 0] = across * 2.0 * x / 0.001
        scores[30:, 1] = -across / 0.001
        each = -0.5 * np.concatenate([along, across]) ** 2
        return LogLikelihood(each, scores, np.zeros(60, dtype=np.int64))


def test_a_ridge_that_bends_is_followed() -> None:
    likelihood = Bent()
    hyperparameters = [Hyperparameter(name, -4.0, 9.0, 1.0, free=True) for name in "xy"]
    alpha = np.ones(2)
    inference = infer(likelihood, alpha, hyperparameters)
    likelihood.asked = 0
    profile = profile_intervals(likelihood, alpha, hyperparameters, inference)
    # with y at its best x is a mean of thirty; y then is the square of that
    reach = TARGET * 0.5 / np.sqrt(30.0)
    ends = np.array([[1.0 - reach, 1.0 + reach], [(1.0 - reach) ** 2, (1.0 + reach) ** 2]])
    assert np.allclose(profile.intervals, ends, atol=0.005)
    assert likelihood.asked < 60
