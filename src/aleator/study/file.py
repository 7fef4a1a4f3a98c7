"""Reading study.toml into the values for an identification; all mistakes are one StudyError."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from aleator.core.arithmetic import share_of
from aleator.errors import (
    AleatorError,
    ExperimentsError,
    InputsError,
    SimulatorError,
    StudyError,
    key_path,
    nearest,
    require_filled,
)
from aleator.fit.question import Choices, varying_conditions
from aleator.inference.check import Check
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.outcome_question import OutcomeQuestion, require_laws_at
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations import tables
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.model import ObservationModel
from aleator.observations.noise import Noise
from aleator.results.units import checked_units
from aleator.search import GradientMultistart, Search
from aleator.simulators import Runner, Simulator, Store
from aleator.simulators.derived import Derivation, Derived, defaults_left, derived
from aleator.simulators.fmu import FMUSimulator
from aleator.simulators.parameter import ParameterItself
from aleator.study.kinds import FAULT, ChosenKind, LawSection, in_toml
from aleator.study.sections import (
    ExperimentsSection,
    NoiseSection,
    QuestionSection,
    StudyFile,
    columns_of,
    pairs,
    scales_of,
)
from aleator.study.simulators import RunsSection
from aleator.surrogates import ResponseSurface

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def study_error(error: ValidationError, document: Mapping[str, Any], path: Path) -> StudyError:
    """One StudyError that lists all wrong keys of a study file, each with its remedy."""
    faults = [_fault(details, document) for details in error.errors(include_url=False)]
    lines = [f"{path}: {problem}" for problem, _ in faults]
    if len(faults) == 1:
        return StudyError(lines[0], faults[0][1])
    numbered = [f"{line}: {remedy}" for line, (_, remedy) in zip(lines, faults, strict=True)]
    return StudyError(
        f"{path}: {len(faults)} keys are wrong\n  " + "\n  ".join(numbered), "correct these keys"
    )


def _fault(details: ErrorDetails, document: Mapping[str, Any]) -> tuple[str, str]:
    """The problem with one key of study.toml, and its remedy, from an error of pydantic."""
    context: dict[str, Any] = dict(details.get("ctx", {}))
    kind = details["type"]
    location = key_path(details["loc"], document, missing=kind == "missing")
    if context.get("key"):
        location = f"{location}.{context['key']}" if location else str(context["key"])
    key = f"key '{location}'"
    if kind == FAULT:
        return f"{key}{context['problem']}", str(context["remedy"])
    if kind == "missing":
        name = location.rpartition(".")[2]
        return f"{key} is missing", f"add {_FORMS.get(location, _FORMS.get(name, 'it'))}"
    if kind == "literal_error":
        return _unknown(location, str(context["expected"]), details.get("input"))
    shown = f"{key} = {in_toml(details.get('input'))}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        inner = f"{location.rpartition('.')[2]} = {{KEY = VALUE, ...}}"
        head = inner if "[" in location else f"[{location}] and its keys under it"
        return f"{shown} is not a table", f"write {head}"
    if kind == "list_type" and isinstance(details.get("input"), dict):
        return f"{shown} is one table", f"write [[{location}]] above the keys of each"
    if kind == "union_tag_invalid" and isinstance(details.get("input"), list | dict):
        name = location.rpartition(".")[2]
        form = "list" if isinstance(details["input"], list) else "table"
        return f"{shown} is a {form}", f"write {_FORMS.get(name, 'a number')}"
    if kind == "union_tag_invalid" and isinstance(details.get("input"), str):
        share = share_of(details["input"])
        name = location.rpartition(".")[2]
        wanted = "a number without quotes, such as 0.5" if share is None else f"{name} = {share:g}"
        return f"{shown} is a text", f"write {wanted}"
    message = details["msg"]
    message = message.removeprefix("Input ").removeprefix("Value ").removeprefix("List ")
    return f"{shown}: it {message}", _WANTED.get(kind, "correct the value")


def _unknown(location: str, expected: str, value: object) -> tuple[str, str]:
    """The problem and the remedy of a key with an unknown value.

    `expected` is pydantic's text that lists the known values.
    """
    known = [word.strip(" '") for word in expected.replace(" or ", ", ").split(",")]
    return (
        f"key '{location}' = {in_toml(value)} is not known{nearest(str(value), known)}",
        f"choose one of {', '.join(known)}",
    )


_FORMS = {
    "experiments.file": 'file = "experiments.csv"',
    "experiments.outcome": 'outcome = "COLUMN"',
    "experiments": "[experiments] and its keys under it",
    "simulator": "[simulator] and its keys under it",
    "parameters": "[parameters.NAME] and its keys under it, for each parameter",
    "box": "box = [LOWER, UPPER]",
    "mean": "mean = NUMBER, or mean = {lower = NUMBER, upper = NUMBER} to identify it",
    "sd": "sd = NUMBER, or sd = {lower = NUMBER, upper = NUMBER} to identify it",
    "value": "value = NUMBER, or value = {lower = NUMBER, upper = NUMBER} to identify it",
}
"""For each required key, a line that shows how it is written; messages quote it."""

_WANTED = {
    "float_type": "write a number without quotes, such as 0.5",
    "int_type": "write a whole number without quotes, such as 10",
    "bool_type": "write true or false, without quotes",
    "string_type": 'write a text in quotes: "..."',
    "list_type": "write a list in brackets: [..., ...]",
    "too_short": "write as many values as it says",
    "too_long": "write as many values as it says",
    "finite_number": "write a finite number",
}


def units_of(
    file: StudyFile, folder: Path, table: Experiments, simulator: Simulator
) -> Mapping[str, str]:
    """The unit of each outcome, condition and parameter that has one.

    Raises InputsError if the study states the unit of a name that is no column of the table.
    """
    columns = [*table.observations.names, *map(str, table.table.columns)]
    checked_units(file.experiments.units, columns)
    stated = file.experiments.stated_units(folder)
    own = {name: unit.strip() for name, unit in stated.items() if name in columns and unit.strip()}
    for name, choice in file.parameters.items():
        if isinstance(choice.keys, LawSection) and choice.keys.unit.strip():
            own[name] = choice.keys.unit.strip()
    asked = (*columns, *file.parameters)
    return {**_of_fmu(simulator, table.observations.names, asked), **own}


def _of_fmu(
    simulator: Simulator, responses: tuple[str, ...], names: tuple[str, ...]
) -> Mapping[str, str]:
    """The units that an FMU states for its variables; empty for any other simulator."""
    inner = simulator.inner if isinstance(simulator, Derived) else simulator
    return inner.units(responses, names) if isinstance(inner, FMUSimulator) else {}


T = TypeVar("T")


@dataclass(frozen=True)
class Study:
    """A study file, read and checked: the arguments of `aleator.identify`, and their origin.

    `file` is the study file, `sha256` the hash of its bytes, and `store` the file of the
    simulator's runs, which need not exist. `restricted` says that the restricted likelihood is
    maximized, `small_sample` that intervals are adjusted for few experiments. A failed run is
    repeated `retries` times; a share of failures above `max_failed` stops a study. `units` has the
    units of outcomes, conditions and parameters; a unit in the study file takes precedence over the
    unit in an FMU. `questions` are answered with the law, each about one new experiment.
    """

    file: Path
    sha256: str
    title: str
    seed: int
    experiments: Experiments
    simulator: Simulator
    inputs: Inputs
    noise: Noise | Mapping[str, Noise] | None
    propagation: ResponseSurface | Collocation
    density: Density | None
    search: Search
    verification: Check
    restricted: bool
    small_sample: bool
    table: ExperimentsSection
    store: Path
    retries: int
    max_failed: float
    units: Mapping[str, str]
    questions: tuple[OutcomeQuestion, ...] = ()

    @property
    def model(self) -> Model:
        """The statistical model without noise: laws, propagation and density of the outcome."""
        return Model.of(self.inputs, self.propagation, self.density)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters of the study, free and fixed, in the order of alpha."""
        return Choices.of(
            self.experiments, self.inputs, self.noise, self.propagation, self.density, self.search
        ).hyperparameters

    def overridden(
        self, seed: int | None = None, starts: int | None = None, verified: bool = True
    ) -> Study:
        """The study with another seed or number of starts, or without the check on the simulator.

        Raises InputsError for fewer than one start, and for a search method that has no starts.
        """
        return replace(
            self,
            seed=self.seed if seed is None else seed,
            search=self.search if starts is None else _started(self.search, starts),
            verification=self.verification if verified else Check(0),
        )

    def runner(
        self,
        conditions: Conditions | None = None,
        store: Store | None = None,
        executor: Executor | None = None,
    ) -> Runner:
        """A runner, which runs the simulator under the study's experiments or other `conditions`.

        `store` provides earlier runs and keeps new ones; without it runs are kept in memory only.
        The workers of `executor` make the runs; without it this process does. Raises
        SimulatorError if the simulator does not take these conditions and parameters.
        """
        measured = self.experiments
        return Runner(
            self.simulator, conditions or measured, self.inputs.names, store=store,
            executor=executor, retries=self.retries, max_failed=self.max_failed,
            varying=varying_conditions(measured, [*map(str, measured.conditions.columns)]),
        )  # fmt: skip

    def simulator_notes(self) -> tuple[str, ...]:
        """Notes on an FMU: which variables have the conditions and parameters, how its runs went.

        Any other simulator has no notes.
        """
        simulator, names = self.simulator, self.inputs.names
        tried = [*map(str, self.experiments.conditions.columns)]
        if isinstance(simulator, Derived):
            names, simulator = simulator.passed(tried, names), simulator.inner
        if not isinstance(simulator, FMUSimulator):
            return ()
        return (*simulator.bindings(tried, names), *simulator.notes)

    def defaults_left(self) -> dict[str, float]:
        """The arguments of a Python function that keep a number as their default, by name."""
        names = (*self.inputs.names, *map(str, self.experiments.conditions.columns))
        return defaults_left(self.simulator, names)

    def close(self) -> None:
        """End the processes of the simulator; a later run starts them again."""
        close = getattr(self.simulator, "close", None)
        if close is not None:
            close()

    def read_conditions(self, path: str | Path, *, measured: bool = False) -> Conditions:
        """Read a table of new conditions, which has the form of the study's table without outcomes.

        Conditions that the simulator does not take may be missing, covariates of a law may not,
        except for experiments that were `measured`. A column of numbers in the study's table must
        have numbers here. Rows with the same id are one new experiment; without a column of ids
        each row is one, named by its number, unless one run of the simulator makes the several
        rows of an experiment. Raises ExperimentsError for the errors that `Experiments.from_csv`
        reports.
        """
        table = tables.read(path, self.table.delimiter, self.table.decimal)
        own, experiments = self.table.id, self.experiments
        single = len(experiments.ids) == len(experiments.experiment)
        apart = single or not getattr(self.simulator, "series", False)
        if own is not None and own not in table.columns and apart and not measured:
            own = None
        found = Conditions.from_table(
            table,
            id=own,
            conditions=self.taken,
            numbers=self._numbers,
            responses=experiments.observations.responses,
        )
        covariates = () if measured else self.inputs.covariates
        if missing := [name for name in covariates if name not in found.table.columns]:
            needed = ", ".join(dict.fromkeys([*self.taken, *covariates]))
            raise ExperimentsError(
                f"{path}: the column '{missing[0]}' is missing, which a law of the study follows",
                f"add it, one value for each new experiment; the table needs {needed}",
            )
        return found

    def stated_conditions(self, columns: Mapping[str, Sequence[str | float]]) -> Conditions:
        """New conditions from values by name; a name with one value has it in every row.

        Numbers that are texts have the decimal sign of the study's table.

        Raises InputsError for a name that is no column of the table, a condition that is missing,
        and unequal numbers of values; ExperimentsError for a text where a number is needed.
        """
        import pandas as pd

        own = [] if self.table.id is None else [self.table.id]
        known = [*map(str, self.experiments.table.columns), *own]
        for name in columns:
            if name not in known:
                raise InputsError(
                    f"'{name}' is no condition of the study{nearest(name, known)}",
                    f"the columns of its table are {', '.join(known)}",
                )
        needed = dict.fromkeys([*self.taken, *self.inputs.covariates])
        if absent := [name for name in needed if name not in columns]:
            raise InputsError(
                f"the simulator or a law takes {', '.join(absent)} too",
                f"give each condition a value: {absent[0]}=...",
            )
        rows = max(map(len, columns.values()))
        if any(len(cells) not in (1, rows) for cells in columns.values()):
            raise InputsError(
                "the conditions have different numbers of values",
                "give each one value, or as many as the others have",
            )
        whole = {n: [*cells] * (rows if len(cells) == 1 else 1) for n, cells in columns.items()}
        found = Conditions.from_frame(
            pd.DataFrame(whole),
            id=self.table.id if self.table.id in columns else None,
            conditions=self.taken,
            numbers=self._numbers,
            decimal=self.table.decimal,
        )
        places = [
            ", ".join(f"{n}={cells[row]}" for n, cells in whole.items()) for row in range(rows)
        ]
        return Conditions(
            found.ids, found.conditions, responses=self.experiments.observations.responses,
            table=found.table, experiment=found.experiment, places=places, id=found.id,
        )  # fmt: skip

    @property
    def taken(self) -> tuple[str, ...]:
        """The conditions of the table that the simulator takes."""
        tried = map(str, self.experiments.conditions.columns)
        return self.simulator.asks([*tried], self.inputs.names)

    def event(self, question: OutcomeQuestion) -> OutcomeEvent | None:
        """The event that a question of the study asks for; None for limits."""
        seen = self.experiments.observations.responses
        return question.event(seen, self.units, self.inputs.names)

    def for_event(self, event: OutcomeEvent | None) -> Study:
        """The study with a parameter in place of the simulator, if the event is one of a parameter.

        No run tells of a parameter, and no measurement.
        """
        if event is None or event.outcome in self.experiments.observations.names:
            return self
        return replace(self, simulator=ParameterItself(event.outcome), noise=None)

    @property
    def _numbers(self) -> list[str]:
        """The conditions that are numbers in the study's table."""
        tried = self.experiments.conditions
        return [name for name in self.taken if tried[name].dtype != object]


def load_study(path: str | Path) -> Study:
    """Read a study file with its table of experiments and its simulator.

    Paths in the file are relative to its folder. The paths of the simulator and of its store are
    made absolute. Raises StudyError naming file, key, value, cause and remedy; ExperimentsError for
    the table; SimulatorError for a function that cannot be imported or does not take the table's
    conditions and the study's parameters.
    """
    path = Path(path)
    raw = _read(path)
    document = _parse(raw, path)
    try:
        file = StudyFile.model_validate(document)
    except ValidationError as error:
        raise study_error(error, document, path) from None
    study = _build(file, path, hashlib.sha256(raw).hexdigest())
    _check(study, file)
    _made(path, f"simulator.{file.simulator.kind}", study.runner)
    asked = [_question(study, f"questions[{k}]", each) for k, each in enumerate(file.questions)]
    return replace(study, questions=tuple(asked))


def _question(study: Study, key: str, section: QuestionSection) -> OutcomeQuestion:
    """A question of a study, about one of its names and under conditions that are known.

    Raises StudyError or SimulatorError, with the key, for any other.
    """
    asked = _made(study.file, key, section.build)
    event = _made(study.file, key, lambda: study.event(asked))
    at = _made(study.file, f"{key}.at", lambda: _asked_at(study.for_event(event), section))
    return replace(asked, at=at)


def _asked_at(study: Study, section: QuestionSection) -> Conditions:
    """The conditions of a question, under which the simulator, the laws and the noise are known."""
    import pandas as pd

    if section.at or study.taken or study.inputs.covariates:
        found = study.stated_conditions({name: [value] for name, value in section.at.items()})
    else:
        seen = study.experiments.observations.responses
        found = Conditions(("1",), pd.DataFrame(index=[0]), responses=seen)
    study.runner(found)
    noise = study.noise if section.noise else None
    require_laws_at(found, study.inputs, study.experiments, noise)
    return found


def _check(study: Study, file: StudyFile) -> None:
    """Check that formulas and derived quantities name existing columns; else raise StudyError."""
    if study.inputs.individual_laws:
        names = _made(study.file, "parameters", lambda: study.inputs.columns)
        table = covariates(study.experiments, names)
        _made(study.file, "parameters", lambda: study.inputs.resolved(table))
    known = (*map(str, study.experiments.conditions.columns), *study.inputs.names)
    _made(study.file, "derived", lambda: Derivation.of(file.derived, known))


def _made(path: Path, key: str, make: Callable[[], T]) -> T:
    """The result of `make`; if it raises an AleatorError, the message also gets file and key."""
    try:
        return make()
    except AleatorError as error:
        kind = SimulatorError if isinstance(error, SimulatorError) else StudyError
        raise kind(f"{path}: key '{key}': {error.problem}", error.remedy) from error


def _build(file: StudyFile, path: Path, sha256: str) -> Study:
    folder = path.parent

    def made(key: str, make: Callable[[], T]) -> T:
        return _made(path, key, make)

    def built(key: str, choice: ChosenKind[T]) -> T:
        return made(key, lambda: choice.build(folder))

    def noise(key: str, choice: ChosenKind[ObservationModel]) -> Noise:
        kind = built(key, choice)
        made(f"{key}.kind", lambda: require_filled(kind, ObservationModel, choice.kind))
        sd, relative = scales_of(choice)
        if sd is not None:
            made(f"{key}.sd", lambda: Noise(sd))
        if relative is not None:
            made(f"{key}.relative", lambda: Noise(relative=relative))
        keys = choice.keys
        assert isinstance(keys, NoiseSection)
        variance = keys.variance and built(f"{key}.variance", keys.variance)
        ties = keys.correlation and built(f"{key}.correlation", keys.correlation)
        return made(key, lambda: Noise(sd, kind, relative, variance, ties))

    table, runs = file.experiments, file.simulator.keys
    assert isinstance(runs, RunsSection)
    made("experiments.censored", table.censoring)
    errors: Noise | dict[str, Noise] | None = None
    if isinstance(file.noise, Mapping):
        errors = {name: noise(f"noise.{name}", choice) for name, choice in file.noise.items()}
    elif file.noise is not None:
        errors = noise("noise", file.noise)
    laws = {name: built(f"parameters.{name}", law) for name, law in file.parameters.items()}
    sections = {name: law.keys for name, law in file.parameters.items()}
    levels = {
        name: keys.level
        for name, keys in sections.items()
        if isinstance(keys, LawSection) and keys.level
    }
    inputs = made("parameters", lambda: Inputs(laws, levels=levels))
    if file.correlation:
        inputs = made("correlation", lambda: Inputs(laws, pairs(file.correlation), levels))
    experiments = table.read(folder, columns_of(errors))
    if errors is not None:
        made("noise", lambda: MeasurementErrors.of(errors, experiments))
    # The simulator comes last, with absolute paths: its import may change the current folder.
    folder = folder.absolute()
    simulator = built(f"simulator.{file.simulator.kind}", file.simulator)
    if file.derived:
        simulator = made("derived", lambda: derived(simulator, file.derived))
    return Study(
        file=path,
        sha256=sha256,
        title=file.title,
        seed=file.seed,
        experiments=experiments,
        simulator=simulator,
        inputs=inputs,
        noise=errors,
        propagation=built("propagation", file.propagation),
        density=built("density", file.density),
        search=built("search", file.search),
        verification=made("verification", file.verification.build),
        restricted=file.likelihood.restricted,
        small_sample=file.intervals.small_sample,
        table=table,
        store=folder / runs.store,
        retries=runs.retries,
        max_failed=runs.max_failed,
        units=made("experiments.units", lambda: units_of(file, folder, experiments, simulator)),
    )


def _started(search: Search, starts: int) -> Search:
    if not isinstance(search, GradientMultistart):
        raise InputsError(
            f"--starts {starts}: the study's search is {search.name}, which has no starts",
            'leave the option out, or write [search] method = "gradient"',
        )
    return replace(search, starts=starts)


def _read(path: Path) -> bytes:
    if path.is_dir():
        inside = path / "study.toml"
        remedy = f"name the file: {inside}" if inside.is_file() else "name a study file (TOML)"
        raise StudyError(f"{path} is a folder, not a study file", remedy)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        folder = path.parent
        names = sorted(p.name for p in folder.glob("*.toml")) if folder.is_dir() else []
        raise StudyError(
            f"{path}: there is no such file{nearest(path.name, names)}", "check the name"
        ) from None
    except OSError as error:
        raise StudyError(
            f"{path}: the file cannot be read: {error.strerror}", "check its permissions"
        ) from None


def _parse(raw: bytes, path: Path) -> dict[str, Any]:
    try:
        text = raw.decode("utf-8-sig")
        return tomllib.loads(text)
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise StudyError(f"{path}: line {line} is not UTF-8 text", "save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(
            f"{path}: this is not TOML: {error}{_line(str(error), text)}",
            "a key needs a value: text in quotes, numbers with a point, lists in brackets",
        ) from None


def _line(message: str, text: str, most: int = 60) -> str:
    """The line of study.toml to which an error message of the TOML parser refers, or ""."""
    _, found, rest = message.partition("at line ")
    number = rest.partition(",")[0]
    lines = text.splitlines()
    if not found or not number.isdigit() or int(number) > len(lines):
        return ""
    return f": {lines[int(number) - 1].strip()[:most]!r}"
