"""What the experiments hardly determine: single hyperparameters, and directions among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.results.values import Diagnostic
from aleator.types import Array

FLAT = 0.02
"""A curvature below this share of that of each hyperparameter alone marks a weak direction."""
REMEDY = "fix a hyperparameter, or measure under more varied conditions"


def weak_directions(
    inference: Inference, hyperparameters: Sequence[Hyperparameter]
) -> list[Diagnostic]:
    """What the experiments hardly determine: pairs, groups, and directions without any effect.

    Pairs and groups are those whose estimates are correlated beyond 0.98. That a single standard
    deviation is uncertain its interval says.
    """
    named = _correlated if inference.positive else _flat
    return [*named(inference, [hyperparameters[k] for k in inference.free])]


def _weakest(correlation: Array) -> Array:
    """Of these correlations the eigenvectors, as rows, of eigenvalues near zero."""
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors.T[values <= FLAT])


def _correlated(inference: Inference, free: Sequence[Hyperparameter]) -> Iterator[Diagnostic]:
    if inference.free.size < 2:
        return
    names = [h.name for h in free]
    for vector in _weakest(inference.correlation):
        # the small eigenvalue is well determined; what moves along its large parts is not apart
        parts = _large(vector)
        which = [names[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can hardly be told apart: if they change together, the "
            "likelihood hardly changes; well determined is only "
            f"{_combination(vector, parts, names)} (se: standard error)",
            *which,
            remedy=_remedy([free[i] for i in parts]),
        )


def _remedy(which: Sequence[Hyperparameter]) -> str:
    """An intercept far from all experiments is another matter than what they do not tell."""
    terms = [name for h in which if h.beside for name, _ in h.beside.terms]
    if not terms:
        return REMEDY
    covariate = terms[0].partition("[")[2].removesuffix("]")
    return (
        f"write center({covariate}) for {covariate} in the formula: the other coefficient is then "
        "the value at the mean of the covariate, not at zero; nothing else changes"
    )


def _flat(inference: Inference, free: Sequence[Hyperparameter]) -> Iterator[Diagnostic]:
    """Directions along which the log-likelihood is flat: there is no covariance."""
    names = [h.name for h in free]
    inside = np.isin(inference.identified, inference.free)
    information = inference.information[np.ix_(inside, inside)]
    scale = np.sqrt(np.abs(np.diag(information)))
    if not np.all(np.isfinite(information)):
        return
    acts = scale > 0.0
    for name, act in zip(names, acts, strict=True):
        if not act:
            yield _weak(f"{name} has no effect", name)
    known = [name for name, act in zip(names, acts, strict=True) if act]
    values, vectors = np.linalg.eigh(
        information[np.ix_(acts, acts)] / np.outer(scale[acts], scale[acts])
    )
    for vector in vectors.T[np.abs(values) < FLAT]:
        parts = _large(vector)
        which = [known[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can change together without effect, along "
            f"{_combination(vector, parts, known)} (se: standard error of each by itself)",
            *which,
        )


def _weak(message: str, *names: str, remedy: str = REMEDY) -> Diagnostic:
    return Diagnostic("identifiability", message, remedy, names)


def _large(vector: Array) -> list[int]:
    return [int(i) for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > 0.3]


def _combination(vector: Array, parts: Sequence[int], names: Sequence[str]) -> str:
    return " ".join(
        f"{'+' if vector[i] >= 0 else '-'} {abs(vector[i]):.2f} {names[i]}/se" for i in parts
    )
