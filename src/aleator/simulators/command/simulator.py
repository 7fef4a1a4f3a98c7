"""An external program as a simulator: how it is called, and where its outcome is."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import SimulatorError, nearest
from aleator.simulators import protocol
from aleator.simulators.command.inputs import (
    Columns,
    CsvFeed,
    Feed,
    InputFile,
    Text,
    Value,
    Values,
    filled,
    script,
    within,
    write_input,
)
from aleator.simulators.command.outputs import Output, OutputFile
from aleator.simulators.command.run import STDIN, Folder, Keep, Limits, contents, log, run
from aleator.simulators.protocol import (
    Returned,
    RunFailed,
    name_lists,
    one_by_one,
    require_distinct,
    require_file,
)
from aleator.simulators.surroundings import STOP_ON, exit_status, prevented, require_space

# The placeholder for the study's folder. A program runs in another folder.
STUDY = "study"


@dataclass(frozen=True)
class Program:
    """A command with placeholders; its program is looked up before anything runs.

    `command` is a list of arguments, or one text. A text is cut into arguments as a shell does; it
    is given to a shell only with `shell`. A program name with a slash is relative to the folder
    `base`; a name without one is looked up on the PATH. `environment` is added to Aleator's own
    environment.

    Raises SimulatorError if there is no such program or it cannot be executed.
    """

    command: Sequence[str] | str
    base: Path = Path(".")
    shell: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)
    texts: tuple[Text, ...] = field(init=False, repr=False)
    variables: tuple[Text, ...] = field(init=False, repr=False)
    executable: Path = field(init=False, repr=False)

    def __post_init__(self) -> None:
        def parsed(text: str, where: str) -> Text:
            return Text.parse(text, where=where, escapes=True)

        texts = tuple(parsed(part, "the command") for part in self._parts())
        variables = tuple(
            parsed(text, f"the environment variable {name}")
            for name, text in self.environment.items()
        )
        object.__setattr__(self, "texts", texts)
        object.__setattr__(self, "variables", variables)
        object.__setattr__(self, "executable", self._found())

    def _parts(self) -> tuple[str, ...]:
        if self.shell and not isinstance(self.command, str):
            raise SimulatorError(
                "shell = true with a list of arguments", "write the command as one text"
            )
        try:
            cut = isinstance(self.command, str) and not self.shell
            parts = shlex.split(str(self.command)) if cut else self.command
        except ValueError as error:
            raise SimulatorError(
                f"the command {self.command!r} cannot be cut into arguments: {error}",
                "close its quotes, or write a list of arguments",
            ) from None
        parts = (parts,) if isinstance(parts, str) else tuple(parts)
        if not parts or not parts[0].strip():
            raise SimulatorError(
                "the command is empty", 'write command = ["./program", "{parameter}"]'
            )
        return parts

    @property
    def name(self) -> str:
        """The name for messages: "solver", or with its script "python3 model.py"."""
        text = self.texts[0].fill(_Unfilled())
        own = Path(text.split()[0] if self.shell else text).name
        named = [] if self.shell else [path.name for path in self.files()[1:] if path.name != own]
        return " ".join([own, *named[:1]])

    def arguments(self, values: Values) -> list[str]:
        """The arguments of the process, with the values in place of the placeholders.

        Raises SimulatorError for a value that a shell would interpret (see `filled`).
        """
        if self.shell:
            return [str(self.executable), "-c", filled(self.texts[0], values)]
        given = [text.fill(values) for text in self.texts[1:]]
        read = script(self.executable.name, given)
        if read is not None:
            given[read] = filled(self.texts[1 + read], values)
        return [str(self.executable), *given]

    def settings(self, values: Values) -> dict[str, str]:
        """The environment variables, with the values in place of their placeholders."""
        return {
            name: text.fill(values)
            for name, text in zip(self.environment, self.variables, strict=True)
        }

    def files(self) -> list[Path]:
        """The program itself, and every argument that is the path of a file, such as a script."""
        known = {STUDY: os.path.abspath(self.base)}
        constant = [text.fill(known) for text in self.texts if set(text.names) <= set(known)]
        words = [word for text in constant for word in (text.split() if self.shell else [text])]
        return [self.executable, *(path for word in words if (path := self.base / word).is_file())]

    def _found(self) -> Path:
        if self.shell:
            return Path("/bin/sh")
        first = self.texts[0]
        if set(first.names) - {STUDY}:
            raise SimulatorError(
                f"the program '{first.fill(_Unfilled())}' changes from run to run",
                "name one program, and give it the rest as arguments",
            )
        name = first.fill({STUDY: os.path.abspath(self.base)})
        if "/" in name:
            return _executable(Path(os.path.abspath(self.base / name)), name)
        found = shutil.which(name)
        if found is None:
            here = (self.base / name).exists()
            raise SimulatorError(
                f"the program '{name}' is not on the PATH",
                f"write './{name}': a program beside the study has a slash"
                if here
                else f"install it, or write its path; './{name}' is one beside the study",
            )
        return Path(os.path.abspath(found))


class _Unfilled(dict[str, str]):
    """A mapping that gives every placeholder back as it is written."""

    def __missing__(self, name: str) -> str:
        return f"{{{name}}}"


def _executable(path: Path, name: str) -> Path:
    require_file(path, f"the program '{name}'")
    if path.is_dir():
        raise SimulatorError(f"the program '{name}' is a folder", "name a file in it")
    if not os.access(path, os.X_OK):
        python = path.suffix == ".py"
        raise SimulatorError(
            f"the program '{name}' may not be executed",
            f'write ["python3", "{{study}}/{path.name}", ...]'
            if python
            else f"chmod +x {name}, or name the program that interprets it first",
        )
    return path


# The placeholder for the name of the input file, if there is exactly one input file.
INPUT = "input"
# The placeholder for the name of the table that the program reads for a series.
ROWS = "rows"


@dataclass(frozen=True)
class CommandSimulator:
    """A program that is started once for each run, in a folder of its own, and writes its outcome.

    `command`, `shell`, `environment`: see `Program`. Placeholders are the names of conditions and
    parameters, `{study}` (the folder `base`) and `{input}` (the only input file). The program reads
    its arguments, its environment, the `inputs`, and `stdin`. `output` says where its outcome is;
    for several responses it is a mapping from their names.

    With `series` a run makes a whole experiment. Conditions that vary within any experiment are
    written to the table `rows` (a CSV file, whose name is `{rows}`); constant ones replace
    placeholders. Each output is then a column in the order of the rows, or one number for all rows.

    `files`, `link`, `keep`: see `Folder`. `timeout` is in seconds. `stop_on` is a regular
    expression for messages of the machine: a failed run that printed it does not count as made, and
    the study stops (default: full disks and refused licenses; "": none). `version` is a text that
    the user changes when the program changes in a way that its fingerprint does not notice. Every
    parameter must appear somewhere, unless `allow_unused`.

    The simulator can be pickled, and `run_one` may be called in any process. Raises SimulatorError,
    before anything runs, for missing files and for invalid settings. Cost: besides the program
    itself some 2 ms a run, for its folder and its files.

    >>> add = CommandSimulator(["awk", "BEGIN {{print {load} / {stiffness}}}"])
    >>> add.asks(["load", "bench"], ["stiffness"])
    ('load',)
    >>> add.run_one({"load": 1.0}, {"stiffness": 4.0})
    0.25
    """

    command: Sequence[str] | str
    output: Output | Mapping[str, Output] = field(default_factory=OutputFile)
    base: Path = Path(".")
    inputs: tuple[InputFile, ...] = ()
    stdin: Feed | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    link: bool = False
    shell: bool = False
    success_codes: tuple[int, ...] = (0,)
    timeout: float | None = None
    stop_on: str = STOP_ON
    keep: Keep = Keep.FAILED
    version: str = ""
    allow_unused: bool = False
    series: bool = False
    rows: str = "rows.csv"
    program: Program = field(init=False, repr=False)
    folder: Folder = field(init=False, repr=False)
    _limits: Limits = field(init=False, repr=False)
    # A call makes one run, so that progress is reported after every run.
    block: int = field(default=1, init=False, repr=False)

    def __post_init__(self) -> None:
        # The path is made absolute, because a function of the user may change the folder.
        object.__setattr__(self, "base", self.base.absolute())
        folder = Folder(self.base, self.files, self.link, self.keep)
        program = Program(self.command, self.base, self.shell, self.environment)
        object.__setattr__(self, "folder", folder)
        object.__setattr__(self, "program", program)
        object.__setattr__(self, "_limits", Limits(self.success_codes, self.timeout, self.stop_on))
        within(self.rows, "the table of rows")
        taken = [path.name for path in folder.sources]
        written = [file.name for file in self.inputs]
        for name in (*written, self.rows) if self.series else written:
            if name in taken:
                raise SimulatorError(
                    f"'{name}' is written for every run, but is a file of the run already",
                    "give the input another name, or take it from the files",
                )
            taken.append(name)

    @property
    def name(self) -> str:
        """The name of the program, without its folder."""
        return self.program.name

    @property
    def description(self) -> str:
        """The command and the places of its outcomes, as one text."""
        command = self.command if isinstance(self.command, str) else shlex.join(self.command)
        outputs = (getattr(one, "reference", repr(one)) for one in self._outputs().values())
        return f"{command}: {', '.join(outputs)}"

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that have a placeholder; all of them for JSON, CSV and series.

        Raises SimulatorError for a placeholder that is neither a condition nor a parameter, and for
        a parameter that no placeholder uses.
        """
        known = (*conditions, *parameters)
        special = self._special()
        used = self._used()
        everything = any(feed.names is None for feed in self._feeds())
        for name, where in used.items():
            if name in special and name in known:
                raise SimulatorError(
                    f"{where}: '{name}' stands for the {special[name]}, and is also the name of a "
                    "condition or a parameter",
                    "rename the column or the parameter",
                )
            if name not in special and name not in known:
                raise SimulatorError(
                    f"{where}: '{name}' is neither a condition nor a parameter"
                    f"{nearest(name, [*known, *special])}",
                    f"{name_lists(conditions, parameters)}; where no placeholder is meant, double "
                    "the braces in a command, or choose other delimiters for a file",
                )
        for name in parameters:
            if name not in used and not everything and not self.allow_unused:
                raise SimulatorError(
                    f"simulator '{self.name}' is never told the parameter '{name}'"
                    f"{nearest(name, used)}",
                    f"write {{{name}}} in the command or the input, or set allow_unused",
                )
        require_distinct(self.name, conditions, parameters)
        return tuple(c for c in conditions if everything or self.series or c in used)

    def run_one(self, conditions: Mapping[str, Any], parameters: Mapping[str, float]) -> Any:
        """The outcome of one run: a number, or one for each response; for a series a list.

        Raises RunFailed, with the end of what the program printed. Raises SurroundingsError if the
        machine prevented the run (`stop_on`, a full disk, no new process), and SimulatorError for a
        placeholder of a condition that varies within the experiment.
        """
        plain = _plain(conditions) | _plain(parameters)
        varying = {name: value for name, value in plain.items() if isinstance(value, list)}
        constant = {name: v for name, v in plain.items() if not isinstance(v, list)}
        self._require_constant(varying)
        written = [file.name for file in self.inputs]
        stale = {one.file for one in self._outputs().values() if one.file}
        try:
            with self.folder.made(plain, sorted(stale.difference(written))) as folder:
                found = self._made(folder, plain, {**constant, **self._special_values()}, varying)
        except OSError as error:
            raise prevented(error, "the folder of a run could not be made") from error
        return found if isinstance(self.output, Mapping) else found[""]

    def _made(
        self, folder: Path, plain: Columns, values: Values, varying: Mapping[str, list[Value]]
    ) -> dict[str, Any]:
        """The outcomes by response of a run in its folder.

        Raises RunFailed, or SurroundingsError if the machine is at fault.
        """
        try:
            if self.series:
                (folder / self.rows).write_text(CsvFeed().write(varying), encoding="utf-8")
            fed = {folder / file.name: file.feed for file in self.inputs}
            for path, feed in (fed | ({folder / STDIN: self.stdin} if self.stdin else {})).items():
                write_input(path, feed, plain, values)
            settings = self.program.settings(values)
            code = run(self.program.arguments(values), folder, settings, self._limits)
            found = self._found(code, folder, varying)
        except RunFailed as failure:
            raise self._limits.judged(failure, folder) from failure.__cause__
        require_space(folder)
        return found

    def _found(self, code: int, folder: Path, varying: Mapping[str, list[Value]]) -> dict[str, Any]:
        """The outcomes by response in the folder of a run that ended with an exit code.

        Raises RunFailed for outcomes that are not there, and for the exit code of a failure. That
        message says whether the outcomes are there all the same.
        """
        wrong = f"it ended with {exit_status(code)}"
        try:
            found = {
                name: self._read(one, folder, varying) for name, one in self._outputs().items()
            }
        except RunFailed:
            if code in self.success_codes:
                raise
            raise RunFailed(wrong, log(folder)) from None
        if code in self.success_codes:
            return found
        if code < 0:  # A signal ended it.
            raise RunFailed(wrong, log(folder))
        codes = ", ".join(map(str, [*self.success_codes, code]))
        raise RunFailed(
            f"{wrong}, although the outcome is there (success_codes = [{codes}], if the program "
            "always ends so)", log(folder)
        )  # fmt: skip

    def __call__(self, conditions: protocol.Columns, parameters: protocol.Columns) -> Returned:
        """Run R times, one after the other. On a failure RunStopped has the outcomes before it."""
        return one_by_one(lambda cells: self.run_one(cells, {}), conditions, parameters)

    def fingerprint(self) -> str:
        """A hash of the command, its inputs and outputs, and every file that they name.

        These files are the program itself, arguments that are paths of files, templates and
        `files`. Libraries and files that the program opens by itself are not noticed: change
        `version` for them.
        """
        choices = (
            self.command if isinstance(self.command, str) else list(self.command),
            sorted(self.environment.items()),
            self.inputs,
            self.stdin,
            self.shell,
            self._outputs()[""].fingerprint()
            if not isinstance(self.output, Mapping)
            else sorted((name, one.fingerprint()) for name, one in self.output.items()),
            sorted(self.success_codes),
            self.version,
            *(("series", self.rows) if self.series else ()),
        )
        digest = hashlib.sha256(repr(choices).encode("utf-8", "surrogateescape"))
        for path in [*self.program.files(), *contents(self.folder.sources)]:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            digest.update(f"{path.name} {content}\n".encode("utf-8", "surrogateescape"))
        return digest.hexdigest()

    def _outputs(self) -> Mapping[str, Output]:
        """The outputs by response; a single output has the name ""."""
        return self.output if isinstance(self.output, Mapping) else {"": self.output}

    def _read(self, output: Output, folder: Path, varying: Mapping[str, list[Value]]) -> Any:
        found = output.read(folder, self.series)
        if not self.series:
            return found
        rows = len(next(iter(varying.values()))) if varying else 1
        if isinstance(found, list) and varying and len(found) != rows:
            raise RunFailed(
                f"it gave {len(found)} numbers for an experiment of {rows} rows"
                + (f" in '{output.file}'" if output.file else "")
            )
        return np.array(found) if isinstance(found, list) else found

    def _require_constant(self, varying: Collection[str]) -> None:
        for name, where in self._used().items():
            if name in varying:
                raise SimulatorError(
                    f"{where}: '{name}' varies within an experiment; a placeholder is one value",
                    f"let the program read it from the table {self.rows}, whose name is {{rows}}",
                )

    def _feeds(self) -> list[Feed]:
        return [*(file.feed for file in self.inputs), *([self.stdin] if self.stdin else [])]

    def _used(self) -> dict[str, str]:
        """Where each placeholder appears first, by its name."""
        texts: list[Text] = [*self.program.texts, *self.program.variables]
        found = [(name, text.where) for text in texts for name in text.names]
        for feed in self._feeds():
            found += [(name, feed.where) for name in feed.names or ()]
        return dict(reversed(found))

    def _special(self) -> dict[str, str]:
        """Placeholders that are neither conditions nor parameters, with their meanings."""
        one = {INPUT: "input file"} if len(self.inputs) == 1 else {}
        rows = {ROWS: "table of the rows"} if self.series else {}
        return {STUDY: "folder of the study"} | one | rows

    def _special_values(self) -> dict[str, str]:
        values = {STUDY: str(self.base.absolute())}
        one = {INPUT: self.inputs[0].name} if len(self.inputs) == 1 else {}
        return values | one | ({ROWS: self.rows} if self.series else {})


def _plain(values: Mapping[str, Any]) -> dict[str, Value | list[Value]]:
    """The values as Python floats, whose text has all digits; texts unchanged; series as lists."""
    return {
        name: v if isinstance(v, str) else v.tolist() if np.ndim(v) else float(v)
        for name, v in values.items()
    }
