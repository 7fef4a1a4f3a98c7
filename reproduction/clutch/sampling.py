"""Errors of the log-densities of the clutch's outcomes, by sampling and from few runs.

Sampling is evaluated on the response surfaces of the reference: 65,000 samples of 108 experiments
are seven million runs. What that changes is measured on the simulator and told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator.core.progress import Progress
from aleator.laws.quadrature import (
    Cubature,
    MonteCarloPoints,
    ProbabilityGrid,
    SobolPoints,
    TensorGauss,
)
from aleator.moments.densities import Gaussian
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.simulators.response_functions import DirectResponse, ResponseFunction
from reproduction.clutch.laws import EXPANSION, SAMPLED, Judged
from reproduction.clutch.reference import NODES, SAMPLES
from reproduction.clutch.study import ClutchStudy
from reproduction.sampling.histogram import HistogramSpline
from reproduction.sampling.likelihood import (
    Choice,
    SampledLikelihood,
    Sampling,
    log_likelihoods,
)

RANDOM, GRID, SOBOL = "Monte Carlo", "regular grid", "Sobol' points"
HISTOGRAM, ENTROPY, GAUSSIAN = "histogram spline", "maximum entropy", "Gaussian"
QUADRATURE, SURFACES = "quadrature, 25 runs", "surfaces"

RANDOM_SAMPLES = tuple(2**k for k in range(4, 17))
GRID_SIDES = (4, 5, 6, 8, 11, 16, 23, 32, 45, 64, 91, 128, 181, 256)
SOBOL_SAMPLES = tuple(2**k for k in range(4, 15))
LARGEST = {RANDOM: RANDOM_SAMPLES[-1], GRID: GRID_SIDES[-1] ** 2, SOBOL: SOBOL_SAMPLES[-1]}
REPLICATES, SHARED = 16, 2**16  # replicates of few samples; samples that all replicates may take
CHECKED = 256  # samples at which the simulator is run beside the surfaces
DRAWN_SEED = 1000  # added to the seed for what must not be the reference's own points


@dataclass(frozen=True)
class SamplingErrors:
    """What sampling the laws costs and what few runs give, at one law.

    `curves` has a row for each method, density and number of samples, `levels` one for each way
    from few runs. `surface` is the mean absolute change of a log-density that surfaces in place
    of the simulator make, `noise` that of the reference in place of one with other samples.
    """

    at: Judged
    curves: pd.DataFrame
    levels: pd.DataFrame
    surface: float
    noise: float

    def curve(self, method: str, density: str) -> pd.DataFrame:
        """The rows of one method and density, samples ascending."""
        rows = self.curves
        return rows[(rows["method"] == method) & (rows["density"] == density)]

    def level(self, density: str, way: str = EXPANSION) -> float:
        """The mean absolute error from few runs."""
        rows = self.levels
        found = rows[(rows["density"] == density) & (rows["way"] == way)]["mae"]
        return float(found.iloc[0])


def sampling_errors(
    study: ClutchStudy, at: Judged, seed: int, progress: Progress
) -> SamplingErrors:
    """Mean absolute errors of the log-densities of the measured outcomes at one law."""
    rows = []
    for method, cubatures in methods(seed + DRAWN_SEED).items():
        for cubature, replicates in cubatures:
            progress.update(f"{at.name}: {method}, {cubature}")
            way = Sampling(at.surface, study.law(), cubature)
            every = _by(way, at, (HISTOGRAM, ENTROPY), replicates)
            rows += [_row(at, method, name, found) for name, found in every.items()]
    progress.update(f"{at.name}: few runs, and what the surfaces change")
    levels = _levels(study, at)
    other = Sampling(at.surface, study.law(), SobolPoints(SAMPLES // 2, seed + DRAWN_SEED))
    noise = _by(other, at, (HISTOGRAM,))[HISTOGRAM].error(at.log_densities).floored
    return SamplingErrors(at, pd.DataFrame(rows), levels, _surface_change(study, at), noise.item())


def methods(seed: int) -> dict[str, list[tuple[Cubature, int]]]:
    """The cubatures of each method with the replicates of each."""
    return {
        RANDOM: [(MonteCarloPoints(s, seed), _replicates(s)) for s in RANDOM_SAMPLES],
        GRID: [(ProbabilityGrid(m), 1) for m in GRID_SIDES],
        SOBOL: [(SobolPoints(s, seed), _replicates(4 * s)) for s in SOBOL_SAMPLES],
    }


def _replicates(samples: int) -> int:
    return int(np.clip(SHARED // samples, 2, REPLICATES))


def _by(
    way: Sampling, at: Judged, names: Sequence[str], replicates: int = 1
) -> dict[str, SampledLikelihood]:
    choices: dict[str, Choice] = {
        HISTOGRAM: HistogramSpline(), ENTROPY: MaximumEntropy(order=4), GAUSSIAN: Gaussian(),
    }  # fmt: skip
    found = log_likelihoods(
        way, at.alpha, [choices[name] for name in names], at.measured,
        replicates=replicates, lower=at.reference.lower, upper=at.reference.upper,
    )  # fmt: skip
    return dict(zip(names, found, strict=True))


def _row(at: Judged, method: str, density: str, found: SampledLikelihood) -> dict[str, float | str]:
    error = found.error(at.log_densities)
    return {
        "law": at.name,
        "method": method,
        "density": density,
        "samples": found.runs,
        "replicates": error.floored.size,
        "mae": float(error.floored.mean()),
        "standard_error": error.standard_error,
        "mae_of_others": float(np.nanmean(error.others)),
        "missed": float(error.missed.mean()),
    }


def _levels(study: ClutchStudy, at: Judged) -> pd.DataFrame:
    """The errors from the expansion, from plain quadrature of its runs, and from the surfaces."""
    direct = DirectResponse(study.run, len(study.outcomes), study.box)
    plain = _by(Sampling(direct, study.law(), TensorGauss(NODES)), at, (GAUSSIAN, ENTROPY))
    per_experiment = at.surface.total_runs / len(study.outcomes)
    rows = []
    for density in (GAUSSIAN, ENTROPY):
        each = {
            EXPANSION: (float(NODES**2), at.fit(density, EXPANSION).log_pdf(at.measured)),
            QUADRATURE: (float(NODES**2), plain[density].each[0]),
            SURFACES: (per_experiment, at.fit(density, SAMPLED).log_pdf(at.measured)),
        }
        for way, (runs, value) in each.items():
            mae = float(np.abs(value - at.log_densities).mean())
            rows.append({"law": at.name, "density": density, "way": way, "runs": runs, "mae": mae})
    return pd.DataFrame(rows)


def _surface_change(study: ClutchStudy, at: Judged) -> float:
    """Mean absolute change of a log-density by the surfaces, with the same samples."""
    direct = DirectResponse(study.run, len(study.outcomes), study.box)
    responses: tuple[ResponseFunction, ...] = (direct, at.surface)
    by = [
        _by(Sampling(response, study.law(), SobolPoints(CHECKED)), at, (ENTROPY,))[ENTROPY].each
        for response in responses
    ]
    return float(np.abs(by[0] - by[1]).mean())
