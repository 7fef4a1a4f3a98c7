"""`[simulator]` in study.toml: which kind of simulator it is, and what it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from aleator.errors import nearest
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
from aleator.simulators.fmu import Course, FMUSimulator, Operation
from aleator.simulators.fmu.description import read_description
from aleator.study.fmu import Inputs, Outcome, signals
from aleator.study.keys import Section, fault

# The key that tells each kind of simulator, as the file writes it.
_KINDS = {
    "function": 'function = "model.py:name"',
    "command": 'command = ["./program", "{parameter}"]',
    "fmu": 'fmu = "model.fmu"',
}


class KindSection(Section):
    """Keys of every kind of simulator.

    `store` is the file of its runs, `retries` how often a failed run is tried again, `max_failed`
    the share of failed runs that stops a study.
    """

    store: str = "runs.sqlite"
    retries: Annotated[int, Field(ge=0)] = 0
    max_failed: Annotated[float, Field(ge=0.0, le=1.0)] = MAX_FAILED


class FunctionSection(KindSection):
    """`function = ...`: a Python function."""

    key: ClassVar[str] = "simulator.function"

    function: str
    vectorized: bool = False
    version: str = ""
    block: Annotated[int, Field(ge=1)] | None = None

    def build(self, folder: Path) -> Simulator:
        """The library's simulator; `folder` is the study's."""
        return FunctionSimulator.named(
            self.function, folder, self.vectorized, self.version, self.block
        )


# Of each way to find a program's outcome: the library's choice, and the keys beside the way's own.
_OUTPUTS: dict[str, tuple[Callable[..., Output], tuple[str, ...]]] = {
    "regex": (RegexOutput, ("file", "match")),
    "column": (CsvOutput, ("file", "row", "delimiter", "skip")),
    "path": (JsonOutput, ("file",)),
    "hook": (HookOutput, ()),
}


class OutputSection(Section):
    """`output = {...}`: where a program's outcome is."""

    file: str = "stdout"
    regex: str | None = None
    match: int = -1
    column: Annotated[
        Annotated[int, Tag("int")] | Annotated[str | None, Tag("text")],
        Discriminator(lambda value: "int" if isinstance(value, int) else "text"),
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
        """The library's choice."""
        if self.hook is not None:
            return HookOutput(self.hook, folder)
        way = next((way for way in _OUTPUTS if way in self.model_fields_set), None)
        return (_OUTPUTS[way][0] if way else OutputFile)(**self.given())


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _file(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


_FEEDS: dict[str, Feed] = {"json": JsonFeed(), "csv": CsvFeed()}
_Names = Annotated[list[str], BeforeValidator(_listed)]
_Command = Annotated[
    Annotated[str, Tag("text")] | Annotated[list[str], Tag("list")],
    Discriminator(lambda value: "text" if isinstance(value, str) else "list"),
]


class CommandSection(KindSection):
    """`command = ...`: an external program, started once a run."""

    key: ClassVar[str] = "simulator"

    command: _Command
    template: _Names = Field(default_factory=list)
    input: _Names = Field(default_factory=list)
    delimiters: list[str] = Field(["{", "}"], min_length=2, max_length=2)
    stdin: str | None = None
    environment: dict[str, str] = Field(default_factory=dict)
    output: Annotated[OutputSection, BeforeValidator(_file)] = OutputSection()
    files: _Names = Field(default_factory=list)
    link: bool = False
    shell: bool = False
    success_codes: list[int] = Field([0])
    timeout: float | None = None
    keep: Literal["failed", "all", "none"] = "failed"
    version: str = ""
    allow_unused: bool = False

    @model_validator(mode="after")
    def _inputs_are_made(self) -> Self:
        if len(self.template) != len(self.input):
            raise fault(
                f"{len(self.template)} of template, {len(self.input)} of input",
                "each template is written as one input: template = ..., input = ...",
            )
        return self

    def build(self, folder: Path) -> Simulator:
        """The library's simulator; `folder` is the study's."""
        marks = Delimiters(*self.delimiters)
        named = zip(self.input, self.template, strict=True)
        plain = ("shell", "link", "timeout", "version", "allow_unused", "environment")
        return CommandSimulator(
            self.command,
            output=self.output.build(folder),
            base=folder,
            inputs=tuple(InputFile(name, Template(folder / file, marks)) for name, file in named),
            stdin=self._standard_input(folder, marks),
            files=tuple(self.files),
            success_codes=tuple(self.success_codes),
            keep=Keep(self.keep),
            **{key: getattr(self, key) for key in plain},
        )

    def _standard_input(self, folder: Path, marks: Delimiters) -> Feed | None:
        if self.stdin is None:
            return None
        return _FEEDS.get(self.stdin) or Template(folder / self.stdin, marks)


class FMUSection(KindSection):
    """`fmu = ...`: a Functional Mock-up Unit."""

    key: ClassVar[str] = "simulator"

    fmu: str
    outcome: Outcome
    start_time: float | None = None
    stop_time: float | None = None
    step: float | None = None
    kind: Literal["co_simulation", "model_exchange"] | None = None
    tolerance: float | None = None
    variables: dict[str, str] = Field(default_factory=dict)
    constants: dict[str, Any] = Field(default_factory=dict)
    inputs: Inputs = Field(default_factory=dict)
    reuse: Literal["reset", "recreate"] = "reset"
    recycle: int = 1000
    timeout: float | None = None
    isolated: bool = True
    version: str = ""

    def build(self, folder: Path) -> Simulator:
        """The library's simulator; `folder` is the study's."""
        course = Course(self.start_time, self.stop_time, self.step, self.kind, self.tolerance)
        file = folder / self.fmu
        return FMUSimulator(
            file,
            self.outcome.build(folder),
            course=course,
            variables=self.variables,
            constants=self.constants,
            inputs=signals(self.inputs, folder, read_description(file)),
            operation=Operation(self.reuse, self.recycle, self.timeout, self.isolated),
            version=self.version,
        )


def _one_kind(value: Any) -> Any:
    """The table as it is, if exactly one key says what kind of simulator it is."""
    if not isinstance(value, Mapping):
        return value
    chosen = [kind for kind in _KINDS if kind in value]
    if len(chosen) == 1:
        return value
    if chosen:
        raise fault(f"{' and '.join(chosen)} are both given", "keep one of them")
    meant = "".join(filter(None, (nearest(key, _KINDS) for key in map(str, value))))
    raise fault(f"it names no simulator{meant}", f"write one of {'; '.join(_KINDS.values())}")


def _kind(value: Any) -> str:
    # A tag must not look like a key of the file: messages leave it out of a key's path.
    return next((f"[{kind}]" for kind in _KINDS if kind in value), "[function]")


SimulatorSection = Annotated[
    Annotated[FunctionSection, Tag("[function]")]
    | Annotated[CommandSection, Tag("[command]")]
    | Annotated[FMUSection, Tag("[fmu]")],
    Discriminator(_kind),
    BeforeValidator(_one_kind),
]
"""`[simulator]`: exactly one kind of simulator."""
