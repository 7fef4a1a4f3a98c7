"""What `aleator new` is to make a study of: by options, by questions, or as it is proposed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from aleator.cli.asking import Questions
from aleator.errors import AleatorError, SimulatorError, nearest
from aleator.study.offers import (
    Offer,
    functions_in,
    offered_by_command,
    offered_by_fmu,
    offered_by_function,
)
from aleator.study.proposal import outcome_of, require_outcome, responses_of
from aleator.study.proposal_text import variables
from aleator.study.proposed_laws import Limits, around, parameters_of
from aleator.study.roles import Roles, Sheet
from aleator.views.terminal import TerminalTable

LISTED = 40
"""Variables of an FMU that are shown before the user is asked."""


@dataclass(frozen=True)
class Asked:
    """How the user is asked, and the folder that the study file will be in."""

    questions: Questions
    folder: Path

    def id(self, sheet: Sheet, roles: Roles, given: str | None) -> str | None:
        """The column that names the experiments, or None."""
        if given is not None:
            sheet.table.require(given, "the id")
        known = [name for name in (roles.id, *roles.others) if name]
        if given is not None or not self.questions.asked or not known:
            return given or roles.id
        nothing = "none"
        answer = self.questions.one_of(
            "Rows of one experiment share which column", [nothing, *dict.fromkeys(known)],
            roles.id or nothing, AleatorError(""),
        )  # fmt: skip
        return None if answer == nothing else answer


def chosen_table(asked: Asked, given: Path | None) -> Path:
    """The table, by default the only CSV file of the current folder."""
    if given is not None:
        return given
    found = _only("*.csv")
    missing = AleatorError(
        "nothing says which table is meant", "aleator new TABLE.csv: name the file of measurements"
    )
    return Path(asked.questions.text("Table of experiments (CSV)", found, missing))


def chosen_offer(
    asked: Asked, function: str | None, fmu: Path | None, command: str | None
) -> Offer:
    """The simulator, by default the only function of the only Python file here, or the only FMU."""
    given = {"--function": function, "--fmu": fmu, "--command": command}
    named = [name for name, value in given.items() if value]
    if len(named) > 1:
        raise AleatorError(f"{' and '.join(named)} contradict each other", "choose one of them")
    if command:
        return offered_by_command(_located(asked.folder, command))
    if not named:
        missing = AleatorError(
            "nothing says what the simulator is",
            "--function FILE.py:NAME, --fmu FILE.fmu or --command '...'",
        )
        answer = asked.questions.text(
            "Simulator (FILE.py:NAME, FILE.fmu, or a command with {names})", _likely(), missing
        )
        fmu = Path(answer) if answer.endswith(".fmu") else None
        if fmu is None and "{" in answer:
            return offered_by_command(_located(asked.folder, answer))
        function = answer
    if fmu is not None:
        return offered_by_fmu(fmu, _beside(asked.folder, fmu))
    return _function(asked, str(function))


def chosen_outcomes(
    asked: Asked, sheet: Sheet, offer: Offer, given: Sequence[str]
) -> tuple[str, ...]:
    """The measured columns."""
    told = tuple(given) or responses_of(sheet, offer)
    if told:
        return told
    found, possible = outcome_of(sheet, offer)
    if not asked.questions.asked:
        return (require_outcome(found, possible),)
    known = possible or sheet.names
    return (asked.questions.one_of("Measured column", known, found, AleatorError("")),)


def chosen_parameters(
    asked: Asked, offer: Offer, roles: Roles, most: int, given: Sequence[str]
) -> dict[str, Limits | float | None]:
    """The parameters that differ between experiments, with their limits as far as they are known.

    Raises AleatorError for limits that are none.
    """
    if given or not asked.questions.asked:
        called = {variable: name for name, variable in offer.variables.items()}
        return {called.get(name, name): value for name, value in map(_parameter, given)}
    laws, others = parameters_of(offer, roles, most, {})
    known = {each.name: each for each in (*(law.given for law in laws), *others)}
    if others:
        table = TerminalTable(
            (("name", "left"), ("unit", "left"), ("value", "right"), ("meaning", "fold")),
            variables([*known.values()][:LISTED], offer),
        )
        Console(stderr=True).print(table)
    names = asked.questions.names(
        "Parameters that differ between experiments", [*known],
        [law.name for law in laws if law.scatters],
    )  # fmt: skip
    limits: dict[str, Limits | float | None] = {
        name: asked.questions.limits(f"  {name} lies between (two numbers)", around(known[name]))
        for name in names
    }
    for law in laws:
        if law.name not in names and law.given.required:
            limits[law.name] = asked.questions.number(f"  {law.name}, the same for all, is")
    return limits


def _parameter(text: str) -> tuple[str, Limits | float | None]:
    """`stiffness=1:3`, `stiffness=2` or `stiffness`."""
    name, given, value = text.partition("=")
    try:
        numbers = [float(part) for part in value.split(":")] if given else []
    except ValueError:
        numbers = [0.0, 0.0]
    if len(numbers) > 2 or (len(numbers) == 2 and not numbers[0] < numbers[1]):
        raise AleatorError(
            f"--parameter {text}: '{value}' is neither a number nor limits",
            f"write --parameter {name}=1.0:3.0, or {name}=2.0 for a constant",
        )
    if len(numbers) == 2:
        return name.strip(), (numbers[0], numbers[1])
    return name.strip(), numbers[0] if numbers else None


def _function(asked: Asked, reference: str) -> Offer:
    """A function by a name that is relative to the current folder, or of a module."""
    file, _, name = reference.rpartition(":")
    if reference.endswith(".py"):
        file, name = reference, ""
    if file.endswith(".py") and not Path(file).is_file():
        beside = [path.name for path in Path(file).parent.glob("*.py")]
        raise SimulatorError(
            f"{file}: there is no such file{nearest(Path(file).name, beside)}", "check the name"
        )
    if not name:
        known = functions_in(Path(file))
        missing = SimulatorError(
            f"nothing says which function of {file} is meant"
            if known
            else f"{file or reference} defines no function",
            f"--function {file or 'FILE.py'}:{known[-1] if known else 'NAME'}",
        )
        default = known[0] if len(known) == 1 else None
        if not known:
            raise missing
        name = asked.questions.one_of("Function", known, default, missing)
    if not file.endswith(".py"):
        return offered_by_function(f"{file}:{name}", asked.folder)
    found = offered_by_function(f"{Path(file).absolute()}:{name}", asked.folder)
    return replace(found, value=f"{_beside(asked.folder, Path(file))}:{name}")


def _located(folder: Path, command: str) -> str:
    """A command whose arguments that are files beside the study are found from everywhere."""
    program, *rest = command.split(" ")
    return " ".join(
        [program, *(f"{{study}}/{w}" if w and (folder / w).is_file() else w for w in rest)]
    )


def _beside(folder: Path, file: Path) -> str:
    """A file as a study in the folder names it."""
    return Path(os.path.relpath(file.absolute(), folder)).as_posix()


def _likely() -> str | None:
    """What in the current folder is a simulator, if there is one such thing."""
    fmu = _only("*.fmu")
    if fmu is not None:
        return fmu
    file = _only("*.py")
    names = functions_in(Path(file)) if file else ()
    return f"{file}:{names[0]}" if len(names) == 1 else file


def _only(pattern: str) -> str | None:
    found = sorted(path.name for path in Path().glob(pattern))
    return found[0] if len(found) == 1 else None
