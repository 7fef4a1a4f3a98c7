"""What the estimates tell of themselves: too few experiments, limits, directions left open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from aleator.core.types import Array
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.results.values import Diagnostic
from aleator.search import SearchResult, wide_limits


@dataclass(frozen=True)
class EstimateSettings:
    """When estimates are not at a maximum, too many, or hardly determined; by judgement.

    edm: distance to the maximum, in log-likelihood, that still counts as arrived: 0.1 standard
    errors. experiments: experiments for each free hyperparameter; with fewer, intervals of a normal
    law contain the truth in less than 93 % of all cases: 92 % at four, 91 % at three, by the laws
    of Student and Helmert.
    weak: curvature of a direction over that of each hyperparameter alone; with less it is weak.
    part: share of a direction from which a hyperparameter is named.
    correlation: that of two estimates from which advice on it is a warning.
    distance: the mean of a condition over its standard deviation from which it is far from zero.
    proportional: relative deviation of the ratio of two effects from a condition that counts as
    none, at most the share `spread` of the relative spread of the condition.
    """

    edm: float = 5e-3
    experiments: int = 5
    weak: float = 0.02
    part: float = 0.3
    correlation: float = 0.95
    distance: float = 3.0
    proportional: float = 0.01
    spread: float = 0.2


ESTIMATES = EstimateSettings()


def count_warnings(
    experiments: int, inference: Inference, settings: EstimateSettings = ESTIMATES
) -> list[Diagnostic]:
    """Whether normal theory can be trusted at this number of experiments."""
    free = inference.identified.size
    if experiments >= settings.experiments * free:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{experiments} experiments for {free} free hyperparameters: intervals hold the truth "
            "in less than 93 % of all cases, estimates -+ 1.96 standard errors in less than 90 %, "
            "and estimated standard deviations tend to be too small, by about the ratio of "
            "hyperparameters to experiments",
            "take the intervals, not the standard errors; fix some, or add experiments "
            f"({2 * settings.experiments} for each is a start)",
        )
    ]


def search_refusals(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Whether the answer is a maximum, and the search arrived there."""
    warnings = []
    wide = wide_limits(hyperparameters)
    narrow = f"; narrow the limits of {', '.join(wide)}, many orders of magnitude wide"
    also = narrow if wide else ""
    if not inference.positive:
        warnings.append(
            Diagnostic(
                "search",
                "the information matrix at the answer is not positive definite: it is no maximum, "
                "or a hyperparameter has no effect",
                f"fix a hyperparameter, or search from more starts{also}",
            )
        )
    elif not inference.edm < settings.edm:
        warnings.append(
            Diagnostic(
                "search",
                "the search did not arrive: the maximum is an estimated "
                f"{inference.edm:.2g} higher in log-likelihood",
                f"allow more evaluations a start, search from more starts, or polish{also}",
            )
        )
    return warnings


def once_warnings(found: SearchResult) -> list[Diagnostic]:
    """Whether the maximum is one that no second start came to."""
    if not found.once:
        return []
    return [
        Diagnostic(
            "search",
            f"of {len(found.ascents)} starts of the search not two came to the same best "
            "log-likelihood: there may be a higher maximum",
            "search from more starts, give a hyperparameter a start or narrower limits, or fix one",
        )
    ]


def bound_warnings(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[Diagnostic]:
    """Estimates on a limit, and intervals of which an end was not found."""
    warnings = [
        _on_limit(h, side)
        for h, side in zip(hyperparameters, inference.at_bound, strict=True)
        if side is not None
    ]
    unknown = [hyperparameters[k] for k in profile.unknown(inference.identified)]
    if unknown and inference.positive:
        names = tuple(h.name for h in unknown)
        warnings.append(
            Diagnostic(
                "interval",
                f"no interval is told of {', '.join(names)}: an end of it could not be found, at "
                "which the profile of the log-likelihood has dropped by 1.92",
                "take the standard error for what it is worth, or a bootstrap of the experiments; "
                "see whether the likelihood is rough because the simulator jumps",
                names,
            )
        )
    return warnings


def _on_limit(h: Hyperparameter, side: str) -> Diagnostic:
    if side == "lower" and h.reaches_zero:
        return Diagnostic(
            "bounds",
            f"{h.name} ends at zero: as far as these experiments tell, it is no scatter. It has no "
            "standard error, and those of the others hold with it at zero",
            "take a constant in place of a law that does not scatter, or leave it and say so",
            (h.name,),
        )
    scatter = side == "lower" and h.log and not h.name.startswith("noise.")
    constant = '; if its parameter is the same in all experiments, take law = "constant"'
    return Diagnostic(
        "bounds",
        f"{h.name} ends on its {side} limit {h.lower if side == 'lower' else h.upper:.6g}; "
        "it has no standard error, and those of the others hold with it fixed there",
        "widen the limit if it is not physical, or fix the hyperparameter"
        + (constant if scatter else ""),
        (h.name,),
    )


REMEDY = "fix a hyperparameter, or measure under more varied conditions"


def weak_directions(
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """What the experiments hardly determine: pairs, groups, and directions without any effect.

    Pairs and groups are those whose estimates are correlated beyond 0.98. That a single standard
    deviation is uncertain its interval says.
    """
    named = _correlated if inference.positive else _flat
    return [*named(inference, [hyperparameters[k] for k in inference.free], settings)]


def _weakest(correlation: Array, settings: EstimateSettings) -> Array:
    """Of these correlations the eigenvectors, as rows, of eigenvalues near zero."""
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors.T[values <= settings.weak])


def _correlated(
    inference: Inference, free: Sequence[Hyperparameter], settings: EstimateSettings
) -> Iterator[Diagnostic]:
    if inference.free.size < 2:
        return
    names = [h.name for h in free]
    for vector in _weakest(inference.correlation, settings):
        # the small eigenvalue is well determined; what moves along its large parts is not apart
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
    """An intercept far from all experiments is another matter than what they do not tell."""
    terms = [name for h in which if h.beside for name, _ in h.beside.terms]
    if not terms:
        return REMEDY
    covariate = terms[0].partition("[")[2].removesuffix("]")
    return (
        f"write center({covariate}) for {covariate} in the formula: the other coefficient is then "
        "the value at the mean of the covariate, not at zero; nothing else changes"
    )


def _flat(
    inference: Inference, free: Sequence[Hyperparameter], settings: EstimateSettings
) -> Iterator[Diagnostic]:
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
    for vector in vectors.T[np.abs(values) < settings.weak]:
        parts = _large(vector, settings)
        which = [known[i] for i in parts]
        yield _weak(
            f"{', '.join(which)} can change together without effect, along "
            f"{_combination(vector, parts, known)} (se: standard error of each by itself)",
            *which,
        )


def _weak(message: str, *names: str, remedy: str = REMEDY) -> Diagnostic:
    return Diagnostic("identifiability", message, remedy, names)


def _large(vector: Array, settings: EstimateSettings) -> list[int]:
    return [int(i) for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > settings.part]


def _combination(vector: Array, parts: Sequence[int], names: Sequence[str]) -> str:
    return " ".join(
        f"{'+' if vector[i] >= 0 else '-'} {abs(vector[i]):.2f} {names[i]}/se" for i in parts
    )


def centering_advice(
    slope: Array,
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    conditions: pd.DataFrame,
    settings: EstimateSettings = ESTIMATES,
) -> list[Diagnostic]:
    """Advice for pairs of parameters of which one acts as the other times a condition.

    By slopes (M, n) of M simulated values by the parameters; a row of conditions for each.

    In y = a + b T with T far from zero, a and b take each other's place; in a' + b (T - T0) with
    T0 in the middle they do not. None where laws follow covariates: their values are not in alpha.
    """
    if inputs.regressed:
        return []
    far = {
        str(name): column.to_numpy()
        for name, column in conditions.items()
        if pd.api.types.is_float_dtype(column) and _far(column.to_numpy(), settings)
    }
    found = []
    for i, j in _close(inputs, hyperparameters, inference, settings):
        for a, b in ((i, j), (j, i)):
            for name, values in far.items():
                if _times(slope[:, b], slope[:, a], values, settings):
                    found.append(_advice(inputs.names[a], inputs.names[b], name, values))
    return found


def _far(values: Array, settings: EstimateSettings) -> bool:
    spread = float(values.std())
    return bool(
        np.all(np.isfinite(values)) and 0.0 < settings.distance * spread < abs(values.mean())
    )


def _times(effect: Array, other: Array, condition: Array, settings: EstimateSettings) -> bool:
    """Whether one effect is the other times the condition and a constant, over all experiments."""
    wanted = other * condition
    size = float(wanted @ wanted)
    if size == 0.0:
        return False
    off = effect - (effect @ wanted) / size * wanted
    # as close as to the other alone would be no sign of the condition
    spread = float(condition.std() / abs(condition.mean()))
    closeness = min(settings.proportional, settings.spread * spread)
    return bool(np.linalg.norm(off) < closeness * np.linalg.norm(effect))


def _close(
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    settings: EstimateSettings,
) -> Iterator[tuple[int, int]]:
    """Pairs of parameters whose means or values are free, and hardly told apart."""
    where = {
        int(k): i
        for i, part in enumerate(inputs.slices)
        for k in inference.free
        if part.start <= k < part.stop and not hyperparameters[k].log
    }
    rows = [row for row, k in enumerate(inference.free) if int(k) in where]
    for p, q in combinations(rows, 2):
        i, j = where[int(inference.free[p])], where[int(inference.free[q])]
        if not inference.positive or abs(inference.correlation[p, q]) > settings.correlation:
            yield i, j


def _advice(a: str, b: str, name: str, values: Array) -> Diagnostic:
    low, high = values.min(), values.max()
    middle = float(f"{0.5 * (low + high):.3g}")
    return Diagnostic(
        "identifiability",
        f"{b} acts as {a} times {name} does, and {name} ({low:.6g} to {high:.6g}) lies far from "
        f"zero, so that the experiments hardly tell {a} from {b}",
        f"count {name} from its middle: write ({name} - {middle:.6g}) for {name} in the simulator, "
        f"and set the limits of {a} anew, which then belongs to {name} = {middle:.6g}",
        (a, b, name),
    )
