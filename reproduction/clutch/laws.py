"""Laws of the wet clutch's parameters: identified two ways, and the paper's own answers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.progress import Progress, Standing
from aleator.core.types import Array
from aleator.moments.densities import Density, FittedDensity
from aleator.moments.moments import Moments
from aleator.surrogates import ResponseSurface, Surface
from aleator.tasks.identification import Identification
from aleator.tasks.identify import identify
from examples.wet_clutch.model import shifting_time
from reproduction.clutch.reference import (
    DENSITIES,
    SAMPLES,
    Reference,
    expansion_moments,
    reference,
    surfaces,
)
from reproduction.clutch.study import ClutchStudy

SEARCH_TOLERANCE = 0.02  # of the surfaces
EXPANSION, SAMPLED = "expansion, 25 runs", "samples"

PAPER_GAUSSIAN = np.array([0.91, 0.077, 0.55, 0.014])
PAPER_ENTROPY = np.array([0.91, 0.081, 0.55, 0.046])
"""The paper's answers for its own measurements, in our order: mean, sd of x_1, mean, sd of x_2."""


@dataclass(frozen=True)
class Judged:
    """A law alpha with the reference of its outcomes and the moments from few runs and from many.

    `surface` is where the reference was sampled, `measured` (N,) are the outcomes whose
    log-densities are compared.
    """

    name: str
    alpha: Array
    surface: Surface
    reference: Reference
    moments: dict[str, Moments]
    measured: Array

    def fit(self, density: str, source: str = EXPANSION) -> FittedDensity:
        """The densities of all experiments from the moments of one source."""
        found = self.reference
        return DENSITIES[density].fit(self.moments[source], found.lower, found.upper)

    @property
    def log_densities(self) -> Array:
        """Log-densities (N,) of the measured outcomes under the reference."""
        return self.reference.histogram.log_pdf(self.measured)

    @property
    def log_density_errors(self) -> Array:
        """Their standard errors (N,): that of the number of samples in a bin of the histogram."""
        h = self.reference.histogram
        width = (h.high - h.low) / (h.cumulated.shape[1] - 1)
        expected = SAMPLES * width * np.exp(self.log_densities)
        return np.asarray(1.0 / np.sqrt(np.maximum(expected, 1.0)))


def judged(study: ClutchStudy, name: str, alpha: Array, seed: int, progress: Progress) -> Judged:
    """Make the reference of a law, and both kinds of moments."""
    surface = surfaces(study, alpha, progress, name)
    found = reference(study, alpha, surface, seed, progress, name)
    every = np.arange(len(study.outcomes))
    moments = {EXPANSION: expansion_moments(study, alpha, every), SAMPLED: found.moments}
    return Judged(name, alpha, surface, found, moments, study.outcomes)


def drawn(study: ClutchStudy, at: Judged, name: str, seed: int) -> Judged:
    """The same law with outcomes that it explains: one draw of the simulator an experiment."""
    uniform = np.random.default_rng(seed).random((at.measured.size, len(study.box)))
    x = study.law().sample(at.alpha, uniform)
    return replace(at, name=name, measured=study.run(np.arange(at.measured.size), x))


def identified(
    study: ClutchStudy, density: Density, seed: int, progress: Progress
) -> Identification:
    """Identify the law on response surfaces of one tolerance.

    The paper runs the simulator at 25 nodes for every alpha of its search; the surfaces give the
    same moments for far fewer runs.
    """
    return identify(
        shifting_time,
        study.experiments,
        study.law(),
        vectorized=True,
        propagation=ResponseSurface(tolerance=SEARCH_TOLERANCE),
        density=density,
        seed=seed,
        progress=_Within(progress),
    )


@dataclass(frozen=True)
class _Within:
    """The stages of an identification as texts of the figure's own stage."""

    outer: Progress

    def stage(self, name: str) -> None:
        self.outer.update(f"identification: {name}")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        self.outer.update(f"identification: {text}", done, total)

    def reached(self, standing: Standing) -> None:
        self.outer.update(f"identification: {standing}")


def values(result: Identification) -> Array:
    """The identified alpha (K,) in the order of the law."""
    return np.array([estimate.estimate for estimate in result.alpha.values()])
