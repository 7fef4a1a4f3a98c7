"""The keys and types of identification.json and ceiling.json, checked when a file is read.

An entry that belongs to a data class is checked against the fields of that class. In JSON null
stands for a number that JSON cannot hold: NaN or infinity.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, reduce
from operator import or_
from pathlib import Path
from types import GenericAlias, UnionType
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin
from typing import get_type_hints as hints_of

from pydantic import BaseModel, ConfigDict, ValidationError, create_model, model_validator
from pydantic import Field as Known
from pydantic_core import PydanticCustomError

from aleator.errors import AleatorError, key_path, short
from aleator.results.result import Result
from aleator.results.values import (
    REPORTED,
    Consistency,
    Estimate,
    ExperimentReport,
    IndividualReport,
    LogLikelihoodReport,
)

Document = dict[str, Any]
Finite = Annotated[float, Known(allow_inf_nan=False)]
Number = Finite | None
Series = list[Number]
Grid = list[Series]
FORMER = (Any, None)
"""The type of a key that only earlier versions of Aleator wrote; its value is not read."""
IDENTIFICATION = "identification.json"
"""The file in which an identification stands in the folder of its results."""
NEEDED = ("alpha", "log_likelihood", "experiments")
"""The keys that every identification has."""


def fault(key: str, problem: str) -> PydanticCustomError:
    """A pydantic error about a key of an entry, with the problem in words."""
    return PydanticCustomError("disagrees", "{problem}", {"key": key, "problem": problem})


class DocumentEntry(BaseModel):
    """A JSON object in a document; keys that are not declared here are allowed."""

    model_config = ConfigDict(strict=True, extra="allow")


class ExactEntry(DocumentEntry):
    """A JSON object that belongs to a data class: only fields of the class are allowed as keys."""

    model_config = ConfigDict(extra="forbid")


def require_equal(key: str, *columns: Sequence[Any] | None) -> None:
    """Raise an error about `key` unless all the given columns have the same length."""
    lengths = {len(column) for column in columns if column is not None}
    if len(lengths) > 1:
        raise fault(key, f"has series of unequal lengths: {', '.join(map(str, sorted(lengths)))}")


def require_shape(key: str, grid: Grid | None, rows: int, columns: int) -> None:
    """Raise an error about `key` unless the grid has this number of rows and columns."""
    if grid is None or [len(row) for row in grid] != [columns] * rows:
        raise fault(key, f"is no grid of {rows} x {columns} numbers")


# ------------------------------------------------------------------------------ parts


class CorrelationEntry(DocumentEntry):
    """The correlation matrix of the estimates that have a standard error, and their names."""

    names: list[str]
    matrix: Grid

    @model_validator(mode="after")
    def _square(self) -> Self:
        require_shape("matrix", self.matrix, len(self.names), len(self.names))
        return self


class OptimumEntry(DocumentEntry):
    """A local maximum that the search found, and from how many starts."""

    log_likelihood: Number
    starts: int
    alpha: dict[str, Number] = {}


class SearchEntry(DocumentEntry):
    """How the maximum of the likelihood was searched: method, starts, evaluations, local maxima."""

    method: str = ""
    starts: int = 0
    evaluations: int = 0
    distinct_optima: int = 0
    optima: list[OptimumEntry] = []
    stopped: list[OptimumEntry] = []


class RoundEntry(DocumentEntry):
    """What an emulator of the simulator left unknown after a number of runs."""

    runs: int
    estimates_error: Number
    log_likelihood_error: Number


class Surfaces(DocumentEntry):
    """The response surfaces that replaced the simulator: their number, runs and errors."""

    converged: int = 0
    experiments: int = 0
    runs: int = 0
    median_error: Number = None
    worst_error: Number = None
    estimates_error: Number = None
    log_likelihood_error: Number = None
    intervals_error: Number = None
    surprise: Number = None
    stored: int = 0
    slopes: int = 0
    together: int = 0
    rounds: list[RoundEntry] = []
    against: str = ""
    where: str = ""


class LeastSquaresEntry(DocumentEntry):
    """The fit by least squares, with one value of each parameter for all experiments."""

    parameters: dict[str, Number]
    rmse: Number
    log_likelihood: Number


class Circe(DocumentEntry):
    """The law that is identified by linearization of the simulator (the CIRCE method)."""

    alpha: dict[str, Number]
    log_likelihood: Number


class Baselines(DocumentEntry):
    """The results of simpler methods, for comparison."""

    least_squares: LeastSquaresEntry | None = None
    circe: Circe | None = None


class Quadrature(DocumentEntry):
    """The quadrature of the individual integrals: its nodes, and what finer nodes change."""

    nodes: Finite
    gap: Number


class BestPossible(DocumentEntry):
    """The log-likelihood of the best law of any family, and its gap to the identified law."""

    log_likelihood: Number
    gap: Number
    p_value: Number
    replicates: Number


class StudyEntry(DocumentEntry):
    """The study file that was identified: its name and a hash of its content."""

    file: str | None = None
    sha256: str | None = None
    outcome: str | None = None


class SimulatorEntry(DocumentEntry):
    """The simulator of the study: its name, its fingerprint, and notes about its runs.

    `defaults` are the arguments of a Python function that kept a number as their default.
    """

    name: str
    fingerprint: str | None = None
    notes: list[str] = []
    defaults: dict[str, float] = {}


# ------------------------------------------------------------------------------ pictures


class Curve(DocumentEntry):
    """The curve of a density, and the lower and upper curve of its uncertainty band."""

    x: Series
    density: Series
    lower: Series | None = None
    upper: Series | None = None

    @model_validator(mode="after")
    def _alike(self) -> Self:
        require_equal("x", self.x, self.density, self.lower, self.upper)
        if (self.lower is None) != (self.upper is None):
            raise fault("lower", "has no other end of the band")
        return self


class Contour(DocumentEntry):
    """Contours of the joint law of two parameters, that hold 50 % and 95 %: x and y of each."""

    between: tuple[str, str]
    curves: dict[Literal["0.5", "0.95"], tuple[Series, Series]]

    @model_validator(mode="after")
    def _alike(self) -> Self:
        for share, curve in self.curves.items():
            require_equal(f"curves.{share}", *curve)
        return self


class ProfileEntry(DocumentEntry):
    """The profile likelihood of one hyperparameter: its values, and the drop below the maximum."""

    at: Series
    below: Series

    @model_validator(mode="after")
    def _alike(self) -> Self:
        require_equal("at", self.at, self.below)
        return self


class SurfaceEntry(DocumentEntry):
    """The likelihood over two hyperparameters, on a square grid of at least four points a side."""

    between: tuple[str, str]
    correlation: Finite
    first: Grid
    second: Grid
    below: Grid

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = max(len(self.below), 4)
        for key in ("first", "second", "below"):
            require_shape(key, getattr(self, key), size, size)
        return self


class Shown(DocumentEntry):
    """One observation for which a chart shows the simulated outcome."""

    id: str
    response: str
    lower: Number
    upper: Number
    place: Literal["first", "middle", "last"] = "last"
    curves: dict[str, Series] = {}
    map: Grid | None = None
    values: Series | None = None


class Simulated(DocumentEntry):
    """The simulated outcome over the parameters: curves and a map, or values at nodes."""

    over: dict[str, list[Finite]] = {}
    map: dict[str, list[Finite]] = {}
    nodes: dict[str, Series] | None = None
    shown: list[Shown] = []

    @model_validator(mode="after")
    def _alike(self) -> Self:
        sides = [*self.map.values()]
        if len(sides) not in (0, 2) or any(len(side) < 2 for side in sides):
            raise fault("map", "has no two sides")
        if self.nodes is not None:
            require_equal("nodes", *self.nodes.values())
        for k, one in enumerate(self.shown):
            if self.nodes is not None:
                require_equal(f"shown[{k}].values", one.values or [], *self.nodes.values())
                continue
            for name, at in self.over.items():
                require_equal(f"shown[{k}].curves.{name}", at, one.curves.get(name, []))
            if sides:
                require_shape(f"shown[{k}].map", one.map, *map(len, sides))
        return self


class Pictures(DocumentEntry):
    """The data of the charts in a report."""

    conditions: dict[str, list[Number | str]] = {}
    laws: dict[str, Curve] = {}
    laws_by_level: dict[str, dict[str, Curve]] = {}
    contours: list[Contour] = []
    profiles: dict[str, ProfileEntry] = {}
    surface: SurfaceEntry | None = None
    response: Simulated | None = None
    roughness: Series = []
    predicted: dict[str, Series] = {}


# ------------------------------------------------------------------------------ the documents


class _AnswerDocument(DocumentEntry):
    """The keys of identification.json that are not fields of `Result`, and checks across keys."""

    title: str = ""
    study: StudyEntry | None = None
    simulator: SimulatorEntry | None = None
    consistent: bool | None = None
    correlation: CorrelationEntry
    pictures: Pictures = Pictures()

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if key_and_problem := _disagreement(self):
            raise fault(*key_and_problem)
        return self


def _disagreement(answer: Any) -> tuple[str, str] | None:
    """The first key that contradicts another key, with the problem; None if all agree."""
    pictures, seen = answer.pictures, answer.observations or ()
    for key, names in (
        ("correlation.names", answer.correlation.names),
        ("pictures.profiles", pictures.profiles),
        ("pictures.surface.between", pictures.surface.between if pictures.surface else ()),
    ):
        if strange := [name for name in names if name not in answer.alpha]:
            return key, f"names {strange[0]}, which is no key of alpha"
    laws = answer.plausible
    if laws is not None and any(len(row) != len(answer.alpha) for row in laws.alpha or ()):
        return "plausible.alpha", "has rows that are not of alpha"
    if laws is not None and len(laws.alpha or ()) != len(laws.weights or ()):
        return "plausible.weights", "are not one for each row of plausible.alpha"
    if answer.consistency is not None and "consistent" not in answer.model_fields_set:
        return "consistent", "is missing"
    ids = {one.id for one in answer.experiments}
    for k, one in enumerate(seen):
        if one.id not in ids:
            return f"observations[{k}].id", "is that of no experiment"
        if one.response not in (answer.responses or {}):
            return f"observations[{k}].response", "is no key of responses"
    if seen:
        parameters = answer.experiments[0].mean.keys()
        for k, own in enumerate(answer.experiments):
            for key in ("mode", "mean", "sd"):
                if getattr(own, key).keys() != parameters:
                    return f"experiments[{k}].{key}", "has other parameters than the first one"
            counts = {name: len(each) for name, each in (own.components or {}).items()}
            first = {n: len(p) for n, p in (answer.experiments[0].components or {}).items()}
            if counts != first or 0 in counts.values():
                return f"experiments[{k}].components", "are not those of the first one"
    if pictures.predicted and (
        pictures.predicted.keys() != {str(p) for p in REPORTED.quantiles}
        or any(len(column) != len(seen) for column in pictures.predicted.values())
    ):
        return "pictures.predicted", "has not each quantile of each observation"
    points = (answer.failures and answer.failures.points) or {}
    if len({len(column) for column in points.values()}) > 1:
        return "failures.points", "has series of unequal lengths"
    sides = pictures.response.map if pictures.response else {}
    if points and not points.keys() >= sides.keys():
        return "failures.points", "lacks a parameter of pictures.response.map"
    return None


class _CeilingDocument(DocumentEntry):
    """The keys of ceiling.json that a report uses; the file has the best law of any family."""

    study: StudyEntry = StudyEntry()
    log_likelihood: dict[str, Number] = {}
    bootstrap: dict[str, Number] | None = None
    points: list[dict[str, Finite]] = []

    @model_validator(mode="after")
    def _weighted(self) -> Self:
        for k, point in enumerate(self.points):
            if "probability" not in point:
                raise fault(f"points[{k}]", "has no probability")
        return self


# ------------------------------------------------------------------------------ of data classes


def entry_of(
    kind: type, base: type[DocumentEntry] = ExactEntry, required: tuple[str, ...] = (), **own: Any
) -> type[DocumentEntry]:
    """The pydantic model of a data class; fields with a default may be missing in a document.

    `required` are fields that must not be missing. `own` gives the type and default of keys that
    differ from the fields; None means that the document has no such key.
    """
    hints = hints_of(kind)
    known = {
        field.name: (
            _in_json(hints[field.name]),
            ... if field.name in required else _default(field),
        )
        for field in fields(kind)
    }
    every = {name: value for name, value in (known | own).items() if value is not None}
    found: type[DocumentEntry] = create_model(kind.__name__, __base__=base, **every)
    return found


def _default(field: Field[Any]) -> Any:
    """The default of a key, for documents of an earlier version that did not write it."""
    return ... if (field.default, field.default_factory) == (MISSING, MISSING) else None


def _in_json(hint: Any) -> Any:
    """The type of a key in JSON, from the type of the field."""
    if hint is float:
        return Number
    if isinstance(hint, type) and is_dataclass(hint):
        return entry_of(hint)
    parts = tuple(_in_json(part) for part in get_args(hint))
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        return reduce(or_, parts)
    if origin in (Mapping, dict):
        return GenericAlias(dict, parts)
    return GenericAlias(origin, parts) if origin is not None else hint


@cache
def _answer(individual: bool) -> type[DocumentEntry]:
    """The pydantic model of identification.json.

    `individual` says that experiments have several observations each.
    """
    estimate = entry_of(
        Estimate, estimate=(Finite, ...), interval=(tuple[Number, Number] | None, None)
    )
    one = (
        entry_of(IndividualReport)
        if individual
        else entry_of(ExperimentReport, surface_error=(Number, None), verified=FORMER)
    )
    tests = ("discrepancies", "outliers", "tests", "reason")
    consistency = entry_of(Consistency, required=tests, consistent=None)
    likelihood = entry_of(LogLikelihoodReport, reached=FORMER)
    return entry_of(
        Result, _AnswerDocument,
        alpha=(GenericAlias(dict, (str, estimate)), ...),
        log_likelihood=(likelihood, ...),
        experiments=(GenericAlias(list, (one,)), ...),
        consistency=(consistency, None),
        search=(SearchEntry, ...), surface=(Surfaces | None, None), baselines=(Baselines, ...),
        seconds=(dict[str, Finite], ...), law_curves=(dict[str, Curve], {}),
        quadrature=(Quadrature | None, None), best_possible=(BestPossible | None, None),
        correlation=None, correlation_names=None, pictures=None,
    )  # fmt: skip


# ------------------------------------------------------------------------------ reading


def answer_file(path: Path) -> Path:
    """The file of an answer: `path` itself, or what a folder of results has.

    Of a folder it is identification.json; without that, its only JSON file. Raises AleatorError,
    which names all, if there is none or more than one.
    """
    if not path.is_dir() or (path / IDENTIFICATION).exists():
        return path / IDENTIFICATION if path.is_dir() else path
    found = sorted(path.glob("[!.]*.json"))
    if len(found) != 1:
        raise AleatorError(
            f"{short(path)}: this folder has no {IDENTIFICATION}",
            f"name one of its files: {', '.join(short(each) for each in found)}"
            if found
            else "name the folder or the file that a command of Aleator wrote",
        )
    return found[0]


def read_answer(path: str | Path) -> Document:
    """Read the document of an identification, and check all of its keys.

    For a folder of results the file is that of `answer_file`.

    Raises AleatorError, naming the file and the key, if the file is absent, not JSON, no
    identification, or has a key that an identification does not write so.
    """
    path = answer_file(Path(path))
    document = read_document(path)
    missing = [key for key in NEEDED if key not in document]
    if missing:
        raise AleatorError(
            f"{path}: this is not an identification: it lacks {', '.join(missing)}",
            "name the identification.json that `aleator identify` wrote",
        )
    _check(_answer(bool(document.get("observations"))), document, path, "identify")
    return document


def read_ceiling(path: Path) -> Document:
    """Read the document that `aleator ceiling` wrote, and check the keys that a report uses."""
    document = read_document(path, "ceiling")
    _check(_CeilingDocument, document, path, "ceiling")
    return document


def read_document(path: Path, command: str = "identify") -> Document:
    """Read a JSON file that a `command` wrote; a value that is no JSON object becomes {}.

    Raises AleatorError if the file cannot be read, or is not JSON.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_int=_whole)
    except OSError as error:
        raise AleatorError(
            f"{path}: the file cannot be read: {error.strerror}",
            f"name the file that `aleator {command}` wrote",
        ) from None
    except (ValueError, RecursionError) as error:
        raise AleatorError(
            f"{path}: this is not JSON: {error}", f"run `aleator {command}` again to write it anew"
        ) from None
    return document if isinstance(document, dict) else {}


def _whole(digits: str, most: int = 19) -> float:
    """A whole number from a JSON file; infinity for one of more than `most` digits."""
    return int(digits) if len(digits) <= most else math.inf


def _check(entry: type[DocumentEntry], document: Document, path: str | Path, command: str) -> None:
    """Raise AleatorError, naming the key, if a document does not match its pydantic model."""
    try:
        entry.model_validate_json(json.dumps(document))
    except ValidationError as error:
        every = error.errors(include_url=False)
        first = min(every, key=lambda one: one["type"] == "missing")
        where = key_path(first["loc"], document, missing=first["type"] == "missing")
        own = first.get("ctx", {})
        where = ".".join(part for part in (where, str(own.get("key", ""))) if part)
        problem = own.get("problem") or first["msg"].replace("Input ", "it ")
        problem = "it is missing" if first["type"] == "missing" else problem
        key = re.split(r"[.\[]", where)[0]
        raise AleatorError(
            f"{path}: key '{key}' is not as `aleator {command}` writes it: {where}: {problem}",
            f"run `aleator {command}` again to write the file anew",
        ) from None
