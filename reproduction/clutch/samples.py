"""How many samples do what 25 runs do: the paper's last figure and its second table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.views.axes import BLACK, BLUE, GRAY, GREEN, ORANGE, PURPLE
from reproduction.canvas import DASHES, DOTS, LIGHT, explain, powers_of_ten
from reproduction.clutch.laws import EXPANSION
from reproduction.clutch.sampling import (
    ENTROPY,
    GAUSSIAN,
    GRID,
    HISTOGRAM,
    LARGEST,
    QUADRATURE,
    RANDOM,
    SOBOL,
    SURFACES,
    SamplingErrors,
)
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict
from reproduction.sampling.likelihood import samples_needed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

HUES = {RANDOM: BLUE, GRID: ORANGE, SOBOL: GREEN}
MARKS = {RANDOM: "o", GRID: "s", SOBOL: "^"}
RUNS, ORDER = 25, 10.0  # of the expansion; what is called an order of magnitude
PAPER_MAE = {GAUSSIAN: (0.183, 0.117), ENTROPY: (0.155, 0.088)}  # at each of its two laws
PAPER_NEEDED = {
    RANDOM: {GAUSSIAN: (458, 265), ENTROPY: (629, 383)},
    GRID: {GAUSSIAN: (577, 370), ENTROPY: (1171, 1009)},
}
PAPER_LIKELIHOOD = (176.7, 183.7)


def accuracy(context: Context) -> Reproduction:
    """Fig. 20: the mean absolute error of the log-densities against the number of samples."""
    found = context.sampling
    tables = {
        "": pd.concat([errors.curves for errors in found], ignore_index=True),
        "few-runs": pd.concat([errors.levels for errors in found], ignore_index=True),
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(found), sharex=True, sharey=True)
        for axes, errors in zip(panels, found, strict=True):
            _draw_errors(axes, errors)
        panels[0].set_ylabel("mean absolute error of log-densities [-]")
        explain(canvas, panels[0], 4)

    return Reproduction(tables, draw, _accuracy_claims(found), (10.5, 5.6))


def needed(context: Context) -> Reproduction:
    """Table 2: log-likelihood, error, and the samples that sampling needs for the same error."""
    found = context.sampling
    table = pd.DataFrame([row for k, errors in enumerate(found) for row in _needed(k, errors)])
    return Reproduction(
        {"": table},
        lambda canvas: _draw_needed(canvas, table),
        _needed_claims(table),
        (9.6, 5.2),
    )


def _accuracy_claims(found: Sequence[SamplingErrors]) -> tuple[Claim, ...]:
    own = found[:2]
    falls = [_rate(errors, RANDOM, density) for density in (HISTOGRAM, ENTROPY) for errors in own]
    first = own[0].curve(RANDOM, HISTOGRAM)
    least = first["samples"].iloc[0]
    less = [1.0 - errors.level(ENTROPY) / errors.level(GAUSSIAN) for errors in found]
    plain = [(errors.level(ENTROPY), errors.level(ENTROPY, QUADRATURE)) for errors in found]
    kept = [errors.level(ENTROPY, SURFACES) for errors in found]
    runs = own[0].levels["runs"].max()
    limits = (
        f"surfaces in place of the simulator change a log-density by "
        f"{max(errors.surface for errors in found):.4f} in the mean, the reference is known to "
        f"{', '.join(f'{errors.noise:.4f}' for errors in found)}"
    )
    return (
        Claim(
            "The error of brute-force propagation falls with the number of samples.",
            "shown, no number",
            f"Monte Carlo, at both identified laws: as S^-{-falls[0]:.2f} and S^-{-falls[1]:.2f} "
            f"with a histogram spline, S^-{-falls[2]:.2f} and S^-{-falls[3]:.2f} with maximum "
            "entropy of the sampled moments, which ends at its own error",
            Verdict.of(max(falls) < -0.2),
            f"slopes from 64 to 4,096 samples. Where hardly a sample falls (of {least} samples, "
            f"at {first['missed'].iloc[0]:.0f} of 108 outcomes) "
            "the log-density of one sample in a bin stands in: the paper does not say what it "
            "took. " + limits,
        ),
        Claim(
            "Maximum entropy lowers the mean absolute error below the Gaussian's.",
            "by 15.3 % and 24.8 %: 0.183 to 0.155, 0.117 to 0.088",
            "at its Gaussian and its maximum-entropy answer: "
            + ", ".join(
                f"by {share:.0%} ({e.level(GAUSSIAN):.3f} to {e.level(ENTROPY):.3f})"
                for share, e in zip(less[:2], own, strict=True)
            ),
            Verdict.of(min(less) > 0.0),
            f"by {less[2]:.0%} at the third law ({found[2].level(GAUSSIAN):.3f} to "
            f"{found[2].level(ENTROPY):.3f}), whose outcomes are drawn from it",
        ),
        Claim(
            "The expansion makes the best use of 25 runs.",
            "implied; plain quadrature is left out",
            "maximum entropy by expansion and by plain quadrature: "
            + ", ".join(f"{a:.4f} and {b:.4f}" for a, b in plain),
            Verdict.of(all(a <= b for a, b in plain)),
            f"with response surfaces of {runs:.0f} runs an experiment, which serve every alpha: "
            + ", ".join(f"{value:.4f}" for value in kept),
        ),
    )


def _rate(errors: SamplingErrors, method: str, density: str) -> float:
    """Slope of log error against log samples, from 64 to 4,096 samples."""
    rows = errors.curve(method, density)
    part = rows[(rows["samples"] >= 64) & (rows["samples"] <= 4096)]
    return float(np.polyfit(np.log(part["samples"]), np.log(part["mae"]), 1)[0])


def _needed(k: int, errors: SamplingErrors) -> list[dict[str, float | str]]:
    rows = []
    for density in (GAUSSIAN, ENTROPY):
        row: dict[str, float | str] = {
            "law": errors.at.name,
            "log_likelihood": float(errors.at.log_densities.sum()),
            "density": density,
            "mae": errors.level(density),
            "s_expansion": RUNS,
        }
        for method in HUES:
            for way in (HISTOGRAM, ENTROPY):
                curve = errors.curve(method, way)
                row[f"{method}, {way}"] = samples_needed(
                    curve["samples"], curve["mae"], errors.level(density)
                )
        if k < len(PAPER_LIKELIHOOD):
            row["paper_log_likelihood"] = PAPER_LIKELIHOOD[k]
            row["paper_mae"] = PAPER_MAE[density][k]
            for method, numbers in PAPER_NEEDED.items():
                row[f"paper, {method}"] = numbers[density][k]
        rows.append(row)
    return rows


def _needed_claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    own, third = table.iloc[:4], table.iloc[4:]

    def least(method: str, way: str) -> float:
        return float(own[f"{method}, {way}"].fillna(np.inf).min())

    paper = {
        m: _list([n for pair in zip(*by.values(), strict=True) for n in pair])
        for m, by in PAPER_NEEDED.items()
    }
    with_histogram = min(least(RANDOM, HISTOGRAM), least(GRID, HISTOGRAM))
    with_entropy = min(least(method, ENTROPY) for method in HUES)
    both = own[own[[f"{RANDOM}, {HISTOGRAM}", f"{GRID}, {HISTOGRAM}"]].notna().all(axis=1)]
    worse = both[f"{GRID}, {HISTOGRAM}"] > both[f"{RANDOM}, {HISTOGRAM}"]
    order = "Gaussian and maximum entropy at its Gaussian answer, then at the other"
    return (
        Claim(
            "The expansion needs an order of magnitude fewer runs than sampling.",
            f"25 against {paper[RANDOM]} (Monte Carlo) and {paper[GRID]} (grid)",
            f"25 against {_samples(own, RANDOM)} (Monte Carlo) and {_samples(own, GRID)} (grid)",
            Verdict.of(with_histogram >= ORDER * RUNS),
            f"in the order {order}; histogram splines as in the paper; > marks an error that the "
            f"most samples tried do not reach; Sobol' points: {_samples(own, SOBOL)}",
        ),
        Claim(
            "The same when sampling, too, takes a density from moments.",
            "not compared",
            f"maximum entropy of the sampled moments: 25 against {_samples(own, RANDOM, ENTROPY)} "
            f"(Monte Carlo), {_samples(own, GRID, ENTROPY)} (grid), "
            f"{_samples(own, SOBOL, ENTROPY)} (Sobol')",
            Verdict.of(with_entropy >= ORDER * RUNS),
            "the first and third numbers reach the Gaussian's error, which is that of its shape, "
            "not of its runs",
        ),
        Claim(
            "A grid needs more samples than Monte Carlo.",
            f"{paper[GRID]} against {paper[RANDOM]}",
            f"{_samples(own, GRID)} against {_samples(own, RANDOM)}",
            Verdict.of(len(both) > 0 and bool(worse.all())),
            "judged where both get there; here because one parameter hardly scatters, so that an m "
            "by m grid has m different outcomes; not so at the third law, where both scatter: "
            f"{_samples(third, GRID)} against {_samples(third, RANDOM)}",
        ),
        Claim(
            "Log-likelihood at both answers.",
            " and ".join(f"{value:g}" for value in PAPER_LIKELIHOOD),
            " and ".join(f"{value:.1f}" for value in own["log_likelihood"].iloc[::2]),
            Verdict.NOT_COMPARABLE,
            "synthetic measurements of another clutch",
        ),
    )


def _samples(rows: pd.DataFrame, method: str, way: str = HISTOGRAM) -> str:
    beyond = f"> {LARGEST[method]:,}"
    return _list(rows[f"{method}, {way}"], beyond)


def _list(values: Iterable[float], beyond: str = "") -> str:
    return ", ".join(beyond if np.isnan(value) else f"{value:,.0f}" for value in values)


def _draw_errors(axes: Axes, errors: SamplingErrors) -> None:
    styles: dict[str, Any] = {HISTOGRAM: "-", ENTROPY: DASHES}
    for density, style in styles.items():
        for method, hue in HUES.items():
            rows, full = errors.curve(method, density), density == HISTOGRAM
            axes.errorbar(
                rows["samples"], rows["mae"], rows["standard_error"].fillna(0.0), color=hue,
                ls=style, lw=1.2, marker=MARKS[method], ms=3.4, mfc=hue if full else "white",
                elinewidth=0.9, label=f"{method}, {density}",
            )  # fmt: skip
    levels: tuple[tuple[str, str, str, Any], ...] = (
        (GAUSSIAN, EXPANSION, GRAY, DASHES),
        (ENTROPY, EXPANSION, BLACK, "-"),
        (ENTROPY, QUADRATURE, BLACK, DOTS),
        (ENTROPY, SURFACES, PURPLE, DASHES),
    )
    for density, way, hue, style in levels:
        label = f"{density}, {way}"
        axes.axhline(errors.level(density, way), color=hue, ls=style, lw=1.3, label=label)
    axes.axvline(RUNS, color=LIGHT, lw=1.0, zorder=0)
    axes.set(xscale="log", yscale="log", xlabel="samples S", title=f"law: {errors.at.name}")
    axes.set_ylim(0.004, 2.0)
    powers_of_ten(axes.xaxis)
    powers_of_ten(axes.yaxis)


def _draw_needed(canvas: Canvas, table: pd.DataFrame) -> None:
    axes, rows = canvas.subplots(), np.arange(len(table))
    edge = 2e5
    for k, method in enumerate(HUES):
        for way, fill in ((HISTOGRAM, HUES[method]), (ENTROPY, "white")):
            values = table[f"{method}, {way}"].to_numpy(dtype=float)
            place = rows + 0.16 * (k - 1) + (0.0 if way == HISTOGRAM else 0.06)
            axes.plot(
                np.where(np.isnan(values), edge, values), place, ls="none", marker=MARKS[method],
                ms=6.5, mfc=fill, mec=HUES[method], label=f"{method}, {way}",
            )  # fmt: skip
        if method in PAPER_NEEDED:
            axes.plot(
                table[f"paper, {method}"], rows + 0.16 * (k - 1), ls="none", mfc="none",
                marker="x" if method == RANDOM else "+", ms=8.0, mec=BLACK,
                label=f"the paper: {method}",
            )  # fmt: skip
    axes.axvline(RUNS, color=BLACK, lw=1.2, label="25 runs")
    axes.axvline(1e5, color=GRAY, lw=1.0, ls=DOTS, label="beyond: not reached")
    names = [f"law: {row.law}\nerror of {row.density}, {row.mae:.3f}" for row in table.itertuples()]
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="samples needed for the same mean absolute error")
    powers_of_ten(axes.xaxis)
    explain(canvas, axes, 4)
