"""Log-likelihoods of two variables whose largest value is known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.core.types import Array
from aleator.laws import Hyperparameter
from aleator.search.interface import LogLikelihood


def result(value: float, gradient: Array) -> LogLikelihood:
    return LogLikelihood(np.array([value]), gradient[None, :], np.zeros(1, dtype=int))


def ridge(alpha: Array) -> LogLikelihood:
    """Rosenbrock's: 0 at (1, 1), along a curved ridge."""
    a, b = alpha
    gap = b - a**2
    gradient = np.array([2.0 * (1.0 - a) + 400.0 * a * gap, -200.0 * gap])
    return result(-((1.0 - a) ** 2) - 100.0 * gap**2, gradient)


CENTERS = np.array([[-2.0, -2.0], [2.5, 1.5], [0.0, 3.0]])
HEIGHTS = np.log([1.0, 1.6, 0.8])


def hills(alpha: Array) -> LogLikelihood:
    """Three normal hills; the largest value is log 1.6 at (2.5, 1.5), the next log 1 is 0.47 less.

    The hills are 2.9 units apart or more and 0.4 wide: one adds less than 1e-11 to another.
    """
    exponent = -np.sum((alpha - CENTERS) ** 2, axis=1) / 0.32 + HEIGHTS
    top = exponent.max()
    share = np.exp(exponent - top)
    value = top + np.log(share.sum())
    return result(value, (share / share.sum()) @ (-(alpha - CENTERS) / 0.16))


def waves(alpha: Array) -> LogLikelihood:
    """Rastrigin's: 0 at the origin, and an optimum of its own near every pair of integers."""
    value = -np.sum(alpha**2 + 10.0 * (1.0 - np.cos(2.0 * np.pi * alpha)))
    return result(float(value), -2.0 * alpha - 20.0 * np.pi * np.sin(2.0 * np.pi * alpha))


def box(low: float = -5.0, high: float = 5.0, start: float = 4.0) -> list[Hyperparameter]:
    return [Hyperparameter(name, low, high, start, free=True) for name in ("a", "b")]


class Recorded:
    """An objective that keeps every alpha it was asked for, and how: one with score, or a batch."""

    def __init__(self, function: Callable[[Array], LogLikelihood]) -> None:
        self.function = function
        self.asked: list[Array] = []
        self.batches: list[int] = []
        self.scored = 0

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked.append(alpha.copy())
        self.scored += 1
        return self.function(alpha)

    def values(self, alphas: Array) -> Array:
        self.asked.extend(alphas.copy())
        self.batches.append(len(alphas))
        return np.array([self.function(alpha).total for alpha in alphas])


class Heard:
    """A progress that keeps what it was told."""

    def __init__(self) -> None:
        self.updates: list[tuple[str, float | None, float | None]] = []

    def stage(self, name: str) -> None:
        raise AssertionError(f"a search has no stages of its own, such as {name}")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        self.updates.append((text, done, total))
