"""Where the best law of a fit is sought: parameters, their region, and the points that cover it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.errors import InputsError
from aleator.inference.fit import Fit
from aleator.laws.inputs import Inputs
from aleator.tasks.individual.population import FAR, around, held_region
from aleator.tasks.region import within
from aleator.types import Array

POINTS = (256, 1024, 2048)
"""Points that cover one, two, and more parameters."""
VALUES, FEWEST = 4_000_000, 128
"""Densities of observations at the points of a law, at most, and points at least."""
WIDER = 1.5
"""Half of the points are of the law with variates so many times as far out."""
EDGE = 1e-3
"""Share of the region's width within which a point is on its edge."""


def require_one_law(inputs: Inputs) -> None:
    """Raise InputsError where there is no one law of all experiments to be better than."""
    if inputs.regressed:
        raise InputsError(
            "the best possible law is one for all experiments, but these laws follow "
            f"{', '.join(inputs.covariates)}",
            "ask for it with laws that follow no column; the two verdicts of `aleator identify` "
            "do not need it",
        )
    if not inputs.scattering:
        raise InputsError(
            "no parameter scatters: there is no law to compare with the best possible one",
            "give a parameter a law, such as normal",
        )


@dataclass(frozen=True, eq=False)
class Sought:
    """Where the best law of a fit is sought: a region (s, 2) of the parameters that scatter."""

    fit: Fit
    moving: list[int]
    region: Array

    @classmethod
    def of(cls, fit: Fit) -> Sought:
        """The box of laws that have one; of others where their mass is; within the surfaces.

        Raises InputsError where there is no such law.
        """
        inputs = fit.inputs
        require_one_law(inputs)
        moving = [*inputs.scattered]
        mass = around(held_region(inputs, [fit.alpha], 1, FAR), inputs.box)
        laws = [*inputs.laws.values()]
        bounded = np.array([law.bounded for law in laws])[:, None]
        region = within(fit.likelihood.region, np.where(bounded, fit.likelihood.region, mass))
        return cls(fit, moving, region[moving])

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters that scatter."""
        return tuple(self.fit.inputs.names[i] for i in self.moving)

    @cached_property
    def still(self) -> Array:
        """The parameters (n,) of the median of the law: of constants, their values."""
        inputs, alpha = self.fit.inputs, self.fit.alpha
        middle = np.full((1, len(inputs.names)), 0.5)
        return np.asarray(inputs.marginal(alpha[: inputs.size], middle)[0])

    @property
    def held(self) -> dict[str, float]:
        """What is identified and not of the law of a scattering parameter: constants and noise."""
        inputs = self.fit.inputs
        kept = set(range(inputs.size))
        for i, part in enumerate(inputs.parts):
            if i not in self.moving:
                kept -= set(range(inputs.size)[part])
        return {
            h.name: float(value)
            for k, (h, value) in enumerate(
                zip(self.fit.hyperparameters, self.fit.alpha, strict=True)
            )
            if k not in kept and h.free
        }

    def x(self, z: Array) -> Array:
        """Parameters (J, n) of points (J, s) of the unit cube."""
        low, high = self.region.T
        x = np.tile(self.still, (len(z), 1))
        x[:, self.moving] = low + (high - low) * z
        return x

    def z(self, x: Array) -> Array:
        """Points (J, s) of the unit cube, on its faces where parameters x (J, n) are beyond."""
        low, high = self.region.T
        return np.asarray(np.clip((x[:, self.moving] - low) / (high - low), 0.0, 1.0))

    def log_density(self, z: Array) -> Array:
        """log p(observations | parameters) (N, J) at points (J, s) of the unit cube."""
        return self.fit.likelihood.given(self.x(z))

    @property
    def count(self) -> int:
        """Points that cover the region."""
        most = POINTS[min(len(self.moving), len(POINTS)) - 1]
        allowed = max(VALUES // len(self.fit.table.observations), FEWEST)
        return most if allowed >= most else int(2 ** np.floor(np.log2(allowed)))

    def cover(self, seed: int, count: int) -> Array:
        """Points (J, s): half of them spread over the region, half where the law is."""
        s, inputs = len(self.moving), self.fit.inputs
        uniform = qmc.Sobol(s, rng=seed).random(count // 2)
        scores = WIDER * special.ndtri(qmc.Sobol(s, rng=seed + 1).random(count // 2))
        probability = np.full((len(scores), len(inputs.names)), 0.5)
        probability[:, self.moving] = special.ndtr(scores)
        x = inputs.sample(self.fit.alpha[: inputs.size], probability)
        return np.concatenate([uniform, self.z(x)])

    def points(self, fit: Fit, rng: np.random.Generator) -> Array:
        """Points x (J, n) for another fit of the same laws: those that cover, and its own."""
        there = Sought(fit, self.moving, self.region)
        return there.x(np.concatenate([self._covering, there.own(rng)]))

    def own(self, rng: np.random.Generator) -> Array:
        """A draw (N, s) of the parameters of each experiment."""
        x = self.fit.likelihood.individuals(rng)
        step = max(1, len(x) // self.count)
        return self.z(x[::step][np.all(np.isfinite(x[::step]), axis=1)])

    def edges(self, x: Array) -> tuple[str, ...]:
        """Parameters of points x (S, s) that are on an edge of the region but not of the box."""
        box = self.fit.inputs.box[self.moving]
        slack = EDGE * np.diff(self.region, axis=1)[:, 0]
        low = (x.min(axis=0) < self.region[:, 0] + slack) & (self.region[:, 0] > box[:, 0])
        high = (x.max(axis=0) > self.region[:, 1] - slack) & (self.region[:, 1] < box[:, 1])
        return tuple(name for name, on in zip(self.names, low | high, strict=True) if on)

    @cached_property
    def _covering(self) -> Array:
        return self.cover(0, self.count)
