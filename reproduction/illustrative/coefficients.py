"""Coefficients of the illustrative outcome's expansion, by quadratures of growing order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.polynomials import gauss_hermite
from aleator.views.axes import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from reproduction.canvas import explain
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict, keyed

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

DEGREE = 7
ORDERS = tuple(range(2, 11))
SHOWN = (2, 3, 4, 5, 6, 8)
HUES = (PURPLE, VERMILION, ORANGE, GREEN, SKY, BLUE)


def coefficients(context: Context) -> Reproduction:
    """Fig. 5a: coefficients c_i for each quadrature order q, beside fine integration."""
    camelback = context.camelback
    rows = []
    for polynomials in ("hermite", "own"):
        exact = camelback.exact_coefficients(DEGREE, polynomials)
        for q in ORDERS:
            found = camelback.coefficients(DEGREE, q, polynomials)
            rows += [
                {
                    "polynomials": polynomials,
                    "q": q,
                    "i": i,
                    "coefficient": found[i],
                    "exact": exact[i],
                    "error": found[i] - exact[i],
                    "determined": i < q,
                }
                for i in range(DEGREE + 1)
            ]
    table = pd.DataFrame(rows)
    hermite = table[table["polynomials"] == "hermite"]
    return Reproduction(
        tables={"": table},
        draw=lambda canvas: _draw(canvas, hermite),
        claims=_claims(hermite, table),
    )


def _claims(hermite: pd.DataFrame, table: pd.DataFrame) -> tuple[Claim, ...]:
    found, exact, error = (
        keyed(hermite, ["q", "i"], column) for column in ("coefficient", "exact", "error")
    )
    worst = max((key for key in error if key[1] >= key[0]), key=lambda key: abs(error[key]))
    exactly_q = [abs(found[i, i]) for i in range(2, DEGREE + 1)]
    third = [abs(error[q, 3]) for q in ORDERS if q >= 4]
    own = keyed(table[table["polynomials"] == "own"], ["q", "i"], "error")
    reach = max(abs(gauss_hermite(ORDERS[-1])[0]))
    return (
        Claim(
            "Low orders of the quadrature approximate the higher coefficients poorly.",
            "shown, no number",
            f"worst: c_{worst[1]} with q = {worst[0]} is {found[worst]:.3f} instead of "
            f"{exact[worst]:.3f}",
            Verdict.of(abs(error[worst]) > abs(exact[worst])),
            f"all nodes of q <= {ORDERS[-1]} lie within |x| <= {reach:.2f}: the poles are not seen",
        ),
        Claim(
            "Coefficient d needs a quadrature of order d + 1 at least.",
            "q >= d + 1",
            f"with q = d it is exactly zero (largest |c_d| {max(exactly_q):.0e}): "
            "the nodes are the zeros of that polynomial",
            Verdict.of(max(exactly_q) < 1e-12),
        ),
        Claim(
            "Beyond q = d + 1 the estimate grows more precise, as for i = 3.",
            "shown, no number",
            f"error of c_3 for q = 4, 5, .., {ORDERS[-1]}: "
            + ", ".join(f"{error:.4f}" for error in third),
            Verdict.of(bool(np.all(np.diff(third) < 0.0))),
            f"with the conditioned law's own polynomials {abs(own[4, 3]):.4f} at "
            f"q = 4 and {abs(own[10, 3]):.4f} at q = 10: the poles, not the basis, "
            "set the pace",
        ),
    )


def _draw(canvas: Canvas, table: pd.DataFrame) -> None:
    axes = canvas.subplots()
    exact = table[table["q"] == ORDERS[0]].sort_values("i")["exact"]
    i = np.arange(DEGREE + 1)
    width = 0.8 / len(SHOWN)
    for k, (q, hue) in enumerate(zip(SHOWN, HUES, strict=True)):
        place = i + (k - 0.5 * (len(SHOWN) - 1)) * width
        axes.bar(
            place, table[table["q"] == q]["coefficient"], 0.9 * width, color=hue, label=f"q = {q}"
        )
    axes.hlines(exact, i - 0.43, i + 0.43, color=BLACK, lw=1.4, label="fine integration")
    axes.axhline(0.0, color=BLACK, lw=0.6)
    axes.set(xlabel="index i of the coefficient", ylabel="coefficient c_i of orthonormal Hermite")
    axes.set_xticks(i)
    explain(canvas, axes, 7)
