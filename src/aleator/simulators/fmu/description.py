"""What an FMU says of itself, and whether it can be run here."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

from aleator.errors import SimulatorError, nearest

Kind = Literal["co_simulation", "model_exchange"]

REALS = frozenset({"Real", "Float64", "Float32"})
INTEGERS = frozenset(
    {"Integer", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))}
)
NUMBERS = REALS | INTEGERS | {"Boolean", "Enumeration"}
INTERFACES: dict[Kind, str] = {"co_simulation": "CoSimulation", "model_exchange": "ModelExchange"}
DEFAULT_POINTS = 500  #: communication points where neither the user nor the FMU gives a step


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU as its model description has it; `items` are those of an enumeration.

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
        """Whether a value can be given to it before the FMU is initialized."""
        if self.variability == "constant" or not self.scalar:
            return False
        started = self.causality in ("local", "output") and self.initial == "exact"
        return self.causality in ("parameter", "input") or started

    @property
    def recordable(self) -> bool:
        """Whether it is a number whose values over time can be taken."""
        return self.scalar and self.type in NUMBERS and self.name != "time"


@dataclass(frozen=True)
class Description:
    """An FMU's version, interfaces, defaults and variables by name.

    `fixed_step` is true if the FMU cannot end a co-simulation on another than a whole step;
    `internal_step` (s) is that of the solver inside, where the FMU tells it.
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
        """The variable of this name; raises SimulatorError, with the nearest, if there is none."""
        if name in self.variables:
            return self.variables[name]
        raise SimulatorError(
            f"{what}: the FMU {self.file.name} has no variable '{name}'"
            f"{nearest(name, self.variables)}",
            f"name one of its {len(self.variables)} variables, such as {self._some()}",
        )

    def outputs(self) -> tuple[str, ...]:
        """The names of outputs that are numbers."""
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
    fmpy = imported_fmpy()
    _check_file(file)
    try:
        version = _version(file)
        _check_version(file, version)
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


def imported_fmpy() -> Any:
    """The package FMPy. Raises SimulatorError if it is not installed."""
    try:
        import fmpy
    except ImportError as error:
        raise SimulatorError(
            f"a simulator that is an FMU needs the package FMPy: {error}",
            "pip install fmpy",
        ) from error
    return fmpy


def _check_file(file: Path) -> None:
    if not file.is_file():
        folder = file.parent
        names = sorted(p.name for p in folder.glob("*.fmu")) if folder.is_dir() else []
        raise SimulatorError(
            f"the simulator's file {file} does not exist{nearest(file.name, names)}",
            "name the FMU relative to the study file",
        )
    if zipfile.is_zipfile(file):
        with zipfile.ZipFile(file) as archive:
            if "modelDescription.xml" in archive.namelist():
                return
    raise SimulatorError(
        f"{file} is not an FMU: an FMU is a zip file with a modelDescription.xml at its top",
        "name the .fmu file that the modeling tool exported",
    )


def _version(file: Path) -> str:
    with zipfile.ZipFile(file) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    return root.get("fmiVersion", "unknown")


def _check_version(file: Path, version: str) -> None:
    if version != "2.0" and not version.startswith("3.0"):
        raise SimulatorError(
            f"{file}: this FMU is of FMI {version}", "export it as FMI 2.0 or FMI 3.0"
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
    """The start value of a real number; None where there is none."""
    try:
        return float(raw.start) if raw.type in REALS and raw.start is not None else None
    except ValueError:
        return None  # an array has several


def _number(text: Any) -> float | None:
    return None if text is None else float(text)
