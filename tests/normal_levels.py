"""A fit in closed form: outcomes y_lk = a_l + e_lk, a ~ N(mu, tau^2), e ~ N(0, s^2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from aleator import Experiments, Free, Inputs, Normal
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.inference.consistency import consistency_of
from aleator.results.values import Consistency

NAMES = ("a.mean", "a.sd", "noise.sd")


@dataclass(frozen=True, eq=False)
class Levels:
    """N experiments with m outcomes each, y (N, m); alone, outcomes have no error."""

    y: Array
    alpha: Array
    inference: Any
    table: Experiments

    @classmethod
    def of(cls, y: Array, table: Experiments) -> Levels:
        """At the maximum of the likelihood."""
        n, m = y.shape
        mean, within = y.mean(axis=1), y - y.mean(axis=1, keepdims=True)
        between = float(np.var(mean))
        if m == 1:
            alpha = np.array([mean.mean(), np.sqrt(between)])
            information = np.diag([n / between, 2.0 * n / between])
        else:
            error = float(np.sum(within**2)) / (n * (m - 1))
            level = max(between - error / m, 1e-6)
            alpha = np.array([mean.mean(), np.sqrt(level), np.sqrt(error)])
            v, by = level + error / m, np.array([0.0, 2.0 * alpha[1], 2.0 * alpha[2] / m])
            information = n * np.outer(by, by) / (2.0 * v**2)
            information += np.diag([n / v, 0.0, 2.0 * n * (m - 1) / error])
        free = np.arange(alpha.size)
        inference = SimpleNamespace(
            free=free, identified=free, information=information,
            covariance=np.linalg.inv(information),
        )  # fmt: skip
        return cls(y, alpha, inference, table)

    @property
    def likelihood(self) -> Levels:
        """Its own."""
        return self

    @property
    def hyperparameters(self) -> Sequence[Any]:
        """Without limits."""
        return [
            SimpleNamespace(name=name, lower=-np.inf, upper=np.inf)
            for name in NAMES[: self.alpha.size]
        ]

    @property
    def count(self) -> int:
        """N."""
        return len(self.y)

    @property
    def noise(self) -> float:
        """s."""
        return float(self.alpha[2]) if self.alpha.size > 2 else 0.0

    @property
    def inputs(self) -> Any:
        """One parameter."""
        return Inputs({"a": Normal(Free(-9.0, 9.0), Free(0.01, 9.0))})

    def variates(self) -> tuple[Array, Array] | None:
        """Those of the best linear predictor; None where outcomes are alone."""
        m, tau = self.y.shape[1], self.alpha[1]
        if m == 1:
            return None
        gain = tau**2 / (tau**2 + self.noise**2 / m)
        means = gain * (self.y.mean(axis=1) - self.alpha[0])[:, None] / tau
        return means, (means**2 + 1.0 - gain)[:, :, None]

    def scored(self) -> Any:
        """The scores (N, K)."""
        m, tau, s = self.y.shape[1], self.alpha[1], self.noise
        r, v = self.y.mean(axis=1) - self.alpha[0], tau**2 + s**2 / m
        by = 0.5 * (r**2 / v - 1.0) / v
        columns = [r / v, 2.0 * tau * by]
        each = -0.5 * (np.log(v) + r**2 / v)
        if m > 1:
            within = np.sum((self.y - self.y.mean(axis=1, keepdims=True)) ** 2, axis=1)
            columns += [2.0 * s / m * by + within / s**3 - (m - 1) / s]
            each = each - 0.5 * within / s**2 - (m - 1) * np.log(s)
        scores = np.stack(columns, axis=1)
        return SimpleNamespace(scores=scores, score=scores.sum(axis=0), total=each.sum())

    def probabilities(self, points: int | None = None) -> Array:  # noqa: ARG002
        """By the normal law of each outcome given the earlier ones."""
        mean, variance = np.full(self.count, self.alpha[0]), np.full(self.count, self.alpha[1] ** 2)
        w = np.empty(self.y.shape)
        for k, y in enumerate(self.y.T):
            total = variance + self.noise**2
            w[:, k] = (y - mean) / np.sqrt(total)
            gain = variance / total
            mean, variance = mean + gain * (y - mean), variance * (1.0 - gain)
        return np.asarray(special.ndtr(w).ravel())

    def for_replicates(self) -> Levels:
        """The same: it has no nodes."""
        return self

    def at(self, alpha: Array) -> Levels:
        """The same outcomes."""
        return replace(self, alpha=alpha)

    def drawn(self, rng: np.random.Generator) -> Levels:
        """Other outcomes under alpha."""
        a = self.alpha[0] + self.alpha[1] * rng.standard_normal(self.count)
        return replace(self, y=a[:, None] + self.noise * rng.standard_normal(self.y.shape))


def judged(y: Array, seed: int = 0, **columns: Any) -> Consistency:
    """The consistency of outcomes y (N,) or (N, m) in a table that has these columns (N,) too."""
    y = y[:, None] if y.ndim == 1 else y
    n, m = y.shape
    frame = pd.DataFrame(
        {name: np.repeat(np.asarray(values), m) for name, values in columns.items()}
        | {"id": np.repeat([f"s{l}" for l in range(n)], m), "y": y.ravel()}
    )
    if m > 1:
        frame["time"] = np.tile(np.arange(float(m)), n)
    fit = Levels.of(y, Experiments.from_frame(frame, outcome="y"))
    return consistency_of(fit, True, seed, Silent())  # type: ignore[arg-type]
