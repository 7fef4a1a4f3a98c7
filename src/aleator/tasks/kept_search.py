"""Searches are kept beside the runs: a study that was killed does not search again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import is_dataclass

import numpy as np

from aleator.laws import Hyperparameter
from aleator.search import Search, SearchResult
from aleator.search.interface import Objective
from aleator.search.written import read, written
from aleator.simulators import Runner
from aleator.simulators.store import keep, kept
from aleator.types import Array

FORMAT = 2
"""To be changed with what a search does, or with how its result is written."""
PROBES = 3
"""Alphas at which two likelihoods agree in every digit of every experiment if they are the same."""


def kept_search(
    runner: Runner | None,
    search: Search,
    objective: Objective,
    hyperparameters: Sequence[Hyperparameter],
    guesses: Sequence[Array],
    seed: int,
    searched: Callable[[], SearchResult],
) -> SearchResult:
    """What `searched` finds, or has found before in a study whose runner has the same store.

    A likelihood is known again by its values and scores of all experiments at PROBES alphas. A
    search that is not a dataclass may hold what cannot be seen, and is made again; so is one that
    makes runs, which are counted: it has no `runner`.
    """
    if runner is None or runner.cache is None or not is_dataclass(search):
        return searched()
    store, fingerprint = runner.cache.store, runner.cache.identity.fingerprint
    key = _key(search, objective, hyperparameters, guesses, seed)
    known = kept(store, fingerprint, key)
    if known is not None:
        return read(known)
    found = searched()
    keep(store, fingerprint, key, written(found))
    return found


def _key(
    search: Search,
    objective: Objective,
    hyperparameters: Sequence[Hyperparameter],
    guesses: Sequence[Array],
    seed: int,
) -> str:
    """Of what a search depends on, a digest."""
    digest = hashlib.sha256(repr((FORMAT, search, [*hyperparameters], seed)).encode())
    start = np.array([h.start for h in hyperparameters])
    for guess in guesses:
        digest.update(np.ascontiguousarray(guess).tobytes())
    with np.errstate(all="ignore"):
        for alpha in [start, *guesses][:PROBES]:
            found = objective(alpha)
            digest.update(found.each.tobytes())
            digest.update(np.ascontiguousarray(found.scores).tobytes())
    return digest.hexdigest()
