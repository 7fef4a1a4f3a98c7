"""A PEtab problem (version 1) as a study: its tables, its parameters, its noise."""

from __future__ import annotations

import csv
import io
import keyword
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from aleator.core.arithmetic import NoArithmeticError, require_arithmetic, tree
from aleator.core.toml_text import key, written
from aleator.errors import ExperimentsError, StudyError, count
from aleator.observations import tables
from aleator.observations.tables import Table
from aleator.study.proposal_text import line, remarked

FUNCTION = "simulate"
"""The name of the function that simulates the model, in the file that is written for it."""
_CONDITION = "simulationConditionId"
_LEAST = 1e-3
"""The lower limit of a noise parameter that PEtab lets be zero, as a part of its upper limit."""
_WORD = re.compile(r"[A-Za-z_]\w*")
_SCALES: dict[str, tuple[str, Callable[[float], float], float]] = {
    "log": ("exp({})", math.log, 1.0),
    "log10": ("10**{}", math.log10, math.log(10.0)),
}
"""Of each logarithm: the value of which it is, the function, and one unit of it in natural ones."""


@dataclass(frozen=True)
class PetabStudy:
    """The files of a study: its text, its table of experiments, and a function to be filled in.

    `notes` say in words what became of the problem.
    """

    study: str
    table: str
    function: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class PetabParameter:
    """A row of PEtab's table of parameters: nominal value and limits are those of the model.

    `limits` is None for a parameter that is known.
    """

    id: str
    scale: str
    nominal: float | None
    limits: tuple[float, float] | None

    @property
    def name(self) -> str:
        """The name in the study: `log10_k1` if k1 is estimated on a logarithmic scale."""
        return f"{self.scale}_{self.id}" if self.scale in _SCALES else self.id

    def specification(self, of: Callable[[float], float]) -> str:
        """The value of the hyperparameter in TOML, a number or limits with a start.

        `of` is applied to each of these numbers.
        """
        if self.limits is None:
            return written(of(float(self.nominal or 0.0)))
        keys = dict(zip(("lower", "upper"), map(of, self.limits), strict=True))
        if self.nominal is not None and self.limits[0] < self.nominal < self.limits[1]:
            keys["start"] = of(self.nominal)
        return written(keys)


def petab_study(problem: Path, folder: Path, table: str, function: str) -> PetabStudy:
    """The study of a PEtab problem; `folder` is its folder, `table` and `function` are its keys.

    A simulation condition is an experiment, an observable a response. Parameters are the same in
    all experiments, as PEtab has it: constants to be identified, on a logarithmic scale by
    `[derived]`. Columns of conditions and numeric observableParameters are conditions.

    Raises StudyError and ExperimentsError, which name file and row, for what is not read: version
    2, several problems or files of a kind, preequilibration, times without end, priors, Laplace's
    noise, a noise formula of several estimated parameters, and parameters of single conditions.
    """
    reading = _Reading(*_files(problem))
    reading.read()
    parameters = reading.of_model()
    derived = {one.id: _SCALES[one.scale][0].format(one.name) for one in parameters
               if one.scale in _SCALES}  # fmt: skip
    arguments = [*reading.conditions, *(one.id for one in parameters), *reading.same]
    for name in arguments:
        if keyword.iskeyword(name):
            raise StudyError(f"{problem}: '{name}' is a word of Python", "rename it in the tables")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(reading.columns)
    writer.writerows(zip(*reading.columns.values(), strict=True))
    free = sum(one.limits is not None for one in parameters)
    first = (
        f"PEtab problem: {count(len(reading.used), 'measurement')} of "
        f"{', '.join(reading.formulas)} under "
        f"{count(len({*reading.columns[_CONDITION]}), 'condition')}, "
        f"{count(free, 'parameter')} to be identified"
    )
    model = "" if reading.model is None else Path(os.path.relpath(reading.model, folder)).as_posix()
    return PetabStudy(
        _study(problem, table, function, reading, parameters, {**derived, **reading.same}),
        out.getvalue(), _function(problem, model, arguments, reading.formulas),
        (first, *reading.notes),
    )  # fmt: skip


def _files(problem: Path) -> tuple[dict[str, Table], Path | None]:
    """The four tables of a problem, and the file of its model."""
    try:
        import yaml
    except ImportError:
        raise StudyError(
            f"{problem}: a PEtab problem needs the package PyYAML", "pip install pyyaml"
        ) from None
    try:
        whole = yaml.safe_load(problem.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise StudyError(f"{problem} cannot be read: {error}", "name a file in YAML") from None
    if not isinstance(whole, Mapping) or "problems" not in whole:
        raise StudyError(
            f"{problem} is no PEtab problem of version 1: it has no key 'problems'",
            "name the YAML file that lists the tables",
        )
    if str(whole.get("format_version", 1)).partition(".")[0] != "1":
        raise StudyError(
            f"{problem}: key 'format_version' = {whole['format_version']}: only 1 is read",
            "write the problem in version 1",
        )
    parts = whole["problems"]
    if not isinstance(parts, list) or len(parts) != 1:
        raise StudyError(f"{problem}: key 'problems' has not one entry", "keep one problem")
    named = {
        kind: _one(problem, f"{kind}_files", parts[0].get(f"{kind}_files"))
        for kind in ("condition", "observable", "measurement")
    }
    named["parameter"] = _one(problem, "parameter_file", whole.get("parameter_file"))
    models = parts[0].get("sbml_files") or []
    found = {kind: tables.read(path, "\t") for kind, path in named.items()}
    return found, problem.parent / models[0] if models else None


def _one(problem: Path, name: str, value: Any) -> Path:
    listed = value if isinstance(value, list) else [value] if value else []
    if len(listed) != 1:
        raise StudyError(
            f"{problem}: key '{name}' names {len(listed)} files, and one is read",
            "put their rows into one file",
        )
    return problem.parent / str(listed[0])


def _texts(table: Table, name: str, needed: bool = False) -> list[str]:
    """The cells of a column as texts, "" for NaN; all blank for a column that may be missing."""
    if needed:
        table.require(name, "PEtab's column")
    if name not in table.columns:
        return [""] * len(table)
    found = ["" if text.lower() in ("nan", "na") else text for text in table.texts(name)]
    if needed and "" in found:
        raise _fault(table, found.index(""), name, "is blank", "write its value")
    return found


def _fault(table: Table, row: int, name: str, problem: str, remedy: str) -> ExperimentsError:
    return ExperimentsError(f"{table.where(row, name)} {problem}", remedy)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _value(formula: str) -> float | None:
    """The number that a formula is; None if it has a variable."""
    try:
        return require_arithmetic(tree(formula), lambda _: False)
    except NoArithmeticError:
        return None


def _parameters(table: Table) -> dict[str, PetabParameter]:
    """The parameters of a problem by id."""
    ids, flags = (_texts(table, name, needed=True) for name in ("parameterId", "estimate"))
    scales, priors = _texts(table, "parameterScale"), _texts(table, "objectivePriorType")
    nominal = _texts(table, "nominalValue")

    def number(row: int, name: str) -> float:
        text = _texts(table, name)[row]
        if not _is_number(text):
            raise _fault(table, row, name, f"'{text}' is not a finite number", "write a number")
        return float(text)

    found = {}
    for row, id in enumerate(ids):
        if flags[row] in ("0", "0.0"):
            found[id] = PetabParameter(id, "", number(row, "nominalValue"), None)
            continue
        if flags[row] not in ("1", "1.0"):
            raise _fault(table, row, "estimate", f"is '{flags[row]}'", "write 0 or 1")
        if priors[row] not in ("", "uniform", "parameterScaleUniform"):
            raise _fault(
                table, row, "objectivePriorType", f"is '{priors[row]}'",
                "clear the cell, and give the parameter a prior in the study",
            )  # fmt: skip
        if scales[row] not in ("", "lin", *_SCALES):
            raise _fault(table, row, "parameterScale", f"is '{scales[row]}'", _SCALE)
        low, high = number(row, "lowerBound"), number(row, "upperBound")
        if not low < high:
            raise _fault(table, row, "upperBound", f"{high:g} is not above {low:g}", "correct it")
        if scales[row] in _SCALES and low <= 0.0:
            raise _fault(
                table, row, "lowerBound", f"{low:g} has no logarithm",
                f"write a positive number, or the scale lin in place of {scales[row]}",
            )  # fmt: skip
        value = number(row, "nominalValue") if nominal[row] else None
        found[id] = PetabParameter(id, scales[row], value, (low, high))
    return found


_SCALE = "write lin, log or log10"


@dataclass
class _Reading:
    """What is gathered from the tables of a problem, one thing after the other.

    `columns` are those of the table of experiments, `same` maps names of the model to the parameter
    that they are, `noise` has key and value in TOML for each observable, `logs` are the observables
    whose logarithm is measured, `formulas` those of the model for each observable.
    """

    files: Mapping[str, Table]
    model: Path | None
    columns: dict[str, list[str]] = field(default_factory=dict)
    conditions: list[str] = field(default_factory=list)
    same: dict[str, str] = field(default_factory=dict)
    noise: dict[str, tuple[str, str]] = field(default_factory=dict)
    logs: list[str] = field(default_factory=list)
    formulas: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def read(self) -> None:
        """Read conditions, measurements and observables, in this order."""
        self.parameters = _parameters(self.files["parameter"])
        measured, table = self.files["measurement"], self.files["observable"]
        self.used = _texts(measured, "observableId", needed=True)
        ids = _texts(table, "observableId", needed=True)
        self._known("observableId", self.used, ids)
        for row, text in enumerate(_texts(measured, "preequilibrationConditionId")):
            if text:
                raise _fault(
                    measured, row, "preequilibrationConditionId", "asks for a condition before",
                    "let your function equilibrate, and clear the column",
                )  # fmt: skip
        self.columns[_CONDITION] = _texts(measured, _CONDITION, needed=True)
        self.columns["time"] = [repr(float(number)) for number in measured.numbers("time")]
        self.conditions.append("time")
        self._add_conditions()
        values = [repr(float(number)) for number in measured.numbers("measurement")]
        for at, name in enumerate(ids):
            if name in self.used:
                self.formulas[name] = _texts(table, "observableFormula", needed=True)[at]
                self._add_overrides(name)
                self._add_noise(name, at)
                self.columns[name] = self._of(name, values, "")

    def of_model(self) -> list[PetabParameter]:
        """The parameters of the model: all that do not stand in formulas of the noise alone."""
        texts = [*_texts(self.files["observable"], "noiseFormula"),
                 *_texts(self.files["measurement"], "noiseParameters")]  # fmt: skip
        of_noise = {word for text in texts for word in _WORD.findall(text)}
        others = [*self.formulas.values(), *self.same.values()]
        kept = {word for text in others for word in _WORD.findall(text)}
        return [one for one in self.parameters.values() if one.id not in of_noise - kept]

    def _known(self, name: str, texts: Sequence[str], known: Sequence[str]) -> None:
        for row, text in enumerate(texts):
            if text not in known:
                raise _fault(
                    self.files["measurement"], row, name, f"is '{text}', which no table explains",
                    f"correct it; known are {', '.join(known)}",
                )  # fmt: skip

    def _of(self, observable: str, cells: Sequence[str], other: str) -> list[str]:
        """A column with the cells in the rows of an observable, and `other` in the others."""
        return [c if own == observable else other for c, own in zip(cells, self.used, strict=True)]

    def _add_conditions(self) -> None:
        table = self.files["condition"]
        ids = _texts(table, "conditionId", needed=True)
        self._known(_CONDITION, self.columns[_CONDITION], ids)
        places = [ids.index(name) for name in self.columns[_CONDITION]]
        for name in table.columns:
            if name in ("conditionId", "conditionName"):
                continue
            texts = _texts(table, name)
            cells = [texts[place] for place in places]
            if not any(cells):
                self.notes.append(f"the model's own value: {name}")
            elif not self._added(name, cells, cells):
                bad = next(place for place in places if not _is_number(texts[place]))
                raise _fault(
                    table, bad, name, f"is '{texts[bad]}'",
                    f"write numbers for all conditions; or delete the column, and give '{name}' a "
                    "law in the study: it differs between experiments",
                )  # fmt: skip

    def _add_overrides(self, observable: str) -> None:
        """Add the observableParameters: numbers as conditions, or one parameter for all rows."""
        measured = self.files["measurement"]
        parts = [text.split(";") for text in _texts(measured, "observableParameters")]
        rows = [row for row, own in enumerate(self.used) if own == observable]
        for k in range(max(len(parts[row]) for row in rows)):
            cells = [part[k].strip() if k < len(part) else "" for part in parts]
            mine = [cells[row] for row in rows]
            name = f"observableParameter{k + 1}_{observable}"
            if any(mine) and not self._added(name, mine, self._of(observable, cells, mine[0])):
                raise _fault(
                    measured, next(row for row in rows if cells[row] != mine[0]),
                    "observableParameters", "is not that of the other rows of the observable",
                    "write numbers, or make an observable of each",
                )  # fmt: skip

    def _added(self, name: str, mine: Sequence[str], column: list[str]) -> bool:
        """Whether cells are numbers, a condition then, or all the same parameter."""
        if all(map(_is_number, mine)):
            self.columns[name] = column
            self.conditions.append(name)
        elif len({*mine}) == 1 and mine[0] in self.parameters:
            self.same[name] = mine[0]
        else:
            return False
        return True

    def _add_noise(self, observable: str, at: int) -> None:
        """Add the noise of an observable: a number, a column, a parameter, or a share."""
        table = self.files["observable"]
        kind = _texts(table, "noiseDistribution")[at]
        if kind not in ("", "normal"):
            raise _fault(table, at, "noiseDistribution", f"is '{kind}'", "only 'normal' is read")
        transform = _texts(table, "observableTransformation")[at]
        if transform not in ("", "lin", *_SCALES):
            raise _fault(table, at, "observableTransformation", f"is '{transform}'", _SCALE)
        factor = _SCALES[transform][2] if transform in _SCALES else 1.0
        self.logs += [observable] if transform in _SCALES else []
        formula = _texts(table, "noiseFormula", needed=True)[at]
        parts = [text.split(";")
                 for text in _texts(self.files["measurement"], "noiseParameters")]  # fmt: skip
        texts = [self._filled(formula, observable, part) for part in parts]
        mine = self._of(observable, texts, "")
        words = [*dict.fromkeys(text for text in mine if text)]
        numbers = {text: _value(text) for text in words}
        if None not in numbers.values():
            sds = {text: written(factor * float(sd or 0.0)) for text, sd in numbers.items()}
            if len({*sds.values()}) == 1:
                self.noise[observable] = ("sd", sds[words[0]])
                return
            name = f"sd_{observable}"
            self.columns[name] = [sds.get(text, sds[words[0]]) for text in mine]
            self.noise[observable] = ("sd", written(name))
            return
        model = re.escape(self._filled(self.formulas[observable], observable, []))
        share = re.fullmatch(rf"(\w+)\*\(?(?:{model}|{observable})\)?", words[0])
        known = self.parameters.get(share[1] if share else words[0])
        if len(words) > 1 or known is None or (share and transform in _SCALES):
            raise _fault(
                table, at, "noiseFormula", f"is '{formula}'",
                "write numbers, one estimated parameter, or its product with the observable; and "
                "correct [noise] in the study",
            )  # fmt: skip
        what = "relative" if share else "sd"
        if known.limits is not None and known.limits[0] <= 0.0:  # a density needs some noise
            known = replace(known, limits=(_LEAST * known.limits[1], known.limits[1]))
        spec = known.specification(lambda value: value * (1.0 if share else factor))
        self.noise[observable] = (what, spec)
        self.notes.append(f"noise: {known.id} is noise.{observable}.{what} in the study")

    def _filled(self, formula: str, observable: str, overrides: Sequence[str]) -> str:
        """A formula with the noiseParameters of a row, and with numbers for known parameters."""
        given = {f"noiseParameter{k}_{observable}": text.strip()
                 for k, text in enumerate(overrides, 1)}  # fmt: skip

        def replaced(word: re.Match[str]) -> str:
            name = given.get(word[0], word[0])
            known = self.parameters.get(name)
            return repr(known.nominal) if known is not None and known.limits is None else name

        return _WORD.sub(replaced, formula).replace("^", "**").replace(" ", "")


def _study(
    problem: Path,
    table: str,
    function: str,
    reading: _Reading,
    parameters: Sequence[PetabParameter],
    derived: Mapping[str, str],
) -> str:
    """The text of study.toml."""
    outcomes = [*reading.formulas]
    one = len(outcomes) == 1
    logs: object = "log" if one else dict.fromkeys(reading.logs, "log")
    lines = [
        line("title", problem.stem.strip("_"), "printed above the report and its figures"),
        "",
        "[experiments]",
        line("file", table, "a row for each measurement"),
        line("outcome" if one else "outcomes", outcomes[0] if one else outcomes, "the observables"),
        line("id", _CONDITION, "a simulation condition is an experiment"),
        line("conditions", reading.conditions, "columns that the simulator is given"),
        *([line("transform", logs, "the logarithm is measured")] if reading.logs else []),
        "",
        "[simulator]",
        line("function", function, "takes conditions and parameters by name"),
        line("series", True, "called once for all rows of an experiment"),
    ]
    for each in parameters:
        known = each.limits is None
        scale = _SCALES[each.scale][1] if each.scale in _SCALES else float
        lines += [
            "",
            remarked(f"[parameters.{key(each.name)}]", "the same in all experiments; with another "
                     "law it differs between them"),
            line("law", "constant", "no scatter"),
            remarked(f"value = {each.specification(scale)}", "known" if known else "identified"),
        ]  # fmt: skip
    if derived:
        lines += ["", remarked("[derived]", "what the simulator is given in their place")]
        lines += [f"{key(name)} = {written(text)}" for name, text in derived.items()]
    for name, (what, value) in reading.noise.items():
        lines += ["", "[noise]" if one else f"[noise.{key(name)}]"]
        lines.append(remarked(f"{what} = {value}", "measurement noise, normal"))
    return "\n".join(
        [*lines, "", "[propagation]",
         line("surfaces", "none", "the simulator itself for each alpha; delete if it is slow"), ""]
    )  # fmt: skip


def _function(
    problem: Path, model: str, arguments: Sequence[str], formulas: Mapping[str, str]
) -> str:
    """The text of a Python file with a function that is to simulate the model."""
    said = "\n".join(f"    {name} = {formula}" for name, formula in formulas.items())
    return f'''"""The model of the PEtab problem {problem.name}, as a simulator."""

from pathlib import Path

MODEL = Path(__file__).parent / {written(model)}


def {FUNCTION}({", ".join(arguments)}):
    """The observables under one condition, by name: an array with a value for each time.

    `time` is an array (a number, if no condition has two different times).

{said}
    """
    raise NotImplementedError("simulate MODEL here: docs/coming_from.md has lines for roadrunner")
'''
