"""The inputs and outputs of a simulator, found out without running it."""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from aleator.errors import SimulatorError
from aleator.observations.tables import is_unit
from aleator.simulators.command.inputs import Delimiters, Text
from aleator.simulators.command.simulator import INPUT, ROWS, STUDY
from aleator.simulators.fmu.description import REALS, Description, Variable, read_description
from aleator.simulators.function import load_function


def is_array(annotation: object) -> bool:
    """Whether the annotation of a function's argument says that it is an array."""
    return any(word in str(annotation) for word in ("Array", "ndarray"))


def arrays_among(function: Callable[..., Any]) -> frozenset[str]:
    """The arguments of a function that must be arrays, while its other arguments are numbers.

    An argument must be an array if it is annotated as one while others are not, or if the function
    subscripts it, loops over it, calls `len` on it, or passes it to an integrator as times. The set
    is empty if all arguments are annotated as arrays, or if the source is not available.

    >>> def level(time, rate):
    ...     return [time[0] * rate]
    >>> sorted(arrays_among(level))
    ['time']
    """
    named = inspect.signature(function).parameters
    told = {name for name, p in named.items() if is_array(p.annotation)}
    if told:
        return frozenset(told if len(told) < len(named) else ())
    used = {one.id for node in _nodes(function) for one in _sequences(node)
            if isinstance(one, ast.Name)}  # fmt: skip
    return frozenset(used & set(named))


def returned_by(function: Callable[..., Any]) -> tuple[str, ...]:
    """The names of the responses of a function that returns a dictionary.

    The tuple is empty if the function returns anything else, or if its source is not available.

    >>> def coasting(time, drag):
    ...     return {"speed": time, "way": drag}
    >>> returned_by(coasting)
    ('speed', 'way')
    """
    tables = [node.value for node in _nodes(function) if isinstance(node, ast.Return)]
    keys = [key for table in tables if isinstance(table, ast.Dict) for key in table.keys]
    names = [key.value for key in keys if isinstance(key, ast.Constant)]
    return tuple(dict.fromkeys(name for name in names if isinstance(name, str)))


def _nodes(function: Callable[..., Any]) -> list[ast.AST]:
    """All nodes of a function's syntax tree; none if its source is not available."""
    try:
        return [*ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function))))]
    except (OSError, TypeError, SyntaxError):
        return []


def _sequences(node: ast.AST) -> Iterator[ast.AST]:
    """The expressions that a syntax node uses as a sequence."""
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
        yield node.value
    if isinstance(node, ast.For | ast.comprehension):
        yield node.iter
    if isinstance(node, ast.Call):
        called = ast.unparse(node.func).rpartition(".")[2]
        if called in ("len", "enumerate", "zip", "diff"):
            yield from node.args
        if called == "odeint":
            yield from node.args[2:3]
        yield from (word.value for word in node.keywords if word.arg == "t_eval")


@dataclass(frozen=True)
class SimulatorInput:
    """An input or output of a simulator.

    `nominal` is the default of a function's argument, or the start value of an FMU's variable;
    `lower` and `upper` are limits that an FMU states. `required` says that an input has no default.
    `parameter` is false for what an FMU does not call a parameter: inputs and start values.
    """

    name: str
    nominal: float | None = None
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    required: bool = False
    description: str = ""
    parameter: bool = True


@dataclass(frozen=True)
class Offer:
    """A simulator as study.toml names it, with its inputs and the possible names of its outcome.

    `kind` is the key in the section `[simulator]` (function, fmu, command or umbridge), and `value`
    the value of that key. `stop_time` is the end of simulation that an FMU states. `variables` maps
    names in the study to inputs of the simulator that it calls otherwise. `arrays` are the
    arguments of a function that must be arrays while its others are numbers. `further` are other
    keys of the section, with their values.
    """

    kind: str
    value: str
    inputs: tuple[SimulatorInput, ...]
    returned: tuple[SimulatorInput, ...]
    vectorized: bool = False
    stop_time: float | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    arrays: frozenset[str] = frozenset()
    further: Mapping[str, object] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all inputs of the simulator."""
        return tuple(each.name for each in self.inputs)


def offered_by_function(reference: str, folder: Path) -> Offer:
    """The inputs and outputs of a Python function, "model.py:name" relative to a folder.

    Raises SimulatorError if the function cannot be imported.

    >>> offer = offered_by_function("math:isclose", Path())
    >>> offer.names, offer.inputs[2].nominal
    (('a', 'b', 'rel_tol', 'abs_tol'), 1e-09)
    """
    function = load_function(reference, folder)
    name = reference.rpartition(":")[2]
    try:
        arguments = [*inspect.signature(function).parameters.values()]
    except (TypeError, ValueError):
        raise SimulatorError(
            f"the simulator '{reference}' does not say what its arguments are called",
            "wrap it in a Python function with named arguments",
        ) from None
    named = [p for p in arguments if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    return Offer(
        "function",
        reference,
        tuple(
            SimulatorInput(p.name, _number(p.default), required=p.default is p.empty) for p in named
        ),
        tuple(map(SimulatorInput, returned_by(function))) or (SimulatorInput(name),),
        vectorized=_takes_arrays(function, named),
        arrays=arrays_among(function),
    )


def functions_in(file: Path) -> tuple[str, ...]:
    """The names of the public functions in a Python file; the file is read and not run."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return ()
    names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    return tuple(name for name in names if not name.startswith("_"))


def offered_by_fmu(file: Path, value: str) -> Offer:
    """The numeric inputs and outputs of an FMU; `value` is the path that the study file names.

    Parameters come first, then inputs and start values. Raises SimulatorError for a file that is
    no FMU.
    """
    description = read_description(file)
    settable = [v for v in description.variables.values() if v.settable and v.type in REALS]
    settable.sort(key=lambda v: (v.causality != "parameter", v.causality != "input"))
    return Offer(
        "fmu",
        value,
        tuple(_variable(v) for v in settable),
        tuple(_variable(v) for v in _recorded(description)),
        stop_time=description.stop_time,
    )


def bound(offer: Offer, columns: Sequence[str]) -> Offer:
    """The simulator with its inputs renamed as the columns of a table that mean them.

    A column means an input if the names agree but for case, signs between words, and a unit at the
    end of the column's: `Force_N` is `force`. Of an FMU's variable the part after the last dot
    counts ("force" in "spring.force"). A variable of an FMU whose name cannot be used in study.toml
    gets its last name, or its whole name with underscores if the last name is taken.

    >>> given = (SimulatorInput("spring.force"), SimulatorInput("spring.k"), SimulatorInput("mass"))
    >>> found = bound(Offer("fmu", "a.fmu", given, ()), ["Force_N", "travel"])
    >>> found.names, found.variables
    (('Force_N', 'k', 'mass'), {'Force_N': 'spring.force', 'k': 'spring.k'})
    """
    last = [name.rpartition(".")[2] if offer.kind == "fmu" else name for name in offer.names]
    plain = [_plain(short) for short in last]
    alone = {key: name for key, name in zip(plain, offer.names, strict=True)
             if plain.count(key) == 1 and name not in columns}  # fmt: skip
    called: dict[str, str] = {}
    for column in columns:
        keys = (_plain(column), _plain(without_unit(column)))
        found = next((alone[key] for key in keys if key in alone), None)
        if found and column not in offer.names:
            called.setdefault(found, column)
    taken = {*columns, *offer.names}
    for short, name in zip(last, offer.names, strict=True) if offer.kind == "fmu" else ():
        if name not in called and name not in columns and not name.isidentifier():
            good = short.isidentifier() and short not in taken and last.count(short) == 1
            called[name] = short if good else re.sub(r"\W", "_", name)
    return replace(
        offer,
        inputs=tuple(replace(one, name=called.get(one.name, one.name)) for one in offer.inputs),
        variables={short: name for name, short in called.items()},
        arrays=frozenset(called.get(name, name) for name in offer.arrays),
    )


def same_name(one: str, other: str) -> bool:
    """Whether two names agree but for case and the signs between words.

    >>> same_name("Shifting time", "shifting_time"), same_name("time", "times")
    (True, False)
    """
    return _plain(one) == _plain(other)


def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", "", name).casefold()


def without_unit(name: str) -> str:
    """A name without a unit at its end.

    >>> without_unit("Force_N"), without_unit("wear_rate")
    ('Force', 'wear_rate')
    """
    found = re.match(r"(.*\w)[_ ](\S+)$", name)
    return found[1] if found and is_unit(found[2]) else name


def offered_by_command(command: str, template: Path | None = None) -> Offer:
    """The inputs of a program: the placeholders of its command, `./spring {force} {stiffness}`.

    With the placeholder {input} they are also those of the `template` of the input file, between
    the first of `MARKS` that hold names and nothing else. Raises SimulatorError if there is no
    placeholder.

    >>> offered_by_command("./spring {force} {stiffness:.3f}").names
    ('force', 'stiffness')
    """
    names = Text.parse(command, escapes=True).names
    if "output" in names:
        raise SimulatorError(
            f"the command '{command}' has {{output}}, for which there is no value",
            "write the name of the file that the program writes, as out.csv; in the study "
            'output = {file = "out.csv", column = "..."} reads it',
        )
    further: dict[str, object] = {}
    if template is not None:
        marks, own = _placeholders(template)
        names = (*names, *own)
        stem = template.stem if Path(template.stem).suffix else f"{template.stem}.dat"
        further = {"template": template.name, "input": stem}
        if marks != Delimiters():
            further["delimiters"] = [marks.opening, marks.closing]
    names = tuple(name for name in dict.fromkeys(names) if name not in (STUDY, INPUT, ROWS))
    if not names:
        raise SimulatorError(
            f"the command '{command}' has no place for a condition or a parameter",
            "write their names in braces: --command './spring {force} {stiffness}'"
            if template is None
            else f"write their names in braces in {template.name}: {{force}}",
        )
    given = tuple(SimulatorInput(name, required=True) for name in names)
    return Offer("command", command, given, (), further=further)


MARKS = (
    Delimiters("{{", "}}"), Delimiters(), Delimiters("<", ">"), Delimiters("$", "$"),
    Delimiters("@", "@"),
)  # fmt: skip
"""The marks of placeholders that are looked for in a template, in this order."""
_NAME = re.compile(r"[^\W\d][\w.-]*( \w[\w.-]*)*")


def _placeholders(template: Path) -> tuple[Delimiters, tuple[str, ...]]:
    """The marks of the placeholders of a template, and their names; none where it has none.

    Marks that hold something else than a name belong to the program, as the braces of SPICE do.
    Raises SimulatorError if no other marks hold names then.
    """
    text = template.read_text(encoding="utf-8", errors="replace")
    other = ""
    for marks in MARKS:
        held = [match["name"].strip() for match in re.finditer(marks.pattern, text)]
        odd = [words for words in held if not _NAME.fullmatch(words)]
        if held and not odd:
            return marks, Text.parse(text, marks, f"the template {template.name}").names
        if odd and marks == Delimiters():
            other = odd[0]
    if other:
        raise SimulatorError(
            f"the template {template.name}: {{{other}}} is no place for a value, as {other} is no "
            "name; so its braces belong to the program",
            "write <NAME> where the value of a condition or a parameter goes, or $NAME$ or @NAME@",
        )
    return Delimiters(), ()


def written_by(command: str) -> str | None:
    """The file that a command tells its program to write; None if it names none.

    It is the last argument that ends like a file of results, has no placeholder, and is no file of
    the study.

    >>> written_by("./beam.py {input} out.csv"), written_by("./spring {force} {study}/table.csv")
    ('out.csv', None)
    """
    words = [word for word in command.split()[1:] if "{" not in word and "/" not in word]
    told = [word for word in words if Path(word).suffix.lower() in RESULTS]
    return told[-1] if told else None


RESULTS = (".csv", ".json", ".txt", ".dat", ".out")
"""The ends of names by which an argument of a command is a file that the program writes."""


def reads_a_file(command: str) -> bool:
    """Whether a command has the placeholder {input}, for a file that is written for every run."""
    return INPUT in Text.parse(command, escapes=True).names


def offered_by_server(address: str, inputs: str) -> Offer:
    """The inputs of a model of an UM-Bridge server, whose address ends in the model's name.

    `inputs` are the components of its input vectors, with commas between; a semicolon begins the
    next vector. Numbers are constants. The server is not asked. Raises SimulatorError for an
    address without a model, and without a named input.

    >>> offer = offered_by_server("http://localhost:4242/forward", "load; stiffness, 9.81")
    >>> offer.names, offer.value, offer.further["inputs"]
    (('load', 'stiffness'), 'http://localhost:4242', [['load'], ['stiffness', 9.81]])
    """
    url, _, model = address.rstrip("/").rpartition("/")
    if not model or "//" not in url or url.endswith("/"):
        raise SimulatorError(
            f"'{address}' is no address of a model",
            "write --umbridge http://localhost:4242/forward",
        )
    vectors = [[part.strip() for part in one.split(",") if part.strip()]
               for one in inputs.split(";")]  # fmt: skip
    names = dict.fromkeys(part for one in vectors for part in one if not _is_number(part))
    if not names:
        raise SimulatorError(
            f"nothing says what the inputs of the model '{model}' are",
            "name them in their order: --inputs 'load; stiffness, damping'",
        )
    filled = [[float(part) if _is_number(part) else part for part in one] for one in vectors]
    given = tuple(SimulatorInput(name, required=True) for name in names)
    return Offer("umbridge", url, given, (), further={"model": model, "inputs": filled})


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _recorded(description: Description) -> list[Variable]:
    """The numeric variables that a simulation of an FMU can record, the outputs first."""
    known = [v for v in description.variables.values() if v.recordable and v.type in REALS]
    changing = [v for v in known if v.causality in ("output", "local")]
    return sorted(changing, key=lambda v: v.causality != "output")


def _variable(variable: Variable) -> SimulatorInput:
    return SimulatorInput(
        variable.name,
        variable.start,
        variable.unit or "",
        variable.minimum,
        variable.maximum,
        description=variable.description,
        parameter=variable.causality == "parameter",
    )


def _number(default: object) -> float | None:
    """The default of an argument as a number; None if it is no finite number, or True or False."""
    if isinstance(default, bool) or not isinstance(default, (int, float)):
        return None
    return float(default) if math.isfinite(default) else None


def _takes_arrays(function: Callable[..., Any], arguments: list[inspect.Parameter]) -> bool:
    """Whether a function's annotations say that all its arguments and its result are arrays."""
    kinds = [p.annotation for p in arguments if p.annotation is not p.empty]
    returned = inspect.signature(function).return_annotation
    return bool(kinds) and all(map(is_array, [*kinds, returned]))
