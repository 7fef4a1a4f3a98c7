"""Which program is started, with which arguments and environment."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.placeholders import Text, Values
from aleator.simulators.command.shell import filled, script

# The placeholder for the study's folder, which is not the folder that a program runs in.
STUDY = "study"


@dataclass(frozen=True)
class Program:
    """A command with placeholders, found before anything runs.

    `command` is a list of arguments, or one text: cut into arguments as a shell does, and given to
    a shell only if `shell`. A first argument with a slash is relative to `base`, one without is
    looked for on the PATH. `environment` is added to what Aleator itself has.

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
        """What messages call the program: "solver", or with its script "python3 model.py"."""
        text = self.texts[0].fill(_Shown())
        own = Path(text.split()[0] if self.shell else text).name
        named = [] if self.shell else [path.name for path in self.files()[1:] if path.name != own]
        return " ".join([own, *named[:1]])

    def arguments(self, values: Values) -> list[str]:
        """What is started, with the values in place.

        Raises SimulatorError for a value that a shell would read (see `shell`).
        """
        if self.shell:
            return [str(self.executable), "-c", filled(self.texts[0], values)]
        given = [text.fill(values) for text in self.texts[1:]]
        read = script(self.executable.name, given)
        if read is not None:
            given[read] = filled(self.texts[1 + read], values)
        return [str(self.executable), *given]

    def settings(self, values: Values) -> dict[str, str]:
        """The environment variables with the values in place."""
        return {
            name: text.fill(values)
            for name, text in zip(self.environment, self.variables, strict=True)
        }

    def files(self) -> list[Path]:
        """The program itself, and every argument that is the path of a file: a script, say."""
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
                f"the program '{first.fill(_Shown())}' changes from run to run",
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


class _Shown(dict[str, str]):
    """Every placeholder as it is written."""

    def __missing__(self, name: str) -> str:
        return f"{{{name}}}"


def _executable(path: Path, name: str) -> Path:
    if not path.is_file():
        beside = [p.name for p in path.parent.glob("*")]
        what = "is a folder" if path.is_dir() else "does not exist"
        raise SimulatorError(
            f"the program '{name}' {what}{nearest(path.name, beside)}",
            "name it relative to the study",
        )
    if not os.access(path, os.X_OK):
        python = path.suffix == ".py"
        raise SimulatorError(
            f"the program '{name}' may not be executed",
            f'write ["python3", "{{study}}/{path.name}", ...]'
            if python
            else f"chmod +x {name}, or name the program that interprets it first",
        )
    return path
