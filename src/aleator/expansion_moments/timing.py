"""How long the offline and the online step take, and how many terms there are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aleator.expansion_moments.basis import Basis
from aleator.expansion_moments.exact import ExpansionMoments, prepare
from aleator.expansion_moments.galerkin import Galerkin
from aleator.expansion_moments.multi_indices import count
from aleator.expansion_moments.nonzero import nonzero_set
from aleator.expansion_moments.push_fork import raw_moment
from aleator.expansion_moments.tensor_gauss import TensorGauss
from aleator.indices import TotalDegree
from aleator.polynomials import hermite_recurrence

Array = NDArray[np.float64]

Case = tuple[int, int, int]

PAPER_SECONDS = {(4, 3, 5): 18.0}
"""What the paper says of its offline step (2.1 GHz laptop)."""

MOST_CANDIDATES = 2_000_000
"""Cases with more multi-indices are left out of `paper_grid`: they would take seconds."""


@dataclass(frozen=True)
class Timing:
    """Seconds of one case (n, d, m), Hermite family, total degree d.

    `candidates` = |I_(m,p)|, `terms` = |I*_(m,p)|. The seconds of push and fork are the
    paper's: order m alone, its set offline and its raw moment online. Those of the others are of
    all standardized moments to order m. Online is for `experiments` expansions together.
    """

    n: int
    d: int
    m: int
    p: int
    candidates: int
    terms: int
    push_fork_offline: float
    push_fork_online: float
    tensor_offline: float
    tensor_online: float
    galerkin_offline: float
    galerkin_online: float
    experiments: int


def hermite_basis(n: int, d: int, order: int) -> Basis:
    """The basis of the paper's cases: Hermite polynomials of n parameters to total degree d.

    >>> hermite_basis(4, 3, 5).size
    35
    """
    recurrence = hermite_recurrence(order * d // 2 + 1)
    return Basis((recurrence,) * n, TotalDegree(d).indices((None,) * n))


def paper_grid(
    parameters: Iterable[int] = (1, 2, 3, 4),
    degrees: Iterable[int] = (1, 2, 3, 4),
    orders: Iterable[int] = (2, 3, 4, 5),
) -> list[Case]:
    """Cases (n, d, m) of the paper's figure (zeroprod), those of too many multi-indices left out.

    >>> paper_grid((4,), (3, 4), (4, 5))
    [(4, 3, 4), (4, 3, 5), (4, 4, 4)]
    """
    orders, degrees = tuple(orders), tuple(degrees)
    cases = [(n, d, m) for n in parameters for d in degrees for m in orders]
    return [case for case in cases if counts(*case)[1] <= MOST_CANDIDATES]


def counts(n: int, d: int, m: int) -> tuple[int, int]:
    """p = (n + d)!/(n! d!) and |I_(m,p)| = C(m + p - 1, m).

    >>> counts(4, 3, 5)
    (35, 575757)
    """
    p = count(d, n + 1)
    return p, count(m, p)


def terms(n: int, d: int, m: int) -> int:
    """|I*_(m,p)| for the Hermite family, by push and fork.

    >>> terms(2, 3, 5)
    388
    """
    return int(nonzero_set(hermite_basis(n, d, m), m).coefficients.size)


def timings(cases: Iterable[Case], experiments: int = 100, seed: int = 0) -> Iterator[Timing]:
    """Time each case with random coefficients: the shortest of some runs, one if it is slow.

    >>> [(t.candidates, t.terms) for t in timings([(2, 3, 5)], experiments=1)]
    [(2002, 388)]
    """
    rng = np.random.default_rng(seed)
    for n, d, m in cases:
        basis = hermite_basis(n, d, m)
        c = rng.standard_normal((experiments, basis.size))
        found = nonzero_set(basis, m)
        yield Timing(
            n, d, m, basis.size, found.candidates, found.coefficients.size,
            shortest(partial(nonzero_set, basis, m)),
            shortest(partial(raw_moment, found, c)),
            *_both(partial(prepare, basis, m, TensorGauss()), c),
            *_both(partial(prepare, basis, m, Galerkin()), c),
            experiments,
        )  # fmt: skip


def shortest(work: Callable[[], object]) -> float:
    """Seconds of the shortest of up to five runs; no more runs once they took a quarter second."""
    seconds: list[float] = []
    while len(seconds) < 5 and sum(seconds) < 0.25:
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def _both(offline: Callable[[], ExpansionMoments], c: Array) -> tuple[float, float]:
    return shortest(offline), shortest(partial(offline().moments, c))
