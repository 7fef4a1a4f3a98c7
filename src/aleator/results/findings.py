"""The answer of an identification in sentences: where each parameter lies, and how sure that is.

Every report begins with these sentences: print, notebook, terminal and page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from aleator.results.printed import AMOUNTS, Amounts, Sentence, between, number, percent, with_error
from aleator.results.units import transforms, unit_of, units

Document = Mapping[str, Any]
CONSTANT = re.compile(r"^(?P<of>[^.]+)\.value$")
NOISE = re.compile(r"^noise\.(?:(?P<of>.+)\.)?(?P<what>sd|relative)$")


def findings(document: Document) -> tuple[Sentence, ...]:
    """The sentences that a decision needs, in the order of the parameters.

    There is one for the 95 % range of each parameter that scatters, one for each identified
    constant, one for each identified standard deviation of the measurement noise, and one for the
    outcome of a new experiment under the conditions of the last row. How sure an end is: half of
    the width of its 95 % interval (see `LawRange`). Where the sd of a law ends on its lower limit,
    the range at the estimate says nothing of the scatter, and the outer ends of these intervals
    take its place. What a document lacks is left out.

    >>> one = {"lower": 0.1012, "upper": 0.1788, "lower_interval": [0.093, 0.109],
    ...        "upper_interval": [0.17, 0.188]}
    >>> print(*findings({"alpha": {}, "experiments": [], "ranges": {"friction": one}}))
    95 % of experiments: friction 0.1012 to 0.1788 (ends known to +- 0.0080 and 0.0090).
    """
    return (*_laws(document), *_constants(document), *_noise(document), *_new(document))


# ------------------------------------------------------------------------------- parameters


def _laws(document: Document) -> Iterator[Sentence]:
    for name, entry in (document.get("ranges") or {}).items():
        level = entry.get("level")
        whose = f"the groups by {level}" if level else "experiments"
        at = named_values(document, entry.get("at") or {})
        for factor, ends in (entry.get("by_level") or {}).items():
            with_ = ", ".join([f"{entry['factor']} {factor}", *at])
            yield _law(document, name, f"{whose} with {with_}", ends)
        if not entry.get("by_level"):
            like = " like those of the table" if entry.get("follows") else ""
            yield _law(document, name, f"{whose}{like}", entry)


def _law(document: Document, name: str, whose: str, entry: Document) -> Sentence:
    head, unit = f"{percent(0.95)} of {whose}", _unit(document, name)
    reach = [_half(entry.get(f"{end}_interval")) for end in ("lower", "upper")]
    ends, told, sure = [entry["lower"], entry["upper"]], "{} to {}", _sure(reach, unit)
    limit = _sd_on_limit(document, name, unit)
    if limit is not None and None not in reach:
        ends = [entry["lower_interval"][0], entry["upper_interval"][1]]
        told, sure = "somewhere between {} and {}", f"its scatter is not determined: {limit}"
    low, high = (
        with_error(end, own, estimate=True)[0] for end, own in zip(ends, reach, strict=True)
    )
    return _found(head, f"{name} {told.format(low, high)}{unit} ({sure})")


def _sd_on_limit(document: Document, name: str, unit: str) -> str | None:
    """That the sd of a parameter's law ends on its lower limit; None where it does not."""
    sd = document["alpha"].get(f"{name}.sd") or {}
    interval = sd.get("interval")
    if sd.get("at_bound") != "lower" or interval is None or interval[1] is None:
        return None
    return (
        f"the sd is on its lower limit {number(sd['estimate'])}{unit}, its 95 % interval goes up "
        f"to {number(interval[1], 2)}{unit}"
    )


def _half(ends: Sequence[float | None] | None) -> float | None:
    """Half of the width of an interval; None where it is not known."""
    known = [end for end in ends or () if end is not None and math.isfinite(end)]
    return 0.5 * (known[1] - known[0]) if len(known) == 2 else None


def _sure(reach: Sequence[float | None], unit: str) -> str:
    if any(own is None for own in reach):
        return "how sure the ends are is not known"
    if not any(reach):
        return "this law is given"
    low, high = (with_error(own, own)[0] for own in reach if own is not None)
    if low == high:
        return f"each end known to +- {low}{unit}"
    return f"ends known to +- {low} and {high}{unit}"


def _constants(document: Document) -> Iterator[Sentence]:
    for name, entry in document["alpha"].items():
        found = CONSTANT.match(name)
        if found and not entry.get("fixed"):
            value = f"{found['of']} {_estimate(entry, _unit(document, name))}"
            yield _found("Every experiment", value)


def _noise(document: Document) -> Iterator[Sentence]:
    responses = transforms(document)
    for name, entry in document["alpha"].items():
        found = NOISE.match(name)
        if not found or entry.get("fixed"):
            continue
        of = found["of"] or next(iter(responses), "")
        seen = f"log({of})" if responses.get(of) == "log" else of
        whose = f" of {seen}" if found["of"] or seen != of else ""
        what = "sd" if found["what"] == "sd" else "relative sd"
        yield _found(
            f"Measurement noise{whose}", f"{what} {_estimate(entry, _unit(document, name))}"
        )


def _estimate(entry: Document, unit: str) -> str:
    """An estimate with its unit and its 95 % interval."""
    error = entry.get("standard_error")
    value, _ = with_error(entry["estimate"], error, estimate=True)
    interval = entry.get("interval")
    if interval is None:
        bound = entry.get("at_bound")
        why = f"at its {bound} bound: " if bound else ""
        return f"{value}{unit} ({why}how sure it is is not known)"
    ends = between(interval, error).replace(" .. ", " to ")
    return f"{value}{unit} (95 % interval {ends}{unit})"


# ------------------------------------------------------------------------------- a new experiment


def _new(document: Document) -> Iterator[Sentence]:
    """The 95 % range of each outcome under the conditions of the last row, by the law."""
    said: dict[str, list[str]] = {}
    for name, log, quantiles, at in _last_rows(document):
        ends = [quantiles.get(p) for p in ("0.025", "0.975")]
        known = [math.exp(min(end, 700.0)) if log else end for end in ends if end is not None]
        if len(known) == 2:
            low, high = (number(end, 3) for end in known)
            said.setdefault(at, []).append(f"{name} {low} to {high}{_unit(document, name)}")
    for at, outcomes in said.items():
        share = "(95 %)" if len(outcomes) == 1 else "(95 % each)"
        yield _found(f"A new experiment like the last row{at}", f"{', '.join(outcomes)} {share}")


def _last_rows(document: Document) -> Iterator[tuple[str, bool, Document, str]]:
    """The last row of each outcome: name, whether logarithms, quantiles, conditions in words."""
    entries, seen = document["experiments"], document.get("observations") or ()
    if entries and not seen:
        name, log = str(document.get("outcome") or "outcome"), document.get("transform") == "log"
        yield name, log, entries[-1].get("quantiles") or {}, _at(document, entries[-1]["id"], {})
    predicted = (document.get("pictures") or {}).get("predicted") or {}
    for name, transform in transforms(document).items() if seen else ():
        rows = [k for k, entry in enumerate(seen) if entry["response"] == name]
        if not rows:
            continue
        last = max(rows, key=lambda k: seen[k]["row"])
        quantiles = {p: column[last] for p, column in predicted.items() if len(column) == len(seen)}
        at = _at(document, seen[last]["id"], seen[last]["conditions"])
        yield name, transform == "log", quantiles, at


def _at(document: Document, id: object, varying: Document, amounts: Amounts = AMOUNTS) -> str:
    """The conditions of an experiment in words, in parentheses; empty if they are many or none."""
    entries = document["experiments"]
    place = next((k for k, entry in enumerate(entries) if str(entry["id"]) == str(id)), None)
    columns = (document.get("pictures") or {}).get("conditions") or {}
    own = {
        name: column[place]
        for name, column in columns.items()
        if place is not None and len(column) == len(entries) and name not in varying
    }
    named = named_values(document, own | dict(varying))
    return f" ({', '.join(named)})" if 0 < len(named) <= amounts.named_conditions else ""


def named_values(document: Document, values: Document) -> list[str]:
    """Values of conditions in words, each with its name and unit."""
    return [
        f"{name} {number(v) if isinstance(v, int | float) else v}{_unit(document, name)}"
        for name, v in values.items()
        if v is not None
    ]


def _unit(document: Document, name: str) -> str:
    unit = units(document).get(name) or unit_of(document, name)
    return f" {unit}" if unit else ""


def _found(head: str, said: str) -> Sentence:
    return Sentence(f"{said}.", "finding", head)
