"""The comparison of several models of the same experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from string import ascii_uppercase
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array
from aleator.errors import ExperimentsError, InputsError, count, nearest
from aleator.inference.fit import Fit, names_of, refitted
from aleator.inference.information import infer
from aleator.inference.model_choice import (
    Criteria,
    LeaveOneOut,
    LikelihoodRatio,
    leave_one_out,
    summed_error,
)
from aleator.laws.hyperparameter import has_prior
from aleator.laws.levels import connected
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Transform
from aleator.results import printed
from aleator.search.interface import OPTIMA
from aleator.simulators.derived import defaults_left
from aleator.tasks.arguments import require_kind
from aleator.tasks.ceiling import gap_of
from aleator.tasks.identification import Identification
from aleator.tasks.nesting import Defaults, Embedding, embedded
from aleator.tasks.session import Session
from aleator.views.models import BELOW_CEILING, unreferenced, without_ratio


@dataclass(frozen=True)
class ComparisonSettings:
    """Settings that decide whether two models have equal data; chosen by judgement."""

    same: float = 1e-9
    """The relative difference up to which two measured values are equal."""


COMPARISON = ComparisonSettings()

REMEDY = "compare models of the same table, with the same outcome, bounds and ids"


def require_same_data(fits: Mapping[str, Fit], settings: ComparisonSettings = COMPARISON) -> None:
    """Raise ExperimentsError that names the first difference between the data of two models.

    Ids, transforms, the number of observations, measured values and bounds must be the same, in
    the same order; conditions and the names of responses need not.
    """
    for (one, fit), (other, next_fit) in pairwise(fits.items()):
        fault = _difference(one, fit.table, other, next_fit.table, settings)
        if fault:
            raise ExperimentsError(*fault)


def _difference(
    one: str, a: Experiments, other: str, b: Experiments, settings: ComparisonSettings
) -> tuple[str, str] | None:
    """The first difference between the data of two models, with its remedy."""
    for name, ids, stranger, others in ((one, a.ids, other, b.ids), (other, b.ids, one, a.ids)):
        if lacking := sorted(set(ids) - set(others)):
            found = f"the experiment '{lacking[0]}', which '{stranger}' has not"
            return f"model '{name}' has {found}", REMEDY
    if a.ids != b.ids:
        order = f"models '{one}' and '{other}' have their experiments in another order"
        return order, "sort the rows of the two tables alike"
    seen, met = a.observations, b.observations
    if len(seen.responses) != len(met.responses):
        counts = f"{len(seen.responses)} responses and '{other}' has {len(met.responses)}"
        return f"model '{one}' has {counts}", REMEDY
    for k, (first, second) in enumerate(zip(seen.responses, met.responses, strict=True)):
        if first.transform != second.transform:
            logged = seen if first.transform is Transform.LOG else met
            jacobian = logged.lower[(logged.response == k) & (logged.lower == logged.upper)].sum()
            return (
                f"'{first.name}' has transform {first.transform} in model '{one}' and "
                f"{second.transform} in '{other}': the likelihood is a density of y in one and of "
                f"log y in the other, {jacobian:.6g} apart by the Jacobian alone",
                "give both models the same transform",
            )
    here, there = (np.bincount(s.experiment, minlength=len(a.ids)) for s in (seen, met))
    for l in np.flatnonzero(here != there)[:1]:
        counts = f"{here[l]} observations in model '{one}' and {there[l]} in model '{other}'"
        return f"experiment '{a.ids[l]}' has {counts}", REMEDY
    for end in ("lower", "upper"):
        u, v = getattr(seen, end), getattr(met, end)
        for k in np.flatnonzero(~np.isclose(u, v, rtol=settings.same, atol=0.0))[:1]:
            name = seen.names[seen.response[k]]
            return (
                f"experiment '{a.ids[seen.experiment[k]]}', '{name}': the {end} end is {u[k]:g} "
                f"in model '{one}' and {v[k]:g} in model '{other}'",
                REMEDY,
            )
    return None


RATIO = ("smaller", "larger", "ratio", "df", "reference", "p", "bootstrap_p", "replicates")
"""The columns of the table of likelihood ratios."""


@dataclass(frozen=True, eq=False)
class Competitor:
    """One of the models compared: its verdicts, information criteria, and predictions.

    `sound` and `consistent` are the verdicts of its identification. `left_out` has the predictive
    log-density of each experiment. `below_ceiling` is how much its log-likelihood is below that of
    the best possible law; where there is none it is NaN, and `no_ceiling` says why. `raised_from`
    is the smaller model from whose estimate a higher maximum was found than that of the
    identification, or empty.
    """

    name: str
    sound: bool
    consistent: bool | None
    criteria: Criteria
    left_out: LeaveOneOut
    below_ceiling: float
    no_ceiling: str = ""
    raised_from: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """The models of N experiments `ids`, the best prediction first, and their likelihood ratios.

    Experiments that share parameters in a model are left out together, and count as one. `without`
    has the pairs of models that have no likelihood ratio, each with the reason.
    """

    ids: tuple[str, ...]
    models: tuple[Competitor, ...]
    ratios: tuple[LikelihoodRatio, ...]
    without: tuple[tuple[str, str, str], ...] = ()

    def __repr__(self) -> str:
        return "\n\n".join([
            self._known().to_string(), *self._about_ceiling(), self.nested().to_string(),
            *map(str, [*unreferenced(self.to_dict()["nested"]), *without_ratio(self.to_dict())]),
        ])  # fmt: skip

    def _known(self) -> pd.DataFrame:
        """The table without `below_ceiling` where that is known of no model."""
        known = [model for model in self.models if np.isfinite(model.below_ceiling)]
        return self.table() if known else self.table().drop(columns="below_ceiling")

    def _about_ceiling(self) -> list[str]:
        """What `below_ceiling` is, or why it is not known, one sentence for each reason."""
        known = "below_ceiling" in self._known()
        reasons = dict.fromkeys(model.no_ceiling for model in self.models if model.no_ceiling)
        return [f"below_ceiling: {BELOW_CEILING}."] * known + [
            "below_ceiling is not known for "
            f"{printed.listed([m.name for m in self.models if m.no_ceiling == why])}: {why}."
            for why in reasons
        ]

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        best = f"{self.models[0].name} predicts best." if len(self.models) > 1 else ""
        head = f"{count(len(self.models), 'model')} of {count(len(self.ids), 'experiment')}"
        return printed.shown(head, self._known(), *self._about_ceiling(), best)

    def table(self) -> pd.DataFrame:
        """A table with a row for each model, by its name.

        The columns are `sound`, `consistent`, `log_likelihood`, `below_ceiling`, the number of
        `free` hyperparameters, `aic`, `aicc`, `bic`, `elpd` (the predictive log-likelihood of
        experiments left out) with `elpd_error`, its `difference` to the best model with
        `difference_error`, and `refits`, the number of experiments whose omission needed a new
        maximization.
        """
        best = self.models[0].left_out.each
        rows = [
            {
                "sound": model.sound,
                "consistent": model.consistent,
                "log_likelihood": model.criteria.log_likelihood,
                "below_ceiling": model.below_ceiling,
                "free": model.criteria.free,
                "aic": model.criteria.aic,
                "aicc": model.criteria.aicc,
                "bic": model.criteria.bic,
                "elpd": model.left_out.total,
                "elpd_error": model.left_out.error,
                "difference": float(np.sum(model.left_out.each - best)),
                "difference_error": summed_error(model.left_out.each - best) if place else 0.0,
                "refits": int(np.sum(model.left_out.refitted)),
            }
            for place, model in enumerate(self.models)
        ]
        return pd.DataFrame(rows, index=pd.Index([m.name for m in self.models], name="model"))

    def experiments(self) -> pd.DataFrame:
        """The predictive log-density of each left-out experiment (N rows), a column per model."""
        columns = {model.name: model.left_out.each for model in self.models}
        return pd.DataFrame(columns, index=pd.Index(self.ids, name="id"))

    def nested(self) -> pd.DataFrame:
        """A table with a row for each likelihood ratio of nested models.

        The columns are the names `smaller` and `larger`, the statistic `ratio`, its degrees of
        freedom `df`, the `reference` distribution with its p value `p`, and the p value
        `bootstrap_p` from a number of `replicates`. Missing p values are NaN.
        """
        rows = [
            {
                "smaller": ratio.smaller, "larger": ratio.larger, "ratio": ratio.statistic,
                "df": ratio.df, "reference": ratio.reference, "p": ratio.p,
                "bootstrap_p": ratio.bootstrap_p,
                "replicates": int(np.sum(np.isfinite(ratio.bootstrap))),
            }
            for ratio in self.ratios
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=[*RATIO])

    def to_dict(self) -> dict[str, Any]:
        """The content of compare.json as plain dictionaries, lists, numbers and texts."""
        details = {
            model.name: {
                "of_law": model.criteria.of_law,
                "of_rest": model.criteria.of_rest,
                "observations": model.criteria.observations,
                "not_arrived": int(np.sum(~model.left_out.arrived)),
                "no_ceiling": model.no_ceiling,
                "raised_from": model.raised_from,
            }
            for model in self.models
        }
        return {
            "experiments": len(self.ids),
            "models": [
                {"name": name, **row, **details[str(name)]}
                for name, row in self.table().to_dict("index").items()
            ],
            "nested": self.nested().to_dict("records"),
            "without_ratio": [
                {"models": [one, other], "reason": reason} for one, other, reason in self.without
            ],
            "left_out": self.experiments().rename_axis("id").reset_index().to_dict("records"),
        }


def compare(
    *found: Identification,
    nested: Sequence[tuple[str, str]] = (),
    bootstrap: int = 0,
    ceilings: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
    **named: Identification,
) -> Comparison:
    """Compare models of the same data by criteria, likelihood ratios and predictions; no runs.

    Models passed by keyword have that name, the others are A, B, and so on. AIC, AICc and BIC come
    from the maximum of the likelihood. The predictive log-likelihood comes from leaving out each
    experiment in turn (`aleator.inference.model_choice`). A likelihood ratio is computed where one
    model is recognized as a special case of another, and for the pairs (smaller, larger) in
    `nested`. `bootstrap` is the number of data sets drawn under the smaller model of each pair, for
    a second p value; `seed` is their seed. With `ceilings` the best possible law of each model is
    computed (see `aleator.ceiling`), if there is one. For models with priors the maximum is that
    of the posterior density, and a ratio has a p value from drawn data only.

    Raises InputsError for fewer than two models, unknown names, and a pair whose larger model has
    no more free hyperparameters. Raises ExperimentsError if the data or their transforms differ,
    and AleatorError for an identification that was read from a file without the parts that its
    likelihood needs (see `Identification.with_fit`). Cost: some ten evaluations of
    each likelihood, a maximization for each influential experiment, and two or three maximizations
    for each drawn data set. `progress=aleator.ProgressLine()` prints how far the work is.

    >>> import pandas as pd
    >>> from aleator import Constant, Experiments, Free, Inputs, Noise, Normal, identify
    >>> y = [1.1, 1.2, 1.9, 2.1, 1.4, 1.5, 2.8, 2.7]
    >>> frame = pd.DataFrame({"id": list("aabbccdd"), "y": y})
    >>> table = Experiments.from_frame(frame, outcome="y")
    >>> alike, scattered = (
    ...     identify(lambda x: x, table, Inputs({"x": law}), noise=Noise(Free(0.01, 2.0)))
    ...     for law in (Constant(Free(0.0, 4.0)), Normal(Free(0.0, 4.0), Free(0.0, 2.0))))
    >>> found = compare(alike=alike, scattered=scattered)
    >>> found.table()[["log_likelihood", "free", "aic"]].round(2).to_dict("index")["scattered"]
    {'log_likelihood': -1.27, 'free': 3, 'aic': 8.55}
    >>> found.nested()[["smaller", "larger", "df", "reference"]].to_dict("records")
    [{'smaller': 'alike', 'larger': 'scattered', 'df': 1, 'reference': '1/2 chi2(0) + 1/2 chi2(1)'}]
    """
    models, told = {**_lettered(found, named), **named}, progress or Silent()
    _check(models, nested, bootstrap)
    models = {name: model.with_fit(told) for name, model in models.items()}
    fits = {name: model.fit for name, model in models.items()}
    verdicts = {name: (model.sound, model.consistent) for name, model in models.items()}
    defaults = {name: _defaults(model.session) for name, model in models.items()}
    return compared(fits, verdicts, nested, bootstrap, ceilings, seed, told, defaults)


def _defaults(session: Session) -> Defaults:
    """The arguments of the simulator that keep a number as their default, by name."""
    if session.runner is None or session.experiments is None:
        return {}
    runner = session.runner(session.experiments)
    return defaults_left(runner.simulator, (*runner.parameters, *runner.used_conditions))


def compared(
    fits: Mapping[str, Fit],
    verdicts: Mapping[str, tuple[bool, bool | None]],
    nested: Sequence[tuple[str, str]],
    bootstrap: int,
    ceilings: bool,
    seed: int,
    progress: Progress,
    defaults: Mapping[str, Defaults] = MappingProxyType({}),
    settings: ComparisonSettings = COMPARISON,
) -> Comparison:
    """The comparison of fits; `verdicts` has (sound, consistent) for each name.

    `defaults` has the arguments that each simulator leaves at a number, for models that have some.
    """
    require_same_data(fits, settings=settings)
    pairs, without = _pairs(fits, nested, defaults)
    fits, raised = _raised(fits, pairs)
    competitors, group = [], connected(np.array([fit.cluster for fit in fits.values()]))
    if group.size > 1 and not np.any(group):
        raise InputsError(
            "all experiments share parameters, directly or through others, and none can be left "
            "out of a model and predicted",
            "compare the log-likelihoods and the numbers of hyperparameters in the reports",
        )
    for name, fit in fits.items():
        progress.stage(f"{name}: leave one out")
        left_out = leave_one_out(fit, progress, group)
        gap, reason = float("nan"), ""
        if ceilings:
            progress.stage("best possible law")
            try:
                gap = gap_of(fit, seed)
            except InputsError as error:
                reason = error.problem
        own = Criteria.of(fit)
        start = raised.get(name, "")
        competitors.append(Competitor(name, *verdicts[name], own, left_out, gap, reason, start))
    ratios = []
    for (small, large), found_in in pairs.items():
        progress.stage(f"{small} in {large}: likelihood ratio")
        ratios.append(_ratio(fits, small, large, found_in, bootstrap, seed, progress))
    competitors.sort(key=lambda model: -np.nan_to_num(model.left_out.total, nan=-np.inf))
    ids = names_of(group, next(iter(fits.values())).table.ids)
    return Comparison(ids, tuple(competitors), tuple(ratios), tuple(without))


def _lettered(
    found: Sequence[Identification], named: Mapping[str, Identification]
) -> dict[str, Identification]:
    letters = [letter for letter in ascii_uppercase if letter not in named]
    return dict(zip(letters, found, strict=False))


def require_plain(name: str, *, restricted: bool) -> None:
    """Raise InputsError for a model whose restricted likelihood is maximized."""
    if restricted:
        raise InputsError(
            f"compare: model '{name}' has the maximum of the restricted likelihood, which is that "
            "of other data in a model with other means or constants",
            "identify it without `restricted`",
        )


def _check(
    models: Mapping[str, Identification], nested: Sequence[tuple[str, str]], bootstrap: int
) -> None:
    if len(models) < 2:
        raise InputsError(f"compare: {len(models)} models", "give two or more")
    if bootstrap < 0:
        raise InputsError(f"compare: {bootstrap} data sets", "choose 0 or more; 200 tell a lot")
    for name, model in models.items():
        require_kind(model, Identification, name, "identify(...), or load(...)")
        require_plain(name, restricted=model.log_likelihood.restricted is not None)
    for pair in nested:
        for name in pair:
            if name not in models:
                raise InputsError(
                    f"nested: there is no model '{name}'{nearest(name, models)}",
                    f"the models are {', '.join(models)}",
                )


def _pairs(
    fits: Mapping[str, Fit],
    nested: Sequence[tuple[str, str]],
    defaults: Mapping[str, Defaults],
) -> tuple[dict[tuple[str, str], Embedding | None], list[tuple[str, str, str]]]:
    """The nested pairs (smaller, larger), with the embedding if one is known, else None.

    Then the pairs that are not nested, with the reason.
    """
    found: dict[tuple[str, str], Embedding | None] = {}
    without = []
    for pair in combinations(fits, 2):
        small, large = sorted(pair, key=lambda name: fits[name].inference.identified.size)
        left = (defaults.get(small, {}), defaults.get(large, {}))
        place = embedded(fits[small], fits[large], left)
        if isinstance(place, Embedding):
            found[small, large] = place
        elif not {(small, large), (large, small)} & {*nested}:
            without.append((small, large, place))
    for small, large in nested:
        found.setdefault((small, large), None)
        free = [fits[name].inference.identified.size for name in (small, large)]
        if free[1] <= free[0]:
            raise InputsError(
                f"nested: '{large}' has {free[1]} free hyperparameters, '{small}' has {free[0]}",
                "name the smaller model first",
            )
    return found, without


def _raised(
    fits: Mapping[str, Fit], pairs: Mapping[tuple[str, str], Embedding | None]
) -> tuple[dict[str, Fit], dict[str, str]]:
    """The fits, each at a maximum no lower than at the estimates of models that it contains.

    Where a model is more likely at the estimate of a smaller one than at its own, its search has
    missed the maximum, and it is maximized from there. Then the smaller model of each such model.
    """
    found, raised = dict(fits), dict[str, str]()
    for small, large in sorted(pairs, key=lambda pair: fits[pair[1]].inference.identified.size):
        place = pairs[small, large]
        if place is None:
            continue
        start = found[large].at(place.of(found[small].alpha))
        if start.scored().total > found[large].scored().total + OPTIMA.same_value:
            fit = refitted(start).fit
            inference = infer(fit.objective(), fit.alpha, fit.hyperparameters)
            found[large], raised[large] = replace(fit, inference=inference), small
    return found, raised


def _ratio(
    fits: Mapping[str, Fit],
    small: str,
    large: str,
    place: Embedding | None,
    bootstrap: int,
    seed: int,
    progress: Progress,
) -> LikelihoodRatio:
    smaller, larger = fits[small], fits[large]
    drawn = np.full(bootstrap, np.nan)
    for r in range(bootstrap):
        progress.update(f"{r} of {bootstrap} data sets", r, bootstrap)
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(r,)))
        drawn[r] = _drawn_ratio(smaller, larger, place, rng)
    statistic = 2.0 * (larger.scored().likelihood - smaller.scored().likelihood)
    df = larger.inference.identified.size - smaller.inference.identified.size
    boundary = 0 if place is None else place.on_boundary
    regular = (
        place is not None
        and place.regular
        and not any(map(has_prior, (smaller.hyperparameters, larger.hyperparameters)))
    )
    return LikelihoodRatio(small, large, statistic, df, boundary, regular, drawn)


def _drawn_ratio(
    smaller: Fit, larger: Fit, place: Embedding | None, rng: np.random.Generator
) -> float:
    """The likelihood ratio of a data set drawn under the smaller model.

    NaN if a maximization did not converge.
    """
    drawn = smaller.drawn(rng)
    one = refitted(drawn)
    starts: list[Array] = [larger.alpha]
    if place is not None:
        starts.append(place.of(one.fit.alpha))
    ends = [refitted(larger.at(start).seeing(drawn.table)) for start in starts]
    two = max(ends, key=lambda end: end.value)
    if not (one.arrived and two.arrived):
        return float("nan")
    return 2.0 * (two.fit.scored().likelihood - one.fit.scored().likelihood)
