"""The distribution of every experiment's outcome beside its measurement, and the two answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.moments.densities import FittedDensity
from aleator.tasks.identification import Identification
from aleator.views.axes import VERMILION
from reproduction.clutch.laws import EXPANSION, PAPER_ENTROPY, PAPER_GAUSSIAN, Judged
from reproduction.clutch.reference import SAMPLES
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


LEVELS = np.array([0.025, 0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9, 0.975])
SHADES = ("#dcebf6", "#a9cfe8", "#63a9d6", "#2c7fba")  # from the widest interval to the narrowest
PAPER = {"Gaussian": (188.5, 176.7), "maximum entropy": (189.0, 183.7)}
EQUAL = 0.02  # of the means: what counts as the same mean


def distributions(context: Context) -> Reproduction:
    """Fig. 14, bottom: every outcome's distribution at alpha = (1, 1, 0.07, 0.02)."""
    at = context.at_given
    table = _table(at, at.reference.histogram)
    outside = (at.measured < table["q0.025"]) | (at.measured > table["q0.975"])
    value = float(at.log_densities.sum())
    never = int(np.isinf(at.log_densities).sum())
    told = f"{value:.1f}" if never == 0 else f"minus infinity: {never} outcomes lie beyond"
    claims = (
        Claim(
            "Log-likelihood of the experiments under this law.",
            "given in the figure",
            f"{told} all {SAMPLES:,} samples" if never else told,
            Verdict.NOT_COMPARABLE,
            "synthetic measurements of another clutch; this law was not identified from them",
        ),
        Claim(
            "The distributions explain the scatter that one simulated value cannot.",
            "visual comparison",
            f"{int(outside.sum())} of {len(table)} outcomes lie outside the 95 % intervals",
            Verdict.NOT_COMPARABLE,
            "the example's measurements come from other means",
        ),
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        draw_fans(axes, table)
        axes.set_xlabel("experiment l")
        explain_fans(canvas)

    return Reproduction({"": table}, draw, claims)


def identification(context: Context) -> Reproduction:
    """Figs. 16 and 17: both answers, their distributions, and their log-likelihoods."""
    answers = {"Gaussian": context.gaussian, "maximum entropy": context.entropy}
    laws = {"Gaussian": context.at_gaussian, "maximum entropy": context.at_entropy}
    likelihoods = pd.DataFrame([_likelihoods(name, answers[name], laws[name]) for name in answers])
    panels = {}
    for name, at in laws.items():
        panels[f"{name}: reference, {SAMPLES:,} samples"] = _table(at, at.reference.histogram)
        panels[f"{name}: density from 25 runs"] = _table(at, at.fit(name))
    quantiles = pd.concat(
        [table.assign(panel=name) for name, table in panels.items()], ignore_index=True
    )

    def draw(canvas: Canvas) -> None:
        every = canvas.subplots(len(panels), 1, sharex=True, sharey=True)
        for axes, (name, table) in zip(every, panels.items(), strict=True):
            draw_fans(axes, table)
            axes.set_title(f"law identified with {name}", pad=4.0)
        every[-1].set_xlabel("experiment l")
        explain_fans(canvas)

    tables = {
        "": likelihoods,
        "alpha": pd.concat([_estimates(n, r) for n, r in answers.items()], ignore_index=True),
        "quantiles": quantiles,
    }
    return Reproduction(
        tables, draw, _claims(likelihoods.set_index("density"), answers), (9.0, 10.0)
    )


def _table(at: Judged, fitted: FittedDensity) -> pd.DataFrame:
    """Measured outcomes and quantiles of their distributions."""
    columns = {"id": np.arange(1, at.measured.size + 1), "measured": at.measured}
    found = fitted.quantile(LEVELS)
    columns |= {f"q{level:g}": found[:, k] for k, level in enumerate(LEVELS)}
    return pd.DataFrame(columns)


def _estimates(density: str, result: Identification) -> pd.DataFrame:
    paper = PAPER_GAUSSIAN if density == "Gaussian" else PAPER_ENTROPY
    rows = []
    for (name, found), other in zip(result.alpha.items(), paper, strict=True):
        low, high = found.interval or (np.nan, np.nan)
        rows.append(
            {
                "density": density,
                "hyperparameter": name,
                "estimate": found.estimate,
                "lower_95": low,
                "upper_95": high,
                "at_bound": found.at_bound or "",
                "paper": other,
            }
        )
    return pd.DataFrame(rows)


def _likelihoods(name: str, result: Identification, at: Judged) -> dict[str, float | str]:
    """Log-likelihoods at the answer: of the search, from 25 runs, and verified twice."""
    each = at.fit(name, EXPANSION).log_pdf(at.measured)
    report = result.log_likelihood
    verified = float(at.log_densities.sum())
    return {
        "density": name,
        "search": report.estimated,
        "estimated": float(each.sum()),
        "verified": verified,
        "verified_standard_error": float(np.sqrt(np.sum(at.log_density_errors**2))),
        "mismatch": float(each.sum()) - verified,
        "kernel": report.verified if report.verified is not None else np.nan,
        "kernel_standard_error": report.verified_standard_error or np.nan,
        "least_squares": float(result.baselines["least_squares"]["log_likelihood"]),
        "paper_estimated": PAPER[name][0],
        "paper_verified": PAPER[name][1],
        "largest_surface_error": float(at.reference.error.max()),
    }


def _claims(rows: pd.DataFrame, answers: dict[str, Identification]) -> tuple[Claim, ...]:
    gaussian, entropy = (rows.loc[name].to_dict() for name in ("Gaussian", "maximum entropy"))
    smaller = 1.0 - abs(entropy["mismatch"]) / abs(gaussian["mismatch"])
    gain = entropy["verified"] - gaussian["verified"]
    both = [list(answer.alpha.values()) for answer in answers.values()]
    means = [abs(a.estimate - b.estimate) for a, b in list(zip(*both, strict=True))[::2]]
    spreads = [(a.estimate, b.estimate) for a, b in list(zip(*both, strict=True))[1::2]]
    told = ", ".join(f"{a:.3f} and {b:.3f}" for a, b in spreads)
    over = [row["mismatch"] for row in (gaussian, entropy)]
    noise = max(gaussian["kernel_standard_error"], entropy["kernel_standard_error"])
    return (
        Claim(
            "The mismatch of estimated and verified log-likelihood is smaller for maximum entropy.",
            "about 55 % smaller (5.3 against 11.8)",
            f"{smaller:.0%} smaller: {entropy['mismatch']:+.2f} against "
            f"{gaussian['mismatch']:+.2f}; the histogram itself is known to about "
            f"{entropy['verified_standard_error']:.2f}",
            Verdict.of(smaller > 0.0),
            "synthetic measurements; searched on response surfaces, estimated from the expansion "
            f"by 25 runs, verified by {SAMPLES:,} samples (surface error at most "
            f"{max(rows['largest_surface_error']):.1%} of the outcome's sd)",
        ),
        Claim(
            "The expansion with moment matching overestimates the log-likelihood in both cases.",
            "+11.8 Gaussian, +5.3 maximum entropy",
            f"{over[0]:+.2f} Gaussian, {over[1]:+.2f} maximum entropy",
            Verdict.of(min(over) > 0.0),
            "synthetic measurements",
        ),
        Claim(
            "The verified log-likelihood is 4 % higher for maximum entropy.",
            "183.7 against 176.7: 4 %",
            f"{entropy['verified']:.2f} against {gaussian['verified']:.2f}: "
            f"{gain / abs(gaussian['verified']):+.1%}",
            Verdict.of(gain / abs(gaussian["verified"]) > 0.02),
            f"judged at 2 %; the difference of {gain:.2f} is to be seen beside a Monte Carlo error "
            f"of {noise:.1f} in the check on the simulator",
        ),
        Claim(
            "Both densities give the same means.",
            "0.91 and 0.55 in both",
            f"they differ by {means[0]:.3f} and {means[1]:.3f}",
            Verdict.of(max(means) < EQUAL),
            f"judged at {EQUAL:g}; the interval of the second mean is 0.2 wide",
        ),
        Claim(
            "Maximum entropy finds larger standard deviations than the Gaussian.",
            "0.077 and 0.081, 0.014 and 0.046",
            f"Gaussian and maximum entropy: {told}",
            Verdict.of(all(b > a for a, b in spreads)),
            "the second standard deviation ends on its lower limit and may be up to 0.09: these "
            "experiments hardly determine it",
        ),
        Claim(
            "A law explains the experiments better than the best single point.",
            "no number",
            f"log-likelihood {entropy['verified']:.1f} against {entropy['least_squares']:.1f} of "
            "least squares with its own residual scatter",
            Verdict.of(entropy["verified"] > entropy["least_squares"]),
        ),
    )


def draw_fans(axes: Axes, table: pd.DataFrame) -> None:
    """Nested central intervals of each experiment's outcome, and the measured one."""
    x = table["id"].to_numpy()
    for k, shade in enumerate(SHADES):
        low, high = table[f"q{LEVELS[k]:g}"], table[f"q{LEVELS[-1 - k]:g}"]
        axes.bar(x, high - low, 0.86, low, color=shade)
    axes.plot(x, table["measured"], "o", color=VERMILION, ms=2.8, mew=0.0)
    axes.use_sticky_edges = False
    axes.set(xlim=(0.0, len(table) + 1.0), ylabel="shifting time [s]")


def explain_fans(canvas: Canvas) -> None:
    """The legend of the fans."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shares: Sequence[str] = ("95 %", "80 %", "50 %", "20 %")
    handles: list[Line2D | Patch] = [
        Patch(color=shade, lw=0.0, label=f"central {share}")
        for shade, share in zip(SHADES, shares, strict=True)
    ]
    handles.append(
        Line2D([], [], color=VERMILION, marker="o", ms=4, ls="none", label="measured (synthetic)")
    )
    canvas.legend(handles=handles, loc="outside lower left", ncols=5)
