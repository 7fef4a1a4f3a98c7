"""Exact moments of an expansion: offline and online time of the three ways, and of chaospy.

The cases are those of the paper's figure (zeroprod): Hermite polynomials of n parameters to total
degree d, moments to order m. `table` has them all, `offline_rows` the few that `make bench` prints.
Alone: `python -m benchmarks.offline`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import partial
from math import comb

import numpy as np
import pandas as pd

from aleator.expansion.moments import (
    Basis,
    Galerkin,
    PushFork,
    TensorGauss,
    prepare,
    raw_moment,
    raw_moments,
)
from aleator.polynomials.indices import TotalDegree
from aleator.polynomials.recurrence import hermite_recurrence
from benchmarks.row import Row

Case = tuple[int, int, int]

GRID: tuple[Case, ...] = tuple(
    (n, d, m) for n in (1, 2, 3, 4) for d in (1, 2, 3, 4) for m in (2, 3, 4, 5)
)
LARGEST: Case = (4, 3, 5)
PAPER_SECONDS = 18.0
"""The paper's offline step for the largest case, in parallel on a 2.1 GHz laptop."""

EXPERIMENTS = 100
MOST_CANDIDATES = 2_000_000
"""Larger sets would take push and fork seconds: (4, 4, 5) has 16 million candidates."""

CHAOSPY_SECONDS = 30.0
"""Once chaospy has taken as long as this in all, the larger cases are left out."""


def table(cases: Iterable[Case] = GRID, peer_seconds: float = CHAOSPY_SECONDS) -> pd.DataFrame:
    """A row a case: counts of candidates and terms, and seconds.

    Push and fork is timed as in the paper: order m alone, its set offline and its raw moment
    online. The other ways give all standardized moments to order m. Online is for 100 expansions.
    `chaospy` is one raw moment of one expansion: NaN without chaospy, and for the largest cases
    once it has taken `peer_seconds`. `disagreement` is the largest difference of any raw moment of
    order m, relative to that moment or sd^m, whichever is larger.
    """
    rows = [_case(*case) for case in cases]
    left = peer_seconds
    # cheapest first, so that what is left out is what takes longest
    for row in sorted(rows, key=lambda row: row["candidates"]):
        row["chaospy"] = np.nan
        if left > 0.0 and row["candidates"] <= MOST_CANDIDATES:
            row["chaospy"] = chaospy_seconds(*_key(row))
            left -= row["chaospy"] if np.isfinite(row["chaospy"]) else left
    return pd.DataFrame(rows)


def offline_rows() -> list[Row]:
    """The paper's largest case, and one beyond every multinomial sum."""
    (row,) = table([LARGEST]).to_dict("records")
    chaospy, best = row["chaospy"], min(row["tensor_offline"], row["galerkin_offline"])
    name = "moments, (n, d, m) = (4, 3, 5)"
    rows = [
        Row(f"{name}: push and fork, offline", ms(row["push_fork_offline"]),
            f"paper {PAPER_SECONDS} s", row["push_fork_offline"] / PAPER_SECONDS),
        Row(f"{name}: tensor Gauss, offline", ms(row["tensor_offline"]),
            f"push and fork {ms(row['push_fork_offline'])}",
            row["tensor_offline"] / row["push_fork_offline"]),
        Row(f"{name}: tensor Gauss, {EXPERIMENTS} expansions", ms(row["tensor_online"]),
            f"push and fork {ms(row['push_fork_online'])}",
            row["tensor_online"] / row["push_fork_online"]),
        Row(f"{name}: Galerkin, {EXPERIMENTS} expansions", ms(row["galerkin_online"]),
            f"tensor Gauss {ms(row['tensor_online'])}",
            row["galerkin_online"] / row["tensor_online"]),
        Row(f"{name}: largest disagreement", f"{row['disagreement']:.0e}", "target 1e-12",
            row["disagreement"] / 1e-12),
    ]  # fmt: skip
    if np.isfinite(chaospy):
        whole = best + min(row["tensor_online"], row["galerkin_online"])
        rows.append(Row(f"{name}: all orders, {EXPERIMENTS} expansions", ms(whole),
                        f"chaospy, one of one {chaospy:.1f} s", whole / chaospy))  # fmt: skip
    return [*rows, *_ten_parameters()]


def chaospy_seconds(n: int, d: int, m: int) -> float:
    """Seconds of chaospy.E(polynomial ** m), NaN without chaospy."""
    try:
        import chaospy
    except ImportError:
        return float("nan")
    law = chaospy.Iid(chaospy.Normal(0, 1), n)
    expansion = chaospy.generate_expansion(d, law, normed=True)
    c = np.random.default_rng(0).standard_normal(len(expansion))
    polynomial = chaospy.sum(expansion * c)
    began = time.perf_counter()
    chaospy.E(polynomial**m, law)
    return time.perf_counter() - began


def hermite_basis(n: int, d: int, order: int) -> Basis:
    """Hermite polynomials of n parameters to total degree d."""
    recurrence = hermite_recurrence(order * d // 2 + 1)
    return Basis((recurrence,) * n, TotalDegree(d).indices((None,) * n))


def _case(n: int, d: int, m: int) -> dict[str, float]:
    basis = hermite_basis(n, d, m)
    c = np.random.default_rng(0).standard_normal((EXPERIMENTS, basis.size))
    row: dict[str, float] = {"n": n, "d": d, "m": m, "p": basis.size}
    row["candidates"] = comb(m + basis.size - 1, m)
    row["terms"] = row["push_fork_offline"] = row["push_fork_online"] = np.nan
    found = {}
    if row["candidates"] <= MOST_CANDIDATES:
        terms = PushFork().terms(basis, m)
        row["terms"] = terms.coefficients.size
        row["push_fork_offline"] = shortest(partial(PushFork().terms, basis, m))
        row["push_fork_online"] = shortest(partial(raw_moment, terms, c))
        found["push_fork"] = raw_moment(terms, c)
    for name, way in (("tensor", TensorGauss()), ("galerkin", Galerkin())):
        ready = prepare(basis, m, way)
        row[f"{name}_offline"] = shortest(partial(prepare, basis, m, way))
        row[f"{name}_online"] = shortest(partial(ready.moments, c))
        found[name] = raw_moments(ready.moments(c))[:, m]
    scale = np.maximum(np.abs(found["tensor"]), np.linalg.norm(c, axis=1) ** m)
    row["disagreement"] = max(
        float(np.max(np.abs(other - found["tensor"]) / scale)) for other in found.values()
    )
    return row


def _ten_parameters() -> list[Row]:
    """Degree 2 in ten parameters, four moments: Galerkin against push and fork."""
    basis = hermite_basis(10, 2, 4)
    c = np.random.default_rng(0).standard_normal((EXPERIMENTS, basis.size))
    ours, theirs = (
        shortest(partial(prepare, basis, 4, way))
        + shortest(partial(prepare(basis, 4, way).moments, c))
        for way in (Galerkin(), PushFork())
    )
    what = f"moments, (n, d, m) = (10, 2, 4): Galerkin, with {EXPERIMENTS} expansions"
    return [Row(what, ms(ours), f"push and fork {ms(theirs)}", ours / theirs)]


def _key(row: dict[str, float]) -> Case:
    return int(row["n"]), int(row["d"]), int(row["m"])


def shortest(work: Callable[[], object]) -> float:
    """Seconds of the shortest of up to five runs; no more runs once they took a quarter second."""
    seconds: list[float] = []
    while len(seconds) < 5 and sum(seconds) < 0.25:
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def ms(seconds: float) -> str:
    """Seconds as text in milliseconds."""
    return f"{seconds * 1e3:.1f} ms"


if __name__ == "__main__":
    with pd.option_context("display.max_rows", None, "display.width", 250):
        print(table().to_string(float_format="{:.3g}".format, index=False))
