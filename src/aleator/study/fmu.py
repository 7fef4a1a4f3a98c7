"""What `[simulator] fmu = ...` has inside: the outcome of a trajectory, and inputs over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from aleator.simulators.fmu import Crossing, Extreme, Final, Hook, Reduction, Signal, read_signal
from aleator.simulators.fmu.description import Description
from aleator.simulators.fmu.settings import columns_of
from aleator.study.kinds import Section, fault

_CROSSING = ("value", "direction", "after", "interpolation")


class OutcomeSection(Section):
    """`outcome = {...}`: a variable and what is taken of it, or a Python function."""

    variable: str | None = None
    reduce: Literal["final", "maximum", "minimum", "crossing"] = "final"
    value: float = 0.0
    direction: Literal["down", "up", "any"] = "any"
    after: float = -math.inf
    interpolation: Literal["cubic", "linear"] = "cubic"
    function: str | None = None
    record: list[str] | None = None

    @model_validator(mode="after")
    def _keys_are_used(self) -> Self:
        if (self.variable is None) == (self.function is None):
            raise fault(
                "it needs either variable or function",
                'write {variable = "name", reduce = "final"}, or "module.py:function"',
            )
        own = {"function", "record"} if self.function else {"variable", "reduce"}
        own |= {*_CROSSING} if self.reduce == "crossing" else set()
        for key in sorted(self.model_fields_set - own):
            owner = 'reduce = "crossing"' if key in _CROSSING else "the other"
            raise fault(
                f"{key} has no meaning beside {'function' if self.function else self.reduce}",
                f"delete the key; it belongs to {owner}",
            )
        return self

    def build(self, folder: Path) -> Reduction:
        """The library's choice; `folder` is the study's."""
        if self.function is not None:
            return Hook(self.function, tuple(self.record or ()), str(folder))
        signal = str(self.variable)
        if self.reduce == "final":
            return Final(signal)
        if self.reduce != "crossing":
            return Extreme(signal, largest=self.reduce == "maximum")
        cubic = self.interpolation == "cubic"
        return Crossing(signal, self.value, self.direction, self.after, cubic)


def _written(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    return {"function" if ":" in value else "variable": value}


def _several(value: Any) -> str:
    """A table without any key of an outcome names responses; so does a table of tables."""
    if not isinstance(value, Mapping) or not value:
        return "one"
    tables = all(isinstance(each, (Mapping, OutcomeSection)) for each in value.values())
    return "several" if tables or not {*value} & {*OutcomeSection.model_fields} else "one"


_Outcome = Annotated[
    OutcomeSection, BeforeValidator(_written, json_schema_input_type=OutcomeSection | str)
]
Outcome = Annotated[
    Annotated[_Outcome, Tag("one")] | Annotated[dict[str, _Outcome], Tag("several")],
    Discriminator(_several),
]
"""`outcome = "variable"`, `"module.py:function"` or `{...}`; of several by response."""


def reductions(
    outcome: OutcomeSection | Mapping[str, OutcomeSection], folder: Path
) -> Reduction | dict[str, Reduction]:
    """The library's choice of each outcome; `folder` is the study's."""
    if isinstance(outcome, OutcomeSection):
        return outcome.build(folder)
    return {response: each.build(folder) for response, each in outcome.items()}


Time = Annotated[
    Annotated[float, Tag("number")] | Annotated[str, Tag("condition")],
    Discriminator(lambda value: "condition" if isinstance(value, str) else "number"),
]
"""A time in s, or the name of the condition that has it."""


def _named(value: Any) -> Any:
    return {"*": value} if isinstance(value, str) else value


Inputs = Annotated[
    dict[str, str], BeforeValidator(_named, json_schema_input_type=dict[str, str] | str)
]
"""`inputs = {variable = "file.csv:column"}`, or a file with a column for every such input."""


def signals(section: Mapping[str, str], folder: Path, fmu: Description) -> dict[str, Signal]:
    """The inputs over time by variable. Raises SimulatorError, see `read_signal`."""
    if "*" in section:
        file = section["*"]
        section = dict.fromkeys(columns_of(folder / file, fmu), file)
    return {name: read_signal(reference, folder, name) for name, reference in section.items()}
