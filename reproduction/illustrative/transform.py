"""The illustrative outcome: a normal parameter through a nonlinear simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.special import ndtr

from aleator.core.types import Array
from aleator.moments.distances import earth_movers_distance
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.views.axes import BLACK, BLUE, VERMILION
from reproduction.canvas import LIGHT
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict
from reproduction.illustrative.outcome import POLE, Camelback, Fine, raw

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

SAMPLES = 50  # as the paper draws
BINS = 10
CUTS = (5.0, 6.0, 6.2, 6.28)
ORDER = 6


def transform(context: Context) -> Reproduction:
    """Fig. 4: the density of the parameter, the simulator, the density of the outcome."""
    camelback = context.camelback
    curve = camelback.at(np.linspace(-4.0, 4.0, 801))
    rng = np.random.default_rng(context.seed)
    sample = camelback.law().quantile(np.array([0.0, 1.0]), rng.random(SAMPLES))
    drawn = pd.DataFrame({"x": sample, "y": camelback.outcome(sample)})
    tables = {
        "": pd.DataFrame(
            {
                "x": curve.x,
                "pdf_x": curve.pdf * camelback.slope(curve.x),
                "y": curve.y,
                "pdf_y": curve.pdf,
                "cdf_y": curve.cdf,
            }
        ),
        "sample": drawn,
        "cuts": cuts(),
    }
    return Reproduction(
        tables=tables,
        draw=lambda canvas: _draw(canvas, tables[""], drawn),
        claims=_claims(curve, tables["cuts"]),
        size=(9.0, 6.0),
    )


def modes(y: Array, pdf: Array) -> Array:
    """Where a density on increasing points has its inner maxima.

    >>> modes(np.arange(5.0), np.array([0.0, 2.0, 1.0, 3.0, 0.0])).tolist()
    [1.0, 3.0]
    """
    inner = (pdf[1:-1] > pdf[:-2]) & (pdf[1:-1] >= pdf[2:])
    return np.asarray(y[1:-1][inner])


def cuts() -> pd.DataFrame:
    """How moments and the density from four of them depend on where x is cut."""
    rows = []
    for limit in CUTS:
        camelback = Camelback(limit)
        fine, moments = camelback.fine, camelback.exact_moments(ORDER)
        ends = camelback.outcome(np.array([-limit, limit]))
        fitted = MaximumEntropy(order=4).fit(moments, ends[:1], ends[1:])
        shape = moments.standardized[0]
        powers = raw(fine.y, fine.weights, ORDER)
        rows.append(
            {
                "limit": limit,
                "mass_outside": 2.0 * ndtr(-limit),
                "outcome_at_limit": ends[1],
                "mean": moments.mean[0],
                "sd": moments.sd[0],
                "skewness": shape[3],
                "kurtosis": shape[4],
                **{f"raw_moment_{m + 1}": power for m, power in enumerate(powers)},
                "status": fitted.status[0],
                "emd_maximum_entropy_4": earth_movers_distance(fitted, camelback.exact)[0],
            }
        )
    return pd.DataFrame(rows)


def _claims(curve: Fine, table: pd.DataFrame) -> tuple[Claim, ...]:
    peaks = modes(curve.y, curve.pdf)
    low, high = table.iloc[0], table.iloc[-1]
    shown = ", ".join(f"{kurtosis:.3f}" for kurtosis in table["kurtosis"])
    return (
        Claim(
            "A standard normal parameter gives an outcome whose density has two humps.",
            "two humps",
            f"{peaks.size} modes, at y = {' and '.join(f'{peak:.2f}' for peak in peaks)}",
            Verdict.of(peaks.size == 2),
        ),
        Claim(
            "The moments of this outcome exist: they are compared up to the fifth.",
            "X ~ N(0, 1), no condition",
            "none exists: E|Y| is infinite, for |tan(x/4)| is 4/(2 pi - x) at its pole, "
            f"and |X| > 2 pi has probability {2.0 * ndtr(-POLE):.1e}",
            Verdict.FAILS,
            "the paper does not say how it avoids the poles; here X is conditioned on |x| <= 6",
        ),
        Claim(
            "How far the answers depend on the condition (our question, not the paper's).",
            "not given",
            f"|x| <= {', '.join(f'{cut:g}' for cut in CUTS)}: kurtosis {shown}; sd from "
            f"{low['sd']:.5f} to {high['sd']:.5f}; sixth raw moment from "
            f"{low['raw_moment_6']:.1f} to {high['raw_moment_6']:.2g}",
            Verdict.NOT_COMPARABLE,
            "up to |x| <= 6.2 the first four moments stay within 0.1 %; closer to the poles "
            "everything from the fourth moment on is decided by the cut",
        ),
    )


def _draw(canvas: Canvas, curve: pd.DataFrame, sample: pd.DataFrame) -> None:
    (outcome, simulator), (empty, parameter) = canvas.subplots(
        2, 2, sharex="col", sharey="row", width_ratios=(1.0, 1.6), height_ratios=(1.6, 1.0)
    )
    empty.set_visible(False)
    outcome.hist(sample["y"], BINS, density=True, orientation="horizontal", color=LIGHT)
    outcome.plot(curve["pdf_y"], curve["y"], color=BLUE, lw=1.6)
    outcome.plot(np.zeros(len(sample)), sample["y"], "o", color=BLACK, ms=2.6, clip_on=False)
    outcome.invert_xaxis()
    outcome.set(ylabel="outcome y", xlabel="density of y", title="density of the outcome")
    outcome.tick_params(labelbottom=True)
    simulator.plot(curve["x"], curve["y"], color=VERMILION, lw=1.6)
    simulator.plot(sample["x"], sample["y"], "o", color=BLACK, ms=2.6)
    simulator.set(title="y = tan(x/4) + exp(x/3 − 1) + tanh(x)", ylim=(-3.2, 4.4))
    parameter.hist(sample["x"], BINS, density=True, color=LIGHT)
    parameter.plot(curve["x"], curve["pdf_x"], color=BLUE, lw=1.6)
    parameter.plot(sample["x"], np.zeros(len(sample)), "o", color=BLACK, ms=2.6, clip_on=False)
    parameter.set(xlabel="parameter x", ylabel="density of x", xlim=(-4.0, 4.0))
    parameter.set_ylim(bottom=0.0)
    parameter.tick_params(labelleft=True)
