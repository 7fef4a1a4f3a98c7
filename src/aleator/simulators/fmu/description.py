"""The model description of an FMU, and which of its variables conditions and parameters set."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

from aleator.errors import SimulatorError, nearest, setting
from aleator.simulators.protocol import RunFailed, name_lists, require_distinct, require_file

Kind = Literal["co_simulation", "model_exchange"]

REALS = frozenset({"Real", "Float64", "Float32"})
INTEGERS = frozenset(
    ["Integer", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64"]
)
NUMBERS = REALS | INTEGERS | {"Boolean", "Enumeration"}
INTERFACES: dict[Kind, str] = {"co_simulation": "CoSimulation", "model_exchange": "ModelExchange"}


@dataclass(frozen=True)
class Variable:
    """One variable in the model description of an FMU; `items` are the values of an enumeration.

    >>> str(Variable("k", "Real", "parameter", "fixed", "exact", unit="N/mm"))
    "'k' (parameter, fixed Real in N/mm)"
    """

    name: str
    type: str
    causality: str
    variability: str
    initial: str | None
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    items: Mapping[str, int] = field(default_factory=dict)
    scalar: bool = True
    description: str = ""
    start: float | None = None

    def __str__(self) -> str:
        unit = f" in {self.unit}" if self.unit else ""
        return f"'{self.name}' ({self.causality}, {self.variability} {self.type}{unit})"

    @property
    def settable(self) -> bool:
        """Whether the variable can be given a value before the FMU is initialized."""
        if self.variability == "constant" or not self.scalar:
            return False
        started = self.causality in ("local", "output") and self.initial == "exact"
        return self.causality in ("parameter", "input") or started

    @property
    def recordable(self) -> bool:
        """Whether the variable is a number whose values over time can be recorded."""
        return self.scalar and self.type in NUMBERS and self.name != "time"


@dataclass(frozen=True)
class Description:
    """The model description of an FMU: version, interfaces, defaults, and variables by name.

    `fixed_step` is true if all steps of a co-simulation must have one length. `internal_step` (s)
    is the step of the solver inside the FMU, or None if the FMU does not state it.
    """

    file: Path
    version: str
    kinds: tuple[Kind, ...]
    variables: Mapping[str, Variable]
    start_time: float | None
    stop_time: float | None
    step: float | None
    tolerance: float | None
    fixed_step: bool
    internal_step: float | None = None

    def variable(self, name: str, what: str) -> Variable:
        """The variable of this name. If there is none, SimulatorError suggests a similar one."""
        if name in self.variables:
            return self.variables[name]
        raise SimulatorError(
            f"{what}: the FMU {self.file.name} has no variable '{name}'"
            f"{nearest(name, self.variables)}",
            f"name one of its {len(self.variables)} variables, such as {self._some()}",
        )

    def outputs(self) -> tuple[str, ...]:
        """The names of the FMU's outputs that are numbers."""
        return tuple(
            v.name for v in self.variables.values() if v.causality == "output" and v.recordable
        )

    def _some(self) -> str:
        order = {"parameter": 0, "input": 1, "output": 2}
        chosen = sorted(self.variables.values(), key=lambda v: order.get(v.causality, 3))
        return ", ".join(v.name for v in chosen[:8]) or "none"


def read_description(file: Path) -> Description:
    """Read and check the model description of an FMU; nothing of the FMU is executed.

    Raises SimulatorError if FMPy is missing, if the file does not exist or is no FMU, for FMI 1.0,
    and if there are no binaries for this platform.
    """
    try:
        import fmpy
    except ImportError as error:
        raise SimulatorError(
            f"a simulator that is an FMU needs the package FMPy: {error}", "pip install fmpy"
        ) from error
    require_file(file, f"the simulator's file {file}", "*.fmu")
    try:
        version = _version(file)
        if version != "2.0" and not version.startswith("3.0"):
            raise SimulatorError(
                f"{file}: this FMU is of FMI {version}", "export it as FMI 2.0 or FMI 3.0"
            )
        raw = fmpy.read_model_description(str(file), validate=False)
        platforms = fmpy.supported_platforms(str(file))
    except SimulatorError:
        raise
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise SimulatorError(
            f"{file}: the model description of this FMU cannot be read: {text:.200}",
            "export it anew, as FMI 2.0 or 3.0",
        ) from error
    kinds: tuple[Kind, ...] = (
        *(("co_simulation",) if raw.coSimulation else ()),
        *(("model_exchange",) if raw.modelExchange else ()),
    )
    if not kinds:
        raise SimulatorError(
            f"{file}: this FMU offers neither co-simulation nor model exchange",
            "export it for co-simulation",
        )
    _check_platform(file, platforms, fmpy.platform)
    return _described(file, version, kinds, raw)


def _version(file: Path) -> str:
    """The FMI version of an FMU. Raises SimulatorError for a file that is no FMU."""
    if zipfile.is_zipfile(file):
        with zipfile.ZipFile(file) as archive:
            if (name := "modelDescription.xml") in archive.namelist():
                return ElementTree.fromstring(archive.read(name)).get("fmiVersion", "unknown")
    raise SimulatorError(
        f"{file} is not an FMU: an FMU is a zip file with a modelDescription.xml at its top",
        "name the .fmu file that the modeling tool exported",
    )


def _check_platform(file: Path, platforms: list[str], here: str) -> None:
    if here in platforms:
        return
    compiled = [name for name in platforms if name != "c-code"]
    if not compiled and "c-code" in platforms:
        raise SimulatorError(
            f"{file}: this FMU has C sources, but no binaries",
            f"compile it on this machine: python -m fmpy compile {file.name}",
        )
    raise SimulatorError(
        f"{file}: this FMU has no binaries for {here}, only for {', '.join(compiled) or 'none'}",
        f"export it for {here}, or run Aleator where its binaries belong",
    )


def _described(file: Path, version: str, kinds: tuple[Kind, ...], raw: Any) -> Description:
    experiment, slave = raw.defaultExperiment, raw.coSimulation
    internal = _number(getattr(slave, "fixedInternalStepSize", None))
    varying = slave is not None and slave.canHandleVariableCommunicationStepSize
    return Description(
        file=file,
        version=version,
        kinds=kinds,
        variables={v.name: _variable(v) for v in raw.modelVariables},
        start_time=_number(getattr(experiment, "startTime", None)),
        stop_time=_number(getattr(experiment, "stopTime", None)),
        step=internal or _number(getattr(experiment, "stepSize", None)),
        tolerance=_number(getattr(experiment, "tolerance", None)),
        fixed_step=not varying,
        internal_step=internal,
    )


def _variable(raw: Any) -> Variable:
    declared = raw.declaredType
    items = getattr(declared, "items", None) or ()
    return Variable(
        name=raw.name,
        type=raw.type,
        causality=raw.causality,
        variability=raw.variability or "continuous",
        initial=raw.initial,
        unit=raw.unit or getattr(declared, "unit", None),
        minimum=_number(raw.min or getattr(declared, "min", None)),
        maximum=_number(raw.max or getattr(declared, "max", None)),
        items={item.name: int(item.value) for item in items},
        scalar=not raw.shape,
        description=raw.description or "",
        start=_start(raw),
    )


def _start(raw: Any) -> float | None:
    """The start value of a real variable; None if it has none."""
    try:
        return float(raw.start) if raw.type in REALS and raw.start is not None else None
    except ValueError:
        return None  # The variable is an array and has several start values.


def _number(text: Any) -> float | None:
    return None if text is None else float(text)


Value = float | int | bool | str


@dataclass(frozen=True, eq=False)
class Binding:
    """Which variable of the FMU each condition and parameter sets.

    `names` maps conditions and parameters to variables; others set the variable of the same name.
    `taken` are variables that have their value already: constants, and inputs over time. `times`
    are the conditions that are the start or stop time of a run.

    Raises SimulatorError for variables that do not exist, cannot be set, or are set twice.
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
        """The units of those conditions and parameters whose variable has a unit."""
        units = {name: self.variable(name).unit for name in names if self._is_variable(name)}
        return {name: unit for name, unit in units.items() if unit}

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that are variables of the FMU.

        A condition that is also a time counts only if its variable can be set. Raises
        SimulatorError as `Simulator.asks` does.
        """
        for name in self.names:
            if name not in (*conditions, *parameters):
                raise SimulatorError(
                    f"'{name}' is mapped to the FMU's '{self.names[name]}', but is neither a "
                    f"condition nor a parameter{nearest(name, (*conditions, *parameters))}",
                    name_lists(conditions, parameters),
                )
        for name in parameters:
            self._check_parameter(name)
        asked = tuple(name for name in conditions if self._is_variable(name))
        require_distinct(self.fmu.file.name, asked, parameters)
        for name in asked:
            self._check_free(name, "condition")
        return asked

    def values(self, cells: Mapping[str, Any]) -> dict[str, Value]:
        """Start values by variable, for one run's conditions and parameters. Raises RunFailed."""
        return {
            self.names.get(name, name): start_value(self.variable(name), cell, f"{name} = {cell!r}")
            for name, cell in cells.items()
            if self._is_variable(name)
        }

    def described(self, names: Sequence[str]) -> str:
        """Conditions or parameters as text, each with its variable (if named differently) and unit.

        >>> from pathlib import Path
        >>> k = Variable("spring.k", "Real", "parameter", "fixed", "exact", unit="N/mm")
        >>> fmu = Description(Path("a.fmu"), "2.0", (), {k.name: k}, None, None, None, None, False)
        >>> Binding(fmu, {"stiffness": "spring.k"}).described(["stiffness"])
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
    """The given variable. Raises SimulatorError if it cannot be given a value before a run."""
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
        "these is left out by naming the others: "
        + setting("[experiments] conditions", "Experiments.from_frame(..., conditions=[...])"),
    )


def start_value(variable: Variable, cell: Any, what: str) -> Value:
    """The value in a cell of a table, converted to the type of the variable.

    Raises RunFailed if it does not suit the variable.

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
