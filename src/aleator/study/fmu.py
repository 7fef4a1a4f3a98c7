"""What `[simulator] fmu = ...` has inside: the outcome of a trajectory, and inputs over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, model_validator

from aleator.simulators.fmu import Crossing, Extreme, Final, Hook, Reduction, Signal, read_signal
from aleator.simulators.fmu.description import Description
from aleator.simulators.fmu.signals import columns_of
from aleator.study.keys import Section, fault

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


def _function(value: Any) -> Any:
    return {"function": value} if isinstance(value, str) else value


Outcome = Annotated[OutcomeSection, BeforeValidator(_function)]
"""`outcome = {...}` or `outcome = "module.py:function"`."""


def _named(value: Any) -> Any:
    return {"*": value} if isinstance(value, str) else value


Inputs = Annotated[dict[str, str], BeforeValidator(_named)]
"""`inputs = {variable = "file.csv:column"}`, or a file with a column for every such input."""


def signals(section: Mapping[str, str], folder: Path, fmu: Description) -> dict[str, Signal]:
    """The inputs over time by variable. Raises SimulatorError, see `read_signal`."""
    if "*" in section:
        file = section["*"]
        section = dict.fromkeys(columns_of(folder / file, fmu), file)
    return {name: read_signal(reference, folder, name) for name, reference in section.items()}
