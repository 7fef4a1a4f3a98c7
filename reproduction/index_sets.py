"""The sets of multi-indices behind the exact moments of an expansion, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aleator.core.types import Indices
from aleator.moments.exact_moments import ExactQuadrature, Galerkin, prepare
from aleator.moments.expansion import Basis, TotalDegree
from aleator.views.axes import BLUE, GREEN, ORANGE, VERMILION
from reproduction.canvas import explain, powers_of_ten
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict, keyed
from reproduction.push_fork import (
    count,
    exponents,
    nonzero_set,
    push_and_fork,
    raw_moment,
    raw_moments,
    stacks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

T = TypeVar("T")
Rows = NDArray[np.int64] | NDArray[np.int8]

SETS = (2, 3, 5)  # n, d, m of the sets that are drawn
STEPS = (5, 4)  # m, p of push and fork as it is drawn
CASES = tuple((n, d, m) for n in (1, 2, 3, 4) for d in (1, 2, 3) for m in (3, 4, 5))
LARGE = (4, 3, 5)  # the paper's example
LARGE_SIZE = 35  # of its basis
PAPER_SECONDS, PAPER_GENERATION = 18.0, 1.2
BATCH = 108  # expansions whose moments are taken at once, as many as the clutch has experiments


def sets(_: Context) -> Reproduction:
    """Fig. 2: I_(5,10) and I*_(5,10) for n = 2 and d = 3, and push and fork for (m, p) = (5, 4)."""
    n, d, m = SETS
    basis, indices = hermite(n, d)
    every = np.array(list(push_and_fork(m, len(indices))), dtype=np.int64)
    kept = nonzero_set(basis, indices, m).exponents
    steps = np.array(list(push_and_fork(*STEPS)), dtype=np.int64)
    walk = pd.DataFrame(steps, columns=[f"i_{k + 1}" for k in range(STEPS[1])])
    walk["made_by"] = ["start", *("push" if row[-1] > 0 else "fork" for row in steps[:-1])]
    names = [f"i_{k + 1}" for k in range(len(indices))]
    inside = {tuple(row) for row in kept.tolist()}
    table = pd.DataFrame(every, columns=names)
    table["nonzero"] = [tuple(row) in inside for row in every.tolist()]
    share = 1.0 - len(kept) / len(every)
    claims = (
        Claim(
            "The set of multi-indices has C(m + p - 1, m) members.",
            "C(14, 5) = 2002 for (m, p) = (5, 10)",
            f"{len(every)} made by push and fork, no two equal: {len(set(map(tuple, every)))}",
            Verdict.of(len(every) == count(m, len(indices)) == len(set(map(tuple, every)))),
        ),
        Claim(
            "A significant fraction of them has an inner product of zero.",
            "shown, no number",
            f"{share:.0%} of I_(5,10) for Hermite polynomials of two parameters: "
            f"{len(kept)} of {len(every)} remain",
            Verdict.of(share > 0.5),
            "judged at one half; polynomials of an asymmetric law have fewer zeros",
        ),
    )
    return Reproduction(
        {"": table, "push-fork": walk},
        lambda canvas: _draw_sets(canvas, every, kept, walk),
        claims,
        (9.0, 6.6),
    )


def offline(context: Context) -> Reproduction:
    """Fig. 3: time of the offline step for each (n, d, m), by the paper's way and two others."""
    rng = np.random.default_rng(context.seed)
    rows = []
    for k, case in enumerate(CASES):
        context.progress.update(f"(n, d, m) = {case}", k, len(CASES))
        rows.append(_timed_case(*case, rng))
    table = pd.DataFrame(rows)
    key = ["n", "d", "m"]
    spent, candidates, terms, tensor, worst = (
        keyed(table, key, column)[LARGE]
        for column in ("push_fork_s", "candidates", "nonzero", "tensor_gauss_s", "disagreement")
    )
    generation, _ = timed(lambda: exponents(stacks(LARGE[2], LARGE_SIZE), LARGE_SIZE))
    name = "(n, d, m) = (4, 3, 5)"
    claims = (
        Claim(
            f"{name} has 575,757 inner products to try.",
            "575,757",
            f"{candidates:,}, of which {terms:,} are not zero",
            Verdict.of(candidates == 575_757),
        ),
        Claim(
            f"The offline step takes 18 s for {name}.",
            "18 s in parallel, 2.1 GHz laptop",
            f"{spent:.2f} s on one core, {PAPER_SECONDS / spent:.0f} times less",
            Verdict.of(spent <= PAPER_SECONDS),
            "another machine and language; read as: at most that",
        ),
        Claim(
            "Making the multi-indices alone takes 1.2 s.",
            "1.2 s",
            f"{generation:.2f} s on one core",
            Verdict.of(generation <= PAPER_GENERATION),
            "another machine and language; read as: at most that",
        ),
        Claim(
            "The multinomial sum is the efficient way to high moments of an expansion.",
            "implied; no other exact way is compared",
            f"a tensor Gauss rule gives the same moments with an offline step of "
            f"{1e3 * tensor:.1f} ms, largest difference {table['disagreement'].max():.0e} "
            f"({worst:.0e} at {name})",
            Verdict.of(spent <= tensor),
        ),
    )
    return Reproduction({"": table}, lambda canvas: _draw_times(canvas, table), claims, (9.0, 4.6))


def hermite(n: int, d: int) -> tuple[Basis, Indices]:
    """Hermite polynomials in n parameters, and the multi-indices of total degree d."""
    return Basis.normal(n), TotalDegree(d).indices((None,) * n)


def timed(work: Callable[[], T]) -> tuple[float, T]:
    """Seconds that some work takes, and its result."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def _timed_case(n: int, d: int, m: int, rng: np.random.Generator) -> dict[str, float]:
    basis, indices = hermite(n, d)
    coefficients = rng.standard_normal((BATCH, len(indices)))
    found: dict[str, float] = {"n": n, "d": d, "m": m, "p": len(indices)}
    found["candidates"] = count(m, len(indices))
    found["push_fork_s"], terms = timed(lambda: nonzero_set(basis, indices, m))
    found["nonzero"] = terms.coefficients.size
    raw = float(raw_moment(terms, coefficients[:1])[0])
    reference = 0.0
    for name, way in (("tensor_gauss", ExactQuadrature()), ("galerkin", Galerkin())):
        found[f"{name}_s"], ready = timed(partial(prepare, basis, indices, m, way))
        found[f"{name}_online_s"], moments = timed(lambda r=ready: r.moments(coefficients))  # type: ignore[misc]
        reference = float(raw_moments(moments)[0, m])
    scale = max(abs(raw), float(np.linalg.norm(coefficients[0])) ** m)
    found["disagreement"] = abs(raw - reference) / scale
    return found


def _draw_sets(canvas: Canvas, every: Rows, kept: Rows, walk: pd.DataFrame) -> None:
    from matplotlib.colors import ListedColormap

    shades = ListedColormap(["white", "#cfe3f1", "#7fb8dc", "#3c93c8", "#0072b2", "#003f66"])
    left, middle, right = canvas.subplots(1, 3, width_ratios=(1.0, 1.0, 2.6))
    sizes = ((left, every, "I(5,10)"), (middle, kept, "I*(5,10), not zero"))
    for axes, rows, title in sizes:
        image = axes.imshow(
            rows, shades, aspect="auto", vmin=-0.5, vmax=5.5, interpolation="nearest"
        )
        axes.set(title=f"{title}\n{len(rows):,} rows", xlabel="location")
        axes.set_xticks(range(0, rows.shape[1], 3), range(1, rows.shape[1] + 1, 3))
    left.set_ylabel("multi-index, in the order in which it is made")
    canvas.colorbar(image, ax=middle, label="items at the location", ticks=range(6), shrink=0.5)
    _draw_walk(right, walk)


def _draw_walk(axes: Axes, walk: pd.DataFrame) -> None:
    """The rows of push and fork in four columns, with what made each row."""
    columns = 4
    height = -(-len(walk) // columns)
    for k, row in enumerate(walk.itertuples(index=False)):
        x, y = 6.4 * (k // height), k % height
        mark = str(row[-1])
        hue = {"push": BLUE, "fork": VERMILION}.get(mark, "#404040")
        sign = {"push": "P", "fork": "F"}.get(mark, "")
        axes.text(x, y, sign, color=hue, fontsize=9.0, fontweight="bold", ha="right", va="center")
        for j, items in enumerate(row[:-1]):
            shade = "#404040" if items else "#b8b8b8"
            axes.text(x + 0.9 + j, y, str(items), color=shade, fontsize=9.0, va="center")
    axes.set(xlim=(-0.9, 6.4 * columns - 0.6), ylim=(height - 0.4, -0.9))
    axes.set_title("push (P) and fork (F) for m = 5 items\non p = 4 locations")
    axes.axis("off")


def _draw_times(canvas: Canvas, table: pd.DataFrame) -> None:
    axes = canvas.subplots()
    marks = {1: "o", 2: "s", 3: "^", 4: "D"}
    hues = {"push_fork": BLUE, "tensor_gauss": ORANGE, "galerkin": GREEN}
    for way, hue in hues.items():
        for n, mark in marks.items():
            rows, label = table[table["n"] == n], f"{way.replace('_', ' ')}, n = {n}"
            axes.plot(
                rows["candidates"], rows[f"{way}_s"], mark, color=hue, ms=4.6, mew=0.0, alpha=0.85,
                label=label,
            )  # fmt: skip
    axes.plot(575_757, PAPER_SECONDS, "x", color=VERMILION, ms=8, mew=2, label="paper (4, 3, 5)")
    axes.set(xlabel="candidates |I(m,p)|", ylabel="offline step [s]", xscale="log", yscale="log")
    powers_of_ten(axes.xaxis)
    powers_of_ten(axes.yaxis)
    explain(canvas, axes, 4)
