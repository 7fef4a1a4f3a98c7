"""What the experiments do not determine: flat profiles, and directions along which alpha moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from aleator.core.types import Array
from aleator.inference.information import Inference
from aleator.inference.profile import DROP, Profile
from aleator.laws import Hyperparameter
from aleator.results.findings import replace_each_other
from aleator.results.values import Diagnostic


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """Settings of the warnings about weak directions. The values are chosen by judgement."""

    weak: float = 0.02
    """Curvature of the log-likelihood along a direction, relative to that of the single
    hyperparameters, below which the direction is called weak.
    """
    part: float = 0.3
    """Component of a weak direction from which a hyperparameter is named in the message."""


IDENTIFIABILITY = IdentifiabilitySettings()
REMEDY = "fix a hyperparameter, or measure under more varied conditions"


def identifiability_warnings(
    inference: Inference, hyperparameters: Sequence[Hyperparameter], profile: Profile
) -> list[Diagnostic]:
    """Warnings about flat profiles, and about weak directions that have no part in one of these."""
    flat = flat_profiles(hyperparameters, inference, profile)
    told = {hyperparameters[k].name for k in flat}
    weak = weak_directions(inference, hyperparameters)
    return [
        *(_untold(k, hyperparameters, inference, profile) for k in flat),
        *(one for one in weak if not told & {*one.concerns}),
    ]


def flat_profiles(
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    profile: Profile,
) -> list[int]:
    """The hyperparameters of which no value is ruled out: the 95 % interval has both limits."""
    return [
        k
        for k in inference.identified.tolist()
        if inference.positive
        and profile.intervals[k, 0] == hyperparameters[k].lower
        and profile.intervals[k, 1] == hyperparameters[k].upper
    ]


def left_open(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[int]:
    """The hyperparameters of laws of which no value is ruled out.

    Where an end of the profile interval is unknown, the estimate -+ 1.96 standard errors takes its
    place. The standard deviation of the measurement noise is told by its interval alone.
    """
    unknown = [
        int(k)
        for k in profile.unknown(inference.identified)
        if inference.lower[k] <= hyperparameters[k].lower
        and inference.upper[k] >= hyperparameters[k].upper
    ]
    every = {*flat_profiles(hyperparameters, inference, profile), *unknown}
    return sorted(k for k in every if not hyperparameters[k].name.startswith("noise."))


def exchanged(
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    profile: Profile,
) -> list[int]:
    """The sds of laws of which each may be zero but, with another one, not both.

    The interval of each runs to its lower limit (see `replace_each_other`): the data do not tell
    which parameter scatters. An sd that may be zero by itself is determined.
    """
    rows = [
        (row, int(k))
        for row, k in enumerate(inference.free)
        if inference.positive
        and hyperparameters[k].name.endswith(".sd")
        and not hyperparameters[k].name.startswith("noise.")
        and profile.intervals[k, 0] <= hyperparameters[k].lower
    ]
    z = {k: float(alpha[k] / inference.standard_error[k]) for _, k in rows}
    pairs = [
        (k, m)
        for (p, k), (q, m) in combinations(rows, 2)
        if replace_each_other(z[k], z[m], float(inference.correlation[p, q]))
    ]
    return sorted({k for pair in pairs for k in pair})


def _untold(
    k: int, hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> Diagnostic:
    """What says that no value of hyperparameter k is ruled out, and which other goes with it."""
    h, (low, high) = hyperparameters[k], profile.drops[k]
    others, beside = np.flatnonzero(inference.free != k), ""
    if others.size and k in inference.free:
        row = inference.correlation[int(np.flatnonzero(inference.free == k)[0])]
        most = int(others[np.argmax(np.abs(row[others]))])
        name = hyperparameters[int(inference.free[most])].name
        beside = f"; its estimate is correlated most with that of {name} ({row[most]:.3f})"
    scatter = h.log and not h.name.startswith("noise.")
    return Diagnostic(
        "identifiability",
        f"{h.name} cannot be told from these data: at its limits {h.lower:.4g} and {h.upper:.4g} "
        f"the largest log-likelihood is only {low:.2f} and {high:.2f} lower, and values are ruled "
        f"out from {DROP:.2f}{beside}",
        "fix it, or measure more values an experiment, under other conditions"
        if scatter
        else REMEDY,
        (h.name,),
    )


def weak_directions(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: IdentifiabilitySettings = IDENTIFIABILITY,
) -> list[Diagnostic]:
    """Warnings about hyperparameters that are hardly determined: pairs, groups, single ones.

    Pairs and groups are those whose estimates are correlated beyond 0.98. A single standard
    deviation is not reported, since its interval says how uncertain it is.
    """
    weak = _correlated if inference.positive else _flat
    return [*weak(inference, [hyperparameters[k] for k in inference.free], settings)]


def _correlated(
    inference: Inference, free: Sequence[Hyperparameter], settings: IdentifiabilitySettings
) -> Iterator[Diagnostic]:
    if inference.free.size < 2:
        return
    names = [h.name for h in free]
    values, vectors = np.linalg.eigh(inference.correlation)
    for vector in vectors.T[values <= settings.weak]:
        # A small eigenvalue of the correlation matrix belongs to a well determined combination; the
        # hyperparameters with large components in it cannot be separated.
        parts = _large(vector, settings)
        which = [names[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can hardly be told apart: if they change together, the "
            "likelihood hardly changes; well determined is only "
            f"{_combination(vector, parts, names)} (se: standard error)",
            *which,
            remedy=_remedy([free[i] for i in parts]),
        )


def _remedy(which: Sequence[Hyperparameter]) -> str:
    """The remedy: centering, if a hyperparameter is an intercept far from all experiments."""
    terms = [name for h in which if h.beside for name, _ in h.beside.terms]
    if not terms:
        return REMEDY
    covariate = terms[0].partition("[")[2].removesuffix("]")
    return (
        f"write center({covariate}) for {covariate} in the formula: the other coefficient is then "
        "the value at the mean of the covariate, not at zero; nothing else changes"
    )


def _flat(
    inference: Inference, free: Sequence[Hyperparameter], settings: IdentifiabilitySettings
) -> Iterator[Diagnostic]:
    """Warnings about directions along which the log-likelihood is flat: there is no covariance."""
    inside = np.isin(inference.identified, inference.free)
    information = inference.information[np.ix_(inside, inside)]
    scale = np.sqrt(np.abs(np.diag(information)))
    if not np.all(np.isfinite(information)):
        return
    acts = scale > 0.0
    for h, act in zip(free, acts, strict=True):
        if not act:
            yield _weak(f"{h.name} has no effect", h.name)
    names = [h.name for h, act in zip(free, acts, strict=True) if act]
    values, vectors = np.linalg.eigh(
        information[np.ix_(acts, acts)] / np.outer(scale[acts], scale[acts])
    )
    for vector in vectors.T[np.abs(values) < settings.weak]:
        parts = _large(vector, settings)
        which = [names[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can change together without effect, along "
            f"{_combination(vector, parts, names)} (se: standard error of each by itself)",
            *which,
        )


def _weak(message: str, *names: str, remedy: str = REMEDY) -> Diagnostic:
    return Diagnostic("identifiability", message, remedy, names)


def _large(vector: Array, settings: IdentifiabilitySettings) -> list[int]:
    return [int(i) for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > settings.part]


def _combination(vector: Array, parts: Sequence[int], names: Sequence[str]) -> str:
    return " ".join(
        f"{'+' if vector[i] >= 0 else '-'} {abs(vector[i]):.2f} {names[i]}/se" for i in parts
    )
