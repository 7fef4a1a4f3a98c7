"""Events in a user's words: what a sentence means, and which sentences are refused."""

import numpy as np
import pytest

from aleator.errors import InputsError
from aleator.inference.outcome_event import OutcomeEvent
from aleator.observations.responses import Transform

OUTCOMES = ["travel", "shifting time", "3dB point"]
UNITS = {"travel": "mm", "shifting time": "s"}


@pytest.mark.parametrize(
    ("sentence", "outcome", "inside", "outside"),
    [
        ("travel > 26", "travel", [26.1, 1e9], [26.0, 25.9, -1e9]),
        ("travel > 1234567.5", "travel", [1234567.6], [1234567.5]),
        ("26<travel", "travel", [26.1], [26.0]),
        ("travel >= 26", "travel", [26.0], [25.999]),
        ("travel < -2.6e1 mm", "travel", [-26.1], [-26.0, 0.0]),
        ("26 >= travel", "travel", [26.0, -1.0], [26.001]),
        ("20 < travel < 26", "travel", [20.1, 25.9], [20.0, 26.0]),
        ("26mm >= travel > 20", "travel", [26.0], [20.0, 27.0]),
        ("travel [mm] > .5", "travel", [0.6], [0.5]),
        ("shifting time > 1 s", "shifting time", [1.1], [1.0]),
        ("3dB point < 2", "3dB point", [1.9], [2.0]),
    ],
)
def test_a_sentence_is_its_set_of_outcomes(
    sentence: str, outcome: str, inside: list[float], outside: list[float]
) -> None:
    asked = OutcomeEvent.of(sentence, OUTCOMES, UNITS)
    assert asked.outcome == outcome
    event = asked.on(Transform.NONE)
    assert event.holds(np.array(inside)).all()
    assert not event.holds(np.array(outside)).any()
    assert OutcomeEvent.of(str(asked), OUTCOMES) == asked


def test_a_parameter_has_events_too_and_an_outcome_comes_first() -> None:
    asked = OutcomeEvent.of("gap [um] > 15 um", OUTCOMES, {"gap": "um"}, ["gap", "travel"])
    assert (asked.outcome, asked.low) == ("gap", 15.0)
    assert OutcomeEvent.of("travel > 1", OUTCOMES, {}, ["travel"]).outcome == "travel"
    with pytest.raises(InputsError, match="did you mean 'gap'"):
        OutcomeEvent.of("gp > 15", OUTCOMES, UNITS, ["gap"])


def test_ends_follow_the_transform() -> None:
    asked = OutcomeEvent.of("1 <= travel < 10", OUTCOMES)
    event, y = asked.on(Transform.LOG), np.log([0.999, 1.0, 9.999, 10.0])
    assert event.holds(y).tolist() == [False, True, True, False]
    with pytest.raises(InputsError, match="logarithm"):
        OutcomeEvent.of("travel > 0", OUTCOMES).on(Transform.LOG)


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("travel", "comparison"),
        ("", "comparison"),
        ("travel = 26", "comparison"),
        ("10 < 20 < travel < 26", "comparison"),
        ("travl > 26", "did you mean 'travel'"),
        ("26 < 30", "no outcome '30'"),
        ("P(travel > 26)", "no outcome"),
        ("travel > 26 and travel < 30", "no outcome"),
        ("26 < travel > 20", "one range"),
        ("30 < travel < 20", "nothing lies between"),
        ("travel > 26 cm", "the unit of travel is mm"),
        ("3dB point > 2 dB", "has no unit"),
        ("travel > 2,6", "decimal point"),
        ("travel > limit", "no number"),
        ("travel > nan", "no number"),
        ("travel > 1e999", "no number"),
        ("travel > __import__('os')", "no number"),
        (26.0, "not a text"),
    ],
)
def test_any_other_sentence_is_refused_with_a_right_one(sentence: str, told: str) -> None:
    with pytest.raises(InputsError) as caught:
        OutcomeEvent.of(sentence, OUTCOMES, UNITS)
    assert told in str(caught.value)
    assert caught.value.remedy
