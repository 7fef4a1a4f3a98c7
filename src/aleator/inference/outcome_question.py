"""A question about a new experiment: the probability of an event, or tolerance limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from aleator.errors import InputsError, described, nearest
from aleator.inference.outcome_event import OutcomeEvent
from aleator.laws.inputs import Inputs
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.noise import Noise
from aleator.observations.responses import Response


@dataclass(frozen=True)
class Tolerance:
    """The definition of a tolerance interval or of a one-sided tolerance limit.

    The share `content` of all outcomes lies inside with this `confidence`. The `side` is "both" for
    two limits, "upper" for outcomes below one limit, or "lower" for outcomes above one. Raises
    InputsError for another side, and for shares that are not between zero and one.
    """

    content: float = 0.95
    confidence: float = 0.95
    side: str = "both"

    def __post_init__(self) -> None:
        for name, value in (("content", self.content), ("confidence", self.confidence)):
            if not (isinstance(value, Real) and 0.0 < value < 1.0):
                raise InputsError(
                    f"{name} = {described(value)} of tolerance limits is no share between 0 and 1",
                    "write the content, then the confidence, such as 0.95 and 0.90",
                )
        if self.side not in ("both", "upper", "lower"):
            raise InputsError(f"side '{self.side}'", 'it is "both", "upper" or "lower"')


@dataclass(frozen=True, kw_only=True)
class OutcomeQuestion:
    """A question about a new experiment, which `identify` answers with the law.

    It is about one of two things. `probability` is an event of an outcome or of a parameter, such
    as "travel > 26" or "20 < travel < 26 mm": asked is P(event) of a new experiment
    (`Identification.probability`).
    `tolerance` are a content and a confidence, such as (0.95, 0.90): asked are two limits that hold
    this share of all outcomes with this confidence, or with `side` "upper" or "lower" one limit, of
    one `outcome` or of all (`Identification.tolerance`). `at` has the value of each condition of
    the experiment by name, or is `Conditions` of one row. With `noise` the question is about the
    measured value, without about the true one. An event of a parameter has no noise, and takes of
    the conditions only those that its law follows.

    Raises InputsError unless exactly one of the two is asked, and for shares that are not between 0
    and 1. Cost: the runs of one response surface under these conditions, and for a probability at
    least `Exploration.runs` more; none where the simulator takes arrays, or for a parameter.

    >>> OutcomeQuestion(probability="travel > 26", at={"force": 50.0}).limits is None
    True
    >>> OutcomeQuestion(tolerance=(0.95, 0.9), side="upper").limits
    Tolerance(content=0.95, confidence=0.9, side='upper')
    """

    probability: str | None = None
    tolerance: tuple[float, float] | None = None
    at: Mapping[str, Any] | Conditions = field(default_factory=dict)
    side: str = "both"
    outcome: str | None = None
    noise: bool = True

    def __post_init__(self) -> None:
        if (self.probability is None) == (self.tolerance is None):
            raise InputsError(
                f"a question has {'no' if self.tolerance is None else 'both'} probability and "
                f"{'no ' if self.tolerance is None else ''}tolerance",
                'ask one of the two: probability = "OUTCOME > 26", or tolerance = [0.95, 0.90]',
            )
        if self.tolerance is None and (self.side != "both" or self.outcome is not None):
            raise InputsError(
                "side and outcome say which tolerance limits are meant, and a probability is asked",
                "leave them out, or ask for tolerance = [0.95, 0.90]",
            )
        if not isinstance(self.at, Mapping | Conditions):
            raise InputsError(
                f"at is {described(self.at)}, not the value of each condition by name",
                'write at = {"pressure": 200.0}, and a question for each further value',
            )
        if isinstance(self.at, Mapping):
            for name, value in self.at.items():
                if not isinstance(value, str) and hasattr(value, "__len__"):
                    raise InputsError(
                        f"at: '{name}' is {described(value)}",
                        "give it one value, and write a question for each further value",
                    )
        _ = self.limits

    @property
    def limits(self) -> Tolerance | None:
        """The tolerance limits that are asked for, or None."""
        if self.tolerance is None:
            return None
        try:
            content, confidence = self.tolerance
        except (TypeError, ValueError):
            raise InputsError(
                f"tolerance is {described(self.tolerance)}, not two shares",
                "write tolerance = [0.95, 0.90]: the content, then the confidence",
            ) from None
        return Tolerance(content, confidence, self.side)

    def event(
        self, responses: Sequence[Response], units: Mapping[str, str], parameters: Sequence[str]
    ) -> OutcomeEvent | None:
        """The event that is asked for, of a response or of a parameter; None for limits.

        Raises InputsError unless the event, or the outcome of limits, is one of these.
        """
        names = [response.name for response in responses]
        if self.probability is not None:
            event = OutcomeEvent.of(self.probability, names, units, parameters)
            if event.outcome in names:
                event.on(responses[names.index(event.outcome)].transform)
            return event
        if self.outcome is not None and self.outcome not in names:
            raise InputsError(
                f"there is no outcome '{self.outcome}'{nearest(self.outcome, names)}",
                f"the outcomes are {', '.join(names)}",
            )
        return None


def require_laws_at(
    conditions: Conditions,
    inputs: Inputs,
    table: Experiments,
    noise: Noise | Mapping[str, Noise] | None,
) -> None:
    """Raise AleatorError unless the laws and the noise are known under new conditions.

    A column that a law or the noise follows may be missing, and an entry may be one that no
    experiment in the `table` had.
    """
    if noise is not None:
        MeasurementErrors.of(noise, conditions)
    if inputs.regressed:
        known = inputs.resolved(covariates(table, inputs.columns))
        known.resolved(covariates(conditions, inputs.covariates))
