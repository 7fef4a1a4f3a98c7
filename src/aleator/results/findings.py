"""The answer of an identification in sentences: where each parameter lies, and how sure that is.

Every report begins with these sentences: print, notebook, terminal and page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aleator.errors import count
from aleator.results.printed import (
    AMOUNTS,
    NONE,
    THRESHOLDS,
    Amounts,
    Sentence,
    Thresholds,
    between,
    chance,
    listed,
    number,
    percent,
    with_error,
)
from aleator.results.units import transforms, unit_of, units
from aleator.results.values import OutcomeAnswer, typed

Document = Mapping[str, Any]
CONSTANT = re.compile(r"^(?P<of>[^.]+)\.value$")
QUANTILES = ("0.025", "0.5", "0.975")
NOISE = re.compile(r"^noise\.(?:(?P<of>.+)\.)?(?P<what>sd|relative)$")


def findings(document: Document) -> tuple[Sentence, ...]:
    """The sentences that a decision needs, in the order of the parameters.

    There is one for the 95 % range of each parameter that scatters, one for the answer to each
    question of the study, one for each identified constant, one for what was held fixed, one for
    each identified standard deviation of the measurement noise, and one for the outcome of a new
    experiment: under each distinct condition of the table if these are at most five, else under the
    middle one. How sure an end is: half of the
    width of its 95 % interval (see `LawRange`). Where the interval of a hyperparameter of the law
    runs to its limit, the data do not determine the range; the outer ends of these intervals take
    its place, and the reason is told. What a document lacks is left out. An answer that is not
    computed soundly begins with that, and none of its numbers is told with an interval.

    >>> one = {"lower": 0.1012, "upper": 0.1788, "lower_interval": [0.093, 0.109],
    ...        "upper_interval": [0.17, 0.188]}
    >>> print(*findings({"alpha": {}, "experiments": [], "ranges": {"friction": one}}))
    95 % of experiments: friction 0.1012 to 0.1788 (ends +- 0.0080 and 0.0090, 95 % confidence).
    >>> unsound = {"sound": False, "alpha": {}, "experiments": [], "ranges": {"friction": one}}
    >>> print(*findings(unsound), sep="\\n")
    Not computed soundly: the numbers below may be wrong.
    95 % of experiments: friction 0.1012 to 0.1788.
    """
    doubt = Sentence("the numbers below may be wrong.", "bad", "Not computed soundly")
    return (
        *(() if _sound(document) else (doubt,)), *_laws(document), *answers_to_questions(document),
        *_constants(document), *_held(document), *_noise(document), *_new(document),
    )  # fmt: skip


def _sound(document: Document) -> bool:
    return document.get("sound", True) is not False


# ------------------------------------------------------------------------------- parameters


def _laws(document: Document) -> Iterator[Sentence]:
    for name, entry in (document.get("ranges") or {}).items():
        level = entry.get("level")
        whose = f"the groups by {level}" if level else "experiments"
        at = named_values(document, entry.get("at") or {})
        for factor, ends in (entry.get("by_level") or {}).items():
            with_ = ", ".join([f"{entry['factor']} {factor}", *at])
            group = (str(entry["factor"]), str(factor))
            yield _law(document, name, f"{whose} with {with_}", ends, group)
        if not entry.get("by_level"):
            like = " like those of the table" if entry.get("follows") else ""
            yield _law(document, name, f"{whose}{like}", entry)


def _law(
    document: Document,
    name: str,
    whose: str,
    entry: Document,
    group: tuple[str, str] | None = None,
) -> Sentence:
    head, unit = f"{percent(0.95)} of {whose}", _unit(document, name)
    reach = [_half(entry.get(f"{end}_interval")) for end in ("lower", "upper")]
    ends, told, sure = [entry["lower"], entry["upper"]], "{} to {}", _sure(reach, unit)
    open_ends = [*_undetermined(document, name, unit, group)] if _sound(document) else []
    if open_ends and None not in reach:
        ends = [entry["lower_interval"][0], entry["upper_interval"][1]]
        told, sure = "somewhere between {} and {}", "; ".join(open_ends)
    low, high = (
        with_error(end, own, estimate=True)[0] for end, own in zip(ends, reach, strict=True)
    )
    how = f" ({sure})" if _sound(document) else ""
    return _found(head, f"{name} {told.format(low, high)}{unit}{how}")


def _undetermined(
    document: Document, name: str, unit: str, group: tuple[str, str] | None
) -> Iterator[str]:
    """What the data do not tell of a parameter's law: its intervals that run to a limit.

    Of the law of a `group`, a column and its entry, those coefficients count that belong to it.
    """
    for key, entry in document["alpha"].items():
        interval, limit = entry.get("interval"), entry.get("at_bound") or entry.get("cut")
        if not key.startswith(f"{name}.") or not limit or interval is None or None in interval:
            continue
        if group is not None and _of_another(key, *group):
            continue
        low, high = (f"{number(end, 3)}{unit}" for end in interval)
        if key == f"{name}.sd" and limit in ("lower", "both"):
            most = f"{high}, its upper limit" if limit == "both" else high
            yield _scatter(document, name, low, most)
        else:
            which = "from limit to limit" if limit == "both" else f"to its {limit} limit"
            yield f"the 95 % interval of {key}, {low} to {high}, runs {which}"


def _of_another(key: str, column: str, entry: str) -> bool:
    """Whether a coefficient belongs to another entry of the column: its derivative is zero."""
    terms = key.partition("[")[2].removesuffix("]").split(":")
    return any(term.startswith(f"{column}=") and term != f"{column}={entry}" for term in terms)


def _scatter(document: Document, name: str, low: str, most: str) -> str:
    """What is told of an sd whose interval runs to its lower limit.

    That the data show no scatter is told only where the estimate is the limit and no other sd may
    be zero too: else the scatter of the other may stand for that of this one.
    """
    alpha, own = document["alpha"], f"{name}.sd"
    others = [
        key.removesuffix(".sd")
        for key, entry in alpha.items()
        if key.endswith(".sd") and not NOISE.match(key) and key != own
        and {"lower", "both"} & {entry.get("at_bound"), entry.get("cut")}
    ]  # fmt: skip
    if alpha[own].get("at_bound") != "lower":
        said = f"the sd of {name} may be its lower limit, {low}, or up to {most}"
    elif others:
        said = f"the estimate of the sd of {name} is its lower limit, {low}; it may be up to {most}"
    else:
        return (
            f"these data show no scatter of {name} beyond the lower limit of its sd, {low}; "
            f"its sd may be up to {most}"
        )
    if instead := [other for other in others if _either(document, own, f"{other}.sd")]:
        which = ", ".join([name, *instead])
        said += f"; at least one of {which} scatters, and these data do not tell which"
    return said


def _either(document: Document, one: str, other: str) -> bool:
    table = document.get("correlation") or {}
    names = list(table.get("names") or ())
    if one not in names or other not in names:
        return False
    entries = [document["alpha"][key] for key in (one, other)]
    if not all(entry.get("standard_error") for entry in entries):
        return False
    z = [entry["estimate"] / entry["standard_error"] for entry in entries]
    correlation = table["matrix"][names.index(one)][names.index(other)]
    return correlation is not None and replace_each_other(z[0], z[1], correlation)


def replace_each_other(a: float, b: float, correlation: float) -> bool:
    """Whether one of two sds takes the place of the other: at least one is not zero.

    `a` and `b` are the estimates in standard errors. Wald's statistic that both are zero,
    (a^2 + b^2 - 2 r a b) / (1 - r^2) with the correlation r of the estimates, lies above the
    quantile of 95 % of chi-square with two degrees of freedom, -2 log 0.05, only because of r.

    >>> replace_each_other(1.2, 1.1, -0.93), replace_each_other(1.2, 1.1, 0.0)
    (True, False)
    """
    if not -1.0 < correlation < 0.0:
        return False
    apart = a * a + b * b
    together = (apart - 2.0 * correlation * a * b) / (1.0 - correlation**2)
    return bool(apart <= -2.0 * math.log(0.05) < together)


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
        return f"each end +- {low}{unit}, {percent(0.95)} confidence"
    return f"ends +- {low} and {high}{unit}, {percent(0.95)} confidence"


def _constants(document: Document) -> Iterator[Sentence]:
    for name, entry in document["alpha"].items():
        found = CONSTANT.match(name)
        if found and not entry.get("fixed"):
            value = f"{found['of']} {_estimate(document, name)}"
            yield _found("Every experiment", value)


def _held(document: Document) -> Iterator[Sentence]:
    """The constants of the study that have a number, and the arguments left at their defaults."""
    held = {
        found["of"]: entry["estimate"]
        for name, entry in document["alpha"].items()
        if entry.get("fixed") and (found := CONSTANT.match(name))
    }
    held |= (document.get("simulator") or {}).get("defaults") or {}
    if held:
        named = ", ".join(named_values(document, held))
        yield _found("Taken as known and equal in every experiment", named)


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
        yield _found(f"Measurement noise{whose}", f"{what} {_estimate(document, name)}")


def _estimate(document: Document, name: str) -> str:
    """An estimate with its unit and, in a sound answer, its 95 % interval."""
    entry, unit = document["alpha"][name], _unit(document, name)
    error = entry.get("standard_error")
    value, _ = with_error(entry["estimate"], error, estimate=True)
    interval = entry.get("interval")
    if not _sound(document):
        return f"{value}{unit}"
    if interval is None:
        bound = entry.get("at_bound")
        why = f"at its {bound} bound: " if bound else ""
        return f"{value}{unit} ({why}how sure it is is not known)"
    ends = between(interval, error).replace(" .. ", " to ")
    limits = {
        "lower": ", from its lower limit", "upper": ", to its upper limit",
        "both": ", from limit to limit",
    }  # fmt: skip
    limit = limits.get(entry.get("cut") or "", "")
    return f"{value}{unit} (95 % interval {ends}{unit}{limit})"


# ------------------------------------------------------------------------------- questions

VERBS = {">": "exceeds", ">=": "is at least", "<": "is below", "<=": "is at most"}
"""How a sentence says that an outcome compares with a number."""
CAUTIONS = {
    "unsettled": "more runs of the simulator may change this",
    "runs_failed": "runs of the simulator fail there",
    "poor_draws": "laws that the experiments leave plausible are not drawn well, so that this may "
    "be wrong",
    "never": "no parameters within 6.5 standard deviations of the law lead there",
    "always": "all parameters within 6.5 standard deviations of the law lead there",
}
"""What a sentence adds to an answer by its status."""


def answers_to_questions(document: Document) -> Iterator[Sentence]:
    """A sentence for each answer to a question: under which conditions, and what was answered."""
    for entry in document.get("answers") or ():
        answer: OutcomeAnswer = typed(OutcomeAnswer, entry)
        of, unit = answer.outcome, _unit(document, answer.outcome)
        at = named_values(document, answer.at)
        beyond = f"beyond the tested conditions: {answer.beyond}" if answer.beyond else ""
        whose = f"the {'measured' if answer.noise else 'true'} {of}"
        measured = document.get("quadrature") and of in transforms(document)
        whose = whose if measured else of
        if answer.reason:
            asked = answer.event or f"limits that hold {percent(answer.content)} of {of}"
            told = [f"no answer to '{asked}', because {answer.reason}"]
        elif answer.event is None:
            told = [_limits(answer, whose, unit, sound=_sound(document))]
        else:
            # A constant, or the parameter of a group, is no experiment's own.
            law = (document.get("ranges") or {}).get(of)
            own = of in transforms(document) or (law is not None and law.get("level") is None)
            share = _share(answer, shared=not own, sound=_sound(document))
            told = [f"{_event(answer, answer.event, whose, unit)} {share}"]
        if not answer.reason:
            told += [_measured(answer), CAUTIONS.get(answer.status, ""), beyond]
        yield _found(
            f"At {listed(at)}" if at else "A new experiment", "; ".join(filter(None, told))
        )


def _measured(answer: OutcomeAnswer) -> str:
    """How many of the values measured under the conditions are as the answer says."""
    seen = answer.measured
    if seen is None:
        return ""
    there = " under these conditions" if answer.at else ""
    left = f", and bounds leave {seen.open} of them open" if seen.open else ""
    return f"it did in {seen.inside} of {count(seen.values, 'value')} measured{there}{left}"


def _event(answer: OutcomeAnswer, event: str, whose: str, unit: str) -> str:
    """An event in words: an outcome, and the number or the two numbers that it is compared with."""
    sign, _, value = event.removeprefix(f"{answer.outcome} ").partition(" ")
    if sign in VERBS:
        return f"{whose} {VERBS[sign]} {value}{unit}"
    return f"{whose} lies between {event.partition(' ')[0]} and {event.rpartition(' ')[2]}{unit}"


def _share(
    answer: OutcomeAnswer, *, shared: bool, sound: bool, thresholds: Thresholds = THRESHOLDS
) -> str:
    """How frequent an event is: a share of experiments, or a probability.

    It is a probability where the event is rare, and where experiments have its parameter `shared`.
    With an interval it is the mean over the plausible laws, not the value at the estimate.
    """
    value, ends = answer.probability, (answer.lower, answer.upper)
    if value is None:
        return "with a probability that is not known"
    rare = min(value, 1.0 - value) < thresholds.rare
    as_share = not rare and not shared
    low, high = (
        NONE if end is None else _percent(end) if as_share else chance(end) for end in ends
    )
    sure = f" (mean over the plausible laws; 95 % interval {low.removesuffix(' %')} to {high})"
    told = (
        f"in {_percent(value)} of experiments" if as_share else f"with probability {chance(value)}"
    )
    return f"{told}{sure}" if sound and None not in ends and ends != (value, value) else told


def _percent(share: float) -> str:
    """A share in percent, with more digits near 0 and 1."""
    least = min(share, 1.0 - share)
    return percent(share, 0 if least >= 0.1 or least <= 0.0 else 1 if least >= 0.01 else 2)


def _limits(answer: OutcomeAnswer, whose: str, unit: str, *, sound: bool) -> str:
    """Tolerance limits in words."""
    low, high = number(answer.lower, 3), number(answer.upper, 3)
    one_side = {"upper": f"below {high}{unit}", "lower": f"above {low}{unit}"}
    where = one_side.get(answer.side, f"between {low} and {high}{unit}")
    sure = f" ({percent(answer.confidence)} confidence)" if sound else ""
    return f"{whose} of {percent(answer.content)} of experiments lies {where}{sure}"


# ------------------------------------------------------------------------------- a new experiment


@dataclass(frozen=True)
class _Row:
    """A measured value: its experiment, its conditions, the 95 % range and median of such values.

    The three numbers are in the unit of the outcome.
    """

    id: str
    at: Document
    low: float
    middle: float
    high: float

    @property
    def ends(self) -> tuple[str, str]:
        """The ends of the range as text."""
        return number(self.low, 3), number(self.high, 3)


def _new(document: Document, amounts: Amounts = AMOUNTS) -> Iterator[Sentence]:
    """The 95 % range of each outcome by the law, under the distinct conditions or the middle one.

    Conditions are distinct if their ranges, as they are told, are distinct.
    """
    under: dict[str, list[str]] = {}
    for name, rows in _rows(document).items():
        columns = {column for row in rows for column in row.at}
        varies = {c for c in columns if len({row.at.get(c) for row in rows}) > 1}
        alike: dict[tuple[str, str], list[_Row]] = {}
        for row in sorted(rows, key=lambda row: row.middle):
            alike.setdefault(row.ends, []).append(row)
        places = [(" to ".join(ends), _place(document, own, varies)) for ends, own in alike.items()]
        unit = _unit(document, name)
        if len(places) > 1 and all(at for _, at in places) and len(places) <= amounts.new:
            each = "; ".join(f"{ends}{unit} at {at}" for ends, at in places)
            yield _found("A new experiment", f"{name} {each} ({percent(0.95)} each)")
        elif places:
            ends, at = places[len(places) // 2]
            own = [*alike.values()][len(places) // 2]
            which = f" at {at}" if at else f" like experiment {own[0].id}"
            under.setdefault(which if len(places) > 1 else "", []).append(f"{name} {ends}{unit}")
    for which, outcomes in under.items():
        share = f"({percent(0.95)})" if len(outcomes) == 1 else f"({percent(0.95)} each)"
        yield _found(f"A new experiment{which}", f"{', '.join(outcomes)} {share}")


def _place(
    document: Document, rows: Sequence[_Row], varies: Container[str], amounts: Amounts = AMOUNTS
) -> str:
    """The conditions that rows share, of those that vary in the table; empty if many or none."""
    first = rows[0].at
    shared = {
        name: value
        for name, value in first.items()
        if name in varies and all(row.at.get(name) == value for row in rows)
    }
    named = named_values(document, shared)
    return ", ".join(named) if len(named) <= amounts.named_conditions else ""


def _rows(document: Document) -> dict[str, list[_Row]]:
    """The rows of each outcome whose 95 % range is known, by the name of the outcome."""
    entries, seen = document["experiments"], document.get("observations") or ()
    pictures = document.get("pictures") or {}
    columns = {
        name: column
        for name, column in (pictures.get("conditions") or {}).items()
        if len(column) == len(entries)
    }
    at = {
        str(entry["id"]): {name: column[k] for name, column in columns.items()}
        for k, entry in enumerate(entries)
    }
    found: dict[str, list[_Row]] = {}
    if not seen:
        name, log = str(document.get("outcome") or "outcome"), document.get("transform") == "log"
        for entry in entries:
            quantiles = [(entry.get("quantiles") or {}).get(p) for p in QUANTILES]
            _add(found, name, log, quantiles, str(entry["id"]), at[str(entry["id"])])
    predicted = pictures.get("predicted") or {}
    known, of = [predicted.get(p) or () for p in QUANTILES], transforms(document)
    for k, entry in enumerate(seen if all(len(q) == len(seen) for q in known) else ()):
        name, id = entry["response"], str(entry["id"])
        own = at.get(id, {}) | entry["conditions"]
        _add(found, name, of.get(name) == "log", [q[k] for q in known], id, own)
    return found


def _add(
    found: dict[str, list[_Row]],
    name: str,
    log: bool,
    quantiles: Sequence[float | None],
    id: str,
    at: Document,
) -> None:
    known = [math.exp(min(q, 700.0)) if log else q for q in quantiles if q is not None]
    if len(known) == len(QUANTILES):
        found.setdefault(name, []).append(_Row(id, at, *known))


def _is_number(value: object) -> bool:
    """Whether a value is written as a number; a yes or no is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def named_values(document: Document, values: Document) -> list[str]:
    """Values of conditions in words, each with its name and unit.

    >>> named_values({}, {"load": 2.0, "wet": True, "oil": "a"})
    ['load 2', 'wet True', 'oil a']
    """
    return [
        f"{name} {number(v) if _is_number(v) else v}{_unit(document, name)}"
        for name, v in values.items()
        if v is not None
    ]


def _unit(document: Document, name: str) -> str:
    unit = units(document).get(name) or unit_of(document, name)
    return f" {unit}" if unit else ""


def _found(head: str, said: str) -> Sentence:
    return Sentence(f"{said}.", "finding", head)
