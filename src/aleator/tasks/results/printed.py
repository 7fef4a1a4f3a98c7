"""An identification as a few lines of text, and as HTML for a notebook: both from its document."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from scipy.stats import binom

from aleator.tasks.results.layout import WIDTH, Column, laid_out
from aleator.tasks.results.units import label

Document = Mapping[str, Any]
NONE = "-"
COLUMNS: Sequence[Column] = (
    ("alpha", "left"), ("estimate", "right"), ("std. error", "right"), ("95 % interval", "right"),
    ("note", "fold"),
)  # fmt: skip


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits, "-" for none.

    >>> number(0.91234), number(None), number(123456.0), number(1.5e-7)
    ('0.9123', '-', '123456', '1.5e-07')
    """
    if value is None:
        return NONE
    if value and (abs(value) >= 10.0**digits) and abs(value) < 1e7:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def with_error(value: float, error: float | None, *, estimate: bool = False) -> tuple[str, str]:
    """A value and its standard error, both to the second digit of the error.

    An `estimate` keeps two digits of its own where the error is larger than itself.

    >>> with_error(0.912345, 0.01234), with_error(-9.37012, 0.2149), with_error(2.0, None)
    (('0.912', '0.012'), ('-9.37', '0.21'), ('2', '-'))
    """
    if error is None or not error > 0 or not 1e-4 < abs(value) + error < 1e6:
        return number(value), number(error, 2)
    scale = min(error, abs(value) or error) if estimate else error
    decimals = min(max(1 - math.floor(math.log10(scale)), 0), 9)
    # Adding zero turns a -0.0 that rounding left into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}", f"{error:.{decimals}f}"


def outside(probabilities: Sequence[float]) -> str:
    """How many independent values lie outside their 95 %, and how many of a right model would.

    By their `probabilities` P(below), of which none is missing; the count is binomial.

    >>> outside([0.01, 0.5, 0.99, 0.6])
    '2 of 4 are, and 0 to 1 would be of a right model, in 95 % of all cases.'
    """
    count, found = len(probabilities), sum(abs(p - 0.5) > 0.475 for p in probabilities)
    fewest, most = binom.ppf([0.025, 0.975], count, 0.05).astype(int)
    return (
        f"{found} of {count:,} are, and {fewest} to {most} would be of a right model, in 95 % of "
        "all cases."
    )


def to_three(value: float | None) -> str:
    """A log-likelihood, "-" for none.

    >>> to_three(262.51234), to_three(None)
    ('262.512', '-')
    """
    return NONE if value is None else f"{value:.3f}"


def alpha_rows(document: Document) -> Iterator[tuple[str, str, str, str, str]]:
    """A row for each hyperparameter: name with unit, estimate, standard error, interval, note."""
    for name, entry in document["alpha"].items():
        error_of = entry.get("standard_error")
        estimate, error = with_error(entry["estimate"], error_of, estimate=True)
        interval = NONE
        if entry.get("interval") and None not in entry["interval"]:
            low, high = (with_error(e, error_of, estimate=True)[0] for e in entry["interval"])
            interval = f"{low} .. {high}"
        yield label(document, name), estimate, error, interval, _note(entry)


def _note(entry: Document) -> str:
    if entry.get("fixed"):
        return "fixed"
    if entry.get("at_bound"):
        return f"at its {entry['at_bound']} bound"
    notes = []
    error, sandwich = entry.get("standard_error"), entry.get("sandwich_error")
    if error and sandwich and not 0.7 < sandwich / error < 1.4:
        notes.append(f"sandwich error {number(sandwich, 2)}")
    if entry.get("cut"):
        notes.append(_to_limit(entry["cut"], entry.get("drops")))
    return ", ".join(notes)


def _to_limit(cut: str, drops: Sequence[float] | None) -> str:
    """Which ends of an interval are limits, and how far the profile has dropped there.

    >>> _to_limit("lower", (1.263, 1.92)), _to_limit("both", (0.5, 0.004))
    ('to its lower limit (drop 1.26)', 'from limit to limit (drops 0.50, 0.00)')
    """
    if cut == "both":
        told = f" (drops {drops[0]:.2f}, {drops[1]:.2f})" if drops else ""
        return f"from limit to limit{told}"
    return f"to its {cut} limit" + (f" (drop {drops[cut == 'upper']:.2f})" if drops else "")


def verdict(document: Document) -> str:
    """One sentence: whether the answer can be used, and why.

    >>> verdict({"sound": False, "warnings": [{"about": "search"}, {"about": "check"}]})
    'NOT computed soundly: do not use alpha before the warnings are dealt with (search, check).'
    """
    if document["sound"]:
        return f"Computed soundly: {_reasons(document)}."
    about = dict.fromkeys(str(entry["about"]) for entry in document.get("warnings") or [])
    named = f" ({', '.join(about)})" if about else ""
    return f"NOT computed soundly: do not use alpha before the warnings are dealt with{named}."


def second_verdict(document: Document) -> str:
    """One sentence: whether the model is consistent with the experiments, and what is not.

    Empty where the document does not say. A probability is that of all tests together.

    >>> second_verdict({"consistent": None, "consistency": {"reason": "there are only 4"}})
    'Not tested whether consistent with the experiments: there are only 4.'
    """
    found = document.get("consistency")
    if not found:
        return ""
    if document["consistent"] is None:
        return f"Not tested whether consistent with the experiments: {found['reason']}."
    if document["consistent"]:
        left = f"; {_columns(copies)} left out" if (copies := found.get("copies")) else ""
        return (
            f"Consistent with the experiments: none of {len(found['tests'])} tests contradicts the "
            f"model (p = {number(found['p'], 2)}){left}."
        )
    told = [
        f"{place}{row['message']} (p = {number(row['test']['corrected'], 1)})"
        for place, row in _counted("({}) ", found["discrepancies"])
    ]
    return f"NOT consistent with the experiments: {'; '.join(told)}."


def verdicts(document: Document) -> list[str]:
    """Both verdicts, a sentence each; the second where it is known."""
    return [line for line in (verdict(document), second_verdict(document)) if line]


def remedies(document: Document) -> list[str]:
    """What may mend a model that is not consistent, the outliers by name, what was left out."""
    found = document.get("consistency") or {}
    rows = [
        f"  Remedy{place}: {row['remedy']}."
        for place, row in _counted(" ({})", found.get("discrepancies", ()))
    ]
    outliers = [
        f"{row['id']}{_row_of(document, row)} (p = {number(row['p'], 1)})"
        for row in found.get("outliers", ())
    ]
    if outliers:
        rows += [f"  Outliers: {', '.join(outliers)}."]
    if copies := found.get("copies"):
        rows += [f"  Left out of the tests: {left_out(copies)}"]
    return rows


def left_out(copies: Sequence[str]) -> str:
    """Why columns had no say in the second verdict, and what to do if they should.

    >>> left_out(["travel_in"])[:41]
    '`travel_in`, which the outcome determines'
    """
    return (
        f"{_columns(copies)}, which the outcome determines, as in another unit, a rank, a class "
        "(pass or fail) or a ratio. If it is a condition of the tests, let the simulator or a law "
        "take it."
    )


def _columns(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _counted(form: str, rows: Sequence[Document]) -> Iterator[tuple[str, Document]]:
    """Rows with a number before each; one alone needs none."""
    for place, row in enumerate(rows, start=1):
        yield form.format(place) if len(rows) > 1 else "", row


def _row_of(document: Document, outlier: Document) -> str:
    return f", row {outlier['row']}" if document.get("observations") else ""


def _reasons(document: Document) -> str:
    if not document.get("observations"):
        return f"the search converged, every density was solved{_checked(document)}"
    what = "the search converged, and more nodes do not change the answer"
    return f"{what}{_checked(document)}"


def _checked(document: Document) -> str:
    found = document["log_likelihood"]
    if part := found.get("reached"):
        count = len(document["experiments"])
        return (
            f", and the simulator itself agrees for {part['experiments']} of {count} experiments; "
            "the others lie too far out to be verified"
        )
    if document["propagation"] == "direct":
        return "; the simulator itself was integrated over"
    agrees = found.get("verified") is not None
    return ", and the simulator itself agrees" if agrees else "; not verified on the simulator"


def text(document: Document) -> str:
    """The answer in short: alpha, log-likelihood, warnings, verdict."""
    head, body = laid_out(COLUMNS, [*alpha_rows(document)])
    sentences = [log_likelihood(document)]
    for warning in document["warnings"]:
        sentences += [f"Warning, {warning['about']}: {warning['message']}"]
        sentences += [f"  Remedy: {warning['remedy']}"] if warning["remedy"] else []
    ending = (*sentences, *verdicts(document), *remedies(document))
    folded = [textwrap.fill(line, WIDTH) for line in ending]
    return "\n".join([textwrap.fill(_head(document), WIDTH), *head, *body, *folded])


def html(document: Document) -> str:
    """The same for a notebook."""
    head = "".join(f"<th>{escape(name)}</th>" for name, _ in COLUMNS)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in alpha_rows(document)
    )
    warnings = "".join(
        f"<p><b>Warning, {escape(w['about'])}:</b> {escape(w['message'])}<br>"
        f"Remedy: {escape(w['remedy'])}</p>"
        for w in document["warnings"]
    )
    return (
        f"<p>{escape(_head(document))}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"<p>{escape(log_likelihood(document))}</p>{warnings}"
        + "".join(f"<p><b>{escape(line)}</b></p>" for line in verdicts(document))
        + "".join(f"<p>{escape(line)}</p>" for line in remedies(document))
    )


def _head(document: Document) -> str:
    free = sum(not entry["fixed"] for entry in document["alpha"].values())
    seen = document.get("observations")
    values = f" with {len(seen):,} observations" if seen else ""
    return (
        f"{free} hyperparameters identified from {len(document['experiments'])} experiments"
        f"{values}, {document['runs']:,} runs of the simulator"
    )


def principle(document: Document) -> str:
    """By what alpha was found: the maximum of the likelihood, or with priors of the posterior."""
    prior = document["log_likelihood"].get("log_prior")
    return "by maximum likelihood" if prior is None else "by maximum a posteriori"


def stated_error(likelihood: Mapping[str, Any]) -> str:
    """The error of a log-likelihood behind it, where it is known."""
    error = likelihood.get("error")
    return "" if error is None else f" +- {number(error, 2)}"


def by_name(document: Document) -> str:
    """What made the log-likelihood and those of the experiments, which sum to it.

    >>> by_name({"density": "level sets"}), by_name({})
    ('by level sets', '')
    """
    name = document.get("density")
    return f"by {name}" if name else ""


def log_likelihood(document: Document) -> str:
    """The log-likelihood, by what, with the log prior and what the check says: a sentence."""
    found = document["log_likelihood"]
    value = f"{to_three(found['estimated'])}{stated_error(found)}"
    line = f"log-likelihood {value} {by_name(document)}".rstrip()
    if (prior := found.get("log_prior")) is not None:
        line += f", log prior {to_three(prior)} (maximum a posteriori)"
    if found.get("verified") is None:
        return line
    error = number(found.get("verified_standard_error"), 2)
    return f"{line}; on the simulator itself {to_three(found['verified'])} +- {error}"
