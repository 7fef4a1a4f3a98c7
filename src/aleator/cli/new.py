"""`aleator new` and `aleator schema`: a first study file, by options, questions or proposals."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
from rich.console import Console

from aleator.cli.running import FILE, RESULT, make_place, require_at_most_one
from aleator.core.arithmetic import share_of
from aleator.errors import AleatorError, SimulatorError, disordered, nearest, short
from aleator.results import documents
from aleator.study.nonmem import has_records, subject_table
from aleator.study.offers import (
    Offer,
    bound,
    functions_in,
    offered_by_command,
    offered_by_fmu,
    offered_by_function,
    offered_by_server,
    reads_a_file,
)
from aleator.study.petab import FUNCTION, petab_study
from aleator.study.proposal import (
    Limits,
    Proposal,
    laws_for,
    misspelt,
    nominal_limits,
    outcome_of,
    parameters_of,
    proposed,
    require_outcome,
    responses_of,
    roles_of,
    with_noise,
)
from aleator.study.proposal_text import notes, study_text, variables
from aleator.study.roles import (
    Roles,
    Sheet,
    conditions_each,
    count_of,
    levels_in,
    measured_rows,
    sheet_of,
)
from aleator.study.schema import study_schema
from aleator.views.terminal import TerminalTable

STOP = "stop with Ctrl-C"


def at_terminal() -> bool:
    """Whether the standard input is a terminal, at which a user can answer questions."""
    return sys.stdin.isatty()


@dataclass(frozen=True)
class Questions:
    """Questions to the user; each takes its default if the program is not `interactive`.

    `folder` is the folder of the study.
    """

    interactive: bool
    folder: Path

    def text(self, question: str, default: str | None, missing: AleatorError) -> str:
        """The user's answer as text; raises `missing` without a default and a user to ask."""
        if not self.interactive:
            if default is None:
                raise missing
            return default

        def given(answer: str) -> str:
            if not answer.strip():
                raise click.BadParameter(f"{missing.problem}; write it here, or {STOP}")
            return answer.strip()

        shown = default is not None
        answer = click.prompt(
            question, default=default or "", show_default=shown, value_proc=given, err=True
        )
        return str(answer)

    def one_of(
        self, question: str, names: Sequence[str], default: str | None, missing: AleatorError
    ) -> str:
        """The user's choice of one of the `names`; the question repeats until it is one of them."""
        if not self.interactive:
            return self.text(question, default, missing)
        answer = click.prompt(
            question, default=default or "", show_default=default is not None,
            type=click.Choice([*names]), err=True,
        )  # fmt: skip
        return str(answer)

    def agreed(self, question: str) -> bool:
        """Whether the user answers yes; False if there is no user to ask."""
        return self.interactive and click.confirm(question, default=False, err=True)


def chosen_id(questions: Questions, sheet: Sheet, roles: Roles, option: str | None) -> str | None:
    """The column with the ids of experiments; None if each row is an experiment of its own."""
    if option is not None:
        sheet.table.require(option, "the id")
    columns = [*([roles.id] if roles.id and roles.repeated else []),
               *levels_in(sheet.table, roles.others, roles.id)]  # fmt: skip
    if option is not None or not questions.interactive or not columns:
        return option or roles.id
    nothing = "none"
    repeats = roles.id if roles.repeated else None
    answer = questions.one_of(
        "Rows of one experiment share which column", [nothing, *dict.fromkeys(columns)],
        repeats or nothing, AleatorError(""),
    )  # fmt: skip
    if answer == nothing:
        return None if repeats else roles.id
    return answer


def chosen_table(questions: Questions, option: Path | None) -> Path:
    """The path of the table of experiments, by default the only one in the current folder."""
    if option is not None:
        return option
    found = _only("*.csv", "*.xlsx", "*.parquet")
    missing = AleatorError(
        "nothing says which table is meant", "aleator new TABLE.csv: name the file of measurements"
    )
    return Path(questions.text("Table of experiments (CSV, XLSX, Parquet)", found, missing))


def chosen_offer(
    questions: Questions,
    function: str | None = None,
    fmu: Path | None = None,
    command: str | None = None,
    template: Path | None = None,
    umbridge: str | None = None,
    inputs: str | None = None,
) -> Offer:
    """The simulator: an FMU, a command, a model of a server, or a Python function.

    The default is the only FMU in the current folder, or the only function of its only Python file.
    """
    require_at_most_one(
        {"--function": function, "--fmu": fmu, "--command": command, "--umbridge": umbridge}
    )
    if template is not None and command is None:
        raise AleatorError("--template has no meaning without --command", "leave it out")
    if inputs is not None and umbridge is None:
        raise AleatorError("--inputs has no meaning without --umbridge", "leave it out")
    if command:
        return _command(questions, command, template)
    if umbridge:
        return offered_by_server(umbridge, inputs or "")
    if fmu is not None:
        return offered_by_fmu(fmu, _beside(questions.folder, fmu))
    if function is not None:
        return _function(questions, function)
    answer = questions.text(
        "Simulator (FILE.py:NAME, FILE.fmu, or a command with {names})", _only_simulator(),
        AleatorError(
            "nothing says what the simulator is",
            "--function FILE.py:NAME, --fmu FILE.fmu, --command '...' or --umbridge ADDRESS",
        ),
    )  # fmt: skip
    if answer.endswith(".fmu"):
        return chosen_offer(questions, fmu=Path(answer))
    if "{" in answer:
        return chosen_offer(questions, command=answer)
    return chosen_offer(questions, function=answer)


def _command(questions: Questions, command: str, template: Path | None) -> Offer:
    """The inputs of a program, and of the template of its input file if it reads one.

    The default of the template is the only file of the folder that ends like one.
    """
    located, folder = _located(questions.folder, command), questions.folder
    if template is None and reads_a_file(located):
        found = _only("*.tpl", "*.tmpl", "*.template", "*.in")
        missing = AleatorError(
            "nothing says which file is the template of {input}",
            "--template FILE: a copy of the program's input file with {names} for its values",
        )
        template = Path(found or questions.text("Template of the input file", None, missing))
    if template is not None and not template.is_file():
        raise AleatorError(f"{template}: there is no such file", "check the name of the template")
    offer = offered_by_command(located, template)
    if template is None:
        return offer
    return replace(offer, further={**offer.further, "template": _beside(folder, template)})


def chosen_outcomes(
    questions: Questions, sheet: Sheet, offer: Offer, option: Sequence[str]
) -> tuple[str, ...]:
    """The columns with measured outcomes: by option, recognized in the table, or by the user."""
    told = tuple(option) or responses_of(sheet, offer)
    if told:
        return told
    found, possible = outcome_of(sheet, offer)
    if not questions.interactive:
        return (require_outcome(found, possible),)
    if found is not None:
        return (found,)
    known = possible or sheet.names
    return (questions.one_of("Measured column", known, known[-1], AleatorError("")),)


def chosen_parameters(
    questions: Questions,
    offer: Offer,
    roles: Roles,
    most: int,
    conditions: int,
    option: Sequence[str],
    listed: int = 40,
) -> dict[str, Limits | float | None]:
    """The parameters that differ between experiments, each with its limits if they are known.

    A parameter that is a constant has its number. Raises AleatorError for limits in `option` that
    cannot be read.
    """
    called = {variable: name for name, variable in offer.variables.items()}

    def read(words: Sequence[str]) -> dict[str, Limits | float | None]:
        found = {called.get(name, name): value for name, value in map(_parameter, words)}
        for name in found:
            if not (name.isidentifier() or called):
                raise AleatorError(
                    f"'{name}' is no name of a parameter",
                    "use letters, digits and underscores, not starting with a digit; in a template "
                    "or a command {NAME} marks its place, whatever the program calls it",
                )
        return found

    if option or not questions.interactive:
        try:
            return read(option)
        except AleatorError as error:
            raise AleatorError(f"--parameter {error.problem}", error.remedy) from None
    laws, others = parameters_of(offer, roles, most, conditions, {})
    known = {each.name: each for each in (*(law.input for law in laws), *others)}
    table = TerminalTable(
        (("name", "left"), ("unit", "left"), ("value", "right"), ("meaning", "fold")),
        variables([*known.values()][:listed], offer),
    )
    Console(stderr=True).print(table)

    def typed(answer: str) -> dict[str, Limits | float | None]:
        if not answer.strip():
            raise click.BadParameter(f"write {shown} with numbers for LOW and HIGH, or {STOP}")
        try:
            found = read(answer.replace(",", " ").split())
            parameters_of(offer, roles, most, conditions, found)
        except AleatorError as error:
            raise click.BadParameter(f"{error.problem}. {error.remedy}") from None
        return found

    limits = {law.name: nominal_limits(law.input) for law in laws if law.scatters}
    shown = " ".join(
        f"{name}={f'{ends[0]:g}:{ends[1]:g}' if ends else 'LOW:HIGH'}"
        for name, ends in limits.items()
    )
    click.echo("Limits of parameters: as wide as physics allows, not where you expect them, for "
               "the law is cut there.", err=True)  # fmt: skip
    question = "Parameters that differ between experiments, with limits"
    known_ends = all(limits.values())
    return dict(
        click.prompt(
            question if known_ends else f"{question}: {shown}", default=shown if known_ends else "",
            show_default=known_ends, value_proc=typed, err=True,
        )
    )  # fmt: skip


@dataclass(frozen=True)
class KnownError:
    """The standard deviation of the measurement error, or a share of the value if `relative`."""

    sd: float
    relative: bool = False

    @classmethod
    def of(cls, text: str) -> KnownError:
        """The error that a text says: 0.3, or 1% of the value.

        >>> KnownError.of("0.3"), KnownError.of("1 %")
        (KnownError(sd=0.3, relative=False), KnownError(sd=0.01, relative=True))
        """
        sd = share_of(text)
        if sd is None or not 0.0 < sd < math.inf:
            raise click.BadParameter(f"'{text}': write a number above zero, or a share such as 1%")
        return cls(sd, text.strip().endswith("%"))


def _known_error(_: object, __: object, text: str | None) -> KnownError | None:
    return None if text is None else KnownError.of(text)


def stated_noise(questions: Questions, proposal: Proposal, option: KnownError | None) -> Proposal:
    """The proposal with the measurement error that the user knows, by option or by question.

    The question is asked where an experiment has one value, which hardly tells its error from the
    scatter of the parameters, and no column has the error.
    """
    if option is not None:
        return with_noise(proposal, option.sd, relative=option.relative)
    several = proposal.repeated or len(proposal.outcomes) > 1
    if several or proposal.roles.errors or not questions.interactive:
        return proposal
    unknown, unit = "unknown", proposal.units.get(proposal.outcomes[0])

    def typed(answer: str) -> KnownError | None:
        return None if answer.strip() == unknown else KnownError.of(answer)

    scale = "as a share, 0.1 is 10 %" if proposal.log else f"in {unit}, or 1%" if unit else "or 1%"
    said = f"Standard deviation of the measurement error, {scale}"
    known = click.prompt(f"{said}, if it is known", default=unknown, value_proc=typed, err=True)
    return proposal if known is None else stated_noise(questions, proposal, known)


def _parameter(text: str) -> tuple[str, Limits | float | None]:
    """The name and the value of an option `stiffness=1:3`, `stiffness=2` or `stiffness`."""
    name, given, value = text.partition("=")
    try:
        numbers = [float(part) for part in value.split(":")] if given and value else []
    except ValueError:
        numbers = [0.0, 0.0]
    if len(numbers) == 2 and numbers[0] > numbers[1]:
        low, high = value.split(":")
        problem, _ = disordered(*numbers)
        raise AleatorError(f"{text}: {problem}", f"write {name}={high}:{low}")
    if len(numbers) > 2 or (len(numbers) == 2 and not numbers[0] < numbers[1]):
        ends = re.fullmatch(r"([\d.]+)\D+([\d.]+)", value)
        low, high = ends.groups() if ends else ("LOW", "HIGH")
        raise AleatorError(
            f"{text}: '{value}' is neither a number nor limits",
            f"write {name}={low}:{high} for limits, {name}=NUMBER for a constant",
        )
    if len(numbers) == 2:
        return name.strip(), (numbers[0], numbers[1])
    return name.strip(), numbers[0] if numbers else None


def _function(questions: Questions, reference: str) -> Offer:
    """The inputs and outputs of a function in a Python file, or in a module."""
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
        name = questions.one_of("Function", known, default, missing)
    if not file.endswith(".py"):
        return offered_by_function(f"{file}:{name}", questions.folder)
    found = offered_by_function(f"{Path(file).absolute()}:{name}", questions.folder)
    return replace(found, value=f"{_beside(questions.folder, Path(file))}:{name}")


def _located(folder: Path, command: str) -> str:
    """The command with {study}/ before each argument that is a file in the study's folder."""
    program, *rest = command.split(" ")
    return " ".join(
        [program, *(f"{{study}}/{w}" if w and (folder / w).is_file() else w for w in rest)]
    )


def _beside(folder: Path, file: Path) -> str:
    """The path of a file relative to the folder of the study."""
    return Path(os.path.relpath(file.absolute(), folder)).as_posix()


def _only_simulator() -> str | None:
    """The only FMU, or the only Python file with its only function, in the current folder."""
    fmu = _only("*.fmu")
    if fmu is not None:
        return fmu
    file = _only("*.py")
    names = functions_in(Path(file)) if file else ()
    return f"{file}:{names[0]}" if len(names) == 1 else file


def _only(*patterns: str) -> str | None:
    """The name of the only file in the current folder with one of the patterns; else None."""
    found = sorted(path.name for pattern in patterns for path in Path().glob(pattern))
    return found[0] if len(found) == 1 else None


@click.command()
@click.option("--output", type=RESULT, metavar="FILE", help="Write it there.")
def schema(output: Path | None) -> None:
    """Print the JSON schema of study.toml, for editors.

    An editor that knows TOML (Even Better TOML in Visual Studio Code, Taplo in others) then offers
    the keys and marks mistakes while you type. The first line of study.toml must name the file of
    the schema; `aleator new --schema` writes both.

    \b
      aleator schema --output study.schema.json
      #:schema study.schema.json           <- the first line of study.toml

    The schema has the laws, simulators and other kinds of installed plug-ins too.
    """
    text = schema_text()
    if output is None:
        click.echo(text, nl=False)
        return
    make_place(output)
    documents.write_text(text, output)
    click.echo(f"Written: {short(output)}")


def schema_text() -> str:
    """The JSON schema of study.toml as text."""
    return json.dumps(study_schema(), indent=1, ensure_ascii=False) + "\n"


SCHEMA = "study.schema.json"


@click.command()
@click.argument("table", type=FILE, metavar="[TABLE|PROBLEM.yaml]", required=False)
@click.option("--function", metavar="FILE.py:NAME", help="A Python function is the simulator.")
@click.option("--fmu", type=FILE, metavar="FILE.fmu", help="An FMU is the simulator.")
@click.option(
    "--command",
    metavar="TEXT",
    help="A program is the simulator: './spring {force} {stiffness}' prints the outcome.",
)
@click.option(
    "--template",
    type=FILE,
    metavar="FILE",
    help="The program reads {input}: this file, with {names} for the values.",
)
@click.option(
    "--umbridge", metavar="ADDRESS/MODEL", help="A model of an UM-Bridge server is the simulator."
)
@click.option(
    "--inputs",
    metavar="A,B;C",
    help="The inputs of the server's model: a semicolon between vectors.",
)
@click.option(
    "--outcome", multiple=True, metavar="COLUMN", help="The measured column; may be several."
)
@click.option("--id", metavar="COLUMN", help="Rows with the same value are one experiment.")
@click.option(
    "--parameter",
    "parameters",
    multiple=True,
    metavar="NAME[=LOW:HIGH]",
    help="It differs between experiments, within limits; NAME=NUMBER is a constant.",
)
@click.option(
    "--noise",
    callback=_known_error,
    metavar="SD|SHARE%",
    help="The known standard deviation of the measurement error, in the unit of the outcome "
    "(of its logarithm where that is proposed), or a share of the value, for each outcome: 1%.",
)
@click.option(
    "--series", is_flag=True, help="A run serves all rows of an experiment: arrays of times."
)
@click.option(
    "--output",
    type=RESULT,
    default="study.toml",
    show_default=True,
    metavar="FILE.toml",
    help="The study file that is written.",
)
@click.option("--schema", is_flag=True, help="Write study.schema.json beside it, for editors.")
@click.option("--yes", is_flag=True, help="Ask nothing: take what is proposed.")
@click.option("--force", is_flag=True, help="Replace the study file if it is there.")
def new(
    table: Path | None,
    function: str | None,
    fmu: Path | None,
    command: str | None,
    template: Path | None,
    umbridge: str | None,
    inputs: str | None,
    outcome: tuple[str, ...],
    id: str | None,
    parameters: tuple[str, ...],
    noise: KnownError | None,
    series: bool,
    output: Path,
    schema: bool,
    yes: bool,
    force: bool,
) -> None:
    """Write a first study.toml from a table and a simulator.

    The table is a CSV, XLSX or Parquet file. Asks for what neither options nor table say, and
    proposes an answer. Columns are recognized by the inputs of the simulator. Each argument of a
    function without a default gets a law. Limits lie a factor of three below and above a default,
    or an FMU's start value. Nothing is simulated.
    Without a terminal the proposals are taken. A table of NONMEM (ID, TIME, DV, AMT, EVID, ...)
    becomes a table of its observations, with the doses as conditions. Of a PEtab problem (YAML)
    the whole study is written, and a file for the function that simulates its model.

    \b
      aleator new springs.csv --function model.py:spring
      aleator new springs.csv --function model.py:spring --parameter stiffness=1:3
      aleator new tanks.csv --fmu tank.fmu --id tank --outcome level
      aleator new springs.csv --command './spring {force} {stiffness}'
      aleator new beams.xlsx --command './beam {input}' --template beam.tpl
      aleator new springs.csv --umbridge http://localhost:4242/spring --inputs force,k

    What cannot be known is left as a line that says FILL IN.
    """
    questions = Questions(at_terminal() and not yes, output.parent)
    _require_free(output, force, questions)
    path = chosen_table(questions, table)
    if path.suffix in (".yaml", ".yml"):
        stated = {"--fmu": fmu, "--command": command, "--umbridge": umbridge, "--outcome": outcome,
                  "--id": id, "--parameter": parameters, "--noise": noise,
                  "--series": series}  # fmt: skip
        _from_petab(path, function, output, stated, schema, force, questions)
        return
    sheet, title = sheet_of(path), _title(path)
    offer = chosen_offer(questions, function, fmu, command, template, umbridge, inputs)
    if has_records(sheet.table):
        spelled = (*offer.names, *(each.name for each in offer.returned))
        subjects = subject_table(sheet, spelled)
        path = output.with_name(f"{path.stem}_observations.csv")
        _require_free(path, force, questions)
        documents.write_text(subjects.text, path)
        sheet = sheet_of(path)
        outcome, id = outcome or subjects.outcomes, id or subjects.id
        for line in subjects.notes:
            click.echo(f"  {line}")
        click.echo(f"Written: {short(path)}")
    offer = bound(offer, [name for name in sheet.names if name not in outcome])
    outcomes = chosen_outcomes(questions, sheet, offer, outcome)
    roles = roles_of(sheet, offer, outcomes)
    if measured := measured_rows(sheet, outcomes):
        text, blank = measured
        path = output.with_name(f"{path.stem}_measured.csv")
        _require_free(path, force, questions)
        documents.write_text(text, path)
        sheet = sheet_of(path)
        roles = roles_of(sheet, offer, outcomes)
        click.echo(f"  nothing was measured in {', '.join(blank)}: left out; where only a bound is "
                   "known, write it, such as <0.5")  # fmt: skip
        click.echo(f"Written: {short(path)}")
    named = chosen_id(questions, sheet, roles, id)
    for line in misspelt(sheet, offer, roles, (*outcomes, named)):
        click.echo(f"  {line}")
    most = laws_for(count_of(sheet.table, named), len(sheet.table))
    each = conditions_each(sheet.table, roles.conditions, named) * len(outcomes)
    laws = chosen_parameters(questions, offer, roles, most, each, parameters)
    file = Path(os.path.relpath(path.absolute(), output.parent)).as_posix()
    proposal = proposed(sheet, file, title, offer, outcomes, named, laws, series)
    proposal = stated_noise(questions, proposal, noise)
    if schema:
        documents.write_text(schema_text(), output.with_name(SCHEMA))
    documents.write_text(study_text(proposal, SCHEMA if schema else None), output)
    for line in notes(proposal):
        click.echo(f"  {line}")
    click.echo(f"Written: {short(output)}")
    if proposal.incomplete:
        click.echo(f"Fill in: {', '.join(proposal.incomplete)}")
        if lacking := [p.name for p in proposal.parameters if not p.complete]:
            said = " ".join(f"--parameter {name}=LOW:HIGH" for name in lacking)
            click.echo(f"Or add to the same command: {said} --force")
    click.echo(
        f"A question that {short(output)} has is answered with the law: [[questions]], "
        f'probability = "{proposal.outcomes[0]} > VALUE", at = {{CONDITION = VALUE}}'
    )
    click.echo(f"Next: aleator check {short(output)}")


def _from_petab(
    problem: Path,
    function: str | None,
    output: Path,
    stated: Mapping[str, object],
    schema: bool,
    force: bool,
    questions: Questions,
) -> None:
    """Write the study of a PEtab problem, its table, and a function where there is none yet."""
    if wrong := next((option for option, value in stated.items() if value), None):
        raise AleatorError(
            f"{wrong} has no meaning for a PEtab problem, whose tables say it", "leave it out"
        )
    table = output.with_name(f"{problem.stem.lstrip('_')}_measurements.csv")
    stub = output.with_name("model.py")
    _require_free(table, force, questions)
    found = petab_study(problem, output.parent, table.name, function or f"{stub.name}:{FUNCTION}")
    head = f"#:schema {SCHEMA}\n" if schema else ""
    if schema:
        documents.write_text(schema_text(), output.with_name(SCHEMA))
    files = {table: found.table, output: head + found.study}
    if function is None and not stub.exists():
        files[stub] = found.function
    for line in found.notes:
        click.echo(f"  {line}")
    for path, text in files.items():
        documents.write_text(text, path)
        click.echo(f"Written: {short(path)}")
    if stub in files:
        click.echo(f"Fill in: the function {FUNCTION} in {short(stub)}")
    click.echo(f"Next: aleator check {short(output)}")


def _require_free(output: Path, force: bool, questions: Questions) -> None:
    """Raise AleatorError if the file exists and the user does not agree to replace it."""
    if not output.exists() or force or questions.agreed(f"{short(output)} is there. Replace it?"):
        return
    raise AleatorError(
        f"{short(output)} is there already", "--output another name, or --force to replace it"
    )


def _title(table: Path) -> str:
    words = table.stem.replace("_", " ").replace("-", " ")
    return words[:1].upper() + words[1:]
