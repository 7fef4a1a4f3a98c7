"""Metropolis within Gibbs on the fission-gas study, as the example of OpenTURNS solves it.

Written for this comparison: the posterior of the two means and sds with flat priors on the limits
of the study, by random walks. Every sweep moves the parameters of all experiments, one parameter
after the other, and then the four hyperparameters; steps are tuned in the first half, which is
thrown away.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags
from aleator.study import Study

WISHED = 0.3
"""Share of steps to be taken."""


def posterior(study: Study, sweeps: int, seed: int = 0) -> Array:
    """Draws (sweeps, 4) of diff.mean, diff.sd, crack.mean, crack.sd after as many that tune."""
    rng, runner = np.random.default_rng(seed), study.runner()
    box, experiments = study.inputs.box, np.arange(len(study.experiments))
    limits = np.array([[h.lower, h.upper] for h in study.inputs.hyperparameters])
    y = study.experiments.observations.lower
    sd = study.experiments.table["noise_sd"].to_numpy()
    alpha = limits.mean(axis=1)
    x = np.tile(box.mean(axis=1), (experiments.size, 1))

    def fit(x: Array) -> Array:
        return np.asarray(-0.5 * ((y - runner.straight(experiments, x)[:, 0]) / sd) ** 2)

    def law(x: Array, alpha: Array) -> Array:
        mean, width = alpha[::2], alpha[1::2]
        inside = special.ndtr((box[:, 1] - mean) / width) - special.ndtr((box[:, 0] - mean) / width)
        return np.asarray(-0.5 * ((x - mean) / width) ** 2 - np.log(width * inside))

    step = 0.1 * np.diff(box, axis=1)[:, 0] * np.ones_like(x)
    wide = 0.1 * np.diff(limits, axis=1)[:, 0]
    draws, fitted = np.empty((2 * sweeps, 4)), fit(x)
    for sweep in range(2 * sweeps):
        tune = 0.1 if sweep < sweeps else 0.0
        for i in range(2):
            trial = x.copy()
            trial[:, i] += step[:, i] * rng.standard_normal(experiments.size)
            within = (trial[:, i] >= box[i, 0]) & (trial[:, i] <= box[i, 1])
            trial[~within] = x[~within]
            new = fit(trial)
            gain = new - fitted + (law(trial, alpha) - law(x, alpha))[:, i]
            taken = within & _taken(gain, rng)
            x[taken], fitted[taken] = trial[taken], new[taken]
            step[:, i] *= np.exp(tune * (taken - WISHED))
        for k in range(4):
            moved = alpha.copy()
            moved[k] += wide[k] * rng.standard_normal()
            within = limits[k, 0] <= moved[k] <= limits[k, 1]
            gain = np.sum(law(x, moved) - law(x, alpha), keepdims=True)
            taken = within and bool(np.all(_taken(gain, rng)))
            alpha = moved if taken else alpha
            wide[k] *= np.exp(tune * (taken - WISHED))
        draws[sweep] = alpha
    return draws[sweeps:]


def _taken(gain: Array, rng: np.random.Generator) -> Flags:
    return np.asarray(np.log(rng.uniform(size=np.shape(gain))) < gain)


def effective(draws: Array) -> float:
    """The effective number of draws (S,): S over the sum of autocorrelations (Geyer, 1992)."""
    centered = draws - draws.mean()
    size = 2 * len(centered)
    spectrum = np.abs(np.fft.rfft(centered, size)) ** 2
    rho = np.fft.irfft(spectrum, size)[: len(centered)]
    pairs = (rho[: len(rho) // 2 * 2] / rho[0]).reshape(-1, 2).sum(axis=1)
    positive = int(np.argmax(pairs < 0.0)) or len(pairs)
    return float(len(draws) / (2.0 * pairs[:positive].sum() - 1.0))
