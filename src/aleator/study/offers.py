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
from aleator.simulators.command.inputs import Text
from aleator.simulators.command.simulator import STUDY
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


INPUT = "input"
"""The name of the placeholder `{input}` in a command: the input file of the program."""


@dataclass(frozen=True)
class SimulatorInput:
    """An input or output of a simulator.

    `nominal` is the default of a function's argument, or the start value of an FMU's variable;
    `lower` and `upper` are limits that an FMU states. `required` says that an input has no default.
    """

    name: str
    nominal: float | None = None
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    required: bool = False
    description: str = ""


@dataclass(frozen=True)
class Offer:
    """A simulator as study.toml names it, with its inputs and the possible names of its outcome.

    `kind` is the key in the section `[simulator]` (function, fmu or command), and `value` the value
    of that key. `stop_time` is the end of simulation that an FMU states. `variables` maps names in
    the study to variables of the FMU. `arrays` are the arguments of a function that must be arrays
    while its others are numbers.
    """

    kind: str
    value: str
    inputs: tuple[SimulatorInput, ...]
    returned: tuple[SimulatorInput, ...]
    vectorized: bool = False
    stop_time: float | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    arrays: frozenset[str] = frozenset()

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
    """The simulator with its inputs renamed if the names in its FMU cannot be used in study.toml.

    A function or a command is unchanged. The last name of an FMU's variable is the part after the
    last dot ("force" in "spring.force"). A variable is renamed as the column of the table that has
    its last name, if no other variable has the same. Any other variable whose name is no identifier
    gets its last name, or its whole name with underscores if the last name is taken.

    >>> given = (SimulatorInput("spring.force"), SimulatorInput("spring.k"), SimulatorInput("mass"))
    >>> found = bound(Offer("fmu", "a.fmu", given, ()), ["Force", "travel"])
    >>> found.names, found.variables
    (('Force', 'k', 'mass'), {'Force': 'spring.force', 'k': 'spring.k'})
    """
    if offer.kind != "fmu":
        return offer
    last = [name.rpartition(".")[2] for name in offer.names]
    alone = {short.lower(): name for short, name in zip(last, offer.names, strict=True)
             if [one.lower() for one in last].count(short.lower()) == 1}  # fmt: skip
    called = {alone[c.lower()]: c for c in columns if c not in offer.names and c.lower() in alone}
    taken = {*columns, *offer.names}
    for short, name in zip(last, offer.names, strict=True):
        if name not in called and name not in columns and not name.isidentifier():
            good = short.isidentifier() and short not in taken and last.count(short) == 1
            called[name] = short if good else re.sub(r"\W", "_", name)
    given = tuple(replace(each, name=called.get(each.name, each.name)) for each in offer.inputs)
    return replace(offer, inputs=given, variables={short: name for name, short in called.items()})


def offered_by_command(command: str) -> Offer:
    """The inputs of a program: the placeholders of its command, `./spring {force} {stiffness}`.

    Raises SimulatorError if the command has no placeholder.

    >>> offered_by_command("./spring {force} {stiffness:.3f}").names
    ('force', 'stiffness')
    """
    names = Text.parse(command, escapes=True).names
    if not names:
        raise SimulatorError(
            f"the command '{command}' has no place for a condition or a parameter",
            "write their names in braces: --command './spring {force} {stiffness}'",
        )
    given = tuple(
        SimulatorInput(name, required=True) for name in names if name not in (STUDY, INPUT)
    )
    return Offer("command", command, given, ())


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
