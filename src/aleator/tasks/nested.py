"""Which of two models is a special case of the other, and where in the other it lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.inference.fit import Fit
from aleator.inference.information import BOUND
from aleator.laws import Hyperparameter, Law, Mixture
from aleator.laws.hyperparameter import limits_of
from aleator.types import Array

AGREE = 0.02
"""An experiment's log-density of one law may differ by that, by the surfaces of two models."""


@dataclass(frozen=True, eq=False)
class Embedding:
    """The hyperparameters (K,) of a larger model at which it is the smaller one.

    `source` (K,) is the one of the smaller model that each takes its value from, or -1 where it
    has the value in `value` (K,). `df` are free in the larger model only, and of these
    `on_boundary` lie on a limit.
    """

    source: Array
    value: Array
    df: int
    on_boundary: int

    def of(self, alpha: Array) -> Array:
        """The larger model's alpha at the smaller one's."""
        return np.where(self.source >= 0, alpha[self.source], self.value)


def embedded(smaller: Fit, larger: Fit) -> Embedding | None:
    """Where the larger model is the smaller one; None where it is not known to be.

    The hyperparameters are matched by their names: a number in place of a free one, a constant in
    place of a law whose scale may end at zero, no correlation, a formula with fewer terms. Laws
    must be of one family, and every experiment must have the same log-likelihood there: other
    simulators and other codings of covariates are found out by that. Cost: an evaluation.
    """
    if not _same_families(smaller.inputs.laws, larger.inputs.laws):
        return None
    found = matched(smaller.hyperparameters, larger.hyperparameters)
    if found is None or found.df < 1:
        return None
    alpha = found.of(smaller.alpha)
    lower, upper = limits_of(larger.hyperparameters)
    if np.any((alpha < lower) | (alpha > upper)):
        return None
    gaps = larger.at(alpha).scored().each - smaller.scored().each
    return found if np.all(np.abs(gaps) <= AGREE) else None


def _same_families(smaller: Mapping[str, Law], larger: Mapping[str, Law]) -> bool:
    """Whether each law has the family that it has in the other model, or is a constant."""
    return smaller.keys() == larger.keys() and all(
        not law.scatters or _family(law) == _family(larger[name]) for name, law in smaller.items()
    )


def _family(law: Law) -> object:
    """What two laws share that differ in their hyperparameters only."""
    if isinstance(law, Mixture):
        return [_family(component) for component in law.components]
    own = {h.name for h in law.hyperparameters}
    stated = [name for name in getattr(law, "__dataclass_fields__", ()) if name not in own]
    return type(law), [_frozen(getattr(law, name)) for name in stated]


def _frozen(value: object) -> object:
    """A distribution of SciPy by its name and arguments; all else as it is."""
    family = getattr(value, "dist", None)
    return value if family is None else (family.name, value.args, value.kwds)  # type: ignore[attr-defined]


def matched(
    smaller: Sequence[Hyperparameter], larger: Sequence[Hyperparameter]
) -> Embedding | None:
    """The same by the names alone.

    >>> from aleator.laws import Constant, Free, Inputs, Normal
    >>> one = Inputs({"x": Constant(Free(0.0, 1.0))}).hyperparameters
    >>> two = Inputs({"x": Normal(Free(0.0, 1.0), Free(0.0, 1.0))}).hyperparameters
    >>> found = matched(one, two)
    >>> found.of(np.array([0.3])).tolist(), found.df, found.on_boundary
    ([0.3, 1e-06], 1, 1)
    >>> matched(two, one) is None
    True
    """
    known = {h.name: j for j, h in enumerate(smaller)}
    sources, values, on_boundary = list[int](), list[float](), 0
    for h in larger:
        j = next((known[name] for name in _aliases(h.name) if name in known), -1)
        value = _absent(h, known) if j < 0 else smaller[j].start
        if value is None or not _reaches(h, None if j < 0 else smaller[j]):
            return None
        added = h.free and (j < 0 or not smaller[j].free)
        on_boundary += added and _on_limit(h, value)
        sources.append(j)
        values.append(value)
    if set(range(len(smaller))) - set(sources):
        return None
    df = sum(h.free for h in larger) - sum(h.free for h in smaller)
    return Embedding(np.array(sources, dtype=np.intp), np.array(values), df, on_boundary)


def _aliases(name: str) -> list[str]:
    """What it is called where the parameter is a constant, and where it follows no covariate."""
    bare = name.removesuffix("[Intercept]")
    return [
        *dict.fromkeys(
            form.replace(".mean", old, 1) for form in (name, bare) for old in (".mean", ".value")
        )
    ]


def _reaches(h: Hyperparameter, source: Hyperparameter | None) -> bool:
    """Whether it can have the values of its source: a fixed one has one only."""
    return source is None or h.free or (not source.free and source.start == h.start)


def _absent(h: Hyperparameter, known: Mapping[str, int]) -> float | None:
    """The value at which it does nothing, or None where that is not known."""
    parameter = h.name.partition(".")[0]
    constant = any(name.startswith(f"{parameter}.value") for name in known)
    further = parameter == "noise" and any(name.startswith("noise.") for name in known)
    if h.log and (constant or further):
        return h.lower
    term = h.name.endswith("]") and any(name.startswith(f"{parameter}.") for name in known)
    if parameter == "correlation" or (term and not h.log):
        return 0.0 if h.lower <= 0.0 <= h.upper else None
    return None


def _on_limit(h: Hyperparameter, value: float) -> bool:
    margin = BOUND * (h.upper - h.lower)
    return value <= h.lower + margin or value >= h.upper - margin
