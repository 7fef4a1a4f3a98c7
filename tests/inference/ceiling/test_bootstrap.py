"""The p value of the gap is uniform under the right law and small under a wrong one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from aleator.inference.information import infer
from aleator.inference.npmle import EXCEEDED, GapTest, gap, judged
from aleator.laws.hyperparameter import Hyperparameter
from aleator.progress import Silent
from aleator.search.value import LogLikelihood

COUNT, NOISE = 40, 0.5
LIMITS = (
    Hyperparameter("mean", -5.0, 5.0, 0.0, free=True),
    Hyperparameter("sd", 1e-3, 5.0, 1.0, free=True, log=True),
)
GRID = np.linspace(-6.0, 6.0, 121)[:, None]


@dataclass(frozen=True)
class Measured:
    """y = x + noise with x normal, whose likelihood is a closed form: as a `Fit`."""

    y: np.ndarray
    alpha: np.ndarray
    inference: object = None
    hyperparameters: tuple[Hyperparameter, ...] = LIMITS

    @classmethod
    def of(cls, y: np.ndarray) -> Measured:
        sd = np.sqrt(max(y.var() - NOISE**2, 1e-6))
        alpha = np.array([y.mean(), sd])
        fit = cls(y, alpha)
        return replace(fit, inference=infer(fit.objective(), alpha, LIMITS))

    @property
    def likelihood(self) -> Measured:
        return self

    def objective(self):
        def value(alpha: np.ndarray) -> LogLikelihood:
            mean, sd = alpha
            variance = sd**2 + NOISE**2
            away = self.y - mean
            each = -0.5 * (away**2 / variance + np.log(2.0 * np.pi * variance))
            by_sd = sd * (away**2 / variance**2 - 1.0 / variance)
            return LogLikelihood(
                each, np.stack([away / variance, by_sd], axis=1), np.zeros(len(each), dtype=int)
            )

        return value

    def scored(self) -> LogLikelihood:
        return self.objective()(self.alpha)

    def at(self, alpha: np.ndarray) -> Measured:
        return replace(self, alpha=alpha)

    def drawn(self, rng: np.random.Generator) -> Measured:
        mean, sd = self.alpha
        x = mean + sd * rng.standard_normal(len(self.y))
        return replace(self, y=x + NOISE * rng.standard_normal(len(self.y)))

    def given(self, x: np.ndarray) -> np.ndarray:
        away = (self.y[:, None] - x[:, 0]) / NOISE
        return -0.5 * (away**2 + np.log(2.0 * np.pi * NOISE**2))


def points(fit: object, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG001
    return GRID


def of(fit: Measured, most: int, seed: int = 0) -> GapTest:
    test = judged(fit, points, most, seed, Silent())  # type: ignore[arg-type]
    assert test is not None
    return test


def p_values(count: int, modes: float, most: int = 39) -> np.ndarray:
    """Of data sets whose law has two modes so many units from the middle; 0 is a normal law."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng([1, seed])
        x = modes * rng.choice([-1.0, 1.0], COUNT) + rng.normal(0.0, 0.1 if modes else 1.0, COUNT)
        fit = Measured.of(x + NOISE * rng.standard_normal(COUNT))
        found.append(of(fit, most, seed).p_value)
    return np.array(found)


def test_the_right_law_is_doubted_as_often_as_the_level_says() -> None:
    found = p_values(60, 0.0)
    assert 0.3 < found.mean() < 0.7
    assert np.mean(found <= 0.05) <= 0.12
    assert np.mean(found <= 0.5) == pytest.approx(0.5, abs=0.2)


def test_two_modes_are_found() -> None:
    assert np.mean(p_values(12, 1.5) <= 0.05) > 0.8


def test_it_stops_after_ten_larger_gaps_and_else_draws_all() -> None:
    rng = np.random.default_rng(0)
    fit = Measured.of(rng.normal(0.0, 1.1, COUNT))
    test = of(fit, 200)
    assert test.exceeded == EXCEEDED
    assert test.p_value == test.exceeded / test.replicates
    two = Measured.of(np.repeat([-3.0, 3.0], COUNT // 2))
    test = of(two, 25)
    assert (test.exceeded, test.replicates) == (0, 25)
    assert test.p_value == pytest.approx(1.0 / 26.0)


def test_a_gap_is_never_negative_where_points_are_many() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        assert gap(Measured.of(rng.normal(0.0, 1.2, COUNT)), GRID) > 0.0  # type: ignore[arg-type]


def test_replicates_without_a_likelihood_count_as_larger_and_are_told() -> None:
    class Broken(Measured):
        def drawn(self, rng: np.random.Generator) -> Measured:
            other = super().drawn(rng)
            return replace(other, y=np.full(COUNT, np.nan))

    fit = Measured.of(np.random.default_rng(2).normal(0.0, 1.2, COUNT))
    broken = Broken(fit.y, fit.alpha, SimpleNamespace(**vars(fit.inference)))
    with np.errstate(all="ignore"):
        test = of(broken, 30)
    assert test.failed == test.exceeded == EXCEEDED
    assert test.p_value == 1.0


def test_data_without_a_likelihood_are_not_judged() -> None:
    fit = Measured.of(np.random.default_rng(2).normal(0.0, 1.2, COUNT))
    lost = replace(fit, y=np.full(COUNT, np.nan))
    assert judged(lost, points, 30, 0, Silent()) is None  # type: ignore[arg-type]
