"""The next experiment: which candidates would tell most of a hyperparameter or a prediction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from aleator.errors import InputsError
from aleator.inference.design import (
    Choice,
    Plan,
    Scores,
    chosen,
    expected_scores,
    possible_laws,
    repetitions,
)
from aleator.inference.fit import Fit
from aleator.observations.experiments import Conditions, unmeasured
from aleator.progress import Progress, Silent
from aleator.results import printed
from aleator.results.printed import number
from aleator.simulators import Runner
from aleator.tasks.identification import Identification
from aleator.tasks.session import Session
from aleator.tasks.wanted import Predicted, Wanted
from aleator.types import Array

SEED = 11


@dataclass(frozen=True, eq=False)
class NextExperiments:
    """Candidates, what each would tell `about` something, and the set that tells most together.

    Errors are standard errors of what it is about; of several quantities, or of all, their means
    over what they are now (`relative`), geometric for all. `now` is that of the experiments that
    were made, infinite where they leave it open. `alone` (C,) is that after each candidate by
    itself, with its Monte Carlo error `uncertain` (C,), zero where it is exact; NaN for one that
    cannot be simulated. `chosen` are the ids of the best set, the most useful first, `after` the
    error after each, and `ties` how many others would do as well in its place. As many times all
    `made` experiments would have to be repeated as `repetitions` says for the same; None where no
    repetition reaches it. `planned_for` has the value of a hyperparameter that ended on its limit.
    `hyperparameters` has the error of each now and after the set. `sound` and `consistent` are the
    verdicts on the identification that all of it rests on.
    """

    about: str
    relative: bool
    ids: tuple[str, ...]
    conditions: pd.DataFrame
    now: float
    alone: Array
    uncertain: Array
    chosen: tuple[str, ...]
    after: tuple[float, ...]
    ties: tuple[int, ...]
    made: int
    repetitions: float | None
    planned_for: Mapping[str, float]
    hyperparameters: pd.DataFrame
    laws: int
    runs: int
    sound: bool
    consistent: bool | None

    def _repr_html_(self) -> str:
        """The chosen experiments in a notebook."""
        now = f"The error of {self.about} is {number(self.now, 3)} now" + (
            ", over what it is." if self.relative else "."
        )
        return printed.shown(now, self.plan(), "The set that tells most together, in this order.")

    def table(self) -> pd.DataFrame:
        """A row for each candidate by its id, the most useful first.

        Its conditions (of the first row, where it has several), `standard_error` after it alone,
        and `chosen`, how often it is in the set.
        """
        found = self.conditions.assign(
            standard_error=self.alone,
            chosen=[self.chosen.count(name) for name in self.ids],
        )
        return found.sort_values("standard_error", kind="stable")

    def plan(self) -> pd.DataFrame:
        """A row for each experiment of the set, in order: its conditions and the error after it."""
        found = self.conditions.loc[list(self.chosen)]
        return found.assign(standard_error=self.after, ties=self.ties)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain lists and numbers, as next.json holds it."""
        return {
            "about": self.about,
            "relative": self.relative,
            "now": self.now,
            "candidates": _rows(self.table()),
            "uncertain": dict(zip(self.ids, self.uncertain.tolist(), strict=True)),
            "chosen": _rows(self.plan()),
            "made": self.made,
            "repetitions": self.repetitions,
            "planned_for": dict(self.planned_for),
            "hyperparameters": _rows(self.hyperparameters),
            "laws": self.laws,
            "runs": self.runs,
            "sound": self.sound,
            "consistent": self.consistent,
        }


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows with their ids; of equal names the one that is told of a candidate counts."""
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
    """Tell what each candidate experiment would tell, and which `count` of them tell most together.

    I_c = E[s s'] is the expected information of alpha in one experiment under the conditions c, s
    its score. What a set S of them leaves unknown of a quantity g(alpha) is the variance
    g' (I + sum_S I_c)^-1 g, with I the observed information of `found` (Chernoff, 1953). `about`
    names a hyperparameter, is a `Predicted` quantile or probability, or "all" for the volume of
    the confidence ellipsoid; left out, the standard deviation that is least known for its size.

    `candidates` are written as the experiments are, without outcomes; rows with one id are one
    experiment. A candidate is chosen `repeat` times at most. A plan is best for the law
    that it was made for, which is the identified one; with `laws` it is best in the mean over so
    many that the experiments leave possible. A hyperparameter that ended on its limit is planned
    for at the other end of its interval.

    Nothing is measured. Runs are made for surfaces of the candidates, by `simulator`, a Runner
    of them, or as the identification made its own. Raises InputsError for an unknown name and for
    more experiments than candidates, AleatorError where `found` was read from a file. Cost: 97
    evaluations of the likelihood of the candidates, 400 where they have several observations.

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
    fit, session = found.fit, found.session
    conditions = _conditions(candidates, fit)
    require_enough_candidates(count, len(conditions.ids), repeat)
    wanted = Wanted.of(about, found, fit)
    every = possible_laws(wanted.alpha, fit.inference, fit.hyperparameters, laws)
    rng = np.random.default_rng(SEED)
    runner = simulator or session.runner_on(conditions)
    before = runner.runs
    progress.stage("candidates")
    planned = session.fit_on(conditions, wanted.alpha, runner, progress)
    scores = [_scores(planned.at(one), wanted, rng, progress) for one in every]
    again = _scores(fit.at(wanted.alpha), wanted, rng, progress).information.sum(axis=0)
    present = again if wanted.moved or not fit.inference.positive else wanted.observed(fit)
    plan = Plan(
        np.broadcast_to(present, (len(every), *present.shape)),
        np.stack([part.information for part in scores]),
        _directions(wanted, fit, session, every, rng, progress),
    ).relative()
    choice = chosen(plan, count, repeat)
    return NextExperiments(
        about=wanted.name,
        relative=plan.directions is None or plan.directions.shape[1] > 1,
        ids=conditions.ids,
        conditions=_first_rows(conditions),
        now=float(plan.standard_error(plan.present)),
        alone=_alone(plan),
        uncertain=_uncertain(plan, scores[0]),
        chosen=tuple(conditions.ids[c] for c in choice.order),
        after=choice.after,
        ties=choice.ties,
        made=fit.count,
        repetitions=repetitions(plan, again, choice.after[-1]),
        planned_for=wanted.moved,
        hyperparameters=_hyperparameters(fit, wanted, plan, choice),
        laws=len(every),
        runs=runner.runs - before,
        sound=found.sound,
        consistent=found.consistent,
    )


def _conditions(candidates: Conditions | pd.DataFrame, fit: Fit) -> Conditions:
    if isinstance(candidates, Conditions):
        return candidates
    return Conditions.from_frame(candidates, responses=fit.table.observations.responses)


def _first_rows(conditions: Conditions) -> pd.DataFrame:
    """The conditions of each experiment, by its id; of several rows, of the first."""
    first = np.unique(conditions.experiment, return_index=True)[1]
    return conditions.conditions.iloc[first].set_axis(pd.Index(conditions.ids, name="id"))


def require_enough_candidates(count: int, candidates: int, repeat: int) -> None:
    """Raise InputsError where so many experiments cannot be chosen."""
    if count < 1:
        raise InputsError(f"next: {count} experiments", "ask for at least one")
    if repeat < 1 or count > candidates * repeat:
        raise InputsError(
            f"next: {count} experiments of {candidates} candidates, each {repeat} times at most",
            "give more candidates, ask for fewer, or let them be repeated",
        )


def _scores(fit: Fit, wanted: Wanted, rng: np.random.Generator, progress: Progress) -> Scores:
    progress.stage("expected information")
    return expected_scores(fit, rng, progress).of(wanted.moving)


def _directions(
    wanted: Wanted,
    fit: Fit,
    session: Session,
    laws: Array,
    rng: np.random.Generator,
    progress: Progress,
) -> Array | None:
    """Of what is wanted by the hyperparameters (A, G, F); None for all of these."""
    if wanted.target is not None:
        return np.tile(np.eye(wanted.moving.size)[wanted.target], (len(laws), 1, 1))
    if wanted.predicted is None:
        return None
    conditions = _conditions(wanted.predicted.conditions, fit)
    runner = session.runner_on(conditions)
    asked = session.fit_on(conditions, wanted.alpha, runner, progress)
    # what is predicted has no limit of a test
    asked = asked.seeing(unmeasured(conditions))
    each = [_scores(asked.at(one), wanted, rng, progress) for one in laws]
    return np.stack([wanted.predicted.gradients(part, fit) for part in each])


def _alone(plan: Plan) -> Array:
    """The standard error (C,) after each candidate; NaN where it cannot be computed."""
    lost = ~np.all(np.isfinite(plan.offered), axis=(0, 2, 3))
    found = plan.standard_error(plan.present[:, None] + plan.offered)
    return np.where(lost, np.nan, found)


def _uncertain(plan: Plan, scores: Scores) -> Array:
    """The Monte Carlo error (C,) of that for one direction and law, else zero.

    By the delta method: the variance d' V d moves by -(V d)' dI (V d).
    """
    nothing = np.zeros(plan.offered.shape[1])
    if scores.outcomes is not None or plan.directions is None or plan.directions.shape[1] > 1:
        return nothing
    variance = np.linalg.pinv(plan.present[0] + plan.offered[0], hermitian=True)
    pulled = variance @ plan.directions[0, 0]
    error = np.sqrt(pulled @ plan.directions[0, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(scores.error(pulled) / (2.0 * error)))


def _hyperparameters(fit: Fit, wanted: Wanted, plan: Plan, choice: Choice) -> pd.DataFrame:
    """The standard error of each now and after the set, by name."""
    size = wanted.moving.size
    each = [replace(plan, directions=_unit(plan, k), unit=1.0) for k in range(size)]
    after = plan.present + plan.offered[:, list(choice.order)].sum(axis=1)
    return pd.DataFrame(
        {
            "now": [float(one.standard_error(plan.present)) for one in each],
            "after": [float(one.standard_error(after)) for one in each],
        },
        index=[fit.hyperparameters[k].name for k in wanted.moving],
    )


def _unit(plan: Plan, k: int) -> Array:
    direction = np.zeros((len(plan.present), 1, plan.present.shape[-1]))
    direction[:, 0, k] = 1.0
    return direction
