"""The text of a proposed study.toml, with a reason beside every key, and notes for its user."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from aleator.core.toml_text import key, written
from aleator.errors import count
from aleator.study.offers import Offer, SimulatorInput, without_unit, written_by
from aleator.study.proposal import Proposal, Proposed

OF_NOISE = "the number that is known: one value an experiment hardly tells it from the law"
GUESS = "a guess"
FILL_IN = "FILL IN"


@dataclass(frozen=True)
class ProposalSettings:
    """Settings of the text of a proposed study. The values are chosen by judgement.

    variables: the largest number of an FMU's variables that are listed. column: the character of a
    line at which remarks begin.
    """

    variables: int = 20
    column: int = 34


WRITTEN = ProposalSettings()


def study_text(proposal: Proposal, schema: str | None = None) -> str:
    """The text of the study file, with a comment FILL IN where a key has to be filled in.

    `schema` is the name of the file with its JSON schema, which editors read.
    """
    sections = [
        _experiments(proposal),
        _simulator(proposal),
        _derived(proposal),
        *(_parameter(each, proposal) for each in proposal.parameters),
        _untouched(proposal),
        _noise(proposal),
    ]
    top = [f"#:schema {schema}"] if schema else []
    title = line("title", proposal.title, "printed above the report and its figures")
    return "\n".join([*top, title, *("\n".join(["", *s]) for s in sections if s), ""])


def notes(proposal: Proposal) -> list[str]:
    """Notes for the user on what was recognized in the table and the simulator."""
    roles = proposal.roles
    said = [f"outcome: {', '.join(proposal.outcomes)}"]
    said.append(f"conditions: {', '.join(proposal.conditions) or 'none'}")
    if proposal.repeated:
        said.append(
            f"repeated: {count(len(proposal.sheet.table), 'row')} of "
            f"{count(proposal.experiments, 'experiment')}, named by the column {proposal.id}"
        )
    laws = [each.name for each in proposal.parameters if each.scatters]
    known = [each.name for each in proposal.parameters if not each.scatters]
    said.append(f"identified: the laws of {', '.join(laws) or 'nothing yet'}")
    if known:
        said.append(f"held constant: {', '.join(known)}")
    if bare := [name for name in (*proposal.outcomes, *laws) if name not in proposal.units]:
        said.append(
            f"no unit is stated of {', '.join(bare)}: reports show none until the study has one "
            "(units in [experiments], unit in [parameters.NAME])"
        )
    exact = [f"{each.name} = {each.nominal:g}" for each in proposal.untouched
             if each.nominal is not None]  # fmt: skip
    if exact and proposal.offer.kind != "fmu":
        said.append(
            f"taken as exact and the same in every experiment: {', '.join(exact)}; where one may "
            "differ, predictions are too sure: name it (--parameter NAME=LOW:HIGH) and compare"
        )
    if roles.constant:
        said.append(f"the same in every row, not used: {', '.join(roles.constant)}")
    if proposal.censored:
        said.append(f"censored values: {', '.join(proposal.censored)}")
    said += [
        f"noise: sd = {sd:g} is {GUESS}, and the identified law rests on it; write {OF_NOISE}"
        f"{'' if proposal.log else '; relative = 0.1 is an error of 10 % of the value'}"
        for sd in proposal.assumed.values()
    ]
    said += [f"no numbers in column {name}: {cells}" for name, cells in proposal.unread.items()]
    file = written_by(proposal.offer.value) if proposal.offer.kind == "command" else None
    if isinstance(marks := proposal.offer.further.get("delimiters"), list):
        said.append(f"the values of a run are written in place of {'NAME'.join(marks)}")
    if file is not None:
        said.append(f"the outcome is read from {file}, by the name {proposal.outcomes[0]}: if the "
                    "program calls it otherwise, change output in [simulator]")  # fmt: skip
    said += proposal.gross_errors
    said += proposal.odd_repeats
    if proposal.series:
        said.append(f"a run serves all rows of an experiment, with arrays of "
                    f"{', '.join(proposal.within)}")  # fmt: skip
    if proposal.covariates:
        said.append(f"laws may follow: {', '.join(proposal.covariates)}")
    if proposal.levels:
        said.append(f"groups of experiments: {', '.join(proposal.levels)}")
    telling = {name for one in proposal.censored.values() for name in one.columns}
    used = {*telling, *proposal.covariates, *proposal.levels}
    unused = [name for name in roles.others if name not in used]
    if unused:
        said.append(f"not used: {', '.join(unused)}")
    return said


def variables(inputs: Sequence[SimulatorInput], offer: Offer) -> list[tuple[str, str, str, str]]:
    """The rows of a table of a simulator's inputs: name, unit, nominal value, meaning."""
    return [
        (each.name, each.unit, "" if each.nominal is None else f"{each.nominal:g}",
         ", ".join(filter(None, (offer.variables.get(each.name), each.description))))
        for each in inputs
    ]  # fmt: skip


def _experiments(proposal: Proposal) -> list[str]:
    sheet = proposal.sheet
    lines = [
        "[experiments]",
        line("file", proposal.file, "a header, then a row for each measured value"),
        _outcome(proposal.outcomes),
    ]
    if proposal.id:
        lines.append(
            line("id", proposal.id, "rows with the same name are one experiment: one draw of the "
                  "parameters")
            if proposal.repeated
            else line("id", proposal.id, "the name of each experiment")
        )  # fmt: skip
    else:
        lines.append("# id = ...  if rows belong together: the column that names their experiment")
    lines.append(line("conditions", [*proposal.conditions], "columns that the simulator is given"))
    lines += _censored(proposal)
    lines.append(_units(proposal))
    if sheet.delimiter not in (",", ""):
        lines.append(line("delimiter", sheet.delimiter, "between the cells"))
    if sheet.decimal != ".":
        lines.append(line("decimal", sheet.decimal, "the decimal sign"))
    if proposal.log:
        lines.append(line("transform", "log", "the outcome spans decades: its logarithm is taken"))
    elif proposal.decades:
        lines.append(off("transform", "log", "for outcomes that span decades, as these do"))
    elif proposal.positive:
        lines.append(off("transform", "log", "for lives and the like; noise is then a share"))
    return lines


def _censored(proposal: Proposal) -> list[str]:
    """The line of study.toml on censored values; no line if there are none."""
    told = {
        name: {key: value for key, value in asdict(one).items() if value}
        for name, one in proposal.censored.items()
    }
    if not told:
        return []
    said: object = told if len(proposal.outcomes) > 1 else told[proposal.outcomes[0]]
    return [line("censored", said, "of these values only bounds are known")]


def _units(proposal: Proposal) -> str:
    """The line of study.toml on units; it has the units in the heads of the table's columns."""
    names = (*proposal.outcomes, *proposal.conditions)
    known = {name: proposal.units[name] for name in names if name in proposal.units}
    remark = "shown on every axis and in every table"
    if known:
        return line("units", known, remark)
    return off("units", dict.fromkeys(names[:1], "..."), remark)


def _outcome(outcomes: Sequence[str]) -> str:
    if len(outcomes) == 1:
        return line("outcome", outcomes[0], "the measured column")
    return line("outcomes", [*outcomes], "the measured columns; a cell may be blank")


def _simulator(proposal: Proposal) -> list[str]:
    offer = proposal.offer
    lines = ["[simulator]", line(offer.kind, offer.value, _SIMULATORS[offer.kind])]
    if offer.kind == "function":
        if proposal.series:
            lines.append(line("series", True, "called once for all rows of an experiment"))
        else:
            lines.append(
                line("vectorized", True, "called with arrays of many runs")
                if offer.vectorized
                else off("vectorized", False, "if a run takes long: never tried with arrays")
            )
            lines += _could_be_series(proposal)
    if offer.kind == "fmu":
        lines += _of_fmu(proposal, offer)
    if offer.kind == "command":
        lines += _of_command(proposal)
    if offer.kind == "umbridge":
        lines += _of_server(proposal)
    return lines


def _of_command(proposal: Proposal) -> list[str]:
    """The lines of study.toml on the input file of a program, and where its outcome is read."""
    lines = [line(name, value, _FURTHER[name]) for name, value in proposal.offer.further.items()]
    file = written_by(proposal.offer.value)
    if proposal.series:
        lines.append(line("series", True, "one run serves all rows of an experiment"))
        if file is None:
            read = off("output", {"file": "result.txt"}, "else all numbers that it prints")
            return [*lines, read]
        return [*lines, _read_from(file, proposal.outcomes[0])]
    if len(proposal.outcomes) > 1:
        columns = {name: {"file": file or "result.csv", "column": name}
                   for name in proposal.outcomes}  # fmt: skip
        lines.append(fill("output", written(columns), "where the program writes each outcome"))
    elif file is not None:
        lines += [*_could_be_series(proposal), _read_from(file, proposal.outcomes[0])]
    else:
        lines += [
            *_could_be_series(proposal),
            remarked(
                f"output = {{regex = '{reading(proposal.outcomes[0])}'}}",
                "what is printed after the outcome's name, or else the last word",
            ),
            off("output", {"file": "result.csv", "column": proposal.outcomes[0]}, "or of a table"),
        ]
    return [*lines, off("timeout", 60, "seconds after which a run is stopped")]


def _read_from(file: str, outcome: str) -> str:
    """The line of study.toml on the outcome in a file that the program writes."""
    if file.lower().endswith(".csv"):
        remark = (
            "the column of that table; a number counts columns without a header, -1 is the last"
        )
        return line("output", {"file": file, "column": outcome}, remark)
    if file.lower().endswith(".json"):
        return line(
            "output", {"file": file, "path": outcome}, "the key in that file; a.b for inner"
        )
    return remarked(
        f"output = {{file = {written(file)}, regex = '{reading(outcome)}'}}",
        "what that file has after the outcome's name, or else the last word",
    )


def reading(outcome: str) -> str:
    """A regular expression for the outcome in what a program prints.

    It is the word after the last mention of its name, or else the last word: a text that has
    neither gives no number, and the run fails.

    >>> found = re.match(reading("travel_mm"), "Springs 2.0\\nTravel: 5.5 mm, solved in 1 step")
    >>> found[1]
    '5.5'
    """
    name = re.escape(without_unit(outcome)).replace("'", r"\x27")
    return rf"(?is)\A(?:.*\b{name}\b\s*[=:]?\s*|.*?(?=\S+\s*\Z))(\S+)"


def _of_server(proposal: Proposal) -> list[str]:
    """The lines of study.toml on the model of a server, its inputs and its outputs."""
    lines = [line(name, value, _FURTHER[name]) for name, value in proposal.offer.further.items()]
    if proposal.series:
        lines.append(line("series", True, "one run serves all rows of an experiment"))
    else:
        lines += _could_be_series(proposal)
    several = len(proposal.outcomes) > 1
    places = {name: k for k, name in enumerate(proposal.outcomes)} if several else 0
    return [*lines, line("output", places, "the output vector, from 0; or [vector, place]")]


_FURTHER = {
    "template": "written for every run, with values in its placeholders",
    "input": "the name of the written file, for {input}",
    "delimiters": "of the placeholders in the template",
    "model": "the name of the model on the server",
    "inputs": "conditions, parameters and numbers, a list for each input vector",
}
"""Remarks on further keys of a simulator."""


def _derived(proposal: Proposal) -> list[str]:
    """The section of study.toml by which the simulator is given columns of other names.

    An FMU has the key `variables` for that.
    """
    offer = proposal.offer
    renamed = {} if offer.kind == "fmu" else offer.variables
    if not renamed:
        return []
    lines = [remarked("[derived]", "what the simulator is given under another name")]
    return [*lines, *(f"{key(name)} = {written(column)}" for column, name in renamed.items())]


def _could_be_series(proposal: Proposal) -> list[str]:
    """A comment in study.toml on `series = true`, by which one run serves a whole experiment."""
    if not proposal.within or proposal.offer.vectorized:
        return []
    names = ", ".join(proposal.within)
    return [off("series", True, f"if one run serves all rows of an experiment: arrays of {names}")]


_SIMULATORS = {
    "function": "takes conditions and parameters by name",
    "fmu": "conditions and parameters are its variables",
    "command": "a program; {name} is where a value goes",
    "umbridge": "the address of the server",
}


def _of_fmu(proposal: Proposal, offer: Offer) -> list[str]:
    names = ", ".join(each.name for each in offer.returned[: WRITTEN.variables])
    lines = [
        line("outcome", proposal.returned, "its value at the end; also maximum, crossing: "
              "docs/simulators.md")
        if proposal.returned
        else fill("outcome", "...", f"the variable that is measured: {names}")
    ]  # fmt: skip
    used = {*proposal.conditions, *(each.name for each in proposal.parameters)}
    if named := {name: called for name, called in offer.variables.items() if name in used}:
        lines.append(line("variables", named, "what these are called in the FMU"))
    if proposal.time and proposal.repeated:
        lines.append(line("series", True, "one run serves all rows of an experiment"))
        lines.append(line("time", proposal.time, "the column of their times, in s"))
    elif proposal.time:
        lines.append(line("stop_time", proposal.time, "the column of the time that is simulated"))
    elif offer.stop_time is None:
        lines.append(fill("stop_time", "...", "seconds that are simulated"))
    else:
        lines.append(off("stop_time", offer.stop_time, "s, as the FMU says"))
    return lines


def _parameter(each: Proposed, proposal: Proposal) -> list[str]:
    if not each.scatters:
        return _constant(each)
    head = remarked(f"[parameters.{key(each.name)}]", "differs between experiments")
    lines = [head, line("law", "truncated_normal", "a normal law, cut at the ends of the box")]
    shown = "shown on every axis and in every table"
    unit = each.input.unit
    lines.insert(1, line("unit", unit, shown) if unit else off("unit", "...", shown))
    if each.limits is None:
        box = fill("box", "[..., ...]", "where the simulator works; mean and sd are sought inside")
        return [*lines, box, *_other_law(None), *_follows(proposal)]
    why = (
        "where the simulator works; mean and sd are sought inside"
        if each.nominal is None
        else f"a factor of three about {written(each.nominal)}: make it as wide as physics allows"
    )
    box = line("box", [*each.limits], why)
    return [*lines, box, *_other_law(each.limits), *_follows(proposal)]


def _other_law(limits: tuple[float, float] | None) -> list[str]:
    """Comments in study.toml with another law in place of the one above and of its box.

    A lognormal law has values above zero; where the limits reach below, it is a normal law.
    """
    law, of = "lognormal", "skewed, above zero, without an upper end; gamma alike"
    if limits is not None and limits[0] <= 0.0:
        law, of = "normal", "without ends"
    mean = "{lower = ..., upper = ...}" if limits is None else ends(limits)
    return [
        "# In place of law and box another law, whose mean is sought between limits:",
        off("law", law, of),
        f"# mean = {mean}",
    ]


def _follows(proposal: Proposal) -> list[str]:
    """Comments in study.toml on covariates of the mean, and on levels of the parameter."""
    needs = "" if proposal.noise else "; needs [noise]"
    lines = [
        off("level", name, f"one value for a whole {name}; a shift beside it: docs/study.md{needs}")
        for name in proposal.levels
    ]
    if proposal.covariates:
        formula = " + ".join(["1", *proposal.covariates.values()])
        lines.append(off("mean", formula, f"if the parameter depends on these{needs}"))
    return lines


def _constant(each: Proposed) -> list[str]:
    head = remarked(f"[parameters.{key(each.name)}]", "the same in all experiments")
    lines = [head, line("law", "constant", "no scatter")]
    if each.value is None:
        return [*lines, fill("value", "...", "a number, or {lower = ..., upper = ...} to "
                              "identify it")]  # fmt: skip
    return [
        *lines,
        line("value", each.value, "known; {lower = ..., upper = ...} identifies it"),
    ]


def _untouched(proposal: Proposal) -> list[str]:
    """Comments in study.toml that list the inputs which keep the simulator's own value."""
    if not proposal.untouched:
        return []
    rest = len(proposal.untouched) - WRITTEN.variables
    of = "variables of the FMU" if proposal.offer.kind == "fmu" else "arguments"
    lines = [f"# Other {of}, taken as exact and the same everywhere unless they get a section:"]
    lines += [
        f"#   {each.name}{f' [{each.unit}]' if each.unit else ''}"
        f"{'' if each.nominal is None else f' = {each.nominal:g}'}"
        f"{f'  {each.description}' if each.description else ''}"
        f"{_variable(proposal.offer, each)}"
        for each in proposal.untouched[: WRITTEN.variables]
    ]
    return [*lines, *([f"#   and {rest} more"] if rest > 0 else [])]


def _variable(offer: Offer, each: SimulatorInput) -> str:
    """The entry of the key `variables` that ties a name to an FMU's variable of another name."""
    called = offer.variables.get(each.name)
    return f"  (variables = {{{each.name} = {written(called)}}})" if called else ""


def _noise(proposal: Proposal) -> list[str]:
    several = len(proposal.outcomes) > 1
    if not proposal.noise:
        return [
            "# Without [noise] the parameters alone explain all scatter. With it:",
            "# [noise]",
            f"# sd = ...  # {OF_NOISE}",
        ]
    lines: list[str] = []
    for name, sd in proposal.noise.items():
        lines += [""] if lines else []
        head = f"[noise.{key(name)}]" if several else "[noise]"
        of = " of the logarithm: 0.1 is 10 %" if proposal.log else ""
        lines.append(remarked(head, f"measurement noise, normal{of}"))
        if isinstance(sd, str):
            lines.append(line("sd", sd, "the column with the sd of each measured value"))
        elif isinstance(sd, float) and proposal.stated:
            name = "relative" if proposal.relative else "sd"
            lines.append(line(name, sd, "known; limits in its place would be identified"))
        elif isinstance(sd, float):
            lines.append(line("sd", sd, f"{GUESS}: 1 % of the scatter; write {OF_NOISE}"))
            if not proposal.log:
                share = "in its place: an error that is a share of the value"
                lines.append(off("relative", 0.1, share))
        else:
            lines.append(remarked(f"sd = {ends(sd)}", "identified; a number would be known"))
    return lines


# ------------------------------------------------------------------------------------ lines


def line(key: str, value: object, remark: str) -> str:
    """A line of study.toml: a key, its value, and a remark."""
    return remarked(f"{key} = {written(value)}", remark)


def off(key: str, value: object, remark: str) -> str:
    """A line of study.toml that is commented out; the user deletes the sign # to use it."""
    return remarked(f"# {key} = {written(value)}", remark)


def fill(key: str, form: str, remark: str) -> str:
    """A line of study.toml whose value the user has to fill in."""
    return remarked(f"# {key} = {form}", f"{FILL_IN}: {remark}")


def remarked(text: str, remark: str) -> str:
    """A line of study.toml with its remark beside it, or above it if the line is long."""
    return (
        f"{text:<{WRITTEN.column}} # {remark}"
        if len(text) <= WRITTEN.column
        else f"# {remark}:\n{text}"
    )


def ends(limits: tuple[float, float]) -> str:
    """The text of two limits as a table of TOML, `{lower = ..., upper = ...}`."""
    return f"{{lower = {written(limits[0])}, upper = {written(limits[1])}}}"
