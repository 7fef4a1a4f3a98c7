"""Small data sets: whole identifications, beside the exact log-likelihood maximized by SciPy.

In three published data sets the random effects b are normal and the curves F are linear in them, so
that y_l ~ Normal(F mean, F S F' + sd^2 I) with the covariance S of b (Laird and Ware, 1982). SciPy
maximizes this closed form, as a program for linear mixed models does. Aleator computes the same
likelihood as an integral, with intervals and both verdicts. Two rows are commands in processes of
their own, where imports count.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import optimize

from aleator import Constant, Experiments, Free, Inputs, Noise, Normal, identify
from aleator.core.types import Array
from aleator.laws.law import Law
from benchmarks.row import Row, seconds_row

ROOT = Path(__file__).parent.parent
DATA = ROOT / "tests" / "data"
TARGETS = {"sleep_study/correlated.toml": 2.0, "fission_gas/study.toml": 15.0}
"""The studies of examples/ that are identified in a process of their own, with their seconds."""
DAYS = np.array([118.0, 484.0, 664.0, 1004.0, 1231.0, 1372.0, 1582.0])
GIRTHS = (
    (30, 58, 87, 115, 120, 142, 145), (33, 69, 111, 156, 172, 203, 203),
    (30, 51, 75, 108, 115, 139, 140), (32, 62, 112, 167, 179, 209, 214),
    (30, 49, 81, 125, 142, 174, 177),
)  # fmt: skip
"""The girths in mm of five orange trees at ages of `DAYS` (Draper and Smith, 1981)."""


@dataclass(frozen=True)
class Small:
    """A data set with its simulator and laws, and its exact normal moments.

    `moments` gives, at alpha, the means (m,) and the covariance (m, m) of the m observations of an
    experiment. They are the same in all experiments. SciPy begins at the alpha `start`.
    """

    frame: pd.DataFrame
    simulator: Callable[..., Array]
    inputs: Inputs
    noise: Noise
    moments: Callable[[Array], tuple[Array, Array]]
    start: Array

    @property
    def y(self) -> Array:
        """The observations (N, m)."""
        return np.array([own["y"].to_numpy() for _, own in self.frame.groupby("id")])

    def log_likelihood(self, alpha: Array) -> float:
        """The exact log-likelihood at alpha."""
        mean, covariance = self.moments(alpha)
        left, (sign, size) = self.y - mean, np.linalg.slogdet(2.0 * np.pi * covariance)
        square = np.sum(left @ np.linalg.inv(covariance) * left)
        return -0.5 * float(square + len(left) * size) if sign > 0 else -np.inf


def sleep() -> Small:
    """Reaction times of 18 persons over ten days: a line with random start and slope."""
    frame = pd.read_csv(DATA / "sleepstudy.csv")
    frame = frame.rename(columns={"unit": "id", "reaction": "y"})
    laws = {
        "start": Normal(Free(100.0, 400.0), Free(0.1, 200.0)),
        "slope": Normal(Free(-50.0, 50.0), Free(0.05, 50.0)),
    }
    curves = np.stack([np.ones(10), np.arange(10.0)], axis=1)

    def moments(alpha: Array) -> tuple[Array, Array]:
        spread = np.diag(alpha[[1, 3]] ** 2)
        return curves @ alpha[[0, 2]], curves @ spread @ curves.T + alpha[4] ** 2 * np.eye(10)

    return Small(
        frame, lambda days, start, slope: start + slope * days, Inputs(laws),
        Noise(Free(1.0, 200.0)), moments, np.array([260.0, 30.0, 9.0, 5.0, 30.0]),
    )  # fmt: skip


def dyestuff() -> Small:
    """The yields of six batches of dyestuff, five samples of each: one random level."""
    frame = pd.read_csv(DATA / "dyestuff.csv").rename(columns={"unit": "id", "yield": "y"})

    def moments(alpha: Array) -> tuple[Array, Array]:
        return np.full(5, alpha[0]), alpha[1] ** 2 * np.ones((5, 5)) + alpha[2] ** 2 * np.eye(5)

    laws = {"level": Normal(Free(1000.0, 2000.0), Free(0.0, 300.0))}
    return Small(
        frame, lambda level: 1.0 * level, Inputs(laws),
        Noise(Free(1.0, 300.0)), moments, np.array([1500.0, 50.0, 50.0]),
    )  # fmt: skip


def orange() -> Small:
    """Logistic growth of five trees with a random final girth."""
    frame = pd.DataFrame(
        [(k, a, float(y)) for k, row in enumerate(GIRTHS) for a, y in zip(DAYS, row, strict=True)],
        columns=["id", "age", "y"],
    )
    laws: dict[str, Law] = {
        "final": Normal(Free(50.0, 500.0), Free(0.1, 200.0)),
        "half": Constant(Free(100.0, 2000.0)),
        "scale": Constant(Free(50.0, 1500.0)),
    }

    def grown(age: Array, final: Array, half: Array, scale: Array) -> Array:
        return np.asarray(final / (1.0 + np.exp(-(age - half) / scale)))

    def moments(alpha: Array) -> tuple[Array, Array]:
        curve = grown(DAYS, np.ones(7), alpha[2], alpha[3])
        return alpha[0] * curve, alpha[1] ** 2 * np.outer(curve, curve) + alpha[4] ** 2 * np.eye(7)

    return Small(
        frame, grown, Inputs(laws), Noise(Free(0.1, 100.0)), moments,
        np.array([200.0, 20.0, 700.0, 300.0, 10.0]),
    )  # fmt: skip


STUDIES = {"sleepstudy": sleep, "Dyestuff": dyestuff, "Orange": orange}


def small_rows() -> list[Row]:
    """A row of seconds and one of log L for each data set, then the commands."""
    rows = [row for name, made in STUDIES.items() for row in _beside(name, made())]
    return rows + [_command(study, target) for study, target in TARGETS.items()]


def _beside(name: str, small: Small) -> list[Row]:
    """Aleator's identification of a data set beside SciPy's maximum of its closed form."""
    began = _processor()
    table = Experiments.from_frame(small.frame, outcome="y", id="id")
    ours = identify(small.simulator, table, small.inputs, noise=small.noise, vectorized=True)
    between = _processor()
    scale = np.abs(small.start)
    found = optimize.minimize(
        lambda u: -small.log_likelihood(u * scale), np.sign(small.start), method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-8, "maxiter": 10_000, "maxfev": 10_000},
    )  # fmt: skip
    ended = _processor()
    gap = -float(found.fun) - ours.log_likelihood.estimated
    size = f"{len(small.frame)} rows"
    return [
        Row(f"{name}, {size}: identify with intervals and verdicts / SciPy's maximum alone",
            f"{between - began:.2f} s", f"{ended - between:.2f} s",
            (between - began) / (ended - between)),
        Row(f"{name}: log L below the exact maximum", f"{gap:.1e}", "target 1e-4", abs(gap) / 1e-4),
    ]  # fmt: skip


def _command(study: str, target: float) -> Row:
    """The seconds of the processor of `aleator identify` with figures and report, imports too."""
    with tempfile.TemporaryDirectory() as folder:
        before = _processor()
        subprocess.run(
            [sys.executable, "-m", "aleator", "identify", str(ROOT / "examples" / study),
             "--no-store", "--output", folder, "--quiet"],
            check=True, capture_output=True,
        )  # fmt: skip
        seconds = _processor() - before
    return seconds_row(f"aleator identify examples/{study}", seconds, target)


def _processor() -> float:
    """Seconds of the processor, of this process and of those that it waited for."""
    return float(sum(os.times()[:4]))
