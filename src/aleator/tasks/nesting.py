"""Models that contain one another: at which hyperparameters a larger one equals a smaller one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, permutations

import numpy as np

from aleator.core.types import Array
from aleator.inference.fit import Fit
from aleator.inference.information import side_of
from aleator.laws import Constant, Hyperparameter, Law, Mixture
from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs
from aleator.laws.levels import connected


@dataclass(frozen=True)
class NestingSettings:
    """Settings that decide whether two models have the same law; chosen by judgement."""

    agree: float = 0.02
    """The difference of an experiment's log-density up to which two models have the same law there;
    it allows for the errors of their response surfaces."""
    spanned: float = 1e-6
    """A column of a design matrix lies in the column space of another if what that does not explain
    is smaller than this, relative to the column."""
    renamings: int = 24
    """The most ways to take parameters of the smaller model for those of the larger model with
    other names; each costs an evaluation of the likelihood."""


NESTING = NestingSettings()

SD_OF_PROCESS, LENGTH = ".process_sd", ".length"
"""The ends of the names of the sd of a `GaussianProcess` of errors and of its length, which has no
effect where the sd is zero."""


@dataclass(frozen=True, eq=False)
class Embedding:
    """A rule for the K hyperparameters of a larger model at which it equals a smaller one.

    They are `value` (K,) + `matrix` (K, k) alpha for the k hyperparameters alpha of the smaller
    model. `df` is the number of hyperparameters that are free in the larger model only;
    `on_boundary` of these are then on a limit. `regular` is False where one of them has no effect
    in the smaller model: then no chi-squared law is known for the ratio (Davies, 1987).
    """

    matrix: Array
    value: Array
    df: int
    on_boundary: int
    regular: bool = True

    def of(self, alpha: Array) -> Array:
        """The alpha (K,) of the larger model that equals the smaller model at its `alpha`."""
        return np.asarray(self.value + self.matrix @ alpha)

    def without(self, last: Sequence[float], rows: int) -> Embedding:
        """The embedding without the last hyperparameters of both models.

        Those of the smaller model have the values `last`; the larger one has this number of `rows`.
        """
        kept, own = len(self.value) - rows, self.matrix.shape[1] - len(last)
        value = self.value + self.matrix[:, own:] @ np.array(last)
        return replace(self, matrix=self.matrix[:kept, :own], value=value[:kept])


Defaults = Mapping[str, float]
"""The arguments of a simulator that keep a number as their default, by name."""


def embedded(
    smaller: Fit,
    larger: Fit,
    defaults: tuple[Defaults, Defaults] = ({}, {}),
    settings: NestingSettings = NESTING,
) -> Embedding | str:
    """The embedding of a smaller model in a larger one; if none is known, the reason in words.

    The hyperparameters are matched by their names. The smaller model may have a number in place of
    a free hyperparameter, a constant in place of a law whose scale may be zero, no correlation of
    parameters or errors, or a formula whose columns are linear combinations of those of the larger
    model, however it is written. It may lack a parameter whose scale may be zero, such as the shift
    of a group. A parameter that has another name in the larger model is tried as each of those of
    its family there. A parameter that one model leaves at the default of its simulator is a
    constant of this number: `defaults` has those of the smaller and of the larger model. Laws must
    be of the same family. Every experiment must have the same log-likelihood in both models, or all
    together that share parameters, so that different simulators are not taken as nested. Cost: an
    evaluation of the likelihood, or one for each way to rename parameters.
    """
    if _free(larger) <= _free(smaller):
        return "they have equally many free hyperparameters"
    reason = "laws of other families, or other parameters scatter"
    own, others = smaller.inputs.laws, larger.inputs.laws
    here, there = _left(defaults[0], own, others), _left(defaults[1], others, own)
    for names in islice(_renamings({**own, **here}, {**others, **there}), settings.renamings):
        found = _embedded(smaller, larger, names, (here, there), settings)
        if isinstance(found, Embedding):
            return found
        reason = found
    return reason


def _left(
    defaults: Defaults, laws: Mapping[str, Law], others: Mapping[str, Law]
) -> dict[str, Constant]:
    """The constants of a model that its simulator has as defaults and that another model names."""
    return {
        name: Constant(value)
        for name, value in defaults.items()
        if name in others and name not in laws
    }


def _renamings(smaller: Mapping[str, Law], larger: Mapping[str, Law]) -> Iterator[dict[str, str]]:
    """The names in the larger model of the smaller model's parameters with another name there.

    Each parameter of the smaller model that scatters has the same family in the larger model.
    """
    alone = [name for name in smaller if name not in larger]
    for others in permutations([name for name in larger if name not in smaller], len(alone)):
        names = dict(zip(alone, others, strict=True))
        pairs = ((law, larger[names.get(name, name)]) for name, law in smaller.items())
        if all(not law.scatters or _family(law) == _family(other) for law, other in pairs):
            yield names


def _embedded(
    smaller: Fit,
    larger: Fit,
    names: Mapping[str, str],
    left: tuple[Mapping[str, Constant], Mapping[str, Constant]],
    settings: NestingSettings,
) -> Embedding | str:
    """The embedding where parameters of the smaller model have other `names` in the larger one.

    `left` are the constants of the smaller and of the larger model that are defaults.
    """
    spans = _spans(smaller.inputs, larger.inputs, names, settings)
    own = [replace(h, name=_renamed(h.name, names)) for h in smaller.hyperparameters]
    here, there = ([*map(_known, each.items())] for each in left)
    found = matched([*own, *here], [*larger.hyperparameters, *there], spans)
    if isinstance(found, str):
        return found
    found = found.without([h.start for h in here], len(there))
    alpha = found.of(smaller.alpha)
    lower, upper = limits_of(larger.hyperparameters)
    if np.any(beyond := (alpha < lower) | (alpha > upper)):
        h = larger.hyperparameters[int(np.argmax(beyond))]
        return f"the limits of {h.name} in the larger model leave the smaller one out"
    group = connected(np.array([smaller.cluster, larger.cluster]))
    one, other = (fit.scored().summed(group)[0] for fit in (larger.at(alpha), smaller))
    if not np.all(np.abs(one - other) <= settings.agree):
        return "their likelihoods differ where their hyperparameters are equal"
    return found


def _known(constant: tuple[str, Constant]) -> Hyperparameter:
    """The hyperparameter of a constant that is given by its name and law."""
    name, law = constant
    return replace(law.hyperparameters[0], name=f"{name}.value")


def _free(fit: Fit) -> int:
    return sum(h.free for h in fit.hyperparameters)


def _renamed(name: str, names: Mapping[str, str]) -> str:
    """The name of a hyperparameter whose parameter has another name."""
    parameter, dot, rest = name.partition(".")
    return names.get(parameter, parameter) + dot + rest


def _family(law: Law) -> object:
    """A key that two laws have in common if they differ in their hyperparameters only."""
    if isinstance(law, Mixture):
        return [_family(component) for component in law.components]
    own = {h.name for h in law.hyperparameters}
    stated = [name for name in getattr(law, "__dataclass_fields__", ()) if name not in own]
    return type(law), [_frozen(getattr(law, name)) for name in stated]


def _frozen(value: object) -> object:
    """A comparable form of a value: a SciPy distribution by its name and arguments."""
    family = getattr(value, "dist", None)
    return value if family is None else (family.name, value.args, value.kwds)  # type: ignore[attr-defined]


def _spans(
    smaller: Inputs, larger: Inputs, names: Mapping[str, str], settings: NestingSettings
) -> dict[int, Array]:
    """Rows of the matrix of an `Embedding` for coefficients that span those of the smaller model.

    They are by the places of the coefficients of the larger model, which must be free.
    """
    if larger.covariate_model is None:
        return {}
    found: dict[int, Array] = {}
    own = {
        _renamed(name, names): (places, design)
        for name, places, design in _designs(smaller, larger)
    }
    for entry in larger.covariate_model.entries:
        name = entry.hyperparameter.name
        known = next((own[one] for one in _aliases(name) if one in own), None)
        free = all(h.free for h in larger.hyperparameters[entry.places])
        if entry.design is None or known is None or not free:
            continue
        places, columns = known
        by = np.linalg.lstsq(entry.design.matrix, columns)[0]
        missed = np.linalg.norm(entry.design.matrix @ by - columns, axis=0)
        if np.all(missed <= settings.spanned * np.linalg.norm(columns, axis=0)):
            rows = np.zeros((len(by), len(smaller.hyperparameters)))
            rows[:, places] = by
            found |= dict(zip(range(*entry.places.indices(larger.size)), rows, strict=True))
    return found


def _designs(smaller: Inputs, larger: Inputs) -> list[tuple[str, slice, Array]]:
    """The name, places and design matrix of each hyperparameter of the smaller model's laws."""
    assert larger.covariate_model is not None
    ones = np.ones((larger.covariate_model.count, 1))
    if smaller.covariate_model is None:
        every = enumerate(smaller.hyperparameters[: smaller.partials.start])
        return [(h.name, slice(k, k + 1), ones) for k, h in every]
    return [
        (e.hyperparameter.name, e.places, ones if e.design is None else e.design.matrix)
        for e in smaller.covariate_model.entries
    ]


def matched(
    smaller: Sequence[Hyperparameter],
    larger: Sequence[Hyperparameter],
    spans: Mapping[int, Array] | None = None,
) -> Embedding | str:
    """The embedding of a smaller model in a larger one by hyperparameter names, or why none is.

    `spans` has rows of its matrix that are known otherwise, for the first hyperparameters of the
    smaller model. The likelihoods are not compared.

    >>> from aleator.laws import Constant, Free, Inputs, Normal
    >>> one = Inputs({"x": Constant(Free(0.0, 1.0))}).hyperparameters
    >>> two = Inputs({"x": Normal(Free(0.0, 1.0), Free(0.0, 1.0))}).hyperparameters
    >>> found = matched(one, two)
    >>> found.of(np.array([0.3])).tolist(), found.df, found.on_boundary
    ([0.3, 1e-06], 1, 1)
    >>> matched(two, one)
    'x.value is in the larger model only and cannot vanish'
    """
    known, spans = {h.name: j for j, h in enumerate(smaller)}, spans or {}
    matrix, values = np.zeros((len(larger), len(smaller))), np.zeros(len(larger))
    processes = [h.name.removesuffix(SD_OF_PROCESS) for h in larger if SD_OF_PROCESS in h.name]
    processes = [one for one in processes if one + SD_OF_PROCESS not in known]
    on_boundary, regular = 0, True
    for k, h in enumerate(larger):
        if k in spans:
            matrix[k, : spans[k].size] = spans[k]
            continue
        j = next((known[name] for name in _aliases(h.name) if name in known), -1)
        value = _absent(h, known) if j < 0 else smaller[j].start
        if j < 0 and h.name in [one + LENGTH for one in processes]:
            value, regular = h.start, regular and not h.free
        if value is None:
            return f"{h.name} is in the larger model only and cannot vanish"
        if not _reaches(h, None if j < 0 else smaller[j]):
            return f"{h.name} is fixed in the larger model"
        on_boundary += h.free and (j < 0 or not smaller[j].free) and side_of(value, h) is not None
        if j < 0:
            values[k] = value
        else:
            matrix[k, j] = 1.0
    alone = np.flatnonzero(~matrix.any(axis=0))
    if alone.size:
        return f"{smaller[int(alone[0])].name} is in the smaller model only"
    df = sum(h.free for h in larger) - sum(h.free for h in smaller)
    return Embedding(matrix, values, df, on_boundary, regular)


def _aliases(name: str) -> list[str]:
    """The names that a hyperparameter may have in a smaller model.

    There the parameter may be a constant ("value" for "mean"), or not depend on a covariate.
    """
    bare = name.removesuffix("[Intercept]")
    return [
        *dict.fromkeys(
            form.replace(".mean", old, 1) for form in (name, bare) for old in (".mean", ".value")
        )
    ]


def _reaches(h: Hyperparameter, source: Hyperparameter | None) -> bool:
    """Whether a hyperparameter can take the values of `source` in the smaller model."""
    return source is None or h.free or (not source.free and source.start == h.start)


def _ties_errors(h: Hyperparameter) -> bool:
    """Whether it is the correlation rho of errors, which are independent where it is zero."""
    return h.name.startswith("noise.") and h.name.endswith(".rho")


def _absent(h: Hyperparameter, known: Mapping[str, int]) -> float | None:
    """The value at which a hyperparameter that the smaller model lacks has no effect; else None."""
    parameter = h.name.partition(".")[0]
    constant = any(name.startswith(f"{parameter}.value") for name in known)
    further = parameter == "noise" and any(name.startswith("noise.") for name in known)
    if h.log and (constant or further):
        return h.lower
    term = h.name.endswith("]") and any(name.startswith(f"{parameter}.") for name in known)
    if parameter == "correlation" or _ties_errors(h) or (term and not h.log):
        return 0.0 if h.lower <= 0.0 <= h.upper else None
    if parameter == "noise" or any(name.startswith(f"{parameter}.") for name in known):
        return None
    if h.free:
        return h.lower if h.reaches_zero else None
    return h.start  # such as the mean of a shift, which has no scatter then
