"""The set of candidates that leaves least unknown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from aleator.inference.design.plan import Plan
from aleator.types import Array

EQUAL = 1e-6
"""Relative difference of two variances that is none."""
SWEEPS = 50
STARTS = 5
"""Candidates, the best by themselves, from which a set is begun."""
MOST = 1e6
"""Repetitions beyond which none are told."""


@dataclass(frozen=True)
class Choice:
    """Candidates by number, the most useful first, and the standard error after each of them.

    `ties` says how many others would be as good in each place, beside the rest of the set.
    """

    order: tuple[int, ...]
    after: tuple[float, ...]
    ties: tuple[int, ...]


def chosen(plan: Plan, count: int, repeat: int = 1) -> Choice:
    """The best set of `count` candidates: one after the other, then exchanged while that helps.

    Every member gives way to the candidate that is best in its place (Fedorov, 1972), until none
    is better. That is a local optimum, no worse than the set taken one after the other; it is
    sought from each of the best five as the first member. A candidate is taken `repeat` times at
    most. Cost: 5 count C decompositions a sweep.
    """
    every = [*range(plan.offered.shape[1])] * repeat
    first = np.argsort(_beside(plan, [], every[: plan.offered.shape[1]]), kind="stable")[:STARTS]
    ends = [
        _exchanged(plan, _greedy(plan, every, count, [start]), repeat) for start in first.tolist()
    ]
    members = min(ends, key=lambda end: float(plan.variance(_sum(plan, end))))
    order = _greedy(plan, members, count)
    steps = np.stack([_sum(plan, order[: k + 1]) for k in range(count)], axis=1)
    after = plan.standard_error(steps)
    return Choice(tuple(order), tuple(after.tolist()), _ties(plan, order, repeat))


def repetitions(plan: Plan, again: Array, goal: float) -> float | None:
    """How often experiments of information `again` (F, F) are to be made for an error of `goal`.

    A number that need not be whole; None where no number reaches it.
    """

    def beyond(times: float) -> float:
        return float(plan.standard_error(plan.present + times * again)) - goal

    if not np.isfinite(goal) or not beyond(MOST) < 0.0:
        return None
    return 0.0 if beyond(0.0) <= 0.0 else float(brentq(beyond, 0.0, MOST, xtol=1e-6))


def _greedy(plan: Plan, among: Sequence[int], count: int, begin: Sequence[int] = ()) -> list[int]:
    """`count` of the candidates `among`, after the first each the best beside those before."""
    taken = [*begin]
    left = Counter(among) - Counter(taken)
    for _ in range(count - len(taken)):
        offered = [c for c, times in left.items() if times]
        best = offered[int(np.argmin(_beside(plan, taken, offered)))]
        taken.append(best)
        left[best] -= 1
    return taken


def _exchanged(plan: Plan, members: list[int], repeat: int) -> list[int]:
    members = [*members]
    value = float(plan.variance(_sum(plan, members)))
    for _ in range(SWEEPS):
        before = value
        for place in range(len(members)):
            others = members[:place] + members[place + 1 :]
            left = _left(plan, others, repeat)
            found = _beside(plan, others, left)
            best = int(np.argmin(found))
            if found[best] < value * (1.0 - EQUAL):
                members[place], value = left[best], float(found[best])
        if value >= before * (1.0 - EQUAL):
            break
    return members


def _ties(plan: Plan, order: list[int], repeat: int) -> tuple[int, ...]:
    value, found = float(plan.variance(_sum(plan, order))), []
    for place, own in enumerate(order):
        others = order[:place] + order[place + 1 :]
        left = [c for c in _left(plan, others, repeat) if c != own]
        found.append(int(np.sum(_beside(plan, others, left) <= value * (1.0 + EQUAL))))
    return tuple(found)


def _left(plan: Plan, others: list[int], repeat: int) -> list[int]:
    """The candidates that may stand beside these others."""
    taken = Counter(others)
    return [c for c in range(plan.offered.shape[1]) if taken[c] < repeat]


def _sum(plan: Plan, members: list[int]) -> Array:
    return np.asarray(plan.present + plan.offered[:, members].sum(axis=1))


def _beside(plan: Plan, members: list[int], candidates: list[int]) -> Array:
    """The variance after these members with each of the candidates."""
    return plan.variance(_sum(plan, members)[:, None] + plan.offered[:, candidates])
