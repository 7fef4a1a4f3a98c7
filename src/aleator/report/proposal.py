"""A proposed study as the text of study.toml, with a reason at every key, and as notes."""

from __future__ import annotations

import json
from collections.abc import Sequence

from aleator.study.offers import Given, Offer
from aleator.study.proposal import Proposal
from aleator.study.proposed_laws import Limits, Proposed

WIDTH = 34  # where the remarks begin
SHOWN = 20  # variables of an FMU that are listed
FILL_IN = "FILL IN"


def study_text(proposal: Proposal, schema: str | None = None) -> str:
    """The study file; what has to be filled in stands there as a remark that says so.

    `schema` is the file of its JSON schema, which editors look for.
    """
    sections = [
        _experiments(proposal),
        _simulator(proposal),
        *(_parameter(each) for each in proposal.parameters),
        _untouched(proposal),
        _noise(proposal),
    ]
    top = [f"#:schema {schema}"] if schema else []
    title = _line("title", proposal.title, "printed above the report and its figures")
    return "\n".join([*top, title, *("\n".join(["", *s]) for s in sections if s), ""])


def notes(proposal: Proposal) -> list[str]:
    """What was recognized, a sentence a line."""
    roles = proposal.roles
    said = [f"outcome: {', '.join(proposal.outcomes)}"]
    said.append(f"conditions: {', '.join(proposal.conditions) or 'none'}")
    if proposal.repeated:
        said.append(
            f"repeated: {len(proposal.sheet.table)} rows of {proposal.experiments} experiments, "
            f"named by the column {proposal.id}"
        )
    laws = [each.name for each in proposal.parameters if each.scatters]
    known = [each.name for each in proposal.parameters if not each.scatters]
    said.append(f"identified: the laws of {', '.join(laws) or 'nothing yet'}")
    if known:
        said.append(f"held constant: {', '.join(known)}")
    if roles.constant:
        said.append(f"the same in every row, not used: {', '.join(roles.constant)}")
    if roles.others:
        said.append(f"not used: {', '.join(roles.others)}")
    said += [
        f"the column '{column}' is not used; if it is the simulator's '{argument}', call it so"
        for column, argument in proposal.unlike.items()
    ]
    return said


def variables(given: Sequence[Given], offer: Offer) -> list[tuple[str, str, str, str]]:
    """Rows of what a simulator can be given: name, unit, value at the start, what it is."""
    return [
        (each.name, each.unit, "" if each.nominal is None else f"{each.nominal:g}",
         ", ".join(filter(None, (offer.variables.get(each.name), each.description))))
        for each in given
    ]  # fmt: skip


def _experiments(proposal: Proposal) -> list[str]:
    sheet = proposal.sheet
    lines = [
        "[experiments]",
        _line("file", proposal.file, "a header, then a row for each measured value"),
        _outcome(proposal.outcomes),
    ]
    if proposal.id:
        lines.append(
            _line("id", proposal.id, "rows with the same name are one experiment: one draw of the "
                  "parameters")
            if proposal.repeated
            else _line("id", proposal.id, "the name of each experiment")
        )  # fmt: skip
    else:
        lines.append("# id = ...  if rows belong together: the column that names their experiment")
    lines.append(_line("conditions", [*proposal.conditions], "columns that the simulator is given"))
    lines.append(_units(proposal))
    if sheet.delimiter != ",":
        lines.append(_line("delimiter", sheet.delimiter, "between the cells"))
    if sheet.decimal != ".":
        lines.append(_line("decimal", sheet.decimal, "the decimal sign"))
    if proposal.decades:
        lines.append(_off("transform", "log", "for outcomes that span decades, as these do"))
    return lines


def _units(proposal: Proposal) -> str:
    """Those of the columns, as far as their heads say."""
    names = (*proposal.outcomes, *proposal.conditions)
    known = {name: proposal.units[name] for name in names if name in proposal.units}
    remark = "shown on every axis and in every table"
    if known:
        return _line("units", known, remark)
    return _off("units", dict.fromkeys(names[:1], "..."), remark)


def _outcome(outcomes: Sequence[str]) -> str:
    if len(outcomes) == 1:
        return _line("outcome", outcomes[0], "the measured column")
    return _line("outcomes", [*outcomes], "the measured columns; a cell may be blank")


def _simulator(proposal: Proposal) -> list[str]:
    offer = proposal.offer
    lines = ["[simulator]", _line(offer.kind, offer.value, _SIMULATORS[offer.kind])]
    if offer.kind == "function":
        shape = "with arrays of many runs" if offer.vectorized else "once a run, with numbers"
        lines.append(_line("vectorized", offer.vectorized, f"called {shape}"))
    if offer.kind == "fmu":
        lines += _of_fmu(proposal, offer)
    if offer.kind == "command":
        lines.append(_off("output", {"file": "result.txt"}, "where the outcome is; else the last "
                          "number that is printed"))  # fmt: skip
    return lines


_SIMULATORS = {
    "function": "takes conditions and parameters by name",
    "fmu": "conditions and parameters are its variables",
    "command": "a program; {name} is where a value goes",
}


def _of_fmu(proposal: Proposal, offer: Offer) -> list[str]:
    names = ", ".join(each.name for each in offer.returned[:SHOWN])
    lines = [
        _line("outcome", proposal.returned, "its value at the end; also maximum, crossing: "
              "docs/simulators.md")
        if proposal.returned
        else _fill("outcome", "...", f"the variable that is measured: {names}")
    ]  # fmt: skip
    used = {*proposal.conditions, *(each.name for each in proposal.parameters)}
    if named := {name: called for name, called in offer.variables.items() if name in used}:
        lines.append(_line("variables", named, "what these are called in the FMU"))
    if proposal.time and proposal.repeated:
        lines.append(_line("series", True, "one run serves all rows of an experiment"))
        lines.append(_line("time", proposal.time, "the column of their times, in s"))
    elif proposal.time:
        lines.append(_line("stop_time", proposal.time, "the column of the time that is simulated"))
    elif offer.stop_time is None:
        lines.append(_fill("stop_time", "...", "seconds that are simulated"))
    else:
        lines.append(_off("stop_time", offer.stop_time, "s, as the FMU says"))
    return lines


def _parameter(each: Proposed) -> list[str]:
    if not each.scatters:
        return _constant(each)
    head = _remarked(f"[parameters.{_key(each.name)}]", "differs between experiments")
    lines = [head, _line("law", "truncated_normal", "a normal law, cut at the ends of the box")]
    if each.given.unit:
        lines.insert(1, _line("unit", each.given.unit, "shown on every axis and in every table"))
    if each.limits is None:
        return [*lines, _fill("box", "[..., ...]", "where the simulator works; mean and sd are "
                              "sought inside")]  # fmt: skip
    why = (
        "where the simulator works; mean and sd are sought inside"
        if each.nominal is None
        else f"a factor of three about {_written(each.nominal)}: make it as wide as physics allows"
    )
    return [*lines, _line("box", [*each.limits], why)]


def _constant(each: Proposed) -> list[str]:
    head = _remarked(f"[parameters.{_key(each.name)}]", "the same in all experiments")
    lines = [head, _line("law", "constant", "no scatter")]
    if each.value is None:
        return [*lines, _fill("value", "...", "a number, or {lower = ..., upper = ...} to "
                              "identify it")]  # fmt: skip
    return [
        *lines,
        _line("value", each.value, "known; {lower = ..., upper = ...} identifies it"),
    ]


def _untouched(proposal: Proposal) -> list[str]:
    """What keeps its value, so that it can be taken as a parameter."""
    if not proposal.untouched:
        return []
    rest = len(proposal.untouched) - SHOWN
    of = "variables of the FMU" if proposal.offer.kind == "fmu" else "arguments"
    lines = [f"# Other {of}, which keep their values unless they get a section:"]
    lines += [
        f"#   {each.name}{f' [{each.unit}]' if each.unit else ''}"
        f"{'' if each.nominal is None else f' = {each.nominal:g}'}"
        f"{f'  {each.description}' if each.description else ''}"
        f"{_variable(proposal.offer, each)}"
        for each in proposal.untouched[:SHOWN]
    ]
    return [*lines, *([f"#   and {rest} more"] if rest > 0 else [])]


def _variable(offer: Offer, each: Given) -> str:
    """The line that lets a name stand for a variable, where it has to be named."""
    called = offer.variables.get(each.name)
    return f"  (variables = {{{each.name} = {_written(called)}}})" if called else ""


def _noise(proposal: Proposal) -> list[str]:
    several = len(proposal.outcomes) > 1
    if not proposal.noise:
        limits = next(iter(proposal.scale.values()), None)
        return [
            "# Without [noise] the parameters alone explain all scatter. With it:",
            "# [noise]",
            f"# sd = {_table(limits)}" if limits else "# sd = ...",
        ]
    lines: list[str] = []
    for name, sd in proposal.noise.items():
        lines += [""] if lines else []
        head = f"[noise.{_key(name)}]" if several else "[noise]"
        lines.append(_remarked(head, "measurement noise, normal"))
        if isinstance(sd, str):
            lines.append(_line("sd", sd, "the column with the sd of each measured value"))
        else:
            lines.append(_remarked(f"sd = {_table(sd)}", "identified; a number would be known"))
    return lines


def _table(limits: Limits) -> str:
    return f"{{lower = {_written(limits[0])}, upper = {_written(limits[1])}}}"


def _line(key: str, value: object, remark: str) -> str:
    return _remarked(f"{key} = {_written(value)}", remark)


def _off(key: str, value: object, remark: str) -> str:
    return _remarked(f"# {key} = {_written(value)}", remark)


def _fill(key: str, form: str, remark: str) -> str:
    return _remarked(f"# {key} = {form}", f"{FILL_IN}: {remark}")


def _remarked(text: str, remark: str) -> str:
    return f"{text:<{WIDTH}} # {remark}" if len(text) <= WIDTH else f"# {remark}:\n{text}"


def _key(name: str) -> str:
    """A name as a key of TOML."""
    bare = all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
    return name if name and bare else _written(name)


def _written(value: object) -> str:
    """A value as TOML has it.

    >>> _written([1.0, 0.5]), _written("a\\tb"), _written({"file": "x"})
    ('[1.0, 0.5]', '"a\\\\tb"', '{file = "x"}')
    """
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_key(k)} = {_written(v)}' for k, v in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)
