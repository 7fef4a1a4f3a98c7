"""An external program as a simulator."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.child import STDIN, Limits, log, run
from aleator.simulators.command.feeds import Feed, InputFile
from aleator.simulators.command.folder import Folder, Keep, contents
from aleator.simulators.command.outputs import Output, OutputFile
from aleator.simulators.command.placeholders import Text, Value, Values
from aleator.simulators.command.program import STUDY, Program
from aleator.simulators.failure import RunFailed
from aleator.simulators.protocol import Columns, Returned, one_by_one

# The placeholder for the name of the input file, where there is exactly one.
INPUT = "input"


@dataclass(frozen=True)
class CommandSimulator:
    """A program that is started once a run, in a private folder, and writes its outcome.

    `command`, `shell`, `environment`: see `Program`; placeholders are the names of conditions and
    parameters, `{study}` (the folder `base`) and `{input}` (the one input file). What the program
    reads: its arguments, its environment, the `inputs`, and `stdin`. `output` says where its
    outcome is. `files`, `link`, `keep`: see `Folder`. `timeout` is in seconds. `version` is a tag
    to change when something changes that is not seen here, so that no old runs are taken up. Every
    parameter must appear somewhere, unless `allow_unused`.

    It can be pickled and holds nothing open: `run_one` may be called in any process.

    Raises SimulatorError, before anything runs, for whatever is missing or wrong in these.
    Cost: besides the program itself some 2 ms a run, for its folder and its files.

    >>> add = CommandSimulator(["awk", "BEGIN {{print {load} / {stiffness}}}"])
    >>> add.asks(["load", "bench"], ["stiffness"])
    ('load',)
    >>> add.run_one({"load": 1.0}, {"stiffness": 4.0})
    0.25
    """

    command: Sequence[str] | str
    output: Output = field(default_factory=OutputFile)
    base: Path = Path(".")
    inputs: tuple[InputFile, ...] = ()
    stdin: Feed | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    link: bool = False
    shell: bool = False
    success_codes: tuple[int, ...] = (0,)
    timeout: float | None = None
    keep: Keep = Keep.FAILED
    version: str = ""
    allow_unused: bool = False
    program: Program = field(init=False, repr=False)
    folder: Folder = field(init=False, repr=False)
    # One run a call, so that progress is told after every run.
    block: int = field(default=1, init=False, repr=False)

    def __post_init__(self) -> None:
        folder = Folder(self.base, self.files, self.link, self.keep)
        program = Program(self.command, self.base, self.shell, self.environment)
        object.__setattr__(self, "folder", folder)
        object.__setattr__(self, "program", program)
        if self.timeout is not None and not 0 < self.timeout < np.inf:
            raise SimulatorError(
                f"timeout = {self.timeout:g} is no time", "give seconds, or leave it out: no limit"
            )
        if not self.success_codes:
            raise SimulatorError("success_codes is empty: every run would fail", "write [0]")
        taken = [path.name for path in folder.sources]
        for name in (file.name for file in self.inputs):
            if name in taken:
                raise SimulatorError(
                    f"'{name}' is written for every run, but is a file of the run already",
                    "give the input another name, or take it from the files",
                )
            taken.append(name)

    @property
    def name(self) -> str:
        """The program without its folder."""
        return self.program.name

    @property
    def description(self) -> str:
        """The command, as one text."""
        return self.command if isinstance(self.command, str) else shlex.join(self.command)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that have a placeholder, or all of them if JSON or CSV is written.

        Raises SimulatorError for a placeholder that is neither a condition nor a parameter, and
        for a parameter without one.
        """
        known = (*conditions, *parameters)
        own = self._own()
        used = self._used()
        everything = any(feed.names is None for feed in self._feeds())
        for name, where in used.items():
            if name in own and name in known:
                raise SimulatorError(
                    f"{where}: '{name}' stands for the {own[name]}, and is also the name of a "
                    "condition or a parameter",
                    "rename the column or the parameter",
                )
            if name not in own and name not in known:
                raise SimulatorError(
                    f"{where}: '{name}' is neither a condition nor a parameter"
                    f"{nearest(name, [*known, *own])}",
                    f"conditions: {', '.join(conditions) or 'none'}; "
                    f"parameters: {', '.join(parameters) or 'none'}; where no placeholder is "
                    "meant, double the braces in a command, or choose other delimiters for a file",
                )
        for name in parameters:
            if name not in used and not everything and not self.allow_unused:
                raise SimulatorError(
                    f"simulator '{self.name}' is never told the parameter '{name}'"
                    f"{nearest(name, used)}",
                    f"write {{{name}}} in the command or the input, or set allow_unused",
                )
            if name in conditions:
                raise SimulatorError(
                    f"simulator '{self.name}': '{name}' is both a condition and a parameter",
                    "rename the column or the parameter, or name the conditions without it",
                )
        return tuple(name for name in conditions if everything or name in used)

    def run_one(self, conditions: Mapping[str, Value], parameters: Mapping[str, float]) -> float:
        """One run; raises RunFailed, with the last of what the program printed."""
        plain = _plain(conditions) | _plain(parameters)
        written = [file.name for file in self.inputs]
        stale = self.output.file if self.output.file not in written else None
        with self.folder.made(plain, stale) as folder:
            values: Values = {**plain, **self._own_values()}
            for file in self.inputs:
                _write(folder / file.name, file.feed, plain, values)
            if self.stdin is not None:
                _write(folder / STDIN, self.stdin, plain, values)
            settings = self.program.settings(values)
            limits = Limits(self.success_codes, self.timeout)
            run(self.program.arguments(values), folder, settings, limits)
            try:
                return self.output.read(folder)
            except RunFailed as failure:
                raise RunFailed(failure.message, log(folder)) from failure.__cause__

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, one after the other; raises RunStopped with the outcomes before."""
        return one_by_one(lambda cells: self.run_one(cells, {}), conditions, parameters)

    def fingerprint(self) -> str:
        """A hash of the command, what it reads, how it is read, and every file named here.

        That is the program itself, arguments that are paths of files, templates and `files`.
        Libraries that it loads and what it opens by itself are not seen: change `version`.
        """
        choices = (
            self.command if isinstance(self.command, str) else list(self.command),
            sorted(self.environment.items()),
            self.inputs,
            self.stdin,
            self.shell,
            self.output.fingerprint(),
            sorted(self.success_codes),
            self.version,
        )
        digest = hashlib.sha256(repr(choices).encode("utf-8", "surrogateescape"))
        for path in [*self.program.files(), *contents(self.folder.sources)]:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            digest.update(f"{path.name} {content}\n".encode("utf-8", "surrogateescape"))
        return digest.hexdigest()

    def _feeds(self) -> list[Feed]:
        return [*(file.feed for file in self.inputs), *([self.stdin] if self.stdin else [])]

    def _used(self) -> dict[str, str]:
        """Every placeholder's name, and where it stands first."""
        texts: list[Text] = [*self.program.texts, *self.program.variables]
        found = [(name, text.where) for text in texts for name in text.names]
        for feed in self._feeds():
            found += [(name, feed.where) for name in feed.names or ()]
        return dict(reversed(found))

    def _own(self) -> dict[str, str]:
        """Placeholders that are no condition and no parameter, and what they stand for."""
        one = {INPUT: "input file"} if len(self.inputs) == 1 else {}
        return {STUDY: "folder of the study"} | one

    def _own_values(self) -> dict[str, str]:
        values = {STUDY: str(self.base.absolute())}
        return values | ({INPUT: self.inputs[0].name} if len(self.inputs) == 1 else {})


def _plain(values: Mapping[str, Value]) -> dict[str, Value]:
    """Numbers as floats of Python, whose text has every digit, texts as they are."""
    return {name: v if isinstance(v, str) else float(v) for name, v in values.items()}


def _write(path: Path, feed: Feed, plain: Values, values: Values) -> None:
    text = feed.write(plain if feed.names is None else values)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # it may be a link to a file of the study, which stays as it is
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
