"""The section `[simulator]` of study.toml: a Python function, a program, an FMU or a server."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from aleator.errors import StudyError
from aleator.simulators import MAX_FAILED, FunctionSimulator, Simulator
from aleator.simulators.command import (
    CommandSimulator,
    CsvFeed,
    CsvOutput,
    Delimiters,
    Feed,
    HookOutput,
    InputFile,
    JsonFeed,
    JsonOutput,
    Keep,
    Output,
    OutputFile,
    RegexOutput,
    Template,
)
from aleator.simulators.fmu import (
    Course,
    Crossing,
    Extreme,
    Final,
    FMUSimulator,
    Hook,
    Operation,
    Reduction,
    Signal,
    read_signal,
)
from aleator.simulators.fmu.description import Description, read_description
from aleator.simulators.fmu.settings import columns_of
from aleator.simulators.surroundings import STOP_ON
from aleator.simulators.umbridge import UMBridgeSimulator
from aleator.study.kinds import BY_FORM, Kinds, Section, fault

_CROSSING = ("value", "direction", "after", "interpolation")


class OutcomeSection(Section):
    """`outcome = {...}` of an FMU: a variable and how it becomes a number, or a function."""

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
        """The rule that reduces a simulation to its outcome; `folder` is the study's folder."""
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
    """Whether a table `outcome` holds an outcome for each response, or the keys of one outcome."""
    if not isinstance(value, Mapping) or not value:
        return "one"
    tables = all(isinstance(each, (Mapping, OutcomeSection)) for each in value.values())
    return "several" if tables or not {*value} & {*OutcomeSection.model_fields} else "one"


_FmuOutcome = Annotated[
    OutcomeSection, BeforeValidator(_written, json_schema_input_type=OutcomeSection | str)
]
FmuOutcome = Annotated[
    Annotated[_FmuOutcome, Tag("one")] | Annotated[dict[str, _FmuOutcome], Tag("several")],
    Discriminator(_several),
]
"""The type of the key `outcome`: `"variable"`, `"module.py:function"` or a table `{...}`.

A study with several responses has a table with one of these for each response.
"""


def reductions(
    outcome: OutcomeSection | Mapping[str, OutcomeSection], folder: Path
) -> Reduction | dict[str, Reduction]:
    """The rules that reduce a simulation to the outcome, or to that of each response by name."""
    if isinstance(outcome, OutcomeSection):
        return outcome.build(folder)
    return {response: each.build(folder) for response, each in outcome.items()}


FmuTime = Annotated[
    Annotated[float, Tag("number")] | Annotated[str, Tag("text")],
    BY_FORM,
]
"""The type of a key for a time: seconds, or the name of the condition that has the seconds."""


def _named(value: Any) -> Any:
    return {"*": value} if isinstance(value, str) else value


FmuInputs = Annotated[
    dict[str, str], BeforeValidator(_named, json_schema_input_type=dict[str, str] | str)
]
"""The type of the key `inputs`: `{variable = "file.csv:column"}`, or the name of a file.

The file has a column of values over time for each input.
"""


def signals(section: Mapping[str, str], folder: Path, fmu: Description) -> dict[str, Signal]:
    """The inputs of an FMU over time, by variable; `folder` is the folder of the study.

    Raises SimulatorError for a file or a column that cannot be read.
    """
    if "*" in section:
        file = section["*"]
        section = dict.fromkeys(columns_of(folder / file, fmu), file)
    return {name: read_signal(reference, folder, name) for name, reference in section.items()}


class RunsSection(Section):
    """Keys of every kind of simulator.

    `store` is the file that keeps the runs, `retries` is how often a failed run is repeated, and
    `max_failed` is the share of failed runs above which a study stops.
    """

    store: str = "runs.sqlite"
    retries: Annotated[int, Field(ge=0)] = 0
    max_failed: Annotated[float, Field(ge=0.0, le=1.0)] = MAX_FAILED


def function(
    function: str,
    folder: Path,
    vectorized: bool | None = None,
    version: str = "",
    block: Annotated[int, Field(ge=1)] | None = None,
    series: bool = False,
    timeout: float | None = None,
    jac: bool = False,
) -> FunctionSimulator:
    """A simulator that is a Python function, "file.py:name" relative to the study's folder."""
    options = (vectorized, version, block, series, timeout, jac)
    return FunctionSimulator.named(function, folder, *options)


# The ways to read the outcome of a program: the key of each way, its class and its further keys.
_OUTPUTS: dict[str, tuple[Callable[..., Output], tuple[str, ...]]] = {
    "regex": (RegexOutput, ("file", "match")),
    "column": (CsvOutput, ("file", "row", "delimiter", "skip")),
    "path": (JsonOutput, ("file",)),
    "hook": (HookOutput, ()),
}


class OutputSection(Section):
    """`output = {...}`: where a program writes its outcome, and how the outcome is read."""

    file: str = "stdout"
    regex: str | None = None
    match: int = -1
    column: Annotated[
        Annotated[int, Tag("number")] | Annotated[str | None, Tag("text")],
        BY_FORM,
    ] = None
    row: int = -1
    delimiter: str = ","
    skip: int = 0
    path: str | None = None
    hook: str | None = None

    @model_validator(mode="after")
    def _keys_are_used(self) -> Self:
        ways = [way for way in _OUTPUTS if way in self.model_fields_set]
        if len(ways) > 1:
            raise fault(f"{' and '.join(ways)} are both given", "keep one of them")
        own = {ways[0], *_OUTPUTS[ways[0]][1]} if ways else {"file"}
        for key in sorted(self.model_fields_set - own):
            owners = [way for way, (_, keys) in _OUTPUTS.items() if key in keys]
            raise fault(
                f"{key} has no meaning {f'beside {ways[0]}' if ways else 'by itself'}",
                f"delete the key, or write {' or '.join(owners)}",
            )
        return self

    def build(self, folder: Path) -> Output:
        """The reader of the outcome, by the keys that the section states."""
        if self.hook is not None:
            return HookOutput(self.hook, folder)
        way = next((way for way in _OUTPUTS if way in self.model_fields_set), None)
        return (_OUTPUTS[way][0] if way else OutputFile)(**self.stated())


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _has_sections(value: Any) -> bool:
    """Whether a table `output` holds a table for each response."""
    return isinstance(value, dict) and any(isinstance(v, (dict, Section)) for v in value.values())


def _file(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


_FEEDS: dict[str, Feed] = {"json": JsonFeed(), "csv": CsvFeed()}
_Output = Annotated[
    OutputSection, BeforeValidator(_file, json_schema_input_type=OutputSection | str)
]
_STDOUT = OutputSection()
_Outputs = Annotated[
    Annotated[_Output, Tag("one")] | Annotated[dict[str, OutputSection], Tag("responses")],
    Discriminator(lambda value: "responses" if _has_sections(value) else "one"),
]
_Names = Annotated[
    Sequence[str], BeforeValidator(_listed, json_schema_input_type=Sequence[str] | str)
]
_Command = Annotated[
    Annotated[str, Tag("text")] | Annotated[list[str], Tag("list")],
    BY_FORM,
]


def command(
    command: _Command,
    folder: Path,
    template: _Names = (),
    input: _Names = (),
    delimiters: tuple[str, str] = ("{", "}"),
    stdin: str | None = None,
    environment: dict[str, str] | None = None,
    output: _Outputs = _STDOUT,
    files: _Names = (),
    link: bool = False,
    shell: bool = False,
    success_codes: tuple[int, ...] = (0,),
    timeout: float | None = None,
    stop_on: str = STOP_ON,
    keep: Literal["failed", "all", "none"] = "failed",
    version: str = "",
    allow_unused: bool = False,
    series: bool = False,
    rows: str = "rows.csv",
) -> CommandSimulator:
    """A simulator that is a program, started once for each run.

    Raises StudyError for keys that contradict each other.
    """
    outputs = output if isinstance(output, dict) else {"": output}
    for key in ("match", "row"):
        if series and any(key in one.model_fields_set for one in outputs.values()):
            raise StudyError(
                f"output: {key} has no meaning beside series = true: every row has a value",
                "delete the key",
            )
    if len(template) != len(input):
        raise StudyError(
            f"{len(template)} of template, {len(input)} of input",
            "each template is written as one input: template = ..., input = ...",
        )
    marks = Delimiters(*delimiters)
    named = zip(input, template, strict=True)
    return CommandSimulator(
        command,
        output={name: one.build(folder) for name, one in output.items()}
        if isinstance(output, dict)
        else output.build(folder),
        base=folder,
        inputs=tuple(InputFile(name, Template(folder / file, marks)) for name, file in named),
        stdin=None if stdin is None else _FEEDS.get(stdin) or Template(folder / stdin, marks),
        files=tuple(files),
        success_codes=success_codes,
        keep=Keep(keep),
        shell=shell,
        link=link,
        timeout=timeout,
        stop_on=stop_on,
        version=version,
        allow_unused=allow_unused,
        series=series,
        rows=rows,
        environment=environment or {},
    )


def fmu(
    fmu: Path,
    outcome: FmuOutcome,
    folder: Path,
    start_time: FmuTime | None = None,
    stop_time: FmuTime | None = None,
    step: float | None = None,
    kind: Literal["co_simulation", "model_exchange"] | None = None,
    tolerance: float | None = None,
    variables: dict[str, str] | None = None,
    constants: dict[str, Any] | None = None,
    inputs: FmuInputs | None = None,
    reuse: Literal["reset", "recreate"] = "reset",
    recycle: int = 1000,
    timeout: float | None = None,
    isolated: bool = True,
    stop_on: str = STOP_ON,
    version: str = "",
    series: bool = False,
    time: str | None = None,
) -> FMUSimulator:
    """A simulator that is a Functional Mock-up Unit, a model in the FMI standard.

    Raises StudyError for `time` without `series`.
    """
    if time is not None and not series:
        raise StudyError(
            f'time = "{time}" without series',
            f'write series = true, if one run serves a whole experiment; or stop_time = "{time}"',
        )
    return FMUSimulator(
        fmu,
        reductions(outcome, folder),
        course=Course(start_time, stop_time, step, kind, tolerance),
        variables=variables or {},
        constants=constants or {},
        inputs=signals(inputs or {}, folder, read_description(fmu)),
        operation=Operation(reuse, recycle, timeout, isolated, stop_on),
        version=version,
        series=series,
        time=time or "time",
    )


_Part = Annotated[Annotated[float, Tag("number")] | Annotated[str, Tag("text")], BY_FORM]
_Vector = Annotated[
    Annotated[float, Tag("number")]
    | Annotated[str, Tag("text")]
    | Annotated[list[_Part], Tag("list")],
    BY_FORM,
]
_Place = Annotated[Annotated[int, Tag("number")] | Annotated[list[int], Tag("list")], BY_FORM]
_Places = Annotated[
    Annotated[int, Tag("number")]
    | Annotated[list[int], Tag("list")]
    | Annotated[dict[str, _Place], Tag("table")],
    BY_FORM,
]


def umbridge(
    umbridge: str,
    model: str,
    inputs: list[_Vector],
    output: _Places = 0,
    config: dict[str, Any] | None = None,
    timeout: float | None = None,
    stop_on: str = STOP_ON,
    version: str = "",
    series: bool = False,
) -> UMBridgeSimulator:
    """A simulator that is a model of an UM-Bridge server."""
    return UMBridgeSimulator(
        umbridge, model, inputs, output, config or {}, timeout, stop_on, version, series
    )


SIMULATORS: Kinds[Simulator] = Kinds(
    "aleator.simulators",
    "",
    {"function": function, "command": command, "fmu": fmu, "umbridge": umbridge},
    common=RunsSection,
)
"""The kinds of simulator in `[simulator]`, each chosen by the key with its name."""
