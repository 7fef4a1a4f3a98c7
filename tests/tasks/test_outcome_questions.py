"""Questions about outcomes of new experiments: answered as they are asked one by one, or told why
not, and never at the cost of the identification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import aleator
from aleator import (
    AleatorError,
    Budget,
    Check,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    OutcomeQuestion,
)
from aleator.results.findings import findings
from aleator.results.values import MeasuredThere, OutcomeAnswer

TESTED, NEW = 3.0, 5.0


def table() -> pd.DataFrame:
    """Thirty synthetic springs under two loads, one of each measured."""
    rng = np.random.default_rng(4)
    load = np.tile([2.0, TESTED], 15)
    return pd.DataFrame({"load": load, "way": load * rng.normal(1.0, 0.1, load.size)})


def way(load: float, give: float) -> float:
    return load * give


def found(simulator: Callable[..., Any], *questions: OutcomeQuestion, **how: Any) -> Identification:
    laws = Inputs({"give": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    return aleator.identify(
        simulator, table(), laws, outcome="way", noise=Noise(0.05), verification=Check(0),
        consistency=False, best_law=False, units={"way": "mm", "load": "N"},
        questions=questions, **how,
    )  # fmt: skip


EVENT = OutcomeQuestion(probability="way > 6 mm", at={"load": NEW}, noise=False)
SHARE = OutcomeQuestion(probability="give > 1.2")
LIMIT = OutcomeQuestion(tolerance=(0.95, 0.9), side="upper", at={"load": NEW})


@pytest.fixture(scope="module")
def asked() -> Identification:
    return found(way, EVENT, LIMIT, SHARE, vectorized=True)


def test_an_answer_is_that_of_the_same_question_asked_alone(asked: Identification) -> None:
    event, limit, share = asked.answers
    alone = asked.probability("way > 6", {"load": NEW}, noise=False).iloc[0]
    for name in ("probability", "lower", "upper", "error"):
        assert getattr(event, name) == alone[name]
    one = asked.tolerance(0.95, 0.9, {"load": NEW}, side="upper").iloc[0]
    assert (limit.lower, limit.upper) == (None, one["upper"])
    assert event.at == limit.at == {"load": NEW}
    assert event.beyond == limit.beyond != ""
    own = asked.probability("give > 1.2").iloc[0]
    assert (share.probability, share.upper) == (own["probability"], own["upper"])
    assert (share.outcome, share.at, share.noise) == ("give", {}, False)
    assert asked.runs_by_stage["questions"] > 0


def test_the_interval_of_an_answer_holds_the_tail_of_the_identified_law(
    asked: Identification,
) -> None:
    mean, sd = asked.values["give.mean"], asked.values["give.sd"]
    event = asked.answers[0]
    tail = float(stats.norm.sf(6.0, NEW * mean, NEW * sd))
    assert event.lower is not None
    assert event.upper is not None
    assert 0.1 * tail < event.lower < tail < event.upper < 10.0 * tail


def test_every_report_says_the_answers_before_the_verdicts(asked: Identification) -> None:
    event = next(s for s in findings(asked.to_dict()) if s.head == "At load 5 N")
    share = 100.0 * float(asked.answers[0].probability or 0.0)
    assert f"the true way exceeds 6 mm in {share:.1f} % of experiments" in event.text
    assert "beyond the tested conditions" in event.text
    of_law = next(s for s in findings(asked.to_dict()) if s.head == "A new experiment")
    assert of_law.text.startswith("give exceeds 1.2")
    for text in (repr(asked).replace("\n", " "), asked._repr_html_(), asked.report().text):
        for part in ("the true way exceeds 6 mm", "the measured way of 95 % of experiments"):
            assert 0 < text.index(part) < text.index("Computed soundly")


def test_what_cannot_be_asked_is_refused_before_any_run() -> None:
    called: list[float] = []

    def counting(load: float, give: float) -> float:
        called.append(give)
        return load * give

    for question, name in (
        (OutcomeQuestion(probability="wey > 6", at={"load": NEW}), "way"),
        (OutcomeQuestion(probability="way > 6 m", at={"load": NEW}), "mm"),
        (OutcomeQuestion(probability="way > 6", at={"laod": NEW}), "load"),
        (OutcomeQuestion(probability="way > 6"), "load"),
        (OutcomeQuestion(probability="way > 6", at={"load": "heavy"}), "heavy"),
        (OutcomeQuestion(tolerance=(0.9, 0.9), outcome="wey", at={"load": NEW}), "way"),
    ):
        with pytest.raises(AleatorError, match=name) as caught:
            found(counting, EVENT, question, vectorized=False)
        assert "questions[1]" in caught.value.problem
    with pytest.raises(AleatorError, match="questions is an OutcomeQuestion"):
        aleator.identify(
            counting, table(), {"give": Normal(Free(0.5, 1.5), 0.1)}, outcome="way", noise=0.05,
            questions=EVENT, vectorized=False,
        )  # type: ignore[call-overload]  # fmt: skip
    assert called == []


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"probability": "way > 6", "tolerance": (0.9, 0.9)},
        {"probability": "way > 6", "side": "upper"},
        {"tolerance": (95, 0.9)},
        {"tolerance": 0.9},
        {"tolerance": (0.9, 0.9), "side": "top"},
        {"probability": "way > 6", "at": {"load": [1.0, 2.0]}},
        {"probability": "way > 6", "at": 5.0},
    ],
)
def test_a_question_asks_one_thing_of_one_experiment(wrong: dict[str, Any]) -> None:
    with pytest.raises(AleatorError):
        OutcomeQuestion(**wrong)


def test_a_simulator_that_fails_there_or_an_interruption_keeps_the_identification() -> None:
    def failing(load: float, give: float) -> float:
        if load == NEW:
            raise RuntimeError("no such load")
        if load == 4.0:
            raise KeyboardInterrupt
        return load * give

    stopped = OutcomeQuestion(probability="way > 4", at={"load": 4.0})
    tested = OutcomeQuestion(tolerance=(0.9, 0.9), at={"load": TESTED})
    result = found(failing, tested, EVENT, stopped, LIMIT, vectorized=False)
    assert result.sound
    assert [answer.status for answer in result.answers] == [
        "solved", "failed", "interrupted", "interrupted",
    ]  # fmt: skip
    assert "no such load" in result.answers[1].reason
    assert repr(result).count("no answer to") == 3


def test_a_defect_keeps_the_identification(monkeypatch: pytest.MonkeyPatch) -> None:
    def defective(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by design")

    monkeypatch.setattr(Identification, "probability", defective)
    result = found(way, EVENT, vectorized=True)
    assert result.sound
    assert (result.answers[0].status, result.answers[0].probability) == ("failed", None)
    assert "ZeroDivisionError: by design" in result.answers[0].reason


def test_runs_are_counted_once_and_a_budget_holds() -> None:
    calls: list[tuple[float, float]] = []

    def counting(load: float, give: float) -> float:
        calls.append((load, give))
        return load * give

    limits = OutcomeQuestion(tolerance=(0.9, 0.9), at={"load": NEW})
    result = found(counting, limits, LIMIT, vectorized=False)
    there = [call for call in calls if call[0] == NEW]
    assert len(there) == len(set(there)) == result.runs_by_stage["questions"] > 0
    assert result.runs == len(set(calls))
    calls.clear()
    spent = found(counting, EVENT, SHARE, vectorized=False, budget=Budget(runs=result.runs))
    assert [answer.status for answer in spent.answers] == ["failed", "solved"]
    assert "budget" in spent.answers[0].reason
    assert not [call for call in calls if call[0] == NEW]


def test_an_answer_stands_beside_what_was_measured_under_its_conditions() -> None:
    own = table()
    heavy = own["way"][own["load"] == TESTED].to_numpy()
    at = {"load": TESTED}
    event = OutcomeQuestion(probability="2.7 < way < 3.3", at=at)
    limits = OutcomeQuestion(tolerance=(0.5, 0.5), at=at)
    result = found(way, event, limits, replace(event, noise=False), EVENT, SHARE, vectorized=True)
    of_event, of_limits, *others = result.answers
    inside = int(np.sum((heavy > 2.7) & (heavy < 3.3)))
    assert 0 < inside < 15
    assert of_event.measured == MeasuredThere(15, inside, 0)
    within = (heavy >= of_limits.lower) & (heavy <= of_limits.upper)
    assert of_limits.measured == MeasuredThere(15, int(within.sum()), 0)
    # A true value and a parameter are not measured, and nothing was under the load 5.
    assert [one.measured for one in others] == [None, None, None]
    assert f"it did in {inside} of 15 values measured" in " ".join(repr(result).split())


def said(outcome: str = "way", **entry: Any) -> str:
    answer = vars(OutcomeAnswer("way", {"load": 5.0}, True, **entry))
    document = {"alpha": {}, "experiments": [], "units": {"way": "mm"}, "answers": [answer]}
    (sentence,) = findings({"outcome": outcome, **document})
    return str(sentence)


def test_the_sentences_of_answers() -> None:
    share = {"probability": 0.5, "lower": 0.25, "upper": 0.875}
    for event, words in {
        "way > 6": "exceeds 6 mm", "way >= 6": "is at least 6 mm", "way < 6": "is below 6 mm",
        "way <= 6": "is at most 6 mm", "2 < way <= 6": "lies between 2 and 6 mm",
    }.items():  # fmt: skip
        assert said(event=event, **share) == (
            f"At load 5: way {words} in 50 % of experiments (mean over the plausible laws; 95 % "
            "interval 25 to 88 %)."
        )
    rare = said(event="way > 6", probability=2.5e-5, lower=1e-6, upper=0.02)
    assert "with probability 2.50e-05 (mean over the plausible laws; 95 % interval 1.00e-06" in rare
    assert "in 4.0 % of experiments." in said(event="way > 6", probability=0.04)
    # All experiments have one value of a constant: no share of them exceeds a number.
    assert "with probability 0.5 " in said(outcome="load", event="way > 6", **share)
    assert "more runs" in said(event="way > 6", status="unsettled", **share)
    seen = {"values": 8, "inside": 3, "open": 2}
    assert "it did in 3 of 8 values measured under these conditions, and bounds leave 2" in said(
        event="way > 6", measured=seen, **share
    )
    assert said(content=0.95, confidence=0.9, lower=1.0, upper=2.0) == (
        "At load 5: way of 95 % of experiments lies between 1 and 2 mm (90 % confidence)."
    )
