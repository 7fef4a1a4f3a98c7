"""The wet clutch's outcome over the box of its two parameters, and their clipped law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from aleator.core.types import Array
from aleator.views.axes import VERMILION
from reproduction.clutch.study import GIVEN, PARAMETERS, SHOWN, ClutchStudy
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


MAP = 71  # points a side of the map
FEASIBLE = 25  # points a side at which all experiments are run
WIDER = np.array([[0.3, 1.7], [0.1, 1.5]])  # what the map shows beyond the box
BROAD = np.array([1.0, 0.25, 0.9, 0.25])  # a law that the box does cut
LABELS = ("c2_scale x₁ [-]", "zp_scale x₂ [-]")


def response(context: Context) -> Reproduction:
    """Fig. 14, top left: the shifting time over the parameters, with the clipping box."""
    study = context.clutch
    x = grid(WIDER, MAP)
    outcome = study.run(np.full(len(x), SHOWN - 1), x)
    table = pd.DataFrame({PARAMETERS[0]: x[:, 0], PARAMETERS[1]: x[:, 1], "outcome": outcome})
    context.progress.update(f"{FEASIBLE**2 * 2} points under all experiments")
    inside, outside = (_feasible(study, grid(limits, FEASIBLE)) for limits in (study.box, WIDER))

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        levels = np.linspace(0.4, 1.5, 23)
        values = outcome.reshape(MAP, MAP).T
        x_1, x_2 = sides(WIDER, MAP)
        filled = axes.contourf(x_1, x_2, values, levels, cmap="viridis", extend="both")
        lines = axes.contour(x_1, x_2, values, levels[::2], colors="white", linewidths=0.5)
        lines.set_alpha(0.6)
        _draw_box(axes, study.box, "white")
        axes.set(xlabel=LABELS[0], ylabel=LABELS[1])
        canvas.colorbar(filled, label="shifting time [s]", ax=axes)

    claims = (
        Claim(
            "Within the clipping box all 108 experiments have a feasible solution.",
            "all",
            f"{inside.mean():.1%} of {inside.size} points of a grid on the box",
            Verdict.of(bool(inside.all())),
        ),
        Claim(
            "The box is the largest of feasible solutions.",
            "maximized",
            f"{outside.mean():.1%} of a grid on the map, 2.4 times the box's area, is feasible too",
            Verdict.NOT_COMPARABLE,
            "here the box is smaller on purpose: beyond it the outcome of some experiments jumps",
        ),
    )
    return Reproduction({"": table}, draw, claims, (7.4, 5.2))


def clipped(context: Context) -> Reproduction:
    """Fig. 14, top right: the joint density of the clipped normal laws."""
    study = context.clutch
    x = grid(WIDER, MAP)
    laws = {"paper": GIVEN, "broad": BROAD}
    table = pd.DataFrame({PARAMETERS[0]: x[:, 0], PARAMETERS[1]: x[:, 1]})
    for name, alpha in laws.items():
        table[f"density_{name}"] = density(study, alpha, x)
    misfit = max(_misfit(study, alpha) for alpha in laws.values())
    lost = {name: 1.0 - float(np.prod(masses(study.box, alpha))) for name, alpha in laws.items()}

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 2, sharey=True)
        titles = (
            f"means 1, 1; sd 0.07, 0.02: {lost['paper']:.0e} cut off",
            f"means 1, 0.9; sd 0.25, 0.25: {lost['broad']:.0%} cut off",
        )
        for axes, name, title in zip(panels, laws, titles, strict=True):
            values = table[f"density_{name}"].to_numpy()
            if name == "paper":
                values = density(study, GIVEN, grid(WIDER, 4 * MAP))
            side = round(values.size**0.5)
            x_1, x_2 = sides(WIDER, side)
            filled = axes.contourf(x_1, x_2, values.reshape(side, side).T, 12, cmap="Blues")
            canvas.colorbar(filled, ax=axes, label="joint density [-]", shrink=0.85)
            _draw_box(axes, study.box)
            axes.set(xlabel=LABELS[0], title=title)
        panels[0].set_ylabel(LABELS[1])

    claims = (
        Claim(
            "The clip maps a normal germ to the normal law cut at the box.",
            "by its three equations",
            f"largest difference of the distribution functions {misfit:.0e}",
            Verdict.of(misfit < 1e-12),
        ),
        Claim(
            "The law must be clipped so that every run is feasible.",
            "alpha = (1, 1, 0.07, 0.02)",
            f"only {lost['paper']:.0e} of this law lies outside the box",
            Verdict.NOT_COMPARABLE,
            "the clip matters for the wider laws that a search tries",
        ),
    )
    return Reproduction({"": table}, draw, claims, (9.0, 4.0))


def grid(limits: Array, points: int) -> Array:
    """Points (points^2, 2) of a regular grid.

    >>> grid(np.array([[0.0, 1.0], [0.0, 2.0]]), 2).tolist()
    [[0.0, 0.0], [0.0, 2.0], [1.0, 0.0], [1.0, 2.0]]
    """
    axes = np.meshgrid(*sides(limits, points), indexing="ij")
    return np.stack([axis.ravel() for axis in axes], axis=1)


def sides(limits: Array, points: int) -> list[Array]:
    """The coordinates of a regular grid, an array for each parameter."""
    return [np.linspace(low, high, points) for low, high in limits.tolist()]


def masses(box: Array, alpha: Array) -> Array:
    """Probability of each side of the box (2,) under the normal laws before they are cut."""
    mean, sd = alpha[::2], alpha[1::2]
    return np.asarray(ndtr((box[:, 1] - mean) / sd) - ndtr((box[:, 0] - mean) / sd))


def density(study: ClutchStudy, alpha: Array, x: Array) -> Array:
    """Joint density of the clipped laws at x (R, 2): phi(u)/(sd (Phi(b) - Phi(a))), 0 outside."""
    mean, sd = alpha[::2], alpha[1::2]
    normal = np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
    inside = np.all((x >= study.box[:, 0]) & (x <= study.box[:, 1]), axis=1)
    return np.where(inside, np.prod(normal / masses(study.box, alpha), axis=1), 0.0)


def _misfit(study: ClutchStudy, alpha: Array) -> float:
    """Largest gap between Phi(theta) and the cut law's distribution function at x(theta)."""
    theta, gaps = np.linspace(-6.0, 6.0, 241), []
    for law, box, part in zip(
        study.law("hermite").laws.values(), study.box, (alpha[:2], alpha[2:]), strict=True
    ):
        low, high = ndtr((box - part[0]) / part[1])
        found = (ndtr((law.standard(part, theta).x - part[0]) / part[1]) - low) / (high - low)
        gaps.append(np.max(np.abs(found - ndtr(theta))))
    return float(max(gaps))


def _feasible(study: ClutchStudy, x: Array) -> NDArray[np.bool_]:
    """Whether all experiments have an outcome at each point (R,)."""
    count = len(study.outcomes)
    index = np.repeat(np.arange(count), len(x))
    outcome = study.run(index, np.tile(x, (count, 1))).reshape(count, -1)
    return np.asarray(np.isfinite(outcome).all(axis=0))


def _draw_box(axes: Axes, box: Array, hue: str = VERMILION) -> None:
    from matplotlib.patches import Rectangle

    corner, size = box[:, 0], box[:, 1] - box[:, 0]
    axes.add_patch(Rectangle(tuple(corner), *size, fill=False, ec=VERMILION, lw=1.8))
    axes.annotate(
        "clipping box", tuple(corner), (4, 5), textcoords="offset points", color=hue,
        fontweight="bold",
    )  # fmt: skip
