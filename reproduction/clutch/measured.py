"""Measured shifting times beside those of the best single point: why a law is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.types import Array
from aleator.fit.search import fitted
from aleator.simulators.response_functions import DirectResponse
from aleator.views.axes import BLUE, VERMILION
from reproduction.canvas import LIGHT, explain
from reproduction.clutch.response import grid
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

COARSE = 13  # points a side of the grid whose best point the fit starts from


def measured(context: Context) -> Reproduction:
    """Fig. 13: measurements against the deterministic simulation, by least squares."""
    study = context.clutch
    count = len(study.outcomes)
    direct = DirectResponse(study.run, count, study.box)
    coarse = grid(study.box, COARSE)
    squares = np.sum((direct.evaluate(coarse) - study.outcomes[:, None]) ** 2, axis=0)
    start = coarse[int(np.argmin(squares))]

    def simulated_at(x: Array) -> tuple[Array, Array]:
        value, slopes = direct.evaluate_with_gradient(x[None])
        return value[:, 0], slopes[:, 0]

    fit = fitted(simulated_at, study.outcomes, study.box, start)
    simulated = direct.evaluate(fit.x[None])[:, 0]
    table = pd.DataFrame(
        {
            "id": study.table["id"],
            "measured": study.outcomes,
            "simulated": simulated,
            "discrepancy": study.outcomes - simulated,
        }
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.vlines(table["id"], table["simulated"], table["measured"], color=LIGHT, lw=1.4)
        axes.plot(table["id"], table["measured"], "o", color=VERMILION, ms=3.6, label="measured")
        name = f"simulated at x = ({fit.x[0]:.2f}, {fit.x[1]:.2f}), least squares"
        axes.plot(table["id"], table["simulated"], "_", color=BLUE, ms=6.5, mew=1.8, label=name)
        axes.set(xlabel="experiment l", ylabel="shifting time [s]", xlim=(0.0, count + 1.0))
        explain(canvas, axes)

    explained = 1.0 - fit.rmse**2 / float(np.var(study.outcomes))
    largest = float(table["discrepancy"].abs().max())
    claims = (
        Claim(
            "The deterministic model captures the global trend.",
            "shown, no number",
            f"{explained:.0%} of the variance of the measurements",
            Verdict.of(explained > 0.5),
            "synthetic measurements; judged at one half",
        ),
        Claim(
            "A distinct discrepancy between measurement and simulation is left.",
            "shown, no number",
            f"root mean square {1e3 * fit.rmse:.0f} ms, at most {1e3 * largest:.0f} ms; "
            "the clock's noise is 2 ms",
            Verdict.of(fit.rmse > 0.01),
            "synthetic measurements",
        ),
    )
    return Reproduction({"": table}, draw, claims, (9.0, 4.2))
