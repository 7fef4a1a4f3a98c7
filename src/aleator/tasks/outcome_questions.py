"""Questions about new experiments, which `identify` answers with the law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from aleator.errors import AleatorError, InputsError
from aleator.fit.ledger import Ledger
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.outcome_question import OutcomeQuestion, require_laws_at
from aleator.observations.experiments import Conditions, Experiments
from aleator.results.values import MeasuredThere, OutcomeAnswer
from aleator.simulators import Runner
from aleator.tasks.identification import Identification
from aleator.tasks.new_experiments import Exploration
from aleator.tasks.p_box import require_one_law
from aleator.tasks.session import Runners, Session

STAGE = "questions"
"""The stage of the answers in the account of runs and seconds."""


def require_answerable(
    questions: Sequence[OutcomeQuestion], session: Session, units: Mapping[str, str]
) -> None:
    """Check before any run that questions are about known names, under known conditions.

    `session` has the laws, the noise, the experiments and the simulator of an identification.
    Raises AleatorError with the number of the question.
    """
    assert session.inputs is not None
    assert session.experiments is not None
    for place, question in enumerate(questions):
        if not isinstance(question, OutcomeQuestion):
            raise InputsError(
                f"questions[{place}] is no OutcomeQuestion",
                'write questions=[OutcomeQuestion(probability="travel > 26", at={"force": 50.0})]',
            )
        try:
            require_one_law(session.hyperparameters)
            event = question.event(session.responses, units, session.parameters)
            simulated = event is None or event.outcome in session.outcomes
            conditions = (
                session.requested(question.at)
                if event is None
                else session.event_conditions(event, question.at)
            )
            if len(conditions.table) != 1:
                raise InputsError(
                    f"at has {len(conditions.table)} rows", "give one, and a question for each"
                )
            if simulated:
                session.runner_on(conditions)
            noise = session.noise if question.noise and simulated else None
            require_laws_at(conditions, session.inputs, session.experiments, noise)
        except AleatorError as error:
            raise type(error)(f"questions[{place}]: {error.problem}", error.remedy) from None


def runs_for_condition(surface: Mapping[str, Any] | None, *, event: bool) -> int:
    """The runs that a surface under new conditions is expected to take; 0 without surfaces.

    As many are expected as each experiment of the identification took. An event takes a round more,
    which looks for other regions of it.
    """
    if not (surface and surface.get("runs") and surface.get("experiments")):
        return 0
    each: int = max(round(surface["runs"] / surface["experiments"]), 1)
    return each + (Exploration().runs if event else 0)


@dataclass(frozen=True, eq=False)
class _CountedRunners:
    """Runners of new conditions, one for equal conditions, so that no run is made twice."""

    base: Runners
    ledger: Ledger
    made: dict[str, Runner] = field(default_factory=dict)

    def __call__(self, asked: Experiments | Conditions) -> Runner:
        if isinstance(asked, Experiments):
            return self.base(asked)
        key = asked.table.to_csv()
        if key not in self.made:
            self.made[key] = self.base(asked)
            self.made[key].progress = self.ledger.progress
        return self.made[key]

    @property
    def runs(self) -> int:
        """The number of different runs that were needed under the new conditions."""
        return sum(runner.runs for runner in self.made.values())

    @property
    def fresh(self) -> int:
        """The number of runs that were made and have an outcome."""
        return sum(runner.fresh for runner in self.made.values())


def with_answers(
    found: Identification, questions: Sequence[OutcomeQuestion], runner: Runner, ledger: Ledger
) -> Identification:
    """The identification with an answer to each question.

    What cannot be answered has a status and a reason in place of numbers: the identification is
    never lost, also where runs fail or Ctrl-C (SIGTERM) ends the work. Without a sound
    identification, and where its budget does not suffice, no run is made. Cost: that of
    `Identification.probability` and `Identification.tolerance`.
    """
    base = found.session.runner
    assert base is not None
    runners = _CountedRunners(base, ledger)
    asking = replace(found, session=replace(found.session, runner=runners))
    made: list[OutcomeAnswer] = []
    with ledger.stage(STAGE):
        for place, question in enumerate(questions):
            try:
                if not found.sound:
                    raise AleatorError("the law was not computed soundly")
                runs = _affordable_runs(found, question, runner, runners.fresh)
                cost = f", some {runs} runs" if runs else ""
                ledger.progress.stage(f"question {place + 1} of {len(questions)}{cost}")
                made += _answers(asking, question, ledger)
            except AleatorError as error:
                made.append(_unanswered(asking, question, "failed", error.problem))
            except Exception as error:  # A defect does not cost the identification either.
                defect = f"of a defect of Aleator ({type(error).__name__}: {error})"
                made.append(_unanswered(asking, question, "failed", defect))
            except KeyboardInterrupt:
                rest = [_unanswered(asking, q, "interrupted", STOPPED) for q in questions[place:]]
                made += rest
                break
    ledger.runs[STAGE] = runners.runs
    return replace(found, answers=tuple(made))


STOPPED = "the work was stopped before: ask again by the same command, or by found.probability"
"""Why a question has no answer after Ctrl-C."""


def _affordable_runs(
    found: Identification, question: OutcomeQuestion, runner: Runner, spent: int
) -> int:
    """The runs that a question is expected to take; AleatorError if the budget leaves too few."""
    event = question.event(found.session.responses, found.units, found.session.parameters)
    if event is not None and event.outcome not in found.session.outcomes:
        return 0
    asked = runs_for_condition(found.surface, event=event is not None)
    if runner.account.granted(asked + spent) < asked + spent:
        raise AleatorError(
            f"it takes some {asked} runs, more than the budget of {runner.account.budget} leaves"
        )
    return asked


def _answers(
    found: Identification, question: OutcomeQuestion, ledger: Ledger
) -> Iterator[OutcomeAnswer]:
    """The answers to a question, one for each outcome that it is about."""
    if question.probability is not None:
        table = found.probability(
            question.probability, question.at, noise=question.noise, progress=ledger.progress
        )
    else:
        limits = question.limits
        assert limits is not None
        table = found.tolerance(
            limits.content, limits.confidence, question.at, side=limits.side,
            outcome=question.outcome, noise=question.noise, progress=ledger.progress,
        )  # fmt: skip
    beyond = "; ".join(table.attrs["beyond"].values())
    for _, row in table.iterrows():
        answer = replace(_asked(found, question), outcome=row["outcome"], beyond=beyond, **{
            name: row[name]
            for name in ("probability", "lower", "upper", "error", "status") if name in row
        })  # fmt: skip
        event = question.event(found.session.responses, found.units, found.session.parameters)
        yield replace(answer, measured=_measured(found.session, answer, event))


def _measured(
    session: Session, answer: OutcomeAnswer, event: OutcomeEvent | None
) -> MeasuredThere | None:
    """What the values show that were measured under the conditions of an answer, if any were.

    Without an `event` the limits of the answer are meant, which belong to what lies within.
    """
    table, names = session.experiments, session.outcomes
    true = session.noise is not None and not answer.noise
    if table is None or answer.outcome not in names or true or {*answer.at} - {*table.table}:
        return None
    if event is None:
        low, high = answer.lower, answer.upper
        if low is None and high is None:
            return None
        ends = -np.inf if low is None else low, np.inf if high is None else high
        event = OutcomeEvent(answer.outcome, *ends, (True, True))
    alike = np.ones(len(table.table), dtype=bool)
    for name, value in answer.at.items():
        alike &= (table.table[name] == value).to_numpy(dtype=bool)
    seen, response = table.observations, names.index(answer.outcome)
    own = (seen.response == response) & alike[seen.row] & ~np.isnan(seen.lower)
    if not own.any():
        return None
    transform = session.responses[response].transform
    met, left = event.met_by(seen.lower[own], seen.upper[own], transform)
    return MeasuredThere(int(own.sum()), int(met.sum()), int(left.sum()))


def _asked(found: Identification, question: OutcomeQuestion) -> OutcomeAnswer:
    """The answer to a question as far as the question says it: without numbers."""
    session, limits = found.session, question.limits
    names, event = (
        session.outcomes,
        question.event(session.responses, found.units, session.parameters),
    )
    if event is not None:
        noise = question.noise and event.outcome in names
        at = _first_row(session.event_conditions(event, question.at))
        return OutcomeAnswer(event.outcome, at, noise, event=str(event))
    assert limits is not None
    at = _first_row(session.requested(question.at))
    return OutcomeAnswer(
        question.outcome or ", ".join(names), at, question.noise, content=limits.content,
        confidence=limits.confidence, side=limits.side,
    )  # fmt: skip


def _first_row(conditions: Conditions) -> dict[str, Any]:
    """The conditions of one new experiment by name."""
    return {str(name): conditions.table[name].iloc[0] for name in conditions.table}


def _unanswered(
    found: Identification, question: OutcomeQuestion, status: str, reason: str
) -> OutcomeAnswer:
    return replace(_asked(found, question), status=status, reason=reason)
