"""Profile intervals: each end has its drop, also at kinks and jumps, and at little cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from aleator.core.types import Array
from aleator.inference.information import infer
from aleator.inference.profile import ENDS, TARGET, Bracket, profile_intervals
from aleator.laws import Hyperparameter
from aleator.search import GradientMultistart
from aleator.search.interface import LogLikelihood

DROP = 0.5 * stats.chi2.ppf(0.95, 1)


@dataclass
class ByDifferences:
    """Log-densities (N,) as a function of alpha (K,), with scores by central differences."""

    each: Callable[[Array], Array]

    def __call__(self, alpha: Array) -> LogLikelihood:
        scores = []
        for k in range(alpha.size):
            step = np.zeros(alpha.size)
            step[k] = 1e-6
            with np.errstate(invalid="ignore"):
                scores.append((self.each(alpha + step) - self.each(alpha - step)) / 2e-6)
        each = self.each(alpha)
        return LogLikelihood(each, np.stack(scores, axis=1), np.zeros(each.size, dtype=np.int64))


def free(*limits: tuple[float, float]) -> list[Hyperparameter]:
    return [
        Hyperparameter(f"h{k}", low, high, 0.5 * (low + high), free=True)
        for k, (low, high) in enumerate(limits)
    ]


# a uniform law of middle m and half width w, seen through normal noise that is small: the
# likelihood falls off steeply where either edge passes an outcome, and m and w go along kinks
NOISE = 0.004


def edges(y: Array) -> Callable[[Array], Array]:
    def each(alpha: Array) -> Array:
        low, high = alpha[0] - alpha[1], alpha[0] + alpha[1]
        # both from the tail in which they differ
        upper = stats.norm.logcdf((y - low) / NOISE)
        lower = stats.norm.logcdf((high - y) / NOISE)
        return np.asarray(upper + lower - np.log(high - low))

    return each


def test_the_middle_of_a_uniform_law_has_the_ends_of_its_exact_profile() -> None:
    y = 1.0 + 0.5 * (2.0 * np.random.default_rng(0).random(40) - 1.0)
    objective, hyperparameters = ByDifferences(edges(y)), free((0.0, 3.0), (0.1, 2.0))
    widths = np.linspace(0.45, 0.6, 4001)

    def highest(middle: float) -> tuple[float, float]:
        low, high = middle - widths, middle + widths
        value = -y.size * np.log(high - low)
        # far from the edges the other factors are one
        for one in np.sort(y)[:5]:
            value = value + stats.norm.logcdf((one - low) / NOISE)
        for one in np.sort(y)[-5:]:
            value = value + stats.norm.logcdf((high - one) / NOISE)
        return float(value.max()), float(widths[np.argmax(value)])

    middles = np.linspace(0.95, 1.05, 401)
    profile = np.array([highest(m)[0] for m in middles])
    top = middles[np.argmax(profile)]
    alpha = np.array([top, highest(float(top))[1]])
    inference = infer(objective, alpha, hyperparameters)
    found = profile_intervals(objective, alpha, hyperparameters, inference)
    inside = middles[profile > profile.max() - DROP]
    np.testing.assert_allclose(found.intervals[0], [inside[0], inside[-1]], atol=5e-4)
    np.testing.assert_allclose(found.drops, DROP, atol=0.03)


def test_an_interval_ends_where_the_likelihood_jumps_to_nothing() -> None:
    """Beyond 0.5 nothing is possible: the end is the last value before, and its drop is told."""

    def each(alpha: Array) -> Array:
        value = -0.5 * (alpha[0] ** 2 + (alpha[1] - alpha[0]) ** 2)
        return np.full(4, value / 4.0 if alpha[0] < 0.5 else -np.inf)

    hyperparameters, alpha = free((-10.0, 10.0), (-10.0, 10.0)), np.zeros(2)
    objective = ByDifferences(each)
    inference = infer(objective, alpha, hyperparameters)
    found = profile_intervals(objective, alpha, hyperparameters, inference)
    assert found.intervals[0] == pytest.approx([-np.sqrt(2.0 * DROP), 0.5], abs=0.02)
    assert found.drops[0] == pytest.approx([DROP, 0.125], abs=0.02)


class Told:
    """The progress of a stage, as it was told."""

    def __init__(self) -> None:
        self.updates: list[tuple[str, float | None, float | None]] = []

    def stage(self, name: str) -> None:
        raise AssertionError(name)

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        self.updates.append((text, done, total))


def test_each_end_is_told_as_it_begins() -> None:
    def each(alpha: Array) -> Array:
        return np.full(4, -0.125 * (alpha[0] ** 2 + (alpha[1] - alpha[0]) ** 2))

    hyperparameters, alpha, told = free((-10.0, 10.0), (-10.0, 10.0)), np.zeros(2), Told()
    objective = ByDifferences(each)
    inference = infer(objective, alpha, hyperparameters)
    profile_intervals(objective, alpha, hyperparameters, inference, progress=told)
    names = [hyperparameters[k].name for k in (0, 0, 1, 1)]
    assert told.updates == [
        (f"end {k + 1} of 4 of the intervals, {name}", k, 4) for k, name in enumerate(names)
    ]


def test_a_limit_is_an_end_only_where_the_profile_was_seen_to_drop_by_less() -> None:
    """A steep wall of height 3 between the maximum and a limit that is far below it."""

    def each(alpha: Array) -> Array:
        return np.full(4, -0.75 * expit(200.0 * (alpha[0] - 1.0)) - 1e-3 * alpha[0] ** 2)

    hyperparameters, alpha = free((-30.0, 30.0)), np.zeros(1)
    objective = ByDifferences(each)
    inference = infer(objective, alpha, hyperparameters)
    found = profile_intervals(objective, alpha, hyperparameters, inference)
    wall = 1.0 + np.log(DROP / (3.0 - DROP)) / 200.0
    assert found.intervals[0] == pytest.approx([-np.sqrt(DROP / 4e-3), wall], rel=0.01)


def test_an_end_that_is_not_found_is_not_told() -> None:
    """The log-likelihood is a staircase without a step of the right height but it has jumps."""
    rng = np.random.default_rng(1)

    def each(alpha: Array) -> Array:
        if abs(alpha[0]) < 0.5:
            return np.full(4, -0.125 * alpha[0] ** 2)
        return rng.normal(-0.48, 3.0, 4)

    hyperparameters, alpha = free((-9.0, 9.0)), np.zeros(1)
    objective = ByDifferences(each)
    inference = infer(objective, alpha, hyperparameters)
    found = profile_intervals(objective, alpha, hyperparameters, inference)
    known = np.isfinite(found.drops)
    assert found.better is not None or np.all(found.drops[known] < DROP + 0.03)


@pytest.mark.parametrize("power", [0.3, 1.0, 4.0])
def test_a_bracket_closes_on_the_root_whatever_its_shape(power: float) -> None:
    """Roots that grow as powers of the distance, and slopes that lead astray."""
    bracket, value, asked = Bracket.from_center(2.0, 50.0, 1.96), 2.7, 0
    while asked < 40:
        asked += 1
        root = 0.7 * (value - 2.0) ** power
        if abs(root - 1.96) < 0.01:
            break
        bracket = bracket.with_root(value, root)
        value = bracket.next(value, root, 0.3 if asked % 2 else -30.0)
    assert asked < 40
    assert bracket.closed is False


def two_hills(alpha: Array) -> Array:
    """log(exp(-(a^2 + b^2)/2) + 0.9 exp(-((a - 3)^2 + (b - 9)^2)/2)): one far hill, a bit lower."""
    a, b = alpha
    near, far = -0.5 * (a**2 + b**2), np.log(0.9) - 0.5 * ((a - 3.0) ** 2 + (b - 9.0) ** 2)
    return np.array([np.logaddexp(near, far)])


def test_an_interval_goes_over_the_hill_of_another_maximum() -> None:
    """The profile is the higher hill of the two: along a they overlap, along b not."""
    objective, top = ByDifferences(two_hills), np.zeros(2)
    hyperparameters = free((-10.0, 10.0), (-20.0, 20.0))
    inference = infer(objective, top, hyperparameters)
    found = profile_intervals(
        objective, top, hyperparameters, inference, rivals=[np.array([3.0, 9.0])]
    ).intervals
    beyond = np.sqrt(2.0 * (DROP + np.log(0.9)))
    near = np.sqrt(2.0 * DROP)
    expected = [[-near, 3.0 + beyond], [-near, near]]
    np.testing.assert_allclose(found, expected, atol=0.02)
    alone = profile_intervals(objective, top, hyperparameters, inference).intervals
    assert alone[0, 1] == pytest.approx(np.sqrt(2.0 * DROP), abs=0.02)


def test_what_is_on_a_limit_stays_there_though_the_likelihood_bends_upward() -> None:
    """-2 a^2 - a b/2 + b^2/2 - 1.4 b with b in (0, 2.5): b = 0 for all a above -2.8.

    The likelihood of a standard deviation bends up at its lower limit. Far away, on the other
    limit of b, it is a hill of its own, 0.375 lower, that no profile is to be led to.
    """

    def each(alpha: Array) -> Array:
        a, b = alpha
        return np.array([-2.0 * a**2 - 0.5 * a * b + 0.5 * b**2 - 1.4 * b])

    objective, hyperparameters = ByDifferences(each), free((-10.0, 10.0), (0.0, 2.5))
    inference = infer(objective, np.zeros(2), hyperparameters)
    found = profile_intervals(objective, np.zeros(2), hyperparameters, inference)
    end = np.sqrt(DROP / 2.0)
    np.testing.assert_allclose(found.intervals[0], [-end, end], atol=0.01)
    np.testing.assert_allclose(found.points[0], [[-end, 0.0], [end, 0.0]], atol=0.01)


@dataclass
class Bent:
    """A bent ridge of 40 normal residuals that counts how often it is asked."""

    asked: int = 0

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked += 1
        return ByDifferences(self.each)(alpha)

    def values(self, alphas: Array) -> Array:
        return np.array([self.each(alpha).sum() for alpha in alphas])

    def each(self, alpha: Array) -> Array:
        residual = np.where(np.arange(40) % 2 == 0, alpha[0], 2.0 * (alpha[1] - alpha[0] ** 2))
        return np.asarray(-0.5 * (residual + np.linspace(-3.0, 3.0, 40)) ** 2)


BENT = free((-5.0, 5.0), (-5.0, 5.0))
TOP = np.array([3.0 / 39.0, (3.0 / 39.0) ** 2 - 1.5 / 39.0])


def test_known_points_about_the_ends_save_evaluations() -> None:
    bent = Bent()
    inference = infer(bent, TOP, BENT)
    bent.asked = 0
    first = profile_intervals(bent, TOP, BENT, inference)
    spent, bent.asked = bent.asked, 0
    again = profile_intervals(bent, TOP, BENT, inference, about=first.points)
    assert again.intervals == pytest.approx(first.intervals, abs=1e-3)
    assert bent.asked < 0.7 * spent


def test_an_end_for_which_evaluations_do_not_suffice_is_not_told() -> None:
    settings = replace(ENDS, evaluations=1)
    found = profile_intervals(Bent(), TOP, BENT, infer(Bent(), TOP, BENT), settings=settings)
    assert np.isnan(found.drops[1]).all()
    assert np.isnan(found.intervals[1]).all()


# ----------------------------------------------------------------------------- many hyperparameters


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


@dataclass
class Ridge:
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
    likelihood = Ridge()
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
