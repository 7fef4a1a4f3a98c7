"""Densities of one experiment's outcome from few runs, against many runs of the simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.status import Status
from aleator.laws.quadrature import TensorGauss
from aleator.moments.moments import weighted_moments
from aleator.views.axes import BLUE, GRAY, VERMILION
from reproduction.canvas import DASHES, PALE, explain
from reproduction.clutch.reference import (
    DENSITIES,
    ORDER,
    SAMPLES,
    Reference,
    expansion_moments,
    node_outcomes,
    of_sample,
    sample,
)
from reproduction.clutch.response import grid
from reproduction.clutch.study import GIVEN, SHOWN, ClutchStudy
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict, keyed

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

EXPANSION, SAMPLED, PLAIN = "expansion, 25 runs", f"{SAMPLES:,} samples", "quadrature, 25 runs"
SOURCES = {EXPANSION: VERMILION, SAMPLED: BLUE, PLAIN: GRAY}
CHUNK = 20_000
SIDE = 51  # points a side of the grid that tells the range of the outcome on the box
MARGIN = 0.02  # s, that the curves go on beyond the samples
CLOSE = 0.15  # of the EMD: what counts as a minor difference


def density_16(context: Context) -> Reproduction:
    """Fig. 15: Gaussian, mixture and maximum entropy for experiment 16, with their EMD."""
    study = context.clutch
    found = _sampled(study, context)
    one = np.array([SHOWN - 1])
    law = study.law("hermite")
    outcomes = node_outcomes(study, GIVEN, one)
    sources = {
        EXPANSION: expansion_moments(study, GIVEN, one),
        SAMPLED: found.moments,
        PLAIN: weighted_moments(outcomes, TensorGauss(5).nodes(law, GIVEN).weights, ORDER),
    }
    low, high = float(found.histogram.low[0]), float(found.histogram.high[0])
    y = np.linspace(low - MARGIN, high + MARGIN, 401)
    curves = {"y": y, "reference": found.histogram.pdf(y[None])[0]}
    rows = []
    for source, moments in sources.items():
        for name, density in DENSITIES.items():
            fitted = density.fit(moments, found.lower, found.upper)
            curves[f"{name}, {source}"] = fitted.pdf(y[None])[0]
            rows.append(
                {
                    "density": name,
                    "moments": source,
                    "status": Status(int(fitted.status[0])).name.lower(),
                    "emd_ms": 1e3 * found.distance(fitted)[0],
                    "mean": moments.mean[0],
                    "sd": moments.sd[0],
                    "skewness": moments.standardized[0, 3],
                    "kurtosis": moments.standardized[0, 4],
                }
            )
    table, shown = pd.DataFrame(rows), pd.DataFrame(curves)
    return Reproduction(
        {"": table, "curves": shown},
        lambda canvas: _draw(canvas, table, shown),
        _claims(table),
        (9.0, 6.4),
    )


def _sampled(study: ClutchStudy, context: Context) -> Reference:
    """The reference of this experiment, on the simulator itself."""
    x = sample(study, GIVEN, context.seed)
    parts = []
    for begin in range(0, SAMPLES, CHUNK):
        part = x[begin : begin + CHUNK]
        parts.append(study.run(np.full(len(part), SHOWN - 1), part))
        context.progress.update(f"{begin + len(part):,} runs", begin + len(part), SAMPLES)
    box = grid(study.box, SIDE)
    over = study.run(np.full(len(box), SHOWN - 1), box)
    y = np.concatenate(parts)[None]
    return of_sample(GIVEN, y, over.min(keepdims=True), over.max(keepdims=True), np.zeros(1))


def _claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    emd = keyed(table, ["density", "moments"], "emd_ms")
    gaussian, entropy = (
        (emd[name, EXPANSION], emd[name, SAMPLED]) for name in ("Gaussian", "maximum entropy")
    )
    less = 1.0 - entropy[0] / gaussian[0]
    gap = abs(entropy[0] - entropy[1]) / entropy[1]
    kurtosis = keyed(table, ["density", "moments"], "kurtosis")
    return (
        Claim(
            "From 25 runs, maximum entropy is closer to the outcome than the Gaussian.",
            "shown, no number",
            f"EMD {entropy[0]:.1f} ms against {gaussian[0]:.1f} ms: {less:.0%} less",
            Verdict.of(less > 0.0),
            f"with the moments of the samples {1.0 - entropy[1] / gaussian[1]:.0%} less",
        ),
        Claim(
            "Densities from the expansion's moments differ little from those of sampled moments.",
            "minor difference",
            f"maximum entropy: EMD {entropy[0]:.1f} ms from 25 runs, {entropy[1]:.1f} ms from "
            f"{SAMPLES:,}; Gaussian {gaussian[0]:.1f} and {gaussian[1]:.1f} ms",
            Verdict.of(gap < CLOSE),
            f"judged at {CLOSE:.0%} for maximum entropy; kurtosis "
            f"{kurtosis['Gaussian', EXPANSION]:.2f} by expansion, "
            f"{kurtosis['Gaussian', PLAIN]:.2f} by plain quadrature, "
            f"{kurtosis['Gaussian', SAMPLED]:.2f} sampled",
        ),
        Claim(
            "The expansion is the way to get moments out of 25 runs.",
            "implied; plain quadrature is left out",
            f"maximum entropy from plain quadrature of the same runs: EMD "
            f"{emd['maximum entropy', PLAIN]:.1f} ms",
            Verdict.of(bool(entropy[0] <= emd["maximum entropy", PLAIN])),
        ),
    )


def _draw(canvas: Canvas, table: pd.DataFrame, curves: pd.DataFrame) -> None:
    cells = canvas.add_gridspec(2, len(DENSITIES), height_ratios=(1.5, 1.0))
    for k, name in enumerate(DENSITIES):
        axes = canvas.add_subplot(cells[0, k])
        axes.fill_between(
            curves["y"], curves["reference"], color=PALE, lw=0.0, label="reference, runs"
        )
        for source, style in ((SAMPLED, "-"), (EXPANSION, DASHES)):
            label = f"from {source}"
            values = curves[f"{name}, {source}"]
            axes.plot(curves["y"], values, color=SOURCES[source], ls=style, label=label)
        axes.set(title=name, xlabel="shifting time [s]")
        axes.set_ylim(0.0, 1.1 * curves.drop(columns="y").to_numpy().max())
        if k == 0:
            axes.set_ylabel("density [1/s]")
            explain(canvas, axes, 4)
    axes, width = canvas.add_subplot(cells[1, :]), 0.8 / len(SOURCES)
    for k, (source, hue) in enumerate(SOURCES.items()):
        values = table[table["moments"] == source]["emd_ms"]
        place = np.arange(len(DENSITIES)) + (k - 1) * width
        axes.bar(place, values, 0.9 * width, color=hue, label=f"moments from {source}")
    axes.set_xticks(range(len(DENSITIES)), list(DENSITIES))
    axes.set(ylabel="EMD [ms]", title="earth mover's distance to the reference")
    axes.set_ylim(0.0, 1.35 * table["emd_ms"].max())
    axes.legend(ncols=3, fontsize=8.0, loc="upper right")
