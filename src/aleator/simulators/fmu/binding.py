"""Which variable of the FMU each condition and each parameter is, and what value it takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aleator.errors import SimulatorError, nearest
from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu.description import INTEGERS, REALS, Description, Variable

Value = float | int | bool | str


@dataclass(frozen=True, eq=False)
class Binding:
    """`names` maps conditions and parameters to variables; others have the variable's own name.

    `taken` are the variables that have a value otherwise: constants, and inputs over time. `times`
    are the conditions that say when a run begins or ends.

    Raises SimulatorError for variables that do not exist, cannot be set, or are given twice.
    """

    fmu: Description
    names: Mapping[str, str]
    taken: tuple[str, ...] = ()
    times: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, variable in self.names.items():
            settable(self.fmu.variable(variable, f"'{name}'"), f"'{name}'")
        twice = sorted({v for v in self.names.values() if [*self.names.values()].count(v) > 1})
        both = sorted(set(self.taken) & set(self.names.values()))
        if twice or both:
            raise SimulatorError(
                f"the FMU's variable '{(twice + both)[0]}' is given more than once",
                "keep one of variables, constants and inputs for it",
            )

    def variable(self, name: str) -> Variable:
        """The variable of a condition or parameter."""
        return self.fmu.variables[self.names.get(name, name)]

    def units(self, names: Sequence[str]) -> dict[str, str]:
        """The units of those of these names that are variables and have one."""
        known = {name: self.variable(name).unit for name in names if self._is_variable(name)}
        return {name: unit for name, unit in known.items() if unit}

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that are variables of the FMU. Raises SimulatorError, see Simulator.

        One that is also a time is a variable only if a value can be given to that.
        """
        for name in self.names:
            if name not in (*conditions, *parameters):
                raise SimulatorError(
                    f"'{name}' is mapped to the FMU's '{self.names[name]}', but is neither a "
                    f"condition nor a parameter{nearest(name, (*conditions, *parameters))}",
                    f"conditions: {', '.join(conditions) or 'none'}; "
                    f"parameters: {', '.join(parameters) or 'none'}",
                )
        for name in parameters:
            self._check_parameter(name)
        asked = tuple(name for name in conditions if self._is_variable(name))
        for name in asked:
            if name in parameters:
                raise SimulatorError(
                    f"'{name}' is both a condition and a parameter",
                    "rename the column or the parameter, or name the conditions without it",
                )
            self._check_free(name, "condition")
        return asked

    def values(self, cells: Mapping[str, Any]) -> dict[str, Value]:
        """Start values by variable of one run's conditions and parameters. Raises RunFailed."""
        return {
            self.names.get(name, name): start_value(self.variable(name), cell, f"{name} = {cell!r}")
            for name, cell in cells.items()
            if self._is_variable(name)
        }

    def told(self, names: Sequence[str]) -> str:
        """Conditions or parameters with the variable of each where its name differs, and its unit.

        >>> from pathlib import Path
        >>> k = Variable("spring.k", "Real", "parameter", "fixed", "exact", unit="N/mm")
        >>> fmu = Description(Path("a.fmu"), "2.0", (), {k.name: k}, None, None, None, None, False)
        >>> Binding(fmu, {"stiffness": "spring.k"}).told(["stiffness"])
        'stiffness = spring.k [N/mm]'
        """
        words = []
        for name in names:
            variable = self.variable(name)
            other = "" if variable.name == name else f" = {variable.name}"
            words.append(f"{name}{other}{f' [{variable.unit}]' if variable.unit else ''}")
        return ", ".join(words)

    def _is_variable(self, name: str) -> bool:
        variable = self.fmu.variables.get(self.names.get(name, name))
        return variable is not None and (name not in self.times or variable.settable)

    def _check_parameter(self, name: str) -> None:
        variable = self.names.get(name, name)
        if variable not in self.fmu.variables:
            raise SimulatorError(
                f"the FMU {self.fmu.file.name} has no variable for the parameter "
                f"'{name}'{nearest(name, self.fmu.variables)}",
                f'name it in the study: variables = {{{name} = "name in the FMU"}}',
            )
        self._check_free(name, "parameter")
        found = self.fmu.variables[variable]
        if found.type not in REALS:
            raise SimulatorError(
                f"the parameter '{name}' has a law, but the FMU's {found} takes no real numbers",
                "give it as a condition or a constant",
            )

    def _check_free(self, name: str, what: str) -> None:
        variable = self.fmu.variables[self.names.get(name, name)]
        settable(variable, f"the {what} '{name}'")
        others = {*self.taken, *(v for n, v in self.names.items() if n != name)}
        if variable.name in others:
            raise SimulatorError(
                f"the {what} '{name}': the FMU's variable {variable} is given already",
                "keep one of variables, constants and inputs for it",
            )


def settable(variable: Variable, what: str) -> Variable:
    """The variable, if a value can be given to it before a run. Raises SimulatorError if not."""
    if variable.settable:
        return variable
    if not variable.scalar:
        why = "is an array"
    elif variable.variability == "constant":
        why = "is constant"
    elif variable.causality == "independent":
        why = "is the time of the simulation"
    elif variable.initial == "approx":
        why = "is calculated by the FMU, from a value that is only a guess"
    else:
        why = "is calculated by the FMU"
    raise SimulatorError(
        f"{what}: a value is given to the FMU's variable {variable}, which {why}",
        "name a parameter, an input or a start value (initial = exact) of the FMU; a time of the "
        "experiment is named by stop_time, or in a series by time; a condition that is none of "
        "these is left out by naming the others in [experiments] conditions",
    )


def start_value(variable: Variable, cell: Any, what: str) -> Value:
    """A cell of a table as the variable's type. Raises RunFailed if it does not fit.

    >>> start_value(Variable("n", "Integer", "parameter", "fixed", "exact"), 3.0, "n")
    3
    """
    if variable.type == "String":
        return str(cell)
    if variable.type == "Boolean":
        return _boolean(variable, cell, what)
    if variable.type == "Enumeration" and cell in variable.items:
        return variable.items[cell]
    try:
        number = float(cell)
    except (TypeError, ValueError):
        raise RunFailed(f"{what} does not fit the FMU's {variable}{_items(variable)}") from None
    if not math.isfinite(number):
        raise RunFailed(f"{what} is not finite")
    for bound, beyond, word in (
        (variable.minimum, -1.0, "minimum"),
        (variable.maximum, 1.0, "maximum"),
    ):
        if bound is not None and beyond * (number - bound) > 0.0:
            raise RunFailed(f"{what} is beyond the {word} {bound:g} of the FMU's {variable}")
    if variable.type in INTEGERS or variable.type == "Enumeration":
        if number != round(number):
            raise RunFailed(f"{what} is not a whole number, as the FMU's {variable} is")
        return round(number)
    return number


def _boolean(variable: Variable, cell: Any, what: str) -> bool:
    words = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
    if str(cell).strip().lower() not in words:
        raise RunFailed(f"{what} is neither true nor false, as the FMU's {variable} is")
    return words[str(cell).strip().lower()]


def _items(variable: Variable) -> str:
    return f", whose items are {', '.join(variable.items)}" if variable.items else ""
