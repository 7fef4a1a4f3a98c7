"""Experimental design: the candidates with most information on a hyperparameter or prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Indices
from aleator.errors import InputsError, nearest
from aleator.inference.alpha_draws import END
from aleator.inference.design import (
    ChosenSet,
    DesignPlan,
    chosen,
    halved,
    possible_laws,
    repetitions,
)
from aleator.inference.fit import Fit
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.virtual_scores import Scores, expected_scores, quantile_gradients
from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import limits_of
from aleator.observations.experiments import Conditions, unmeasured
from aleator.results import documents, printed
from aleator.results.values import Estimate
from aleator.search.newton import ascend, positive
from aleator.simulators import Runner
from aleator.tasks.arguments import require_kind
from aleator.tasks.identification import Identification
from aleator.tasks.new_experiments import PredictionContext
from aleator.tasks.prediction import compared
from aleator.tasks.probability_gradient import EventGradient, event_gradient
from aleator.views.planning import next_experiments as next_report

ALL = "all"
"""The name that stands for all hyperparameters together."""


@dataclass(frozen=True)
class StepSettings:
    """Settings of the steps of alpha by which the gradient of a probability is computed.

    A step is the `share` of what the experiments leave open of a hyperparameter when all others are
    known, and `most` is the largest share of its range. Both are chosen by judgement.
    """

    share: float = 0.003
    most: float = 1e-3


STEP = StepSettings()


@dataclass(frozen=True, eq=False)
class Predicted:
    """A predicted quantity: a quantile of a measurement, or the probability of an event.

    The measurement is made under the `conditions`. Give one of `quantile` (a probability) and
    `event`, such as "travel > 26" (see `Identification.probability`). With `noise` False it is the
    event of the true value, without the error of its measurement. Raises InputsError for none or
    both of quantile and event, for a quantile without noise, and for a probability outside (0, 1).

    >>> Predicted(pd.DataFrame({"load": [3.0]}), quantile=0.99).name
    'the quantile 0.99'
    """

    conditions: Conditions | pd.DataFrame
    quantile: float | None = None
    event: str | None = None
    noise: bool = True

    def __post_init__(self) -> None:
        if (self.quantile is None) == (self.event is None):
            given = "neither a quantile nor an" if self.event is None else "a quantile and an"
            raise InputsError(
                f"a prediction has {given} event", "give quantile=0.95, or event='travel > 26'"
            )
        if self.quantile is not None and not 0.0 < self.quantile < 1.0:
            raise InputsError(f"quantile {self.quantile}", "choose a probability between 0 and 1")
        if self.quantile is not None and not self.noise:
            raise InputsError(
                "the quantile of the true value is not computed here",
                "aim at the probability of an event, or keep the noise",
            )

    @property
    def name(self) -> str:
        """The predicted quantity in words, such as "the quantile 0.99"."""
        if self.quantile is not None:
            return f"the quantile {self.quantile:g}"
        return f"the probability of {self.event}"


@dataclass(frozen=True, eq=False)
class EventAimedAt:
    """The event whose probability a design shall make more precise, and its conditions."""

    event: OutcomeEvent
    context: PredictionContext


@dataclass(frozen=True, eq=False)
class Aim:
    """The aim of a design: the quantity to be estimated better, and the alpha (K,) assumed.

    `moving` (F,) are the indices of the uncertain hyperparameters. `target` is the position among
    them of the hyperparameter aimed at, or None. An estimate on a limit is uncertain too, but no
    experiment has information on it there. The design assumes another value, which is in `moved`,
    for the hyperparameter aimed at, and for all of them where a prediction or all are the aim.
    """

    name: str
    alpha: Array
    moving: Indices
    moved: Mapping[str, float]
    target: int | None
    predicted: Predicted | None

    @classmethod
    def of(cls, about: str | Predicted | None, estimates: Mapping[str, Estimate], fit: Fit) -> Aim:
        """The aim with this name; None chooses the sd with the largest relative standard error.

        Raises InputsError for an unknown or a fixed hyperparameter, and where none is free.
        """
        require_free(about if isinstance(about, str) else None, fit.hyperparameters)
        names = [h.name for h in fit.hyperparameters]
        on_limit = np.setdiff1d(fit.inference.identified, fit.inference.free)
        if isinstance(about, Predicted):
            return cls(about.name, *_inside(on_limit, estimates, fit), None, about)
        about = about or _weakest(fit)
        if about == ALL:
            return cls("all hyperparameters", *_inside(on_limit, estimates, fit), None, None)
        k = names.index(about)
        inside = _inside(on_limit[on_limit == k], estimates, fit)
        return cls(about, *inside, int(np.searchsorted(inside[1], k)), None)

    def observed(self, fit: Fit) -> Array:
        """The observed information (F, F) of the measured experiments on these hyperparameters."""
        place = np.searchsorted(fit.inference.identified, self.moving)
        return np.asarray(fit.inference.information[np.ix_(place, place)])


def require_free(about: str | None, hyperparameters: Sequence[Hyperparameter]) -> None:
    """Raise InputsError for a name that is neither a free hyperparameter nor "all".

    It is raised for any name where no hyperparameter is free.
    """
    free = [h.name for h in hyperparameters if h.free]
    if not free:
        raise InputsError(
            "no hyperparameter is free: there is nothing that an experiment could tell",
            "give a hyperparameter limits in place of its number",
        )
    if about is None or about == ALL or about in free:
        return
    fixed = about in [h.name for h in hyperparameters]
    why = "is fixed" if fixed else f"is unknown{nearest(about, free)}"
    raise InputsError(
        f"the hyperparameter '{about}' {why}", f"name one of {', '.join(free)}, or all"
    )


def _weakest(fit: Fit) -> str:
    """The name of the standard deviation with the largest relative standard error.

    That of the noise counts only if no other is identified. Without any it is "all".
    """
    inference, hyperparameters = fit.inference, fit.hyperparameters
    every = [k for k in inference.identified if hyperparameters[k].log]
    scales = [k for k in every if k < fit.inputs.size] or every
    if not scales:
        return ALL
    share = inference.standard_error[scales] / fit.alpha[scales]
    largest = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
    return str(hyperparameters[scales[largest]].name)


def _inside(
    which: Indices, estimates: Mapping[str, Estimate], fit: Fit
) -> tuple[Array, Indices, dict[str, float]]:
    """alpha (K,) with the hyperparameters `which` moved off their limits, and these values by name.

    The others have the values that are most likely beside these. Between them are the indices (F,)
    of the uncertain hyperparameters, `which` among them.
    """
    alpha, inference = fit.alpha.copy(), fit.inference
    alpha[which] = [_elsewhere(estimates, fit, k) for k in which]
    others = np.setdiff1d(inference.free, which)
    if which.size and others.size:
        place = np.searchsorted(inference.identified, others)
        information = positive(inference.information[np.ix_(place, place)])
        alpha = ascend(fit.objective(), alpha, fit.hyperparameters, others, information)[0]
    moved = {fit.hyperparameters[k].name: float(alpha[k]) for k in which}
    return alpha, np.union1d(inference.free, which), moved


def _elsewhere(estimates: Mapping[str, Estimate], fit: Fit, k: int) -> float:
    """A value for a hyperparameter whose estimate is on a limit.

    It is one standard deviation off the limit, as far as its 95 % interval reaches over 1.96: the
    root mean square of its draws (see `alpha_draws`). Without an interval it is the starting value.
    """
    h = fit.hyperparameters[k]
    interval = estimates[h.name].interval
    if interval is None:
        return h.start
    side = fit.inference.at_bound[k]
    end = interval[0] if side == "upper" else interval[1]
    if not (np.isfinite(end) and h.lower < end < h.upper):
        return h.start
    return float(fit.alpha[k] + (end - fit.alpha[k]) / END)


@dataclass(frozen=True, eq=False, repr=False)
class NextExperiments:
    """The candidate experiments with the standard error of `about` after each, and the best set.

    An error is the expected standard error of the quantity `about`. For several quantities it is
    the mean of their errors relative to the present ones (`relative`); for all hyperparameters the
    geometric mean. `now` is the error with the `made` experiments only, infinite if they do not
    determine it. `alone` (C,) is the error after each candidate alone, NaN for one that cannot be
    simulated. `uncertain` (C,) is its Monte Carlo error, zero where it is exact. `beyond` says of
    each candidate outside the tested conditions, by its id, how far it is.

    `chosen` are the ids of the best set, the most useful first. `after` is the error after each of
    them, and `ties` the number of other candidates that are as good in its place. `repetitions` is
    how many times all `made` experiments would have to be repeated for the same error; None if no
    number is enough. `halving` is the number of experiments like those of the set that halve the
    present error, None if no number does. If the aim is the probability of an event, `probability`
    has it for each row of its conditions, and `settled` is false if a response surface does not
    determine the event. `planned_for` has the value assumed for a hyperparameter on a limit.
    `hyperparameters` has the standard error of each now and after the set. `sound` and `consistent`
    are the verdicts on the identification. `aim_by_default` is true where `about` was not asked
    for. `rows_alone` is true where each row of the candidates is taken as an experiment, though
    experiments of the study have several rows. `units` are those of the study, by name.
    """

    about: str
    relative: bool
    ids: tuple[str, ...]
    conditions: pd.DataFrame
    now: float
    alone: Array
    uncertain: Array
    beyond: Mapping[str, str]
    chosen: tuple[str, ...]
    after: tuple[float, ...]
    ties: tuple[int, ...]
    made: int
    repetitions: float | None
    halving: float | None
    probability: tuple[float, ...] | None
    settled: bool
    planned_for: Mapping[str, float]
    hyperparameters: pd.DataFrame
    laws: int
    runs: int = 0
    sound: bool = True
    consistent: bool | None = None
    aim_by_default: bool = False
    rows_alone: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        return printed.text(next_report(self._document()))

    def _repr_html_(self) -> str:
        """The chosen experiments and what they bring in a notebook."""
        return printed.fragment(next_report(self._document()))

    def _document(self) -> dict[str, Any]:
        known: dict[str, Any] = documents.plain({**self.to_dict(), "units": dict(self.units)})
        return known

    def table(self) -> pd.DataFrame:
        """A table with a row for each candidate by its id, the most useful first.

        The columns are its conditions (of its first row) and covariates, the `standard_error` after
        it alone, `chosen`, how often it is in the best set, and `beyond`, how far it lies beyond
        the tested conditions, in words.
        """
        found = self.conditions.assign(
            standard_error=self.alone,
            chosen=[self.chosen.count(name) for name in self.ids],
            beyond=[self.beyond.get(name, "") for name in self.ids],
        )
        return found.sort_values("standard_error", kind="stable")

    def plan(self) -> pd.DataFrame:
        """A table of the best set in order: the conditions of each, and the error after it."""
        found = self.conditions.loc[list(self.chosen)]
        return found.assign(standard_error=self.after, ties=self.ties)

    @property
    def probability_range(self) -> dict[str, tuple[float, float]] | None:
        """95 % ranges of the probability aimed at, `now` and `after` the set.

        They are Phi(-(beta -+ 1.96 s/phi(beta))) with the reliability index beta = -Phi^-1(P) and
        the standard error s of P (Ditlevsen and Madsen, 1996): a small probability is far from
        normally distributed, its index is less so. None for another aim, for several conditions or
        laws, and where the experiments leave the probability open.
        """
        if self.probability is None or self.relative or self.laws > 1 or np.isinf(self.now):
            return None
        index = -special.ndtri(self.probability[0])

        def between(error: float) -> tuple[float, float]:
            reach = END * error * np.sqrt(2.0 * np.pi) * np.exp(0.5 * index**2)
            return float(special.ndtr(-index - reach)), float(special.ndtr(-index + reach))

        return {"now": between(self.now), "after": between(self.after[-1])}

    def to_dict(self) -> dict[str, Any]:
        """The design as plain lists and numbers: the content of next.json."""
        return {
            "about": self.about,
            "relative": self.relative,
            "now": self.now,
            "candidates": _rows(self.table()),
            "uncertain": dict(zip(self.ids, self.uncertain.tolist(), strict=True)),
            "beyond": dict(self.beyond),
            "chosen": _rows(self.plan()),
            "made": self.made,
            "repetitions": self.repetitions,
            "halving": self.halving,
            "probability": self.probability,
            "probability_range": self.probability_range,
            "settled": self.settled,
            "planned_for": dict(self.planned_for),
            "hyperparameters": _rows(self.hyperparameters),
            "laws": self.laws,
            "runs": self.runs,
            "sound": self.sound,
            "consistent": self.consistent,
            "aim_by_default": self.aim_by_default,
            "rows_alone": self.rows_alone,
        }


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table as dictionaries with their "id"; a column "id" replaces it."""
    return [
        {"id": str(name)} | {str(key): value for key, value in row.items()}
        for name, row in zip(table.index, table.to_dict("records"), strict=True)
    ]


def next_experiments(
    found: Identification,
    candidates: Conditions | pd.DataFrame,
    count: int = 5,
    *,
    about: str | Predicted | None = None,
    repeat: int = 1,
    laws: int = 1,
    simulator: Runner | None = None,
    progress: Progress | None = None,
) -> NextExperiments:
    """The expected information of each candidate experiment, and the best set of `count` of them.

    I_c = E[s s'] is the expected information of one experiment under the conditions c on alpha,
    where s is its score. After a set S of experiments the variance of a quantity with gradient g is
    g' (I + sum_S I_c)^-1 g, where I is the observed information of `found` (Chernoff, 1953).
    `about` is the name of a hyperparameter, a `Predicted` quantile or probability, or "all" for the
    volume of the confidence ellipsoid. By default it is the standard deviation with the largest
    relative standard error.

    `candidates` is a table like that of the experiments, without outcomes; rows with the same id,
    in the column of ids that the experiments have, are one experiment. Experiments of a new group
    of a level, such as a batch, are one candidate. A candidate is chosen at most `repeat` times.
    The set is best under the identified law, or with `laws` above 1 best on average over so many
    plausible laws. A hyperparameter on a limit is assumed one standard deviation off it, which is
    its interval over 1.96: for itself, and for a prediction or "all", whose error would else leave
    out that it is not known exactly.

    Runs are made for response surfaces of the candidates, by the Runner `simulator`, or in the same
    way as in the identification. Raises InputsError for an unknown name and for more experiments
    than candidates. Raises AleatorError if `found` was read from a file and has no fit (see
    `Identification.with_fit`). Cost: 97 evaluations of
    the likelihood of the candidates, or 400 if they have several observations.

    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.5, 1.2, 4.2, 3.4]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.9))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  vectorized=True, verification=Check(0))
    >>> plan = next_experiments(found, pd.DataFrame({"load": [0.1, 1.0, 9.0]}), count=1)
    >>> plan.about, plan.chosen
    ('x.sd', ('3',))
    """
    progress = progress or Silent()
    require_kind(found, Identification, "found", "identify(...), or load(...)")
    if about is not None:
        require_kind(about, (str, Predicted), "about", '"x.sd", "all" or Predicted(...)')
    found = found.with_fit(progress)
    fit, session = found.fit, found.session
    conditions = session.requested(candidates)
    require_enough_candidates(count, len(conditions.ids), repeat)
    aim = Aim.of(about, found.alpha, fit)
    runner = simulator or session.runner_on(conditions)
    before = runner.runs
    progress.stage("candidates")
    offered = session.fit_on(conditions, aim.alpha, runner, progress)
    require_enough_candidates(count, len(offered.cluster_names), repeat)
    predicted = None
    if aim.predicted is not None:
        predicted = _of_prediction(found, aim.predicted, aim.alpha, progress)
    made = planned(fit, offered, predicted, aim, count, repeat, laws, progress)
    runs = runner.runs - before
    if isinstance(predicted, EventAimedAt) and predicted.event.outcome in session.outcomes:
        runs += predicted.context.runner.runs
    return replace(
        made, runs=runs, sound=found.sound, consistent=found.consistent, units=found.units,
        aim_by_default=about is None, rows_alone=_rows_alone(conditions, fit),
    )  # fmt: skip


def planned(
    fit: Fit,
    offered: Fit,
    predicted: Fit | EventAimedAt | None,
    aim: Aim,
    count: int,
    repeat: int,
    laws: int,
    progress: Progress,
    seed: int = 11,
) -> NextExperiments:
    """The best set of the `offered` candidates, in addition to the measured experiments of the fit.

    `predicted` are the experiments to be predicted, if a prediction is the aim: their fit for a
    quantile, and with an event their context.
    """
    every = possible_laws(aim.alpha, fit.inference, fit.hyperparameters, laws)
    rng = np.random.default_rng(seed)
    scores = [_scores(offered.at(one), aim, rng, progress) for one in every]
    measured = _scores(fit.at(aim.alpha), aim, rng, progress, measured=True)
    again = measured.information.sum(axis=0)
    present = again if aim.moved or not fit.inference.positive else aim.observed(fit)
    event = None
    if isinstance(predicted, EventAimedAt):
        event = _event(aim, fit, predicted, every, present, progress)
    plan = DesignPlan(
        np.broadcast_to(present, (len(every), *present.shape)),
        np.stack([part.information for part in scores]),
        _directions(aim, predicted, event, every, rng, progress),
    ).relative()
    choice = chosen(plan, count, repeat)
    added = plan.offered[:, list(choice.order)].sum(axis=1)
    ids = offered.cluster_names
    return NextExperiments(
        about=aim.name,
        relative=plan.directions is None or plan.directions.shape[1] > 1,
        ids=ids,
        conditions=_first_rows(offered),
        now=float(plan.standard_error(plan.present)),
        alone=_alone(plan),
        uncertain=_uncertain(plan, scores[0]),
        beyond=_beyond(fit, offered),
        chosen=tuple(ids[c] for c in choice.order),
        after=choice.after,
        ties=choice.ties,
        made=fit.count,
        repetitions=repetitions(plan, again, choice.after[-1]),
        halving=halved(plan, added, count),
        probability=None if event is None else tuple(event.probability[0].tolist()),
        settled=event is None or event.settled,
        planned_for=aim.moved,
        hyperparameters=_hyperparameters(fit, aim, plan, choice),
        laws=len(every),
    )


def _rows_alone(conditions: Conditions, fit: Fit) -> bool:
    """Whether each row is a candidate by itself, though experiments of the study have several."""
    measured = fit.table
    return conditions.simple and len(measured.ids) < len(measured.experiment)


def _first_rows(offered: Fit) -> pd.DataFrame:
    """The conditions of the first row of each candidate, and its covariates, by its name."""
    first = np.unique(offered.cluster[offered.table.experiment], return_index=True)[1]
    names = pd.Index(offered.cluster_names, name="id")
    conditions, every = offered.table.conditions, offered.table.table
    beside = [name for name in offered.inputs.columns if name in every and name not in conditions]
    return conditions.join(every[beside]).iloc[first].set_axis(names)


def _beyond(fit: Fit, offered: Fit) -> dict[str, str]:
    """How far each candidate outside the tested conditions is from them, by its name.

    Of several rows the one that is farthest counts. Groups of levels are new by their nature.
    """
    table, tested = offered.table, fit.table.table
    columns = dict.fromkeys([*table.conditions, *offered.inputs.covariates])
    levels = {*offered.inputs.levels.values()}
    names = [n for n in columns if n in tested and n in table.table and n not in levels]
    found = compared(tested[names], table.table[names])
    farthest: dict[str, str] = {}
    for row in np.argsort(-found.distance, kind="stable").tolist():
        name = offered.cluster_names[offered.cluster[table.experiment[row]]]
        if found.why[row]:
            farthest.setdefault(name, found.why[row])
    return farthest


def require_enough_candidates(count: int, candidates: int, repeat: int) -> None:
    """Raise InputsError if `count` experiments cannot be chosen from the candidates."""
    if count < 1:
        raise InputsError(f"next: {count} experiments", "ask for at least one")
    if repeat < 1 or count > candidates * repeat:
        raise InputsError(
            f"next: {count} experiments of {candidates} candidates, each {repeat} times at most",
            "give more candidates, ask for fewer, or let them be repeated",
        )


def _scores(
    fit: Fit, aim: Aim, rng: np.random.Generator, progress: Progress, *, measured: bool = False
) -> Scores:
    progress.stage("expected information")
    return expected_scores(fit, rng, progress, measured=measured).of(aim.moving)


def _of_prediction(
    found: Identification, wanted: Predicted, alpha: Array, progress: Progress
) -> Fit | EventAimedAt:
    """The experiments to be predicted: their fit for a quantile, with an event their context."""
    session = found.session
    there = session.requested(wanted.conditions)
    if wanted.event is not None:
        event = session.event(wanted.event, found.units)
        context = session.event_context(event, there, alpha, noise=wanted.noise)
        return EventAimedAt(event, context)
    predicted = session.fit_on(there, alpha, session.runner_on(there), progress)
    # A predicted value is not censored at the limits of the tests.
    return predicted.seeing(unmeasured(there))


def _event(
    aim: Aim,
    fit: Fit,
    wanted: EventAimedAt,
    laws: Array,
    present: Array,
    progress: Progress,
    settings: StepSettings = STEP,
) -> EventGradient:
    """The probability of the event aimed at, with its gradient."""
    limits, steps = limits_of(fit.hyperparameters), np.zeros(fit.alpha.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = settings.share / np.sqrt(np.maximum(np.diagonal(present), 0.0))
    steps[aim.moving] = np.minimum(own, settings.most * (limits[1] - limits[0])[aim.moving])
    return event_gradient(wanted.context, laws, wanted.event, steps, limits, progress)


def _directions(
    aim: Aim,
    predicted: Fit | EventAimedAt | None,
    event: EventGradient | None,
    laws: Array,
    rng: np.random.Generator,
    progress: Progress,
) -> Array | None:
    """The gradients (A, G, F) of the quantities aimed at; None for all hyperparameters."""
    if aim.target is not None:
        return np.tile(np.eye(aim.moving.size)[aim.target], (len(laws), 1, 1))
    if event is not None:
        return event.gradient[..., aim.moving]
    if aim.predicted is None or aim.predicted.quantile is None or not isinstance(predicted, Fit):
        return None
    each = [_scores(predicted.at(one), aim, rng, progress) for one in laws]
    if each[0].outcomes is None:
        raise InputsError(
            f"{aim.name}: the conditions have several observations an experiment",
            "give each row an id of its own, and predict one response",
        )
    return np.stack([quantile_gradients(part, aim.predicted.quantile)[1] for part in each])


def _alone(plan: DesignPlan) -> Array:
    lost = ~np.all(np.isfinite(plan.offered), axis=(0, 2, 3))
    found = plan.standard_error(plan.present[:, None] + plan.offered)
    return np.where(lost, np.nan, found)


def _uncertain(plan: DesignPlan, scores: Scores) -> Array:
    """The Monte Carlo error (C,) of the standard error after each candidate.

    It is computed by the delta method: an error dI of the information changes the variance d' V d
    by -(V d)' dI (V d). It is zero for several quantities, where it is not computed.
    """
    nothing = np.zeros(plan.offered.shape[1])
    if scores.outcomes is not None or plan.directions is None or plan.directions.shape[1] > 1:
        return nothing
    variance = np.linalg.pinv(plan.present[0] + plan.offered[0], hermitian=True)
    pulled = variance @ plan.directions[0, 0]
    error = np.sqrt(pulled @ plan.directions[0, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(scores.error(pulled) / (2.0 * error)))


def _hyperparameters(fit: Fit, aim: Aim, plan: DesignPlan, choice: ChosenSet) -> pd.DataFrame:
    units = [np.tile(unit, (len(plan.present), 1, 1)) for unit in np.eye(aim.moving.size)]
    each = [replace(plan, directions=unit, unit=1.0) for unit in units]
    after = plan.present + plan.offered[:, list(choice.order)].sum(axis=1)
    return pd.DataFrame(
        {
            "now": [float(one.standard_error(plan.present)) for one in each],
            "after": [float(one.standard_error(after)) for one in each],
        },
        index=[fit.hyperparameters[k].name for k in aim.moving],
    )
