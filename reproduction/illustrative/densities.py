"""Densities that match the moments of the illustrative outcome, and how far they are from it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.core.status import Status
from aleator.moments.densities import Density, Gaussian
from aleator.moments.distances import earth_movers_distance
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments, weighted_moments
from aleator.views.axes import BLUE, GRAY, GREEN, ORANGE, PURPLE, SKY, VERMILION
from reproduction.canvas import DASHES, PALE, explain
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict
from reproduction.illustrative.outcome import Camelback
from reproduction.two_normals import TwoNormals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

ORDERS = (2, 3, 4, 5, 6, 7, 8)
EXPANSIONS = ((2, 3), (3, 4), (4, 5), (5, 6), (6, 7))
QUADRATURE = "quadrature, q = 5"
SHOWN = (4, 5)  # degree and runs of the expansion that is drawn, those of the wet clutch
EXACT = "exact"

CHOICES: dict[str, Density | TwoNormals] = {
    "Gaussian": Gaussian(),
    "two-component mixture": TwoNormals(),
    **{f"maximum entropy, M = {order}": MaximumEntropy(order=order) for order in ORDERS},
}
DRAWN = ("Gaussian", "two-component mixture", "maximum entropy, M = 4")
BARS = [name for name in CHOICES if not name.endswith(("2", "7"))]


def matching(context: Context) -> Reproduction:
    """Fig. 6: densities from exact moments and from those of expansions, with their EMD."""
    camelback = context.camelback
    table = distances(camelback)
    curves = _curves(camelback)
    return Reproduction(
        tables={"": table, "curves": curves},
        draw=lambda canvas: _draw(canvas, table, curves),
        claims=_claims(table),
        size=(9.0, 6.4),
    )


def source(d: int, q: int) -> str:
    """What the table calls moments of the expansion of degree d from q runs."""
    return f"expansion d = {d}, q = {q}"


def moments_of(camelback: Camelback) -> dict[str, Moments]:
    """Moments by their source: exact, of each expansion, of plain quadrature."""
    most = max(ORDERS)
    found = {EXACT: camelback.exact_moments(most)}
    for d, q in EXPANSIONS:
        y, weights = camelback.expanded(d, q, most)
        found[source(d, q)] = weighted_moments(y[None], weights, most)
    outcomes, weights = camelback.nodes(SHOWN[1])
    found[QUADRATURE] = weighted_moments(outcomes[None], weights, most)
    return found


def distances(camelback: Camelback) -> pd.DataFrame:
    """EMD and status of each density from each source of moments."""
    rows = []
    for name, density in CHOICES.items():
        for origin, moments in moments_of(camelback).items():
            fitted = density.fit(moments, *_ends(camelback))
            status = Status(int(fitted.status[0]))
            distance = earth_movers_distance(fitted, camelback.exact)[0]
            rows.append(
                {
                    "density": name,
                    "moments": origin,
                    "status": status.name.lower(),
                    "emd": distance if status == Status.SOLVED else np.nan,
                }
            )
    return pd.DataFrame(rows)


def _ends(camelback: Camelback) -> tuple[Any, Any]:
    ends = camelback.outcome(np.array([-camelback.limit, camelback.limit]))
    return ends[:1], ends[1:]


def _curves(camelback: Camelback) -> pd.DataFrame:
    at = camelback.at(np.linspace(-3.9, 3.9, 601))
    columns = {"y": at.y, "true": at.pdf}
    found = moments_of(camelback)
    for name in DRAWN:
        for origin in (EXACT, source(*SHOWN)):
            fitted = CHOICES[name].fit(found[origin], *_ends(camelback))
            columns[f"{name}, {origin}"] = fitted.pdf(at.y[None])[0]
    return pd.DataFrame(columns)


def _claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    emd = table.set_index(["density", "moments"])["emd"]
    status = table.set_index(["density", "moments"])["status"]
    ladder = [emd.loc[(f"maximum entropy, M = {order}", EXACT)] for order in ORDERS]
    gaussian, four = emd.loc[("Gaussian", EXACT)], emd.loc[("maximum entropy, M = 4", EXACT)]
    mixture = emd.loc[("two-component mixture", EXACT)]
    missing = sum(status.loc[("two-component mixture", source(*e))] != "solved" for e in EXPANSIONS)
    told = ", ".join(f"{value:.4f}" for value in ladder)
    expanded = emd.loc[("maximum entropy, M = 4", source(*SHOWN))]
    plain = emd.loc[("maximum entropy, M = 4", QUADRATURE)]
    approximate = ", ".join(
        f"{emd.loc[(f'maximum entropy, M = {order}', source(*SHOWN))]:.4f}" for order in (4, 5, 6)
    )
    best = table[table["moments"] == EXACT].set_index("density")["emd"]
    others = table[table["moments"].str.startswith("expansion")]
    beyond = others[others["emd"] < others["density"].map(best) - 1e-6]
    failed = [name for name in CHOICES if status.loc[(name, EXACT)] != "solved"]
    return (
        Claim(
            "Maximum entropy with four moments is closer to the outcome than the Gaussian.",
            "shown, no number",
            f"EMD {four:.4f} against {gaussian:.4f}: {100.0 * (1.0 - four / gaussian):.0f} % less",
            Verdict.of(bool(four < gaussian)),
            f"from {SHOWN[1]} runs: {expanded:.4f} by the expansion of degree {SHOWN[0]}, "
            f"{plain:.4f} by plain quadrature",
        ),
        Claim(
            "Maximum entropy with four moments is closer to the outcome than two normals.",
            "shown, no number",
            f"EMD {four:.4f} against {mixture:.4f} of the mixture with five moments",
            Verdict.of(bool(four < mixture)),
            f"the mixture does not exist for {missing} of {len(EXPANSIONS)} expansions",
        ),
        Claim(
            "The more moments are taken into account, the better the density.",
            "no number",
            f"EMD for M = {', '.join(map(str, ORDERS))}: {told}",
            Verdict.of(all(b <= 1.01 * a for a, b in itertools.pairwise(ladder))),
            "exact moments, within 1 %: the third alone changes nothing; from the expansion of "
            f"degree {SHOWN[0]} more than four are no gain: {approximate} for M = 4, 5, 6",
        ),
        Claim(
            "Maximum entropy has a solution for any number of moments.",
            "on the whole real line",
            "false there for odd M, and for M = 4 with a kurtosis above 3 and no skewness; on the "
            f"bounded range {len(ORDERS) - len(failed)} of M = 2 to 8 were solved",
            Verdict.FAILS,
            "on the real line exp(-sum lambda_m y^m) with an odd leading power has no integral",
        ),
        Claim(
            "The density from exact moments bounds what the expansion's moments can give.",
            "upper bound",
            f"{len(beyond)} of {len(others)} densities from expansions are closer to the outcome "
            "than the same density from exact moments",
            Verdict.of(beyond.empty),
            "wrong moments may by chance fit better: a rule of thumb, not a bound",
        ),
    )


def _draw(canvas: Canvas, table: pd.DataFrame, curves: pd.DataFrame) -> None:
    grid = canvas.add_gridspec(2, len(DRAWN), height_ratios=(1.35, 1.0))
    panels = [canvas.add_subplot(grid[0, k]) for k in range(len(DRAWN))]
    for axes, name in zip(panels, DRAWN, strict=True):
        axes.fill_between(curves["y"], curves["true"], color=PALE, lw=0.0, label="true")
        hues = (BLUE, VERMILION)
        for origin, hue in zip((EXACT, source(*SHOWN)), hues, strict=True):
            style = "-" if origin == EXACT else DASHES
            label = "from exact moments" if origin == EXACT else f"from {origin}"
            axes.plot(curves["y"], curves[f"{name}, {origin}"], color=hue, ls=style, label=label)
        axes.set(title=name, xlabel="outcome y", xlim=(-2.8, 3.6), ylim=(0.0, 0.46))
    panels[0].set_ylabel("density")
    explain(canvas, panels[0], 3)
    _draw_distances(canvas.add_subplot(grid[1, :]), table)


def _draw_distances(axes: Axes, table: pd.DataFrame) -> None:
    """The EMD of every density, bars side by side by the source of the moments."""
    origins = [EXACT, *(source(d, q) for d, q in EXPANSIONS), QUADRATURE]
    hues = (BLUE, SKY, ORANGE, VERMILION, GREEN, PURPLE, GRAY)
    emd, width = table.set_index(["density", "moments"])["emd"], 0.8 / len(origins)
    x = np.arange(len(BARS))
    for k, (origin, hue) in enumerate(zip(origins, hues, strict=True)):
        values = [emd.loc[(name, origin)] for name in BARS]
        place = x + (k - 0.5 * (len(origins) - 1)) * width
        axes.bar(place, values, 0.9 * width, color=hue, label=origin)
        for at, value in zip(place, values, strict=True):
            if np.isnan(value):
                axes.plot(at, 0.002, "x", color=hue, ms=3.5, mew=1.0)
    short = [
        name.replace("maximum entropy, ", "max. entropy\n").replace("-component ", "-component\n")
        for name in BARS
    ]
    axes.set_xticks(x, short)
    axes.set(ylabel="EMD", title="earth mover's distance to the outcome (x: not solved)")
    axes.set_ylim(0.0, 1.4 * np.nanmax(table["emd"]))
    axes.legend(ncols=4, fontsize=8.0, loc="upper right")
