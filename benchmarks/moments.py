"""Exact moments of an expansion: this library's two ways, the paper's push and fork, and chaospy.

The cases are named by (n, d, m): Hermite polynomials of n parameters to total degree d, moments to
order m. Push and fork is timed as in the paper, for the order m alone; the others give all orders.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from aleator.core.types import Array, Indices
from aleator.moments.exact_moments import ExactQuadrature, Galerkin, prepare
from benchmarks.row import Row, ms
from reproduction.index_sets import LARGE, PAPER_SECONDS, hermite
from reproduction.push_fork import nonzero_set, raw_moment, raw_moments

EXPERIMENTS = 100
MANY = (10, 2, 4)
"""Ten parameters, where no tensor rule serves."""


def moment_rows() -> list[Row]:
    """The paper's largest case, and one of ten parameters."""
    (basis, indices), order = hermite(*LARGE[:2]), LARGE[2]
    c = coefficients(indices)
    paper = seconds(partial(nonzero_set, basis, indices, order))
    terms = nonzero_set(basis, indices, order)
    sums = seconds(partial(raw_moment, terms, c))
    ready = prepare(basis, indices, order, ExactQuadrature())
    offline = seconds(partial(prepare, basis, indices, order, ExactQuadrature()))
    online = seconds(partial(ready.moments, c))
    moments, expected = raw_moments(ready.moments(c))[:, order], raw_moment(terms, c)
    scale = np.maximum(np.abs(moments), np.linalg.norm(c, axis=1) ** order)
    gap = float(np.max(np.abs(moments - expected) / scale))
    name = f"moments, (n, d, m) = {LARGE}"
    return [
        Row(f"{name}: push and fork, offline", ms(paper), f"paper {PAPER_SECONDS} s",
            paper / PAPER_SECONDS),
        Row(f"{name}: tensor Gauss, offline", ms(offline), f"push and fork {ms(paper)}",
            offline / paper),
        Row(f"{name}: tensor Gauss, {EXPERIMENTS} expansions", ms(online),
            f"push and fork {ms(sums)}", online / sums),
        Row(f"{name}: difference from push and fork", f"{gap:.0e}", "target 1e-12", gap / 1e-12),
        *chaospy_row(offline + online),
        ten_parameters(),
    ]  # fmt: skip


def chaospy_row(ours: float) -> list[Row]:
    """All orders of a hundred expansions, against one order of one expansion by chaospy."""
    try:
        import chaospy
    except ImportError:
        return []
    n, d, m = LARGE
    law = chaospy.Iid(chaospy.Normal(0, 1), n)
    expansion = chaospy.generate_expansion(d, law, normed=True)
    c = np.random.default_rng(0).standard_normal(len(expansion))
    polynomial = chaospy.sum(expansion * c)
    began = time.perf_counter()
    chaospy.E(polynomial**m, law)
    theirs = time.perf_counter() - began
    what = f"moments, (n, d, m) = {LARGE}: all orders, {EXPERIMENTS} expansions"
    return [Row(what, ms(ours), f"chaospy, one of one {theirs:.1f} s", ours / theirs)]


def ten_parameters() -> Row:
    """Galerkin products against the multinomial sums of the orders 3 and 4."""
    (basis, indices), orders = hermite(*MANY[:2]), (3, 4)
    c = coefficients(indices)
    ours = seconds(lambda: prepare(basis, indices, MANY[2], Galerkin()).moments(c))
    theirs = seconds(lambda: [raw_moment(nonzero_set(basis, indices, m), c) for m in orders])
    what = f"moments, (n, d, m) = {MANY}: Galerkin, with {EXPERIMENTS} expansions"
    return Row(what, ms(ours), f"push and fork {ms(theirs)}", ours / theirs)


def coefficients(indices: Indices) -> Array:
    """Coefficients (EXPERIMENTS, P) of random expansions."""
    return np.random.default_rng(0).standard_normal((EXPERIMENTS, len(indices)))


def seconds(work: Callable[[], object]) -> float:
    """Seconds of the shortest of up to five calls, of which no more start after 0.25 s."""
    spent: list[float] = []
    while len(spent) < 5 and sum(spent) < 0.25:
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return min(spent)
