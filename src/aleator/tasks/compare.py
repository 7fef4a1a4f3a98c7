"""Several models of the same experiments, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from string import ascii_uppercase
from typing import Any

import numpy as np
import pandas as pd

from aleator.errors import InputsError, nearest
from aleator.inference.criteria import Criteria
from aleator.inference.fit import Fit, refitted
from aleator.inference.leave_one_out import LeaveOneOut, leave_one_out, summed_error
from aleator.inference.likelihood_ratio import LikelihoodRatio
from aleator.laws.prior import has_prior
from aleator.progress import Progress, Silent
from aleator.results import printed
from aleator.tasks.ceiling import gap_of
from aleator.tasks.identification import Identification
from aleator.tasks.nested import Embedding, embedded
from aleator.tasks.same_experiments import require_same_data
from aleator.types import Array

RATIO = ("smaller", "larger", "ratio", "df", "reference", "p", "bootstrap_p", "replicates")
"""The columns of likelihood ratios."""


@dataclass(frozen=True, eq=False)
class Competitor:
    """One model: its two verdicts, its criteria, its predictions.

    `below_ceiling` is how far its log-likelihood is below that of the best of all laws; NaN where
    that is not known.
    """

    name: str
    sound: bool
    consistent: bool | None
    criteria: Criteria
    left_out: LeaveOneOut
    below_ceiling: float


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Models of N experiments `ids`, those that predict best first, and likelihood ratios."""

    ids: tuple[str, ...]
    models: tuple[Competitor, ...]
    ratios: tuple[LikelihoodRatio, ...]

    def __repr__(self) -> str:
        return f"{self.table().to_string()}\n\n{self.nested().to_string()}"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        best = f"{self.models[0].name} predicts best." if len(self.models) > 1 else ""
        head = f"{len(self.models)} models of {len(self.ids)} experiments"
        return printed.shown(head, self.table(), best)

    def table(self) -> pd.DataFrame:
        """A row for each model, by its name.

        Columns `sound`, `consistent`, `log_likelihood`, `below_ceiling`, `free` hyperparameters,
        `aic`, `aicc`, `bic`, `elpd` (the predictive log-likelihood of experiments left out) with
        `elpd_error`, its `difference` to the best with `difference_error`, and `refits`: maxima
        that were climbed to.
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
        """log p of each experiment (N rows) by the maximum of the others, a column a model."""
        columns = {model.name: model.left_out.each for model in self.models}
        return pd.DataFrame(columns, index=pd.Index(self.ids, name="id"))

    def nested(self) -> pd.DataFrame:
        """A row for each likelihood ratio.

        `smaller`, `larger`, `ratio`, `df`, `reference`, its `p`, and `bootstrap_p` of so many
        `replicates`; NaN where there is none.
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
        """The document compare.json as plain dictionaries, lists, numbers and texts."""
        details = {
            model.name: {
                "of_law": model.criteria.of_law,
                "of_rest": model.criteria.of_rest,
                "observations": model.criteria.observations,
                "not_arrived": int(np.sum(~model.left_out.arrived)),
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
    """Hold models of the same data against each other: criteria, ratios, predictions; no runs.

    Models given by keyword have that name, the others are A, B, and so on. AIC, AICc and BIC come
    from the maximum of the likelihood; the predictive log-likelihood from leaving out each
    experiment in turn (`aleator.inference.leave_one_out`). A likelihood ratio is taken where one
    model is found to be a special case of another, and for the pairs (smaller, larger) in `nested`.
    `bootstrap` is the number of data sets drawn under the smaller model of each such pair, by which
    the ratio is judged too; `seed` is theirs. With `ceilings` the best possible law of each model
    is found (see `aleator.ceiling`), where it can be. Of models with priors the maximum is that of
    the posterior density, and ratios have no reference but drawn data.

    Raises InputsError for fewer than two models, names that are unknown, and a pair of which the
    larger model has no more free hyperparameters; ExperimentsError where the data or their
    transforms differ; AleatorError for an identification that was read from a file. Cost: some ten
    evaluations of each likelihood and a climb for each influential experiment; two climbs or three
    for each drawn data set.

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
    told = progress or Silent()
    models = {**_lettered(found, named), **named}
    _check(models, nested, bootstrap)
    fits = {name: model.fit for name, model in models.items()}
    require_same_data(fits)
    competitors = []
    for name, fit in fits.items():
        told.stage(f"{name}: leave one out")
        left_out = leave_one_out(fit, told)
        model = models[name]
        gap = float("nan")
        if ceilings:
            told.stage("best possible law")
            gap = _below_ceiling(fit, seed)
        competitors.append(
            Competitor(name, model.sound, model.consistent, criteria(fit), left_out, gap)
        )
    pairs = _pairs(fits, nested)
    ratios = []
    for (small, large), found_in in pairs.items():
        told.stage(f"{small} in {large}: likelihood ratio")
        ratios.append(_ratio(fits, small, large, found_in, bootstrap, seed, told))
    competitors.sort(key=lambda model: -np.nan_to_num(model.left_out.total, nan=-np.inf))
    ids = next(iter(fits.values())).table.ids
    return Comparison(ids, tuple(competitors), tuple(ratios))


def criteria(fit: Fit) -> Criteria:
    """The maximum of a fit, and which of its free hyperparameters belong to laws that scatter."""
    laws, identified = fit.inputs.laws, fit.inference.identified.tolist()
    of_law = 0
    for k in identified:
        law = laws.get(fit.hyperparameters[k].name.partition(".")[0])
        of_law += k < fit.inputs.size and (law is None or law.scatters)
    return Criteria(
        fit.scored().likelihood, of_law, len(identified) - of_law, fit.count,
        len(fit.table.observations),
    )  # fmt: skip


def _below_ceiling(fit: Fit, seed: int) -> float:
    """NaN without noise, with laws that follow covariates, and where nothing scatters."""
    try:
        return gap_of(fit, seed)
    except InputsError:
        return float("nan")


def _lettered(
    found: Sequence[Identification], named: Mapping[str, Identification]
) -> dict[str, Identification]:
    letters = [letter for letter in ascii_uppercase if letter not in named]
    return dict(zip(letters, found, strict=False))


def _check(
    models: Mapping[str, Identification], nested: Sequence[tuple[str, str]], bootstrap: int
) -> None:
    if len(models) < 2:
        raise InputsError(f"compare: {len(models)} models", "give two or more")
    if bootstrap < 0:
        raise InputsError(f"compare: {bootstrap} data sets", "choose 0 or more; 200 tell a lot")
    for pair in nested:
        for name in pair:
            if name not in models:
                raise InputsError(
                    f"nested: there is no model '{name}'{nearest(name, models)}",
                    f"the models are {', '.join(models)}",
                )


def _pairs(
    fits: Mapping[str, Fit], nested: Sequence[tuple[str, str]]
) -> dict[tuple[str, str], Embedding | None]:
    """The pairs (smaller, larger), and where the smaller lies in the larger if that is known."""
    found: dict[tuple[str, str], Embedding | None] = {}
    for small, large in permutations(fits, 2):
        place = embedded(fits[small], fits[large])
        if place is not None or (small, large) in nested:
            found[small, large] = place
    for small, large in nested:
        free = [fits[name].inference.identified.size for name in (small, large)]
        if free[1] <= free[0]:
            raise InputsError(
                f"nested: '{large}' has {free[1]} free hyperparameters, '{small}' has {free[0]}",
                "name the smaller model first",
            )
    return found


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
    regular = place is not None and not any(
        map(has_prior, (smaller.hyperparameters, larger.hyperparameters))
    )
    return LikelihoodRatio(small, large, statistic, df, boundary, regular, drawn)


def _drawn_ratio(
    smaller: Fit, larger: Fit, place: Embedding | None, rng: np.random.Generator
) -> float:
    """The ratio of a data set drawn under the smaller model; NaN where a climb did not arrive."""
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
